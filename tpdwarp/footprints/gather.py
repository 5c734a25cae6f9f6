"""Gathering: the irradiance that footprints leave at query points (Eq. 8 without the BRDF)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints import bspline
from tpdwarp.footprints.bspline import Way, bspline_weight, way_reach
from tpdwarp.footprints.kernels import SUPPORT, moving_weight, static_weight
from tpdwarp.footprints.shaping import FootprintArrays, FootprintMap, PieceArrays

# A footprint lies on planes within 60° of its own; how far off its plane it reaches is up to its slack.
SMALLEST_COSINE = wp.constant(0.5)
CLOSE = wp.constant(1.0e-5)
GROUP = wp.constant(128)
# How much the motions of queries that are gathered together may differ, as a part of the motion itself.
LARGEST_DEVIATION = wp.constant(0.25)
# A footprint is a parabola on runs that reach so far from their middle, in cells; steps for its differences.
LARGEST_STEP = wp.constant(0.125)
SMALLEST_STEP = wp.constant(0.05)
FEWEST_FOR_PARABOLA = wp.constant(8)
# Normals of a run within this cosine of its first one all face a footprint, or none does, if the first one does so.
NARROW_CONE = wp.constant(math.cos(math.radians(10.0)))
ALWAYS_FACING = wp.constant(math.cos(math.radians(60.0 - 10.0)))
NEVER_FACING = wp.constant(math.cos(math.radians(60.0 + 10.0)))
SEVERAL = wp.constant(-2)
FAR_AWAY = wp.constant(1.0e30)


@wp.struct
class QueryArrays:
    """Points at which irradiance is wanted, in the tracer's units.

    ``position`` is where the point stands when it is looked at, ``motion`` the way it goes over the whole shutter (that
    of the surface point a pixel sees), ``normal`` faces the viewer, ``receiver`` its object (−1: no query).
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
def _weight(kernel: str, form: str, time_filter: str, moves: bool, curved: bool) -> wp.Function:
    """w(y, way) with y relative to where the footprint stands in the middle of its way."""
    if kernel == "bspline":
        return bspline_weight(moves, curved)
    support = wp.constant(SUPPORT)
    still = static_weight(kernel)
    if not moves:

        @wp.func
        def static(y: wp.vec2, way: Way) -> float:
            return still(y)

        return static
    moving = moving_weight(kernel, form, time_filter)

    @wp.func
    def swept(y: wp.vec2, way: Way) -> float:
        v = way.velocity
        if wp.abs(y[0]) >= support + 0.5 * wp.abs(v[0]) or wp.abs(y[1]) >= support + 0.5 * wp.abs(v[1]):
            return 0.0
        if v[0] == 0.0 and v[1] == 0.0:
            return still(y)
        return moving(y + 0.5 * v, v)

    return swept


@wp.func
def _meet(lower: wp.vec3, upper: wp.vec3, low: wp.vec3, high: wp.vec3) -> bool:
    """Whether two boxes have a point in common, decided as the BVH does."""
    return wp.min(wp.min(high - lower, upper - low)) >= 0.0


@cache
def gather_kernel(
    kernel: str, form: str, time_filter: str, moves: bool, curved: bool, query_moves: bool, with_motion: bool
) -> wp.Kernel:
    """The gathering kernel for one footprint kernel; a scene at rest takes the static weight, straight ways theirs.

    One thread takes a group of neighbouring queries, walks the BVH once for each run of them that fits into ``reach``,
    and lets every footprint it finds fall on all of the run. Queries that stand still take the whole shutter, moving
    ones their window of it.
    """
    smooth = kernel == "bspline"
    support = wp.constant(bspline.SUPPORT if smooth else SUPPORT)
    weight = _weight(kernel, form, time_filter, moves, curved)

    @wp.kernel(module="unique", enable_backward=False)
    def gather(
        base: int,
        # In
        bvh: wp.uint64,
        footprints: FootprintArrays,
        pieces: PieceArrays,
        duration: float,
        reach: float,
        time: float,
        window_center: float,
        window: float,
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
            run_receiver = int(-1)
            run_normal = wp.vec3(0.0, 0.0, 0.0)
            narrowest = float(1.0)
            run_motion = wp.vec3(0.0, 0.0, 0.0)
            fastest = float(0.0)
            run_window = float(window)
            run_center = float(window_center)
            stop = int(start)
            while stop < end:
                if queries.receiver[stop] >= 0:
                    x = queries.position[stop]
                    a = x
                    b = x
                    if wp.static(query_moves):
                        motion = queries.motion[stop]
                        if low[0] == FAR_AWAY:
                            run_motion = motion
                            fastest = (1.0 + LARGEST_DEVIATION) * wp.length(motion)
                            # A query that races over the receiver stands for less of the shutter.
                            share = wp.min(1.0, reach / wp.max(window * fastest, 1.0e-20))
                            run_window = share * window
                            run_center = time + share * (window_center - time)
                        elif wp.length(motion - run_motion) > LARGEST_DEVIATION * wp.length(run_motion):
                            break
                        half = run_window * motion
                        a = wp.min(x - half, x + half)
                        b = wp.max(x - half, x + half)
                    grown_low = wp.min(low, a)
                    grown_high = wp.max(high, b)
                    if stop > start and wp.length(grown_high - grown_low) > reach and low[0] < FAR_AWAY:
                        break
                    if low[0] == FAR_AWAY:
                        run_receiver = queries.receiver[stop]
                        run_normal = queries.normal[stop]
                    elif queries.receiver[stop] != run_receiver:
                        run_receiver = SEVERAL
                    narrowest = wp.min(narrowest, wp.dot(run_normal, queries.normal[stop]))
                    low = grown_low
                    high = grown_high
                stop += 1

            if low[0] < FAR_AWAY:
                middle = 0.5 * (low + high)
                radius = 0.5 * wp.length(high - low)
                piece = int(0)
                margin = wp.vec3(CLOSE, CLOSE, CLOSE)
                # What wide footprints add up to on this run, as a function of the way from its middle.
                summed = bool(False)
                level = wp.vec3(0.0, 0.0, 0.0)
                slopes = wp.mat33()
                bow_r = wp.mat33()
                bow_g = wp.mat33()
                bow_b = wp.mat33()
                run_since = run_center - time
                query = wp.bvh_query_aabb(bvh, low - margin, high + margin)
                while wp.bvh_query_next(query, piece):
                    j = pieces.footprint[piece]
                    receiver = footprints.receiver[j]
                    center = footprints.center[j]
                    n_p = footprints.normal[j]
                    row_u = footprints.row_u[j]
                    row_v = footprints.row_v[j]
                    density = footprints.density[j]
                    slack = footprints.slack[j] + CLOSE
                    way = Way()
                    if wp.static(smooth):
                        way.box = footprints.box[j]
                    since = float(0.0)
                    length = float(0.0)
                    last = stop
                    if pieces.number[piece] > 0:
                        # Of the pieces that meet the run, the first one stands for the footprint.
                        if _meet(pieces.lower[piece - 1], pieces.upper[piece - 1], low - margin, high + margin):
                            last = start
                    if wp.static(moves):
                        # The part of the shutter that the query's window and the photon's own have in common.
                        center_time = footprints.time[j]
                        opening = center_time - 0.5 * duration
                        closing = center_time + 0.5 * duration
                        share = float(1.0)
                        if fastest > 0.0:
                            opening = wp.max(run_center - 0.5 * run_window, opening)
                            closing = wp.min(run_center + 0.5 * run_window, closing)
                            share = run_window
                        length = closing - opening
                        if length <= 1.0e-6 * share * duration:
                            last = start
                        middle_time = 0.5 * (opening + closing)
                        since = middle_time - time
                        part = length / duration
                        late = (middle_time - center_time) / duration
                        motion_then = footprints.dxdt[j]
                        center += late * motion_then
                        if wp.static(curved):
                            bend = footprints.bend[j]
                            jerk = footprints.jerk[j]
                            stretch = footprints.stretch[j]
                            center += (0.5 * late * late) * (bend + (late / 3.0) * jerk)
                            motion_then += late * (bend + (0.5 * late) * jerk)
                            bend += late * jerk
                            if late != 0.0:
                                # The same way, told from the middle of the part.
                                grown = wp.identity(n=2, dtype=float) + late * stretch
                                inverse = wp.inverse(grown)
                                shrunk_u = inverse[0, 0] * row_u + inverse[0, 1] * row_v
                                row_v = inverse[1, 0] * row_u + inverse[1, 1] * row_v
                                row_u = shrunk_u
                                density = density * wp.abs(wp.determinant(inverse))
                                way.box = wp.vec2(inverse[0, 0] * way.box[0], inverse[1, 1] * way.box[1])
                                stretch = inverse * stretch
                            way.bend = (part * part) * wp.vec2(wp.dot(row_u, bend), wp.dot(row_v, bend))
                            way.jerk = (part * part * part) * wp.vec2(wp.dot(row_u, jerk), wp.dot(row_v, jerk))
                            way.stretch = part * stretch
                        swept = part * motion_then - length * run_motion
                        way.velocity = wp.vec2(wp.dot(row_u, swept), wp.dot(row_v, swept))
                        density = density * (length / (share * duration))
                    # Most long thin footprints that lie askew miss the run although their boxes do not.
                    offset = middle + since * run_motion - center
                    spread = radius + run_window * fastest
                    off_u = wp.abs(wp.dot(row_u, offset)) - wp.length(row_u) * spread - 0.5 * wp.abs(way.velocity[0])
                    off_v = wp.abs(wp.dot(row_v, offset)) - wp.length(row_v) * spread - 0.5 * wp.abs(way.velocity[1])
                    if wp.static(smooth):
                        off_u -= way_reach(way, 0) - support
                        off_v -= way_reach(way, 1) - support
                    if off_u > support or off_v > support:
                        last = start
                    # A footprint much larger than the run is a parabola there; those are added up before they are
                    # evaluated, so that faint wide ones cost next to nothing.
                    parabolic = bool(False)
                    if wp.static(smooth):
                        finest = wp.max(wp.length(row_u), wp.length(row_v))
                        step = radius * finest
                        aside = wp.abs(since - run_since) * LARGEST_DEVIATION * wp.length(run_motion) * finest
                        uniform = run_receiver >= 0 and narrowest > NARROW_CONE and aside < SMALLEST_STEP
                        if uniform and step < LARGEST_STEP and last - start > FEWEST_FOR_PARABOLA:
                            facing = wp.dot(run_normal, n_p)
                            height = wp.abs(wp.dot(n_p, offset))
                            thickness = 0.5 * wp.dot(wp.abs(n_p), high - low)
                            if receiver != run_receiver or facing < NEVER_FACING or height - thickness > slack:
                                last = start
                            elif facing > ALWAYS_FACING and height + thickness <= slack:
                                parabolic = True
                        if parabolic and last > start:
                            step = wp.max(step, SMALLEST_STEP)
                            y_0 = wp.vec2(wp.dot(row_u, offset), wp.dot(row_v, offset))
                            w_0 = weight(y_0, way)
                            right = weight(y_0 + wp.vec2(step, 0.0), way)
                            left = weight(y_0 - wp.vec2(step, 0.0), way)
                            upper = weight(y_0 + wp.vec2(0.0, step), way)
                            lower = weight(y_0 - wp.vec2(0.0, step), way)
                            corner = weight(y_0 + wp.vec2(step, step), way)
                            slope = ((right - left) * row_u + (upper - lower) * row_v) / (2.0 * step)
                            bow = (
                                (0.5 * (right + left) - w_0) * wp.outer(row_u, row_u)
                                + (0.5 * (upper + lower) - w_0) * wp.outer(row_v, row_v)
                                + (corner + w_0 - right - upper) * wp.outer(row_u, row_v)
                            ) / (step * step)
                            level += w_0 * density
                            slopes += wp.outer(density, slope)
                            bow_r += density[0] * bow
                            bow_g += density[1] * bow
                            bow_b += density[2] * bow
                            summed = True
                            if not wp.static(with_motion):
                                last = start
                    for i in range(start, last):
                        if queries.receiver[i] == receiver:
                            if wp.dot(queries.normal[i], n_p) > SMALLEST_COSINE:
                                d = queries.position[i] - center
                                if wp.static(query_moves):
                                    d += since * queries.motion[i]
                                w = float(0.0)
                                if wp.abs(wp.dot(n_p, d)) <= slack:
                                    w = weight(wp.vec2(wp.dot(row_u, d), wp.dot(row_v, d)), way)
                                if w > 0.0:
                                    added = w * density
                                    if not parabolic:
                                        out.irradiance[i] = out.irradiance[i] + added
                                    if wp.static(with_motion):
                                        amount = added[0] + added[1] + added[2]
                                        out.motion[i] = out.motion[i] + amount * footprints.relative[j]
                                        out.weight[i] = out.weight[i] + amount
                                        out.photons[i] = out.photons[i] + 1
                if summed:
                    for i in range(start, stop):
                        if queries.receiver[i] >= 0:
                            d = queries.position[i] - middle
                            if wp.static(query_moves):
                                d += run_since * (queries.motion[i] - run_motion)
                            bowed = wp.vec3(wp.dot(d, bow_r * d), wp.dot(d, bow_g * d), wp.dot(d, bow_b * d))
                            added = level + slopes * d + bowed
                            out.irradiance[i] = out.irradiance[i] + wp.max(added, wp.vec3(0.0, 0.0, 0.0))
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
    time: float = 0.0,
    window: tuple[float, float] = (0.0, 1.0),
    query_moves: bool = False,
    with_motion: bool = False,
) -> Irradiance:
    """Irradiance that ``footprints`` leave at ``queries``, averaged over part of the shutter.

    Args:
        time: When the queries stand where they are, in the shutter (−½ … ½).
        window: Middle and length of the part of the shutter that these queries stand for (it holds ``time``). What a
            pixel sees correlates with when it sees it, so its samples share the shutter out between them.
        query_moves: Whether queries carry their motion.
        with_motion: Whether the flux-weighted D_t x and the number of footprints are wanted.
    """
    count = queries.position.shape[0]
    out = IrradianceArrays()
    out.irradiance = launcher.zeros(count, wp.vec3)
    extra = count if with_motion else 0
    out.motion, out.weight = launcher.zeros(extra, wp.vec3), launcher.zeros(extra, wp.float32)
    out.photons = launcher.zeros(extra, wp.int32)
    if footprints.count:
        moves = footprints.moves or query_moves
        footprint = (form.kernel, form.form, form.time_filter, moves, footprints.curved)
        kernel = gather_kernel(*footprint, query_moves, with_motion)
        photons = [footprints.bvh.id, footprints.arrays, footprints.pieces, footprints.duration, footprints.reach]
        inputs = [*photons, time, *window, count, queries, out]
        launcher(kernel, -(-count // GROUP), inputs, smallest_chunk=16)
    if not with_motion:
        return Irradiance(out.irradiance.numpy())
    return Irradiance(
        out.irradiance.numpy(), out.motion.numpy() / footprints.duration, out.weight.numpy(), out.photons.numpy()
    )
