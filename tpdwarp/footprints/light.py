"""The irradiance that footprints add up to: fine ones at every query, wide and faint ones by rasters."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.background import SplitLight, split_light
from tpdwarp.footprints.bounds import MOST_PIECES
from tpdwarp.footprints.footprint_map import FootprintMap, Footprints, shape_footprints
from tpdwarp.footprints.gather import gathered, irradiance_of
from tpdwarp.footprints.irradiance import Irradiance, Lookup, QueryArrays, rows_of, scattered
from tpdwarp.footprints.rasters import Rasters
from tpdwarp.footprints.receiver_edges import with_images
from tpdwarp.footprints.runs import LARGEST_DEVIATION, LARGEST_RUN
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.footprints.time_slots import slots_of, worth_trees
from tpdwarp.footprints.ways import WayPieces, piece_counts, rows_at
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.footprints.wide import WideFootprints, wide_footprints
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.bends import within_reach
from tpdwarp.trajectories.brightening import follow_lights
from tpdwarp.trajectories.flux_pieces import follow_flux

# Footprints whose sizes lie within so many octaves are looked up together. Chosen: on the blob of
# scripts/benchmarks/solids.py, 256 pixels wide, it takes half of what all of them at once take.
OCTAVES = 2
# Footprints of a size are looked up with those of the next one where they are fewer than this part of all: queries take
# as long to walk through a tree of a few as through one of many. Chosen by measurement.
SMALLEST_PART = 1.0 / 16.0


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
        maps = [part for photons in with_images(maps) for part in follow_lights(within_reach(photons))]
        maps = [piece for photons in maps for piece in follow_flux(photons)]
        # Kernels of the paper are evaluated as it says.
        split = split_light(maps, smoothing, pixel, launcher) if form.smooth else SplitLight(maps)

        def shaped(photons: list[PhotonMap], size: PixelSize) -> Footprints:
            return shape_footprints(photons, form.kernel, smoothing, size, moves, launcher)

        self._shaped = shaped(split.fine, pixel)
        faint = [
            (side, FootprintMap.of(shaped(photons, _square(side))))
            for side, photons in sorted(split.coarse.items())
        ]
        everything = (self._shaped, *(footprints.footprints for _, footprints in faint))
        self.clamped = sum(footprints.clamped for footprints in everything)
        self.growth_limited = sum(footprints.growth_limited for footprints in everything)
        self.count = sum(footprints.count for footprints in everything)

        # ---- By how they are looked up
        self._wide = WideFootprints(np.arange(self._shaped.count))
        if form.smooth:
            self._wide = wide_footprints(self._shaped, pixel, launcher)
        self._smooth = [
            Rasters(planes, levels, form, launcher)
            for planes, levels in ((split.planes, faint), (self._wide.planes, self._levels(self._wide.still)))
            if levels
        ]
        levels = self._levels(self._wide.moving)
        self._sweeping = [Rasters(self._wide.planes, levels, form, launcher)] if levels else []

    def _maps_of(self, rows: np.ndarray, most_pieces: int = MOST_PIECES) -> list[FootprintMap]:
        """Those of about a size together, for a walk through a tree serves queries as far apart as footprints are
        large."""
        extents = self._shaped.arrays.half_extent.numpy()[rows, :2].max(axis=1)
        sizes = np.floor(np.log2(np.maximum(extents, np.finfo(np.float32).tiny)) / OCTAVES)
        return [FootprintMap.of(self._shaped, rows[chosen], most_pieces) for chosen in _by_size(sizes)]

    def _levels(self, sides: dict[float, np.ndarray]) -> list[tuple[float, FootprintMap]]:
        return [(side, FootprintMap.of(self._shaped, rows)) for side, rows in sorted(sides.items())]

    @cached_property
    def _fine(self) -> list[FootprintMap]:
        """What queries look at that see the whole shutter."""
        return self._maps_of(self._wide.others, most_pieces=1)

    @cached_property
    def _all_that_moves(self) -> list[FootprintMap]:
        """What queries look at that move, or see part of the shutter: wide footprints too, unless they stand still."""
        rows = np.concatenate([self._wide.others, *self._wide.moving.values()])
        return self._maps_of(rows) or [FootprintMap.of(self._shaped, rows)]

    @property
    def longest_way(self) -> float:
        """How far a query may move within its window and be looked up at once: through a run, or anywhere."""
        return min(map(_longest_way, self._all_that_moves))

    def of_photons(self, maps: list[PhotonMap]) -> FootprintLight:
        """The light of other photons, evaluated as this one is."""
        return FootprintLight(maps, self._form, self._smoothing, self._pixel, self.moves, self._launcher)

    def irradiance(self, queries: QueryArrays, lookup: Lookup) -> Irradiance:
        """Irradiance at ``queries``, in pieces of their way where that is long."""
        whole = lookup.is_whole
        if whole:
            found = irradiance_of(gathered(self._fine, queries, self._form, self._launcher, lookup), lookup.with_motion)
        else:
            # By size: queries pass the finest of footprints in many pieces of their way, the others in few.
            first, *others = self._all_that_moves
            found = self._along_ways(first, queries, lookup)
            for footprints in others:
                found.add(self._along_ways(footprints, queries, lookup))
        rasters = [*self._smooth, *(self._sweeping if whole else ())]
        if rasters:
            sums = self._launcher.array(found.irradiance, wp.vec3)
            off = [smooth.add_to(queries, lookup, sums) for smooth in rasters]
            found.irradiance = sums.numpy()
            for smooth, rows in zip(rasters, off, strict=True):
                self._add_directly(smooth, queries, rows, lookup, found)
        return found

    def _along_ways(self, footprints: FootprintMap, queries: QueryArrays, lookup: Lookup) -> Irradiance:
        """What ``footprints`` add up to along the ways of queries, looked up piece by piece at once."""
        counts = piece_counts(queries, lookup, _longest_way(footprints))
        if counts.max(initial=1) == 1 and lookup.own_times is None:
            return self._gathered(footprints, queries, lookup, lookup.windows())
        pieces = WayPieces.of(queries, lookup, counts, footprints.run_size)
        if lookup.query_moves:
            times = lookup.windows()[:, 0]
            late = pieces.windows[:, 0] - (times if lookup.own_times is None else times[pieces.rows])
            at = rows_at(queries, pieces.rows, late, self._launcher)
        else:
            at = rows_of(queries, pieces.rows, self._launcher)
        more = self._gathered(footprints, at, lookup, pieces.windows)

        # ---- The mean along each way
        def mean(values: np.ndarray) -> np.ndarray:
            shares = (1.0 / counts).astype(np.float32).reshape(-1, *(1,) * (values.ndim - 1))
            return shares * np.add.reduceat(values[pieces.place], pieces.starts)

        found = Irradiance(mean(more.irradiance))
        if lookup.with_motion:
            found.motion, found.weight = mean(more.motion), mean(more.weight)
            # Those that overlap at a time, as for queries that stand.
            found.photons = np.maximum.reduceat(more.photons[pieces.place], pieces.starts)
        return found

    def _gathered(
        self, footprints: FootprintMap, queries: QueryArrays, lookup: Lookup, windows: np.ndarray
    ) -> Irradiance:
        """What ``footprints`` add up to at queries over their ``windows`` [n, 3] or [1, 3], slot by slot."""
        crowded = worth_trees(queries.position.shape[0], 2.0 * footprints.run_size)
        count, slots = slots_of(windows, footprints.most_slots if crowded else 1)
        parts = []
        for slot in np.unique(slots):
            rows = np.flatnonzero(slots == slot)
            everything = len(rows) == len(slots)
            at = queries if everything else rows_of(queries, rows, self._launcher)
            there = footprints.in_slot(int(slot), count)
            sums = gathered([there], at, self._form, self._launcher, lookup, windows[rows])
            part = irradiance_of(sums, lookup.with_motion)
            if everything:
                return part
            parts.append((rows, part))
        return scattered(parts)

    def _add_directly(
        self, smooth: Rasters, queries: QueryArrays, rows: np.ndarray, lookup: Lookup, found: Irradiance
    ) -> None:
        """Adds the light of rasters to the ``rows`` that lie on none, and its motion to all where that is wanted."""
        looked_at = np.arange(queries.position.shape[0]) if lookup.with_motion else rows
        if not len(looked_at):
            return
        some = rows_of(queries, looked_at, self._launcher)
        for footprints in smooth.levels:
            more = self._along_ways(footprints, some, lookup.of_rows(looked_at))
            more.irradiance = more.irradiance[np.searchsorted(looked_at, rows)]
            found.add(more, rows)


def _by_size(sizes: np.ndarray) -> list[np.ndarray]:
    """Rows of footprints of each size [n], the finest first; where these are few, together with those of the next."""
    found: list[np.ndarray] = []
    few = np.zeros(0, np.int64)
    for size in np.unique(sizes):
        few = np.concatenate([few, np.flatnonzero(sizes == size)])
        if len(few) >= SMALLEST_PART * len(sizes):
            found.append(few)
            few = few[:0]
    if len(few):
        found[-1:] = [np.concatenate([*found[-1:], few])]
    return found


def _longest_way(footprints: FootprintMap) -> float:
    """How far a query may move within its window and be looked up at once among ``footprints``."""
    return float(LARGEST_RUN) * footprints.run_size / (1.0 + float(LARGEST_DEVIATION)) if footprints.count else math.inf


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
