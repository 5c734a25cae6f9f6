"""Footprints of all photons of a frame, shaped and ordered for look-up."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bounds import MOST_PIECES, Pieces, Sweeps, pieces_of, whole_sweeps
from tpdwarp.footprints.cell_parts import told_apart
from tpdwarp.footprints.courses import courses_of
from tpdwarp.footprints.light_images import axes_in_light, images_of
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.footprints.reach import whole_reaches
from tpdwarp.footprints.shaping import FootprintArrays, Mirrors, PixelSize, footprint_kernel
from tpdwarp.footprints.time_slots import most_slots, sweeps_in
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.photons.photon_map import PhotonMap

# Pieces that a leaf of the tree holds: a tree of a million is built in half the time that it takes with one in each and
# looked up no slower. Chosen.
PIECES_OF_LEAF = 4


@dataclass
class Footprints:
    """Footprints of one or more (sub-)shutters.

    Attributes:
        arrays: Device arrays, one row a footprint.
        durations: Part of the shutter that each footprint's ``dxdt`` spans, shape [n].
        moves: Whether any footprint moves.
        curved: Whether any trajectory curves.
        shaded: Whether receivers are shaded by normals that are not those of their triangles.
        clamped: Footprints whose length or aspect was limited, without images of photons.
        growth_limited: Footprints whose axes grow too fast to be followed, likewise.
        launcher: The device.
    """

    arrays: FootprintArrays
    durations: wp.array
    moves: bool
    curved: bool
    shaded: bool
    clamped: int
    growth_limited: int
    launcher: Launcher
    _reaches: dict[GatherForm, wp.array] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of footprints."""
        return self.durations.shape[0]

    def reaches(self, form: GatherForm) -> wp.array:
        """How far each reaches over the whole shutter; found once."""
        if form not in self._reaches:
            given = self.arrays, self.durations, form, self.moves, self.curved, self.launcher
            self._reaches[form] = whole_reaches(*given)
        return self._reaches[form]

    @cached_property
    def courses(self) -> wp.array:
        """The course of each, which only queries that move ask for."""
        return courses_of(self.arrays, self.durations, self.launcher)


@dataclass(frozen=True, eq=False)
class FootprintMap:
    """Some footprints with the BVH over their swept bounds.

    Attributes:
        footprints: All of them, which maps share.
        rows: Those of them that are in this map, by index.
        pieces: The parts that ``bvh`` is built over; None where there are none.
        bvh: Bounds of the pieces, swept over their own part of the shutter; None where there are none.
        run_size: Half the typical size of a piece, in which queries are gathered together (:mod:`.runs`).
    """

    footprints: Footprints
    rows: np.ndarray
    pieces: Pieces | None
    bvh: wp.Bvh | None
    run_size: float
    _slots: dict[tuple[int, int], FootprintMap] = field(default_factory=dict)

    @classmethod
    def of(cls, footprints: Footprints, rows: np.ndarray | None = None, most_pieces: int = MOST_PIECES) -> FootprintMap:
        """Builds the BVH.

        Args:
            rows: Which footprints it holds, by index; None for all.
            most_pieces: Into how many pieces the longest are cut. Where queries see the whole shutter one is enough:
                they ask for the reach of what they find.
        """
        if rows is None:
            rows = np.arange(footprints.count, dtype=np.int32)
        return cls._over(footprints, rows, whole_sweeps(footprints.arrays), most_pieces)

    @classmethod
    def _over(cls, footprints: Footprints, rows: np.ndarray, sweeps: Sweeps, most_pieces: int) -> FootprintMap:
        if not len(rows):
            return cls(footprints, rows, None, None, 0.0)
        pieces = pieces_of(sweeps, rows, footprints.launcher, most_pieces)
        # On the CPU it is built in half the time that the default takes, and walked through no slower.
        constructor = None if footprints.launcher.device.is_cuda else "cubql"
        bvh = wp.Bvh(pieces.lower, pieces.upper, constructor=constructor, leaf_size=PIECES_OF_LEAF)
        return cls(footprints, rows, pieces, bvh, 0.5 * pieces.size)

    @property
    def count(self) -> int:
        """How many footprints are in this map."""
        return len(self.rows)

    @cached_property
    def most_slots(self) -> int:
        """Into how many slots of the shutter it is worth cutting, a power of two."""
        every = self.footprints
        return most_slots(every.arrays, every.courses, self.rows) if self.count else 1

    def in_slot(self, slot: int, count: int) -> FootprintMap:
        """The same footprints as far as they go in one of ``count`` slots of the shutter; built once."""
        if count == 1:
            return self
        if (slot, count) not in self._slots:
            every = self.footprints
            sweeps, rows = sweeps_in(every.arrays, every.courses, self.rows, slot, count, every.launcher)
            there = FootprintMap._over(every, rows, sweeps, MOST_PIECES)
            # Ways of queries are cut to the size of runs: were it smaller here, queries would see less of the shutter.
            self._slots[slot, count] = replace(there, run_size=self.run_size)
        return self._slots[slot, count]


def shape_footprints(
    maps: list[PhotonMap], kernel: str, smoothing: float, pixel: PixelSize, moves: bool, launcher: Launcher
) -> Footprints:
    """Shapes the footprints of all photons in ``maps``."""
    splines, cells = [PhotonRows(photons) for photons in maps if len(photons)], []
    if kernel == "bspline" and smoothing == 1.0:
        splines, cells = told_apart(maps, pixel, launcher)
    parts = [*splines, *cells]
    counts = [len(part) for part in parts]
    count = sum(counts)
    curved = any(part.photons.trajectory is not None for part in parts)
    if not count:
        arrays = launcher.rows(FootprintArrays, 0)
        none = launcher.zeros(0, wp.float32)
        return Footprints(arrays, none, moves, curved, False, 0, 0, launcher)

    def column(name: str, dtype: Any = wp.vec3, *, wanted: bool = True, own: bool = False) -> wp.array:
        """Of all photons; without rows where it is not ``wanted``."""
        return launcher.array(stacked(parts, name, own=own), dtype) if wanted else launcher.zeros(0, dtype)

    # Columns that footprints share with photons are not copied: ten million of either fill memory.
    shared = ("center", "normal", "dxdt", "acceleration", "jerk", "gain", "incidence", "receiver", "mirrors")
    out = launcher.rows(
        FootprintArrays, count, but=(*shared, "time", "jacobian_rate", "filter_width", "pixel", "is_cell")
    )
    is_bent = all(part.has("bend") for part in parts)
    shaded = all(part.has("incidence") for part in parts)
    # Footprints leave their photons, whose places and trajectories stay.
    out.center, out.normal, out.dxdt = column("position", own=is_bent), column("normal"), column("dxdt")
    out.acceleration, out.jerk = (column(name, wanted=curved, own=True) for name in ("dxdtt", "dxdttt"))
    out.gain, out.incidence = column("gain", wp.float32, wanted=curved), column("incidence", wanted=shaded)
    out.receiver = column("receiver", wp.int32)
    are_images = [part.has("mirrors") for part in parts]
    out.mirrors = column("mirrors", Mirrors, wanted=any(are_images))
    out.jacobian_rate = launcher.zeros(count if curved else 0, wp.mat22)
    for name, dtype in (("filter_width", wp.vec3), ("pixel", wp.mat22)):
        setattr(out, name, launcher.zeros(count if kernel == "bspline" else 0, dtype))
    out.is_cell = launcher.array(np.repeat(np.int32([0] * len(splines) + [1] * len(cells)), counts), wp.int32)
    out.time, durations = (
        launcher.array(np.repeat(np.float32([getattr(part.photons, name) for part in parts]), counts), wp.float32)
        for name in ("time", "duration")
    )
    rates = [column(name, wanted=curved) for name in ("dxdut", "dxdvt")]
    columns = [column("dxdu"), column("dxdv"), *rates, column("receiver_motion"), column("flux")]
    bends, images = column("bend", wanted=is_bent), images_of(parts, kernel, launcher)
    extended = all(part.has("image") for part in parts)
    radial = None if kernel == "bspline" else kernel
    shape = footprint_kernel(radial, curved, axes_in_light(radial) if extended else None)
    launcher(shape, count, [*columns, bends, images, float(smoothing), pixel, out], in_turn=True)
    of_photons = np.repeat(~np.array(are_images), counts)
    clamped, limited = (
        int(flags.numpy().sum(dtype=np.int64, where=of_photons)) for flags in (out.clamped, out.growth_limited)
    )
    return Footprints(out, durations, moves, curved, shaded, clamped, limited, launcher)
