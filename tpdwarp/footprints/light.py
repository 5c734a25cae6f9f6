"""The irradiance that footprints add up to: fine ones at every query, those of the background by rasters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpdwarp.device import Launcher
from tpdwarp.footprints.background import SplitLight, split_light
from tpdwarp.footprints.footprint_map import FootprintMap, shape_footprints
from tpdwarp.footprints.gather import PLAIN_LOOKUP, gathered, irradiance_of
from tpdwarp.footprints.irradiance import Irradiance, IrradianceArrays, Lookup, QueryArrays, rows_of
from tpdwarp.footprints.rasters import Rasters
from tpdwarp.footprints.runs import LARGEST_DEVIATION
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.footprints.ways import piece_counts, piece_of, rows_at
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.bends import within_reach


class FootprintLight:
    """The light of the photons of one or more (sub-)shutters.

    Args:
        maps: The photons.
        form: How footprints are evaluated; whether lights have an extent is what the photons say.
        smoothing: Size of footprints in lattice cells.
        pixel: What a query stands for.
        moves: Whether any footprint moves.
        launcher: Where.

    Attributes:
        clamped: Footprints whose length or aspect was limited.
        growth_limited: Footprints whose axes grow too fast to be followed.
        count: Number of footprints.
        moves: As given.
    """

    def __init__(
        self,
        maps: list[PhotonMap],
        form: GatherForm,
        smoothing: float,
        pixel: PixelSize,
        moves: bool,
        launcher: Launcher,
    ) -> None:
        maps = _of_points(maps)
        form = replace(form, extended=any(len(photons.image) for photons in maps))
        self._form, self._launcher, self.moves = form, launcher, moves
        self._smoothing, self._pixel = smoothing, pixel
        maps = [within_reach(photons) for photons in maps]
        # Kernels of the paper are evaluated as it says.
        split = split_light(maps, smoothing, pixel, launcher) if form.smooth else SplitLight(maps)

        def shaped(photons: list[PhotonMap], size: PixelSize) -> FootprintMap:
            return shape_footprints(photons, form.kernel, smoothing, size, moves, launcher)

        self._fine = shaped(split.fine, pixel)
        self._background = [shaped(split.coarse[side], _square(side)) for side in sorted(split.coarse)]
        self._rasters = None
        if self._background:
            shaded = self._background[0].shaded
            self._rasters = Rasters(split.planes, sorted(split.coarse), shaded, self._at_corners, launcher)
        everything = (self._fine, *self._background)
        self.clamped = sum(footprints.clamped for footprints in everything)
        self.growth_limited = sum(footprints.growth_limited for footprints in everything)
        self.count = sum(footprints.count for footprints in everything)

    @property
    def longest_way(self) -> float:
        """How far a query may move within its window and be looked up at once: through a run."""
        sizes = [footprints.run_size for footprints in (self._fine, *self._background) if footprints.count]
        return min(sizes, default=0.0) / (1.0 + float(LARGEST_DEVIATION))

    def of_photons(self, maps: list[PhotonMap]) -> FootprintLight:
        """The light of other photons, evaluated as this one is."""
        return FootprintLight(maps, self._form, self._smoothing, self._pixel, self.moves, self._launcher)

    def irradiance(self, queries: QueryArrays, lookup: Lookup) -> Irradiance:
        """Irradiance at ``queries``, in pieces of their way where that is long."""
        counts = piece_counts(queries, lookup, self.longest_way)
        if counts.max(initial=1) == 1:
            return self._at_once(queries, lookup)
        found = Irradiance(np.zeros((len(counts), 3), np.float32))
        if lookup.with_motion:
            found.motion, found.weight = np.zeros((len(counts), 3), np.float32), np.zeros(len(counts), np.float32)
            found.photons = np.zeros(len(counts), np.int32)
        for count in np.unique(counts):
            rows = np.flatnonzero(counts == count)
            for number in range(count):
                piece = piece_of(lookup, number, count)
                there = rows_at(queries, rows, piece.time - lookup.time, self._launcher)
                more = self._at_once(there, piece)
                found.irradiance[rows] += more.irradiance / np.float32(count)
                if lookup.with_motion:
                    found.motion[rows] += more.motion / np.float32(count)
                    found.weight[rows] += more.weight / np.float32(count)
                    # Those that overlap at a time, as for queries that stand.
                    found.photons[rows] = np.maximum(found.photons[rows], more.photons)
        return found

    def _at_once(self, queries: QueryArrays, lookup: Lookup) -> Irradiance:
        sums = gathered(self._fine, queries, self._form, self._launcher, lookup)
        if self._rasters is None:
            return irradiance_of(sums, lookup.with_motion)
        off = self._rasters.add_to(queries, sums.irradiance)
        found = irradiance_of(sums, lookup.with_motion)
        self._add_directly(queries, off, lookup, found)
        return found

    def _add_directly(self, queries: QueryArrays, rows: np.ndarray, lookup: Lookup, found: Irradiance) -> None:
        """Adds background light to the ``rows`` that lie on no raster, and its motion to all where that is wanted."""
        looked_at = np.arange(queries.position.shape[0]) if lookup.with_motion else rows
        if not len(looked_at):
            return
        some = rows_of(queries, looked_at, self._launcher)
        for footprints in self._background:
            more = irradiance_of(gathered(footprints, some, self._form, self._launcher, lookup), lookup.with_motion)
            found.irradiance[rows] += more.irradiance[np.searchsorted(looked_at, rows)]
            if lookup.with_motion:
                found.motion += more.motion
                found.weight += more.weight
                found.photons += more.photons

    def _at_corners(self, level: int, corners: QueryArrays) -> np.ndarray:
        sums: IrradianceArrays = gathered(self._background[level], corners, self._form, self._launcher, PLAIN_LOOKUP)
        return sums.irradiance.numpy()


def _square(side: float) -> PixelSize:
    """A square of that side as what a query stands for."""
    size = PixelSize()
    size.base = side
    return size


def _of_points(maps: list[PhotonMap]) -> list[PhotonMap]:
    """The photons without images of their lights, where all of these are points."""
    if any(photons.dxda.any() or photons.dxdb.any() for photons in maps):
        return maps
    none, no_image = np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
    return [replace(photons, dxda=none, dxdb=none, image=no_image) for photons in maps]
