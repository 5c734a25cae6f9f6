"""Gathering: the irradiance that footprints leave at query points (Eq. 8 without the BRDF)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.footprints.footprint import FootprintArrays, FootprintMap
from tpdwarp.footprints.kernels import moving_weight, static_weight
from tpdwarp.launch import Launcher

# A footprint lies on planes within 60° of its own; how far off its plane it reaches is up to its slack.
SMALLEST_COSINE = wp.constant(0.5)
CLOSE = wp.constant(1.0e-5)


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
def gather_kernel(kernel: str, form: str, time_filter: str, moves: bool, with_motion: bool) -> wp.Kernel:
    """The gathering kernel for one footprint kernel; a scene at rest takes the static weight."""
    still = static_weight(kernel)
    moving = moving_weight(kernel, form, time_filter) if moves else static_weight(kernel)

    @wp.kernel(module="unique", enable_backward=False)
    def gather(
        base: int,
        # In
        bvh: wp.uint64,
        footprints: FootprintArrays,
        duration: float,
        queries: QueryArrays,
        # Out
        out: IrradianceArrays,
    ):
        i = base + wp.tid()
        receiver = queries.receiver[i]
        if receiver < 0:
            return
        x = queries.position[i]
        n = queries.normal[i]
        motion = wp.vec3(0.0, 0.0, 0.0)
        reach = wp.vec3(CLOSE, CLOSE, CLOSE)
        if wp.static(moves):
            motion = queries.motion[i]
            reach += 0.5 * wp.vec3(wp.abs(motion[0]), wp.abs(motion[1]), wp.abs(motion[2]))
        total = wp.vec3(0.0, 0.0, 0.0)
        drift = wp.vec3(0.0, 0.0, 0.0)
        weight = float(0.0)
        count = int(0)
        j = int(0)
        query = wp.bvh_query_aabb(bvh, x - reach, x + reach)
        while wp.bvh_query_next(query, j):
            if footprints.receiver[j] == receiver:
                n_p = footprints.normal[j]
                d = x - footprints.center[j]
                w = float(0.0)
                if wp.dot(n, n_p) > SMALLEST_COSINE:
                    if wp.static(moves):
                        d += footprints.time[j] * motion
                    if wp.abs(wp.dot(n_p, d)) <= footprints.slack[j] + CLOSE:
                        row_u = footprints.row_u[j]
                        row_v = footprints.row_v[j]
                        y = wp.vec2(wp.dot(row_u, d), wp.dot(row_v, d))
                        if wp.static(moves):
                            way = footprints.dxdt[j] - duration * motion
                            v = wp.vec2(wp.dot(row_u, way), wp.dot(row_v, way))
                            if v[0] == 0.0 and v[1] == 0.0:
                                w = still(y)
                            else:
                                w = moving(y + 0.5 * v, v)
                        else:
                            w = still(y)
                if w > 0.0:
                    added = w * footprints.density[j]
                    total += added
                    if wp.static(with_motion):
                        amount = added[0] + added[1] + added[2]
                        drift += amount * footprints.relative[j]
                        weight += amount
                        count += 1
        out.irradiance[i] = total
        if wp.static(with_motion):
            out.motion[i] = drift
            out.weight[i] = weight
            out.photons[i] = count

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
        kernel = gather_kernel(form.kernel, form.form, form.time_filter, moves, with_motion)
        launcher(kernel, count, [footprints.bvh.id, footprints.arrays, footprints.duration, queries, out])
    if not with_motion:
        return Irradiance(out.irradiance.numpy())
    return Irradiance(
        out.irradiance.numpy(), out.motion.numpy() / footprints.duration, out.weight.numpy(), out.photons.numpy()
    )
