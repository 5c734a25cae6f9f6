"""Footprints that go far beside their own size: the integral over the shutter in closed form.

What passes a query in a small part of the shutter is, while it does, a profile that goes along a line: the integral
over time is that of the footprint across the line, over its speed,

    ∫ K(y − x(s)) ds = K⊥(q)/|ẋ|        q = (y − x(s*)) × ẋ/|ẋ|,  s* when it is next to y

and a part of that next to where the shutter opens and closes. Across the line a cell and its pixel are four boxes, the
projections of their sides; a B-spline is one again, averaged over the boxes that it is averaged over anyway. So nodes
along the way are needed for footprints only that go slowly, or turn (:mod:`.bspline`).

Beyond the paper, whose swept footprints (Eq. 7) are lines as well, all along.
"""

from __future__ import annotations

import math

import warp as wp

from tpdwarp.footprints.bspline import HALF_WIDTH, Trajectory, box_extent, bspline_tail, double_tail
from tpdwarp.footprints.lane_counts import lane_func
from tpdwarp.footprints.lanes import Lanes, between, greater, lesser, not_negative, roots

# A line goes at least so many pixels, or halves of what a B-spline reaches over. Chosen, not derived: at the ends of a
# cell's line, an eighth of it, the profile along it is taken for a box; that of a B-spline is one, of which slower ones
# pass few nodes anyway.
SHORTEST_WAY_OF_CELL, SHORTEST_WAY_OF_BSPLINE = wp.constant(8.0), wp.constant(3.0)
# A box has the variance of a B-spline so many times narrower.
BOX_OF_BSPLINE = wp.constant(math.sqrt(3.0))
# It turns by no more than a radian, so that it passes nothing twice, and leaves its tangent by no more than this part
# of what it covers within that: half of the curvature.
LARGEST_TURN = wp.constant(1.0)
LARGEST_CURVATURE = wp.constant(0.04)
# Newton steps to where it passes a query: from a tenth of the shutter off, each squares what is missing.
STEPS = wp.constant(3)
# How far from its middle that is looked for: beyond what the footprint covers at its ends, a third of its way at most.
LATEST = wp.constant(0.85)
# Boxes are no narrower than these, in cells, or than this part of the widest, so that differences stay exact in
# float32: they add less than a hundredth to the variance of what falls on a pixel.
NARROWEST_BOX, NARROWEST_SECOND = wp.constant(0.1), wp.constant(0.05)
NARROWEST_PART = wp.constant(0.02)


@wp.func
def _measure(trajectory: Trajectory) -> wp.mat22:
    """Maps filter space to one in which what the footprint covers is as long as wide (beyond the paper).

    That of a cell is the pixel, of unit sides there; that of a B-spline reaches one to either side.
    """
    if trajectory.is_cell == 1:
        return wp.inverse(trajectory.pixel)
    cover_u = HALF_WIDTH + box_extent(trajectory.filter_width, 0)
    cover_v = HALF_WIDTH + box_extent(trajectory.filter_width, 1)
    return wp.mat22(1.0 / cover_u, 0.0, 0.0, 1.0 / cover_v)


@wp.func
def is_line(trajectory: Trajectory) -> bool:
    """Whether the footprint passes each query as a line (beyond the paper); discs have no such profile."""
    measure = _measure(trajectory)
    acceleration = wp.length(measure * trajectory.acceleration)
    jerk = wp.length(measure * trajectory.jerk)
    slowest = wp.length(measure * trajectory.velocity) - 0.5 * acceleration - 0.125 * jerk
    turning = acceleration + 0.5 * jerk
    shortest = wp.where(trajectory.is_cell == 1, SHORTEST_WAY_OF_CELL, SHORTEST_WAY_OF_BSPLINE)
    far = slowest > shortest and trajectory.filter_width[2] >= 0.0
    return far and turning < LARGEST_TURN * slowest and turning < LARGEST_CURVATURE * slowest * slowest


@lane_func
def _place(s: Lanes, velocity: float, acceleration: float, jerk: float) -> Lanes:
    """Where the footprint stands along an axis at the parts s of the shutter (beyond the paper)."""
    third = Lanes(0.5 * acceleration) + (jerk / 6.0) * s
    return wp.cw_mul(s, Lanes(velocity) + wp.cw_mul(s, third))


@lane_func
def _speed(s: Lanes, velocity: float, acceleration: float, jerk: float) -> Lanes:
    """How fast it goes along an axis then (beyond the paper)."""
    change = Lanes(acceleration) + (0.5 * jerk) * s
    return Lanes(velocity) + wp.cw_mul(s, change)


@lane_func
def _time_of_passing(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
    """When the footprint passes the points (u, v): when it is next to them by what it covers (beyond the paper)."""
    measure = _measure(trajectory)
    velocity = measure * trajectory.velocity
    acceleration = measure * trajectory.acceleration
    jerk = measure * trajectory.jerk
    first = measure[0, 0] * u + measure[0, 1] * v
    second = measure[1, 0] * u + measure[1, 1] * v
    s = (velocity[0] * first + velocity[1] * second) / wp.length_sq(velocity)
    s = between(s, Lanes(-LATEST), Lanes(LATEST))
    for _step in range(STEPS):
        away = Lanes(0.0)
        slope = Lanes(0.0)
        for axis in range(2):
            at = first
            if axis == 1:
                at = second
            apart = at - _place(s, velocity[axis], acceleration[axis], jerk[axis])
            speed = _speed(s, velocity[axis], acceleration[axis], jerk[axis])
            away += wp.cw_mul(apart, speed)
            slope += wp.cw_mul(speed, speed) - wp.cw_mul(apart, Lanes(acceleration[axis]) + jerk[axis] * s)
        s = s + wp.cw_div(away, greater(slope, Lanes(1.0e-20)))
        s = between(s, Lanes(-LATEST), Lanes(LATEST))
    return s


@lane_func
def _length(x: Lanes, y: Lanes) -> Lanes:
    """√(x² + y²), for profiles across lines (beyond the paper)."""
    return roots(wp.cw_mul(x, x) + wp.cw_mul(y, y))


@lane_func
def four_boxes(x: Lanes, a: Lanes, b: Lanes, c: Lanes, d: Lanes) -> Lanes:
    """Mean of a box over three others, with ∫ = 1 (beyond the paper); the narrowest two count as one.

    Of three boxes it is the third difference of x |x|/4.
    """
    wider = lesser(greater(a, b), greater(c, d))
    narrower = greater(lesser(a, b), lesser(c, d))
    first = 0.5 * greater(greater(a, b), greater(c, d))
    floor = NARROWEST_PART * first
    second = greater(0.5 * greater(wider, narrower), floor)
    third = greater(0.5 * _length(lesser(wider, narrower), lesser(lesser(a, b), lesser(c, d))), floor)
    total = Lanes(0.0)
    for corner in range(8):
        sign_a = float(1 - 2 * (corner % 2))
        sign_b = float(1 - 2 * (corner // 2 % 2))
        sign_c = float(1 - 2 * (corner // 4))
        at = x + sign_a * first + sign_b * second + sign_c * third
        total += (sign_a * sign_b * sign_c) * wp.cw_mul(at, wp.abs(at))
    # Beyond them differences are rounding.
    within = not_negative(first + second + third - wp.abs(x))
    area = 32.0 * wp.cw_mul(wp.cw_mul(first, second), third)
    return wp.cw_div(wp.cw_mul(within, greater(total, Lanes(0.0))), area)


@lane_func
def bspline_and_boxes(x: Lanes, cell: Lanes, first: Lanes, second: Lanes) -> Lanes:
    """Mean of a B-spline with cells of a width over two boxes, with ∫ = 1 (beyond the paper)."""
    one = greater(wp.cw_div(first, cell), Lanes(NARROWEST_BOX))
    other = greater(wp.cw_div(second, cell), Lanes(NARROWEST_SECOND))
    at = wp.cw_div(x, cell)
    both = 0.5 * (one + other)
    apart = 0.5 * (one - other)
    total = double_tail(at + both) + double_tail(at - both) - double_tail(at + apart) - double_tail(at - apart)
    return wp.cw_div(greater(total, Lanes(0.0)), wp.cw_mul(wp.cw_mul(one, other), cell))


@lane_func
def line_weight(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
    """w(u, v, trajectory) of Eq. 8 of a footprint that :func:`is_line` (beyond the paper)."""
    s = _time_of_passing(u, v, trajectory)
    inside = between(s, Lanes(-0.5), Lanes(0.5))

    # ---- How fast it goes when it passes, and where queries are beside the line
    velocity = trajectory.velocity
    acceleration = trajectory.acceleration
    jerk = trajectory.jerk
    speed_u = _speed(s, velocity[0], acceleration[0], jerk[0])
    speed_v = _speed(s, velocity[1], acceleration[1], jerk[1])
    slowness = wp.cw_div(Lanes(1.0), _length(speed_u, speed_v))
    ahead_u = wp.cw_mul(speed_u, slowness)
    ahead_v = wp.cw_mul(speed_v, slowness)
    apart_u = u - _place(s, velocity[0], acceleration[0], jerk[0])
    apart_v = v - _place(s, velocity[1], acceleration[1], jerk[1])
    across = wp.cw_mul(apart_u, ahead_v) - wp.cw_mul(apart_v, ahead_u)

    # ---- The sides of its cell as they are then: across the line, and along it by what the footprint covers
    rate = trajectory.jacobian_rate
    one_u = Lanes(1.0) + rate[0, 0] * inside
    one_v = rate[1, 0] * inside
    other_u = rate[0, 1] * inside
    other_v = Lanes(1.0) + rate[1, 1] * inside
    one_across = wp.abs(wp.cw_mul(one_u, ahead_v) - wp.cw_mul(one_v, ahead_u))
    other_across = wp.abs(wp.cw_mul(other_u, ahead_v) - wp.cw_mul(other_v, ahead_u))
    measure = _measure(trajectory)
    way_u = measure[0, 0] * speed_u + measure[0, 1] * speed_v
    way_v = measure[1, 0] * speed_u + measure[1, 1] * speed_v
    way = _length(way_u, way_v)
    one_along = wp.cw_mul(way_u, measure[0, 0] * one_u + measure[0, 1] * one_v)
    one_along = wp.cw_div(one_along + wp.cw_mul(way_v, measure[1, 0] * one_u + measure[1, 1] * one_v), way)
    other_along = wp.cw_mul(way_u, measure[0, 0] * other_u + measure[0, 1] * other_v)
    other_along = wp.cw_div(other_along + wp.cw_mul(way_v, measure[1, 0] * other_u + measure[1, 1] * other_v), way)
    length = _length(one_along, other_along)

    # ---- Its profile across the line, and its length: that of a box of its variance
    profile = Lanes(0.0)
    if trajectory.is_cell == 1:
        pixel = trajectory.pixel
        p = wp.abs(pixel[0, 0] * ahead_v - pixel[1, 0] * ahead_u)
        q = wp.abs(pixel[0, 1] * ahead_v - pixel[1, 1] * ahead_u)
        profile = four_boxes(across, one_across, other_across, p, q)
        # The pixel has unit sides as it is measured.
        length = _length(length, Lanes(1.0))
    else:
        width = trajectory.filter_width
        box_u = width[0] * wp.abs(ahead_v)
        box_v = wp.max(width[1], width[2]) * wp.abs(ahead_u)
        rest = _length(lesser(box_u, box_v), wp.min(width[1], width[2]) * ahead_u)
        profile = bspline_and_boxes(across, _length(one_across, other_across), greater(box_u, box_v), rest)
        boxes = _length(
            (width[0] * measure[0, 0]) * wp.cw_div(way_u, way),
            (wp.length(wp.vec2(width[1], width[2])) * measure[1, 1]) * wp.cw_div(way_v, way),
        )
        length = _length(BOX_OF_BSPLINE * length, boxes)

    # ---- What passes within the shutter, with the flux that it has then
    part = Lanes(-1.0)
    for end in range(2):
        left = wp.cw_div(wp.cw_mul(way, Lanes(0.5) + float(1 - 2 * end) * s), length)
        if trajectory.is_cell == 1:
            part += between(Lanes(0.5) + left, Lanes(0.0), Lanes(1.0))
        else:
            beyond = bspline_tail(BOX_OF_BSPLINE * wp.abs(left))
            part += beyond + wp.cw_mul(not_negative(left), Lanes(1.0) - 2.0 * beyond)
    weight = wp.cw_mul(wp.cw_mul(profile, slowness), greater(part, Lanes(0.0)))
    return wp.cw_mul(weight, Lanes(1.0) + trajectory.gain * inside)
