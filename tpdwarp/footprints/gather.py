"""Gathering: the irradiance that footprints leave at query points (Eq. 8 without the BRDF)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.footprints.footprint import FootprintArrays, FootprintMap
from tpdwarp.footprints.kernels import SUPPORT, moving_weight, static_weight
from tpdwarp.launch import Launcher

# A footprint lies on planes within 60° of its own; how far off its plane it reaches is up to its slack.
SMALLEST_COSINE = wp.constant(0.5)
CLOSE = wp.constant(1.0e-5)
GROUP = wp.constant(64)
FAR_AWAY = wp.constant(1.0e30)


@wp.struct
class QueryArrays:
    """Points at which irradiance is wanted, in the tracer's units.

    ``position`` is where the point stands at mid shutter, ``motion`` the way it goes over the whole shutter (that of
    the surface point a pixel sees), ``normal`` faces the viewer, ``receiver`` is the object it lies on (−1: no query).
    """

    position: wp.array(dtype=wp.vec3)
    motion: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    receiver: wp.array(dtype=wp.int32)


@wp.struct
class IrradianceArrays:
    """Irradiance [W per square tracer unit], flux-weighted sum of D_t x, sum of weights, overlapping footprints."""

    irradiance: wp.array(dtype=wp.vec3)
    motion: wp.array(dtype=wp.vec3)
    weight: wp.array(dtype=wp.float32)
    photons: wp.array(dtype=wp.int32)


@cache
def gather_kernel(
    kernel: str, form: str, time_filter: str, moves: bool, query_moves: bool, with_motion: bool
) -> wp.Kernel:
    """The gathering kernel for one footprint kernel; a scene at rest takes the static weight.

    One thread takes a group of neighbouring queries, walks the BVH once for each run of them that fits into ``reach``,
    and lets every footprint it finds fall on all of the run.
    """
    still = static_weight(kernel)
    moving = moving_weight(kernel, form, time_filter) if moves else static_weight(kernel)
    support = wp.constant(SUPPORT[kernel])

    @wp.kernel(module="unique", enable_backward=False)
    def gather(
        base: int,
        # In
        bvh: wp.uint64,
        footprints: FootprintArrays,
        duration: float,
        reach: float,
        count: int,
        queries: QueryArrays,
        # Out
        out: IrradianceArrays,
    ):
        group = base + wp.tid()
        end = wp.min((group + 1) * GROUP, count)
        start = group * GROUP
        while start < end:
            # A run: queries from start on whose way over the shutter fits into a box of size reach.
            low = wp.vec3(FAR_AWAY, FAR_AWAY, FAR_AWAY)
            high = -low
            stop = int(start)
            while stop < end:
                if queries.receiver[stop] >= 0:
                    x = queries.position[stop]
                    a = x
                    b = x
                    if wp.static(query_moves):
                        half = 0.5 * queries.motion[stop]
                        a = wp.min(x - half, x + half)
                        b = wp.max(x - half, x + half)
                    grown_low = wp.min(low, a)
                    grown_high = wp.max(high, b)
                    if stop > start and wp.length(grown_high - grown_low) > reach and low[0] < FAR_AWAY:
                        break
                    low = grown_low
                    high = grown_high
                stop += 1

            if low[0] < FAR_AWAY:
                j = int(0)
                margin = wp.vec3(CLOSE, CLOSE, CLOSE)
                query = wp.bvh_query_aabb(bvh, low - margin, high + margin)
                while wp.bvh_query_next(query, j):
                    receiver = footprints.receiver[j]
                    center = footprints.center[j]
                    n_p = footprints.normal[j]
                    row_u = footprints.row_u[j]
                    row_v = footprints.row_v[j]
                    density = footprints.density[j]
                    slack = footprints.slack[j] + CLOSE
                    way = footprints.dxdt[j]
                    v = wp.vec2(wp.dot(row_u, way), wp.dot(row_v, way))
                    for i in range(start, stop):
                        if queries.receiver[i] == receiver:
                            if wp.dot(queries.normal[i], n_p) > SMALLEST_COSINE:
                                d = queries.position[i] - center
                                if wp.static(query_moves):
                                    motion = queries.motion[i]
                                    d += footprints.time[j] * motion
                                    relative = way - duration * motion
                                    v = wp.vec2(wp.dot(row_u, relative), wp.dot(row_v, relative))
                                y = wp.vec2(wp.dot(row_u, d), wp.dot(row_v, d))
                                w = float(0.0)
                                if wp.static(moves):
                                    inside = wp.abs(y[0]) < support + 0.5 * wp.abs(v[0])
                                    inside = inside and wp.abs(y[1]) < support + 0.5 * wp.abs(v[1])
                                    if inside and wp.abs(wp.dot(n_p, d)) <= slack:
                                        if v[0] == 0.0 and v[1] == 0.0:
                                            w = still(y)
                                        else:
                                            w = moving(y + 0.5 * v, v)
                                else:
                                    if wp.abs(wp.dot(n_p, d)) <= slack:
                                        w = still(y)
                                if w > 0.0:
                                    added = w * density
                                    out.irradiance[i] = out.irradiance[i] + added
                                    if wp.static(with_motion):
                                        amount = added[0] + added[1] + added[2]
                                        out.motion[i] = out.motion[i] + amount * footprints.relative[j]
                                        out.weight[i] = out.weight[i] + amount
                                        out.photons[i] = out.photons[i] + 1
            start = stop

    return gather


@dataclass(frozen=True)
class GatherForm:
    """How footprints are evaluated: kernel of Table 1 or B-spline, shutter or swept, time filter of Eq. 9."""

    kernel: str = "bspline"
    form: str = "shutter"
    time_filter: str = "none"


@dataclass
class Irradiance:
    """Irradiance at queries, in the tracer's units.

    Attributes:
        irradiance: [n, 3], W per square unit.
        motion: Sum of D_t x over the whole shutter weighted by ``weight``, [n, 3]; None unless asked for.
        weight: Sum of weights, [n].
        photons: Footprints overlapping, [n].
    """

    irradiance: np.ndarray
    motion: np.ndarray | None = None
    weight: np.ndarray | None = None
    photons: np.ndarray | None = None


def gather(
    footprints: FootprintMap,
    queries: QueryArrays,
    form: GatherForm,
    launcher: Launcher,
    *,
    query_moves: bool = False,
    with_motion: bool = False,
) -> Irradiance:
    """Irradiance that ``footprints`` leave at ``queries``."""
    count = queries.position.shape[0]
    out = IrradianceArrays()
    out.irradiance = launcher.zeros(count, wp.vec3)
    extra = count if with_motion else 0
    out.motion, out.weight = launcher.zeros(extra, wp.vec3), launcher.zeros(extra, wp.float32)
    out.photons = launcher.zeros(extra, wp.int32)
    if footprints.count:
        moves = footprints.moves or query_moves
        kernel = gather_kernel(form.kernel, form.form, form.time_filter, moves, query_moves, with_motion)
        inputs = [footprints.bvh.id, footprints.arrays, footprints.duration, footprints.reach, count, queries, out]
        launcher(kernel, -(-count // GROUP), inputs, smallest_chunk=16)
    if not with_motion:
        return Irradiance(out.irradiance.numpy())
    return Irradiance(
        out.irradiance.numpy(), out.motion.numpy() / footprints.duration, out.weight.numpy(), out.photons.numpy()
    )
