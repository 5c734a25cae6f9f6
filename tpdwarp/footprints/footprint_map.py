"""Footprints of all photons of a frame, shaped and ordered for look-up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bounds import Pieces, pieces_of
from tpdwarp.footprints.cell_parts import told_apart
from tpdwarp.footprints.courses import courses_of
from tpdwarp.footprints.light_images import axes_in_light, images_of
from tpdwarp.footprints.shaping import FootprintArrays, PixelSize, footprint_kernel
from tpdwarp.photons.photon_map import PhotonMap, joined


@dataclass
class Footprints:
    """Footprints of one or more (sub-)shutters.

    Attributes:
        arrays: Device arrays, one row a footprint.
        durations: Part of the shutter that each footprint's ``dxdt`` spans, shape [n].
        moves: Whether any footprint moves.
        curved: Whether any trajectory curves.
        shaded: Whether receivers are shaded by normals that are not those of their triangles.
        clamped: Footprints whose length or aspect was limited.
        growth_limited: Footprints whose axes grow too fast to be followed.
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

    @property
    def count(self) -> int:
        """Number of footprints."""
        return self.durations.shape[0]

    @cached_property
    def courses(self) -> wp.array:
        """The course of each, which only queries that move ask for."""
        return courses_of(self.arrays, self.durations, self.launcher)


@dataclass(frozen=True, eq=False)
class FootprintMap:
    """Some footprints with the BVH over their swept bounds.

    Attributes:
        footprints: All of them, which maps share.
        count: How many of them are in this map.
        pieces: The parts that ``bvh`` is built over; None where there are none.
        bvh: Bounds of the pieces, swept over their own part of the shutter; None where there are none.
        run_size: Half the typical size of a piece, in which queries are gathered together (:mod:`.runs`).
    """

    footprints: Footprints
    count: int
    pieces: Pieces | None
    bvh: wp.Bvh | None
    run_size: float

    @classmethod
    def of(cls, footprints: Footprints, rows: np.ndarray | None = None) -> FootprintMap:
        """Builds the BVH.

        Args:
            rows: Which footprints it holds, by index; None for all.
        """
        if rows is None:
            rows = np.arange(footprints.count, dtype=np.int32)
        if not len(rows):
            return cls(footprints, 0, None, None, 0.0)
        pieces = pieces_of(footprints.arrays, rows, footprints.launcher)
        # On the CPU it is built in half the time that the default takes, and walked through no slower.
        constructor = None if footprints.launcher.device.is_cuda else "cubql"
        bvh = wp.Bvh(pieces.lower, pieces.upper, constructor=constructor)
        return cls(footprints, len(rows), pieces, bvh, 0.5 * pieces.size)


def shape_footprints(
    maps: list[PhotonMap], kernel: str, smoothing: float, pixel: PixelSize, moves: bool, launcher: Launcher
) -> Footprints:
    """Shapes the footprints of all photons in ``maps``."""
    are_cells = np.zeros(len(maps), np.int32)
    if kernel == "bspline" and smoothing == 1.0:
        maps, are_cells = told_apart(maps, pixel, launcher)
    count = sum(len(photons) for photons in maps)
    curved = any(photons.trajectory is not None for photons in maps)
    if not count:
        arrays = launcher.rows(FootprintArrays, 0)
        none = launcher.zeros(0, wp.float32)
        return Footprints(arrays, none, moves, curved, False, 0, 0, launcher)

    def column(name: str) -> wp.array:
        return launcher.array(joined([getattr(photons, name) for photons in maps]), wp.vec3)

    def trajectory_column(name: str) -> wp.array:
        if not curved:
            return launcher.zeros(0, wp.vec3)
        return launcher.array(joined([_trajectory_column(photons, name) for photons in maps]), wp.vec3)

    # Columns that footprints share with photons are not copied: ten million of either fill memory.
    shared = {"center": "position", "normal": "normal", "dxdt": "dxdt"}
    others = ("receiver", "time", "acceleration", "jerk", "jacobian_rate", "gain", "incidence", "is_cell")
    splines = ("filter_width", "pixel")
    out = launcher.rows(FootprintArrays, count, but=(*shared, *others, *splines))
    for name, source in shared.items():
        setattr(out, name, column(source))
    bends = launcher.zeros(0, wp.vec3)
    if all(len(photons.bend) == len(photons) for photons in maps):
        # Footprints leave their photons, whose places stay.
        bends, out.center = column("bend"), wp.clone(out.center)
    out.acceleration, out.jerk = trajectory_column("dxdtt"), trajectory_column("dxdttt")
    out.jacobian_rate = launcher.zeros(count if curved else 0, wp.mat22)
    gains = [_trajectory_column(photons, "gain") for photons in maps] if curved else [np.zeros(0)]
    out.gain = launcher.array(joined(gains).astype(np.float32), wp.float32)
    for name, dtype in zip(splines, (wp.vec3, wp.mat22), strict=True):
        setattr(out, name, launcher.zeros(count if kernel == "bspline" else 0, dtype))
    out.is_cell = launcher.array(np.repeat(are_cells, [len(photons) for photons in maps]), wp.int32)
    shaded = all(len(m.incidence) == len(m) for m in maps)
    out.incidence = column("incidence") if shaded else launcher.zeros(0, wp.vec3)
    out.receiver = launcher.array(joined([m.receiver for m in maps]), wp.int32)
    out.time, durations = (
        launcher.array(np.concatenate([np.full(len(m), getattr(m, name), np.float32) for m in maps]), wp.float32)
        for name in ("time", "duration")
    )
    rates = [trajectory_column("dxdut"), trajectory_column("dxdvt")]
    columns = [column("dxdu"), column("dxdv"), *rates, column("receiver_motion"), column("flux"), bends]
    extended = all(len(m.image) == len(m) for m in maps)
    images = images_of(maps, kernel, launcher)
    radial = None if kernel == "bspline" else kernel
    shape = footprint_kernel(radial, curved, axes_in_light(radial) if extended else None)
    launcher(shape, count, [*columns, images, float(smoothing), pixel, out], in_turn=True)
    clamped, limited = (int(flags.numpy().sum(dtype=np.int64)) for flags in (out.clamped, out.growth_limited))
    return Footprints(out, durations, moves, curved, shaded, clamped, limited, launcher)


def _trajectory_column(photons: PhotonMap, name: str) -> np.ndarray:
    """A column of how trajectories curve, zero where they are straight."""
    if photons.trajectory is not None:
        return getattr(photons.trajectory, name)
    return np.zeros(len(photons), np.float32) if name == "gain" else np.zeros_like(photons.position)
