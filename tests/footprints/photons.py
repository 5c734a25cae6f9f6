"""Photons and query points written down by hand, in the tracer's units."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.footprint_map import FootprintMap, shape_footprints
from tpdwarp.footprints.gather import gather
from tpdwarp.footprints.irradiance import Irradiance, Lookup, QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.photons.photon_map import PhotonMap, TrajectoryColumns

ONE_THREAD = Launcher("cpu", 1)
UP = (0.0, 0.0, 1.0)


def photon_map(
    positions, dxdu, dxdv, dxdt=(0, 0, 0), normals=UP, flux=1.0, receiver=0, receiver_motion=(0, 0, 0),
    time=0.0, duration=1.0, trajectory=None, gain=0.0, share=1.0,
) -> PhotonMap:  # fmt: skip
    """Photons at ``positions`` [n, 3]; every other argument is one value for all or one a photon.

    ``trajectory`` holds D_tt x, D_ttt x, D_t D_u x and D_t D_v x of trajectories that curve, along which flux grows by
    ``gain``.
    """
    count = len(positions)

    def rows(values, dtype=np.float32, width=3):
        values = np.asarray(values, dtype)
        return np.broadcast_to(values, (count, width) if width else (count,)).astype(dtype)

    whole = rows(0, np.int32, 0)
    return PhotonMap(
        ids=np.arange(count),
        position=rows(positions),
        normal=rows(normals),
        dxdu=rows(dxdu),
        dxdv=rows(dxdv),
        dxdt=rows(dxdt),
        receiver_motion=rows(receiver_motion),
        flux=rows(flux),
        emission=rows(0, width=2),
        shift=rows(0, width=2),
        receiver=rows(receiver, np.int32, 0),
        bounces=whole,
        path=rows(0, np.uint32, 0),
        share=rows(share, width=0),
        trajectory=None if trajectory is None else TrajectoryColumns(*map(rows, trajectory), rows(gain, width=0)),
        time=time,
        duration=duration,
    )


def pixel(half_size: float = 0.0) -> PixelSize:
    """Pixels of one size everywhere."""
    size = PixelSize()
    size.base = math.sqrt(12.0) * half_size
    return size


def shaped(*maps: PhotonMap, kernel="bspline", half_pixel=0.0, moves=False, smoothing=1.0) -> FootprintMap:
    shapes = shape_footprints(list(maps), kernel, smoothing, pixel(half_pixel), moves, ONE_THREAD)
    return FootprintMap.of(shapes)


def queries(positions, motions=(0, 0, 0), normals=UP, receiver=0) -> QueryArrays:
    """Query points at ``positions`` [n, 3]; every other argument is one value for all or one a point."""
    count = len(positions)
    out = QueryArrays()
    for name, values in (("position", positions), ("motion", motions), ("normal", normals)):
        values = np.broadcast_to(np.asarray(values, np.float32), (count, 3))
        setattr(out, name, wp.array(np.ascontiguousarray(values), dtype=wp.vec3, device="cpu"))
    receivers = np.broadcast_to(np.asarray(receiver, np.int32), (count,)).copy()
    out.receiver = wp.array(receivers, dtype=wp.int32, device="cpu")
    return out


def irradiance(footprints: FootprintMap, points: QueryArrays, form=GatherForm(), **options) -> Irradiance:  # noqa: B008
    return gather(footprints, points, form, ONE_THREAD, Lookup(**options))


def first_channel(footprints: FootprintMap, positions, form=GatherForm(), **options) -> np.ndarray:  # noqa: B008
    """Irradiance of the first channel at points of the plane z = 0 that face up, shape [n]."""
    found = irradiance(footprints, queries(positions), form, **options)
    return found.irradiance[:, 0].astype(np.float64)


def grid(low, high, counts) -> tuple[np.ndarray, float]:
    """Cell centres [n, 3] of a grid on z = 0 between two corners, and the area of a cell."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    step = (high - low) / counts
    x, y = (low[i] + (np.arange(counts[i]) + 0.5) * step[i] for i in range(2))
    across, along = np.meshgrid(x, y)
    return np.stack([across.ravel(), along.ravel(), np.zeros(across.size)], axis=1), float(step.prod())
