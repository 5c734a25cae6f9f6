"""Gathering: the irradiance that footprints leave at query points (Eq. 8 of the paper without the BRDF).

    E(x) = Σ_pd Φ_pd |det M| w(M (x − x_pd))

Φ |det M| and M come from :mod:`tpdwarp.footprints.placing`, w from :mod:`tpdwarp.footprints.weights`; the sum is here.
:mod:`tpdwarp.footprints.plain_gather` computes the same sum without any of what makes this one fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import lanes_in_vectors
from tpdwarp.device import Launcher
from tpdwarp.footprints.bounds import Piece
from tpdwarp.footprints.courses import Course, passes_by
from tpdwarp.footprints.footprint_map import FootprintMap
from tpdwarp.footprints.irradiance import Irradiance, IrradianceArrays, Lookup, QueryArrays, has_shading_normals
from tpdwarp.footprints.lane_counts import func_of_lanes, kernel_of_lanes, lane_func, lane_struct
from tpdwarp.footprints.lanes import Lanes, LaneVectors, greatest, in_lane, lanes_of
from tpdwarp.footprints.leaves import LEAF, LeafArrays, leaves_of
from tpdwarp.footprints.parabolas import Parabola, parabola_at
from tpdwarp.footprints.placing import PlacedFootprint, TimeWindow, place_footprint, shading_ratio
from tpdwarp.footprints.reach import Reach, misses, reach_of
from tpdwarp.footprints.runs import LARGEST_DEVIATION, Run, next_run
from tpdwarp.footprints.shaping import FootprintArrays
from tpdwarp.footprints.weights import GatherForm, footprint_weight

# A footprint lies on planes within 60° of its own; how far off its plane it reaches is up to its tolerance. Chosen, not
# derived: it keeps light from the next face of a cube, and lets it follow coarse meshes.
SMALLEST_COSINE = wp.constant(0.5)
# Queries of one thread of a CPU: enough to fill runs, few enough to keep all cores busy. Chosen, not derived. One of a
# GPU has as many as it has lanes.
GROUP = 128
# Boxes of runs are grown by the rounding of positions in a scene of unit size, as in PLANE_ROUNDING.
BOX_MARGIN = wp.constant(1.0e-5)
# A footprint is a parabola on runs that reach no further than this from their middle, in cells: it errs by less than
# 1/500 of its peak there. The least step for its differences keeps them above rounding: 6e-8 over its square is 2e-5.
LARGEST_STEP = wp.constant(0.125)
SMALLEST_STEP = wp.constant(0.05)
# Six weights make a parabola; runs of no more queries than this are evaluated one by one.
WEIGHTS_OF_PARABOLA = 6
FEWEST_FOR_PARABOLA = wp.constant(8)
# Of a run whose normals lie within 10° (chosen, not derived) of its first one, all face a footprint where that one lies
# within 60° − 10° of it, and none where it lies beyond 60° + 10°.
NARROW_CONE = wp.constant(math.cos(math.radians(10.0)))
ALWAYS_FACING = wp.constant(math.cos(math.radians(60.0 - 10.0)))
NEVER_FACING = wp.constant(math.cos(math.radians(60.0 + 10.0)))
# Out of reach of every footprint, in cells, yet so near that its square is a number.
FAR_OFF = wp.constant(1.0e9)
# Photons count where more of them falls than rounding leaves beyond their rim: parts of a cell, in single precision.
# Chosen by measurement.
LEAST_WEIGHT = wp.constant(1.0e-5)
# At rest, over the whole shutter, nothing but irradiance.
PLAIN_LOOKUP = Lookup()


@wp.func
def boxes_meet(lower: wp.vec3, upper: wp.vec3, low: wp.vec3, high: wp.vec3) -> bool:
    """Whether two boxes have a point in common, decided as the BVH does: a term of Eq. 8 is found once."""
    return wp.min(wp.min(high - lower, upper - low)) >= 0.0


@wp.func
def found_before(piece: Piece, low: wp.vec3, high: wp.vec3) -> bool:
    """Whether an earlier piece of the same footprint meets the box, too: the first one adds its term to Eq. 8."""
    if piece.number > 0:
        return boxes_meet(piece.low_before, piece.high_before, low, high)
    return False


@wp.func
def is_parabola(run: Run, start: int, placed: PlacedFootprint, radius: float, run_since: float) -> bool:
    """Whether a term of Eq. 8 is a parabola over a run: a B-spline wide beside it, and its queries are alike."""
    finest = wp.max(wp.length(placed.row_u), wp.length(placed.row_v))
    apart = wp.abs(placed.since - run_since) * LARGEST_DEVIATION * wp.length(run.window.motion) * finest
    uniform = run.receiver >= 0 and run.narrowest > NARROW_CONE and apart < SMALLEST_STEP
    uniform = uniform and placed.trajectory.is_cell == 0
    return uniform and radius * finest < LARGEST_STEP and run.stop - start > FEWEST_FOR_PARABOLA


@cache
def _add_parabola(form: GatherForm, lanes: int, moves: bool, curved: bool) -> wp.Function:
    """Adds a term of Eq. 8 to the parabola of a run, by differences of its weight around the run's middle."""
    weight = footprint_weight(form, lanes, moves, curved)

    @func_of_lanes(lanes)
    def add(parabola: Parabola, placed: PlacedFootprint, offset: wp.vec3, radius: float) -> Parabola:
        out = parabola
        row_u = placed.row_u
        row_v = placed.row_v
        density = placed.density
        step = wp.max(radius * wp.max(wp.length(row_u), wp.length(row_v)), SMALLEST_STEP)
        u = Lanes(wp.dot(row_u, offset))
        v = Lanes(wp.dot(row_v, offset))
        u[1] = u[0] + step
        u[2] = u[0] - step
        v[3] = v[0] + step
        v[4] = v[0] - step
        u[5] = u[1]
        v[5] = v[3]
        values = weight(u, v, placed.trajectory)
        here = values[0]
        right = values[1]
        left = values[2]
        upper = values[3]
        lower = values[4]
        corner = values[5]
        slope = ((right - left) * row_u + (upper - lower) * row_v) / (2.0 * step)
        curvature = (
            (0.5 * (right + left) - here) * wp.outer(row_u, row_u)
            + (0.5 * (upper + lower) - here) * wp.outer(row_v, row_v)
            + (corner + here - right - upper) * wp.outer(row_u, row_v)
        ) / (step * step)
        out.value += here * density
        out.slopes += wp.outer(density, slope)
        out.curvature_r += density[0] * curvature
        out.curvature_g += density[1] * curvature
        out.curvature_b += density[2] * curvature
        out.used = True
        return out

    return add


@lane_struct
class LeafSums:
    """Sums of Eq. 8 at the queries of leaves, one row each, as in ``IrradianceArrays``."""

    irradiance: wp.array(dtype=LaneVectors)


@cache
def _add_to_leaf(
    form: GatherForm, lanes: int, moves: bool, curved: bool, shaded: bool, query_moves: bool, with_motion: bool
) -> wp.Function:
    """Adds a term of Eq. 8, Φ |det M| w(y), to each of the queries of a leaf that belong to a run."""
    weight = footprint_weight(form, lanes, moves, curved)

    @func_of_lanes(lanes)
    def add(
        leaves: LeafArrays,
        leaf: int,
        first: int,
        last: int,
        placed: PlacedFootprint,
        dxdt: wp.vec3,
        is_image: bool,
        summed: bool,
        sums: LeafSums,
        out: IrradianceArrays,
    ):
        # ---- Those on its object, on planes like its own; others are out of its reach, and not looked for near them
        position = leaves.position[leaf]
        x = position.x
        y = position.y
        z = position.z
        normal = leaves.normal[leaf]
        n_x = normal.x
        n_y = normal.y
        n_z = normal.z
        receiver = leaves.receiver[leaf]
        if wp.static(query_moves):
            motion = leaves.motion[leaf]
            m_x = motion.x
            m_y = motion.y
            m_z = motion.z
        begin = leaf * LEAF
        u = Lanes(0.0)
        v = Lanes(0.0)
        counted = Lanes(0.0)
        lane = int(0)
        while lane < LEAF:
            offset = wp.vec3(x[lane], y[lane], z[lane]) - placed.center
            if wp.static(query_moves):
                offset += placed.since * wp.vec3(m_x[lane], m_y[lane], m_z[lane])
            here = receiver[lane] == float(placed.receiver) and lane >= first - begin and lane < last - begin
            lying = wp.abs(wp.dot(offset, placed.normal)) <= placed.plane_tolerance
            facing = wp.dot(wp.vec3(n_x[lane], n_y[lane], n_z[lane]), placed.normal) >= SMALLEST_COSINE
            counts = here and lying and facing
            counted[lane] = wp.where(counts, 1.0, 0.0)
            u[lane] = wp.where(counts, wp.dot(offset, placed.row_u), FAR_OFF)
            v[lane] = wp.where(counts, wp.dot(offset, placed.row_v), FAR_OFF)
            lane += 1
        if greatest(counted) > 0.0:
            # ---- Weigh
            w = weight(u, v, placed.trajectory)
            lane = int(0)
            if wp.static(shaded):
                shading = leaves.shading_normal[leaf]
                n_x = shading.x
                n_y = shading.y
                n_z = shading.z
            while lane < LEAF:
                w[lane] = w[lane] * counted[lane]
                if wp.static(shaded):
                    n_s = wp.vec3(n_x[lane], n_y[lane], n_z[lane])
                    w[lane] = w[lane] * shading_ratio(placed.incidence, n_s)
                lane += 1

            # ---- Add
            if not summed:
                light = sums.irradiance[leaf]
                red = light.x
                green = light.y
                blue = light.z
                lane = int(0)
                while lane < LEAF:
                    red[lane] = red[lane] + w[lane] * placed.density[0]
                    green[lane] = green[lane] + w[lane] * placed.density[1]
                    blue[lane] = blue[lane] + w[lane] * placed.density[2]
                    lane += 1
                light.x = red
                light.y = green
                light.z = blue
                sums.irradiance[leaf] = light
            if wp.static(with_motion):
                for i in range(first, last):
                    part = w[i - leaf * LEAF]
                    amount = part * (placed.density[0] + placed.density[1] + placed.density[2])
                    if amount > 0.0:
                        out.motion[i] = out.motion[i] + amount * dxdt
                        out.weight[i] = out.weight[i] + amount
                        if part > LEAST_WEIGHT and not is_image:
                            out.photons[i] = out.photons[i] + 1

    return add


@wp.func
def of_image(footprints: FootprintArrays, j: int) -> bool:
    """Whether a footprint is that of the image of a photon beyond an edge (beyond the paper)."""
    if footprints.mirrors.shape[0] == 0:
        return False
    return wp.ddot(footprints.mirrors[j], footprints.mirrors[j]) > 0.0


@wp.func
def own_dxdt(footprints: FootprintArrays, j: int) -> wp.vec3:
    """D_t x of a photon by its receiver; of an image (beyond the paper) that of its photon, whose light it is."""
    dxdt = footprints.dxdt_relative[j]
    if footprints.mirrors.shape[0] > 0:
        for number in range(2):
            normal = footprints.mirrors[j][1 - number]
            dxdt -= 2.0 * wp.dot(dxdt, normal) * normal
    return dxdt


@lane_func
def take_out(sums: LeafSums, first: int, last: int, out: IrradianceArrays):
    """Adds the sums of Eq. 8 of queries ``first`` … ``last`` − 1, where a leaf begins, to what they have already."""
    leaf = first // LEAF
    while leaf * LEAF < last:
        light = sums.irradiance[leaf]
        for i in range(leaf * LEAF, wp.min((leaf + 1) * LEAF, last)):
            out.irradiance[i] = out.irradiance[i] + in_lane(light, i - leaf * LEAF)
        leaf += 1


@cache
def gather_kernel(
    form: GatherForm, lanes: int, moves: bool, curved: bool, shaded: bool, query_moves: bool, with_motion: bool
) -> wp.Kernel:
    """The kernel that sums Eq. 8 for one form of footprint, specialised by what moves and what is wanted.

    One thread takes a group of neighbouring queries, walks the BVH once for each run of them, and lets every footprint
    that it finds fall on all of the run.
    """
    smooth = form.smooth
    # Shading normals change within a run, which parabolas do not see; their weights are found in as many lanes.
    parabolas = smooth and not shaded and lanes >= WEIGHTS_OF_PARABOLA
    collect = next_run(query_moves)
    place = place_footprint(smooth, moves, curved, shaded)
    reach_of_form = reach_of(form)
    add_parabola = _add_parabola(form, lanes, moves, curved) if parabolas else None
    add_to_leaf = _add_to_leaf(form, lanes, moves, curved, shaded, query_moves, with_motion)

    @kernel_of_lanes(lanes, lanes_in_vectors())
    def gather(
        base: int,
        # In
        bvh: wp.uint64,
        footprints: FootprintArrays,
        pieces: wp.array(dtype=Piece),
        courses: wp.array(dtype=Course),
        reaches: wp.array(dtype=Reach),
        durations: wp.array(dtype=wp.float32),
        run_size: float,
        windows: wp.array(dtype=TimeWindow),
        group_size: int,
        count: int,
        queries: QueryArrays,
        leaves: LeafArrays,
        # Out
        sums: LeafSums,
        out: IrradianceArrays,
    ):
        group = base + wp.tid()
        end = wp.min((group + 1) * group_size, count)
        start = group * group_size
        margin = wp.vec3(BOX_MARGIN, BOX_MARGIN, BOX_MARGIN)
        while start < end:
            # ---- Group queries
            run = collect(queries, start, end, run_size, windows)
            if not run.empty:
                radius = 0.5 * wp.length(run.high - run.low)
                run_since = run.window.center - run.window.time
                parabola = Parabola()
                number = int(0)
                query = wp.bvh_query_aabb(bvh, run.low - margin, run.high + margin)
                while wp.bvh_query_next(query, number):
                    piece = pieces[number]
                    wanted = not found_before(piece, run.low - margin, run.high + margin)
                    if run.receiver >= 0 and footprints.receiver[piece.footprint] != run.receiver:
                        wanted = False
                    if wp.static(query_moves):
                        if wanted:
                            wanted = not passes_by(courses[piece.footprint], run.window, run.middle, run.half)
                    else:
                        if wanted and reaches.shape[0] > 0:
                            known = reaches[piece.footprint]
                            wanted = not misses(known, run.middle - known.center, run.half)
                    if wanted:
                        # ---- Clip the shutter, place the footprint on its trajectory
                        j = piece.footprint
                        placed = place(footprints, durations, j, run.window)

                        # ---- Cull
                        last = run.stop
                        moved = placed.since * run.window.motion - placed.center
                        reach = reach_of_form(placed)
                        if not placed.overlap or misses(reach, run.middle + moved, run.half):
                            last = start
                        summed = bool(False)
                        if wp.static(parabolas):
                            offset = run.middle + moved
                            if last > start and is_parabola(run, start, placed, radius, run_since):
                                facing = wp.dot(run.normal, placed.normal)
                                height = wp.abs(wp.dot(placed.normal, offset))
                                thickness = 0.5 * wp.dot(wp.abs(placed.normal), run.high - run.low)
                                tolerance = placed.plane_tolerance
                                elsewhere = placed.receiver != run.receiver or height - thickness > tolerance
                                if elsewhere or facing < NEVER_FACING:
                                    last = start
                                elif facing > ALWAYS_FACING and height + thickness <= tolerance:
                                    summed = True

                            # ---- Add: wide footprints to the parabola of the run
                            if summed and last > start:
                                parabola = add_parabola(parabola, placed, offset, radius)
                                if not wp.static(with_motion):
                                    last = start

                        # ---- Add: the others to each query
                        dxdt = wp.vec3()
                        is_image = bool(False)
                        if wp.static(with_motion):
                            dxdt = own_dxdt(footprints, j) / durations[j]
                            is_image = of_image(footprints, j)
                        first = int(start)
                        while first < last:
                            leaf = first // LEAF
                            stop = wp.min(last, (leaf + 1) * LEAF)
                            missed = bool(False)
                            if wp.static(not query_moves):
                                missed = misses(reach, leaves.middle[leaf] - placed.center, leaves.half[leaf])
                            if not missed:
                                add_to_leaf(leaves, leaf, first, stop, placed, dxdt, is_image, summed, sums, out)
                            first = stop
                if parabola.used:
                    for i in range(start, run.stop):
                        if queries.receiver[i] >= 0:
                            d = queries.position[i] - run.middle
                            if wp.static(query_moves):
                                d += run_since * (queries.motion[i] - run.window.motion)
                            out.irradiance[i] = out.irradiance[i] + parabola_at(parabola, d)
            start = run.stop
        take_out(sums, group * group_size, end, out)

    return gather


def gather(
    footprints: FootprintMap,
    queries: QueryArrays,
    form: GatherForm,
    launcher: Launcher,
    lookup: Lookup = PLAIN_LOOKUP,
) -> Irradiance:
    """Irradiance that ``footprints`` leave at ``queries`` over a part of the shutter: Eq. 8 without the BRDF."""
    return irradiance_of(gathered([footprints], queries, form, launcher, lookup), lookup.with_motion)


def gathered(
    maps: Sequence[FootprintMap],
    queries: QueryArrays,
    form: GatherForm,
    launcher: Launcher,
    lookup: Lookup,
    windows: np.ndarray | None = None,
) -> IrradianceArrays:
    """The sum over several maps, on the device.

    Args:
        windows: Time, and middle and length of the window, of each query in the place of the lookup's, shape [n, 3].
            Where those that follow each other share a window, they are looked up together.
    """
    count = queries.position.shape[0]
    out = irradiance_arrays(count, lookup.with_motion, launcher)
    maps = [footprints for footprints in maps if footprints.count]
    if not maps:
        return out
    lanes = lanes_of(launcher)
    leaves = leaves_of(queries, count, lanes, lookup.query_moves, launcher)
    group_size = lanes if launcher.device.is_cuda else GROUP
    windows = lookup.windows() if windows is None else windows
    looks = time_windows(windows, launcher)
    whole = not lookup.query_moves and bool((windows[:, 2] >= 1.0).all())
    for footprints in maps:
        every = footprints.footprints
        moves = every.moves or lookup.query_moves
        shaded = every.shaded and has_shading_normals(queries)
        kernel = gather_kernel(form, lanes, moves, every.curved, shaded, lookup.query_moves, lookup.with_motion)
        photons = [footprints.bvh.id, every.arrays, footprints.pieces.rows]
        photons.append(every.courses if lookup.query_moves else launcher.zeros(0, Course))
        photons += [every.reaches(form) if whole else launcher.zeros(0, Reach), every.durations]
        sums = launcher.rows(LeafSums.of(lanes), leaves.middle.shape[0])
        inputs = [*photons, footprints.run_size, looks, group_size, count, queries, leaves, sums, out]
        launcher(kernel, -(-count // group_size), inputs, smallest_chunk=1)
    return out


def time_windows(windows: np.ndarray, launcher: Launcher) -> wp.array:
    """Time, and middle and length of the window, of each query or of all, shape [n, 3], on the device."""
    rows = np.zeros(len(windows), TimeWindow.numpy_dtype())
    rows["time"], rows["center"], rows["length"] = windows.T
    return wp.array(rows, dtype=TimeWindow, device=launcher.device)


def time_window(lookup: Lookup) -> TimeWindow:
    """The window of queries that stand at ``lookup.time`` and look over the part ``lookup.window``."""
    out = TimeWindow()
    out.time, (out.center, out.length) = lookup.time, lookup.window
    return out


def irradiance_arrays(count: int, with_motion: bool, launcher: Launcher) -> IrradianceArrays:
    """Zeroed sums for ``count`` queries."""
    out = IrradianceArrays()
    out.irradiance = launcher.zeros(count, wp.vec3)
    extra = count if with_motion else 0
    out.motion, out.weight = launcher.zeros(extra, wp.vec3), launcher.zeros(extra, wp.float32)
    out.photons = launcher.zeros(extra, wp.int32)
    return out


def irradiance_of(sums: IrradianceArrays, with_motion: bool) -> Irradiance:
    """The sums on the host."""
    if not with_motion:
        return Irradiance(sums.irradiance.numpy())
    return Irradiance(sums.irradiance.numpy(), sums.motion.numpy(), sums.weight.numpy(), sums.photons.numpy())
