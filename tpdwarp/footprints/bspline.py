"""The quadratic B-spline footprint: averaged over a pixel, and over the shutter while it moves, curves and grows.

Beyond the paper: with photons on a lattice, translates of the B-spline by one cell sum to one, so that light is smooth
without noise and the error falls with the number of photons. It lives in filter space, where lattice cells have unit
sides; weights integrate to one there, and |det M| scales them to the surface.

The degree is two. A B-spline of degree d blurs light by its variance (d + 1)/12 cells²: the cubic one errs more at
folds and costs nine sixteenths more; the linear one errs less there, but leaves the lattice's creases in smooth light
(measured with ``scripts/benchmarks/run.py accuracy`` while there were all three). Averaged over the filter width of a
query, its translates still sum to one; those of a B-spline that is stretched beyond its cells do not.

What depends on a query is evaluated for sixteen of them at once (:mod:`tpdwarp.footprints.lanes`), without branches
that differ between them.
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

from tpdwarp.footprints.cells import cell_weight, pixel_extent
from tpdwarp.footprints.lane_counts import func_of_lanes, lane_func
from tpdwarp.footprints.lanes import LANES, Lanes, between, greater, greatest, least, lesser

# Half the width of the B-spline of degree two, in cells: (degree + 1)/2.
SUPPORT = 1.5

TWELFTH = wp.constant(1.0 / 12.0)
SIXTH = wp.constant(1.0 / 6.0)
# Nodes of Gauss's rule with two points lie this far from the middle of their panel, as a part of it.
GAUSS_OFFSET = wp.constant(0.5 / math.sqrt(3.0))
# Panels of the rule over the shutter; of more, single precision (24 bits) would not resolve a sixteenth.
MOST_PANELS = wp.constant(1.0e6)
HALF_WIDTH = wp.constant(SUPPORT)
HALF_CELL = wp.constant(0.5)
# Of two boxes the narrower is no less than this part of the wider one, to whose variance that adds a hundredth.
NARROWEST = wp.constant(0.1)
# The radius of a disc in filter space, where a disc of that radius has a variance of one, and its area.
DISC_RADIUS = wp.constant(2.0)
DISC_AREA = wp.constant(4.0 * math.pi)
# Where the rim is taken for a parabola: of the variance along its tangent, and of the mean of that one's square.
RIM_SAG = wp.constant(1.0 / (12.0 * 2.0 * 2.0))
RIM_EXCESS = wp.constant(1.0 / (8.0 * 4.0 * 2.0**4))


@wp.func
def quadratic_bspline(x: float) -> float:
    """b(x), centred, with support (−3/2, 3/2) and ∫ b = 1: beyond the paper, beside the kernels of Table 1."""
    outer = greater(1.5 - wp.abs(x), 0.0)
    inner = greater(0.5 - wp.abs(x), 0.0)
    return 0.5 * outer * outer - 1.5 * inner * inner


@wp.func
def bspline_tail(x: float) -> float:
    """∫ b from x ≥ 0 to the end of its support, for averages over a box (beyond the paper)."""
    outer = greater(1.5 - x, 0.0)
    inner = greater(0.5 - x, 0.0)
    return SIXTH * outer * outer * outer - 0.5 * inner * inner * inner


@wp.func
def averaged_bspline(x: float, width: float) -> float:
    """Mean of b over an interval of ``width`` around x: a pixel's average along one axis (beyond the paper).

    It is a difference of tails, so that it is exact near the rim.
    """
    distance = wp.abs(x)
    half = 0.5 * width
    near = bspline_tail(wp.abs(distance - half))
    beyond = bspline_tail(distance + half)
    return (wp.where(distance <= half, 1.0 - near, near) - beyond) / width


@wp.func
def double_tail(x: float) -> float:
    """∫ of the tail from |x| on, plus |x|/2, which second differences do not see: even, convex (beyond the paper)."""
    distance = wp.abs(x)
    outer = greater(1.5 - distance, 0.0)
    inner = greater(0.5 - distance, 0.0)
    outer = outer * outer
    inner = inner * inner
    return outer * outer / 24.0 - 0.125 * inner * inner + 0.5 * distance


@wp.func
def twice_averaged_bspline(x: float, width: float, second: float) -> float:
    """Mean of b over an interval of ``width``, and of that over one of ``second`` (beyond the paper).

    Across a line, a pixel is two such boxes: the projections of its sides.
    """
    both = 0.5 * (width + second)
    apart = 0.5 * (width - second)
    outer = double_tail(x + both) + double_tail(x - both)
    inner = double_tail(x + apart) + double_tail(x - apart)
    return greater(outer - inner, 0.0) / (width * second)


@wp.func
def averaged_disc(u: float, v: float, pixel: wp.mat22) -> float:
    """A disc of radius 2 averaged over a parallelogram around (u, v), with ∫ = 1 (beyond the paper).

    It is the image of a round light as pixels see it. Within the parallelogram the rim is a parabola about its tangent
    there: where that passes the middle at a distance d, the mean is that of a half plane d − V_t/(2R) away, with V_t
    the variance along the tangent. So the integral is π R² times 1 + ⟨V_t²⟩/(4 R⁴), by which it is divided; V_t² is
    (2 tr V² + tr² V)/8 on average over all directions.

    Args:
        pixel: The sides of the parallelogram, as columns.
    """
    distance = wp.sqrt(u * u + v * v)
    nearness = 1.0 / greater(distance, 1.0e-6)
    one = wp.abs(pixel[0, 0] * u + pixel[1, 0] * v) * nearness
    other = wp.abs(pixel[0, 1] * u + pixel[1, 1] * v) * nearness
    tangent = wp.ddot(pixel, pixel) - one * one - other * other
    inside = DISC_RADIUS - distance - RIM_SAG * tangent
    # The half plane in two boxes: second differences of half a square, divided by both of their sides.
    wide = greater(greater(one, other), 1.0e-3)
    narrow = greater(lesser(one, other), NARROWEST * wide)
    both = 0.5 * (wide + narrow)
    apart = 0.5 * (wide - narrow)
    inside = between(inside, -both, both)
    full = inside + both
    outer = greater(inside + apart, 0.0)
    inner = greater(inside - apart, 0.0)
    area = full * full - outer * outer - inner * inner
    variance = TWELFTH * (pixel * wp.transpose(pixel))
    squared = 2.0 * wp.ddot(variance, variance) + wp.trace(variance) * wp.trace(variance)
    return area / (wide * narrow) / (2.0 * DISC_AREA * (1.0 + RIM_EXCESS * squared))


@wp.func
def disc_widths(pixel: wp.mat22, softness: float) -> wp.vec3:
    """Filter widths that stand for a disc (beyond the paper): the last one is below zero, and the bounds hold.

    Args:
        pixel: The sides of what it is averaged over, as columns.
        softness: How far its edge fades to either side, at least, as a part of its radius.
    """
    reach_u = 2.0 * (DISC_RADIUS - HALF_WIDTH + pixel_extent(pixel, 0))
    reach_v = 2.0 * (DISC_RADIUS - HALF_WIDTH + pixel_extent(pixel, 1))
    return wp.vec3(reach_u, reach_v + softness, -softness)


@wp.struct
class Trajectory:
    """How a footprint moves over the shutter, in its own filter space at mid shutter.

    At the part s (−½ … ½) of the shutter its centre stands at s velocity + ½ s² acceleration + ⅙ s³ jerk, and its axes
    are those of mid shutter times 1 + s jacobian_rate; its flux is that of mid shutter times 1 + s gain. Only the
    B-spline's trajectory curves, and only its axes and its flux grow.
    ``filter_width`` holds the widths of the boxes that it is averaged over, in cells, one along u and two along v; they
    stay. Where the last is below zero it is a disc (:func:`disc_widths`); where ``is_cell`` is 1 a cell. Both are
    averaged over the pixel whose sides are the columns of ``pixel``, which stays, too. ``straight`` is set where it
    does not curve and its axes do not grow, ``passes`` where it passes queries as a line (:mod:`.lines`).
    """

    velocity: wp.vec2
    acceleration: wp.vec2
    jerk: wp.vec2
    jacobian_rate: wp.mat22
    gain: float
    filter_width: wp.vec3
    pixel: wp.mat22
    is_cell: int
    straight: bool
    passes: bool


@wp.func
def place_at(s: float, trajectory: Trajectory) -> wp.vec2:
    """Where the footprint stands at the part s of the shutter (beyond the paper)."""
    return s * (trajectory.velocity + (0.5 * s) * (trajectory.acceleration + (s / 3.0) * trajectory.jerk))


@lane_func
def _time_within(u: Lanes, v: Lanes, velocity: wp.vec2, extent: wp.vec2) -> wp.vec2:
    """From when to when, in −½ … ½, any of the points (u, v) lies within ``extent`` of what moves by ``velocity``.

    These are the limits of the integral over the shutter (beyond the paper).
    """
    slowness = wp.vec2(1.0e9, 1.0e9)
    for axis in range(2):
        if wp.abs(velocity[axis]) > 1.0e-9:
            slowness[axis] = 1.0 / velocity[axis]
    low = Lanes(0.0)
    high = Lanes(0.0)
    lane = int(0)
    while lane < LANES:
        a_u = slowness[0] * (u[lane] - extent[0])
        b_u = slowness[0] * (u[lane] + extent[0])
        a_v = slowness[1] * (v[lane] - extent[1])
        b_v = slowness[1] * (v[lane] + extent[1])
        since = greater(greater(lesser(a_u, b_u), lesser(a_v, b_v)), -0.5)
        until = lesser(lesser(greater(a_u, b_u), greater(a_v, b_v)), 0.5)
        # Those that it never reaches, later than its end and before its beginning.
        missed = wp.where(until < since, 1.0, 0.0)
        low[lane] = since + missed
        high[lane] = until - missed
        lane += 1
    return wp.vec2(least(low), greatest(high))


@wp.func
def _relative_cell(square: float) -> float:
    """One cell as a part of the cells of a plain B-spline that has the variance of one averaged over a box.

    It says how many nodes the integral over the shutter (beyond the paper) needs. ``square`` is width². The deviation
    of both together, over that of the B-spline alone, is √(1 + width²/3); boxes have edges, of which nodes half as far
    apart see enough (at 262 144 photons folds err by 0.0018, 0.0024 without the factor, 0.0065 at the whole distance;
    scripts/benchmarks/run.py accuracy).
    """
    return wp.where(square > 0.0, 1.6, 1.0) / wp.sqrt(1.0 + TWELFTH * square)


@lane_func
def panels_to(u: Lanes, v: Lanes, middle: float, rates: wp.vec2, reach: wp.vec2, trajectory: Trajectory) -> int:
    """How many panels of the integral (beyond the paper) pass at least until the footprint may reach any (u, v).

    It is 0 if it does.

    Args:
        middle: Time of a panel's middle.
        rates: Panels in which it moves by a cell along either axis, at least.
        reach: The most that it reaches along either axis while it stands, in cells.
    """
    there = place_at(middle, trajectory)
    panels = Lanes(0.0)
    lane = int(0)
    while lane < LANES:
        beside_u = rates[0] * (wp.abs(u[lane] - there[0]) - reach[0])
        beside_v = rates[1] * (wp.abs(v[lane] - there[1]) - reach[1])
        panels[lane] = greater(greater(beside_u, beside_v) - 0.5, 0.0)
        lane += 1
    fewest = least(panels)
    if fewest > 0.0:
        return 1 + int(wp.min(fewest, MOST_PANELS))
    return 0


@wp.func
def box_extent(width: wp.vec3, axis: int) -> float:
    """Half the widths of the boxes along an axis, which a pixel's average (beyond the paper) adds to a footprint."""
    if axis == 0:
        return 0.5 * width[0]
    return 0.5 * (width[1] + width[2])


@wp.func
def trajectory_extent(trajectory: Trajectory, axis: int) -> float:
    """How far along an axis the footprint reaches to either side of its straight trajectory (beyond the paper).

    It bounds what the footprint covers over the whole shutter.
    """
    growth = 0.5 * (wp.abs(trajectory.jacobian_rate[axis, 0]) + wp.abs(trajectory.jacobian_rate[axis, 1]))
    reach = HALF_WIDTH * (1.0 + growth) + box_extent(trajectory.filter_width, axis)
    if trajectory.is_cell == 1:
        reach = HALF_CELL * (1.0 + growth) + pixel_extent(trajectory.pixel, axis)
    return reach + bend_extent(trajectory, axis)


@wp.func
def bend_extent(trajectory: Trajectory, axis: int) -> float:
    """How far along an axis a trajectory leaves its straight line (beyond the paper): ½ s² and ⅙ s³ at s = ±½."""
    return 0.125 * wp.abs(trajectory.acceleration[axis]) + wp.abs(trajectory.jerk[axis]) / 48.0


@lane_func
def _along_axis(x: Lanes, width: float, second: float) -> Lanes:
    """b, averaged over as many boxes as it has (beyond the paper): each of them costs as much again."""
    out = Lanes(0.0)
    lane = int(0)
    if second > 0.0:
        while lane < LANES:
            out[lane] = twice_averaged_bspline(x[lane], width, second)
            lane += 1
    elif width > 0.0:
        while lane < LANES:
            out[lane] = averaged_bspline(x[lane], width)
            lane += 1
    else:
        while lane < LANES:
            out[lane] = quadratic_bspline(x[lane])
            lane += 1
    return out


@cache
def _over_pixels(lanes: int, one: wp.Function) -> wp.Function:
    """``one`` (u, v, pixel), a mean over a pixel, by lanes (beyond the paper)."""

    @func_of_lanes(lanes)
    def over_pixels(u: Lanes, v: Lanes, pixel: wp.mat22) -> Lanes:
        out = Lanes(0.0)
        lane = int(0)
        while lane < LANES:
            out[lane] = one(u[lane], v[lane], pixel)
            lane += 1
        return out

    return over_pixels


@wp.func
def _reach_along(axis: int, growth: float, trajectory: Trajectory) -> float:
    """How far w (beyond the paper) reaches while it stands, with axes that grow by ``growth`` of themselves."""
    if trajectory.is_cell == 1:
        return HALF_CELL * (1.0 + growth) + pixel_extent(trajectory.pixel, axis)
    return HALF_WIDTH * (1.0 + growth) + box_extent(trajectory.filter_width, axis)


@wp.func
def _squared_width(axis: int, trajectory: Trajectory) -> float:
    """The square of the width of what w (beyond the paper) is averaged over along an axis."""
    if trajectory.is_cell == 1:
        return (
            trajectory.pixel[axis, 0] * trajectory.pixel[axis, 0]
            + trajectory.pixel[axis, 1] * trajectory.pixel[axis, 1]
        )
    square = trajectory.filter_width[axis] * trajectory.filter_width[axis]
    if axis == 1:
        square += trajectory.filter_width[2] * trajectory.filter_width[2]
    return square


@cache
def bspline_weight(lanes: int, moves: bool, curved: bool, extended: bool = False) -> wp.Function:
    """w(u, v, trajectory) of a B-spline footprint, or of a cell, (beyond the paper) at queries, by so many lanes.

    It is ∫ b(y − x(s)) ds over s ∈ [−½, ½], by two Gauss nodes for each cell that the footprint moves, of which only
    those are visited that lie inside the support of any query. The nodes do not depend on the queries (u, v), which are
    relative to where it stands at mid shutter, so that translates by one cell sum to one while they sweep, too.

    ``extended`` says whether there may be discs, the images of lights with extent.
    """
    cells, discs = (_over_pixels(lanes, one) for one in (cell_weight, averaged_disc))

    @func_of_lanes(lanes)
    def tensor(u: Lanes, v: Lanes, width: wp.vec3, pixel: wp.mat22, is_cell: int) -> Lanes:
        """b(y_u) b(y_v), each averaged over its boxes where it has any; a disc, or a cell."""
        if is_cell == 1:
            return cells(u, v, pixel)
        if wp.static(extended):
            if width[2] < 0.0:
                return discs(u, v, pixel)
        along_u = _along_axis(u, width[0], 0.0)
        along_v = _along_axis(v, width[1], width[2])
        out = Lanes(0.0)
        lane = int(0)
        while lane < LANES:
            out[lane] = along_u[lane] * along_v[lane]
            lane += 1
        return out

    @func_of_lanes(lanes)
    def still(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
        return tensor(u, v, trajectory.filter_width, trajectory.pixel, trajectory.is_cell)

    if not moves:
        return still

    @func_of_lanes(lanes)
    def at_time(s: float, u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
        """The weight at the part s of the shutter, with axes and flux as they are then."""
        rate = trajectory.jacobian_rate
        width = trajectory.filter_width
        grown_u = 1.0 + s * rate[0, 0]
        grown_v = 1.0 + s * rate[1, 1]
        area = grown_u * grown_v - s * s * rate[0, 1] * rate[1, 0]
        scale = 1.0 / area
        moved = place_at(s, trajectory)
        z_u = Lanes(0.0)
        z_v = Lanes(0.0)
        lane = int(0)
        while lane < LANES:
            from_u = u[lane] - moved[0]
            from_v = v[lane] - moved[1]
            z_u[lane] = scale * (grown_v * from_u - (s * rate[0, 1]) * from_v)
            z_v[lane] = scale * (grown_u * from_v - (s * rate[1, 0]) * from_u)
            lane += 1
        boxes = scale * wp.vec3(grown_v * width[0], grown_u * width[1], grown_u * width[2])
        pixel = trajectory.pixel
        if trajectory.is_cell == 1:
            pixel = scale * (wp.mat22(grown_v, -s * rate[0, 1], -s * rate[1, 0], grown_u) * pixel)
        return ((1.0 + s * trajectory.gain) * scale) * tensor(z_u, z_v, boxes, pixel, trajectory.is_cell)

    @func_of_lanes(lanes)
    def moving(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
        growth = float(0.0)
        if wp.static(curved):
            for axis in range(2):
                rates = wp.abs(trajectory.jacobian_rate[axis, 0]) + wp.abs(trajectory.jacobian_rate[axis, 1])
                growth = wp.max(growth, 0.5 * rates)
        reach = wp.vec2(_reach_along(0, growth, trajectory), _reach_along(1, growth, trajectory))
        extent = reach
        if wp.static(curved):
            extent += wp.vec2(bend_extent(trajectory, 0), bend_extent(trajectory, 1))
        within = _time_within(u, v, trajectory.velocity, extent)
        if within[1] <= within[0]:
            return Lanes(0.0)
        speed = float(0.0)
        speeds = wp.vec2(0.0, 0.0)
        for axis in range(2):
            fastest = wp.abs(trajectory.velocity[axis])
            if wp.static(curved):
                fastest += 0.5 * wp.abs(trajectory.acceleration[axis]) + 0.125 * wp.abs(trajectory.jerk[axis])
            speeds[axis] = fastest
            speed = wp.max(speed, fastest * _relative_cell(_squared_width(axis, trajectory)))
        if speed == 0.0 and growth == 0.0:
            return tensor(u, v, trajectory.filter_width, trajectory.pixel, trajectory.is_cell)
        panels = wp.ceil(wp.clamp(speed, 1.0, MOST_PANELS))
        first = int(wp.floor((within[0] + 0.5) * panels))
        last = int(wp.ceil((within[1] + 0.5) * panels))
        total = Lanes(0.0)
        step = 1.0 / panels
        if wp.static(curved):
            if not trajectory.straight:
                panel = int(first)
                panel_rates = wp.vec2(1.0 / wp.max(speeds[0] * step, 1.0e-6), 1.0 / wp.max(speeds[1] * step, 1.0e-6))
                while panel < last:
                    middle = (float(panel) + 0.5) * step - 0.5
                    apart = panels_to(u, v, middle, panel_rates, reach, trajectory)
                    if apart == 0:
                        total += at_time(middle - GAUSS_OFFSET * step, u, v, trajectory)
                        total += at_time(middle + GAUSS_OFFSET * step, u, v, trajectory)
                    panel += wp.max(apart, 1)
                return (0.5 * step) * total
        for panel in range(first, last):
            middle_time = (float(panel) + 0.5) * step - 0.5
            moved = middle_time * trajectory.velocity
            offset = (GAUSS_OFFSET * step) * trajectory.velocity
            there_u = u - Lanes(moved[0])
            there_v = v - Lanes(moved[1])
            width = trajectory.filter_width
            pixel = trajectory.pixel
            is_cell = trajectory.is_cell
            early = tensor(there_u + Lanes(offset[0]), there_v + Lanes(offset[1]), width, pixel, is_cell)
            late = tensor(there_u - Lanes(offset[0]), there_v - Lanes(offset[1]), width, pixel, is_cell)
            total += early + late
            if wp.static(curved):
                shift = GAUSS_OFFSET * step
                total += (trajectory.gain * (middle_time - shift)) * early
                total += (trajectory.gain * (middle_time + shift)) * late
        return (0.5 * step) * total

    return moving
