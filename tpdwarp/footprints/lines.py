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

from tpdwarp.footprints.bspline import HALF_WIDTH, Trajectory, box_extent, bspline_tail, twice_averaged_bspline
from tpdwarp.footprints.lanes import LANES, Lanes, not_negative

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
# How far beyond the shutter that is looked for: beyond what the footprint covers at its ends, an eighth of it.
LATEST = wp.constant(0.75)
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
    """Whether the footprint passes each query as a line (beyond the paper); soft discs have no such profile."""
    measure = _measure(trajectory)
    acceleration = wp.length(measure * trajectory.acceleration)
    jerk = wp.length(measure * trajectory.jerk)
    slowest = wp.length(measure * trajectory.velocity) - 0.5 * acceleration - 0.125 * jerk
    turning = acceleration + 0.5 * jerk
    shortest = wp.where(trajectory.is_cell == 1, SHORTEST_WAY_OF_CELL, SHORTEST_WAY_OF_BSPLINE)
    far = slowest > shortest and trajectory.filter_width[2] >= 0.0
    return far and turning < LARGEST_TURN * slowest and turning < LARGEST_CURVATURE * slowest * slowest


@wp.func
def _place(s: Lanes, velocity: float, acceleration: float, jerk: float) -> Lanes:
    """Where the footprint stands along an axis at the parts s of the shutter (beyond the paper)."""
    third = Lanes(0.5 * acceleration) + (jerk / 6.0) * s
    return wp.cw_mul(s, Lanes(velocity) + wp.cw_mul(s, third))


@wp.func
def _speed(s: Lanes, velocity: float, acceleration: float, jerk: float) -> Lanes:
    """How fast it goes along an axis then (beyond the paper)."""
    change = Lanes(acceleration) + (0.5 * jerk) * s
    return Lanes(velocity) + wp.cw_mul(s, change)


@wp.func
def _time_of_passing(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
    """When the footprint passes the points (u, v): when it is next to them by what it covers (beyond the paper)."""
    measure = _measure(trajectory)
    velocity = measure * trajectory.velocity
    acceleration = measure * trajectory.acceleration
    jerk = measure * trajectory.jerk
    first = measure[0, 0] * u + measure[0, 1] * v
    second = measure[1, 0] * u + measure[1, 1] * v
    s = (velocity[0] * first + velocity[1] * second) / wp.length_sq(velocity)
    s = wp.min(wp.max(s, Lanes(-LATEST)), Lanes(LATEST))
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
        s = s + wp.cw_div(away, wp.max(slope, Lanes(1.0e-20)))
        s = wp.min(wp.max(s, Lanes(-LATEST)), Lanes(LATEST))
    return s


@wp.func
def _lengths_passed(trajectory: Trajectory, velocity: wp.vec2) -> float:
    """How many of its own lengths the footprint goes within the shutter (beyond the paper).

    Its length is that of a box of its variance along its way, beside a query that it passes aside of its middle.
    """
    measure = _measure(trajectory)
    way = measure * velocity
    ahead = wp.normalize(way)
    along_u = wp.dot(ahead, wp.vec2(measure[0, 0], measure[1, 0]))
    along_v = wp.dot(ahead, wp.vec2(measure[0, 1], measure[1, 1]))
    square = along_u * along_u + along_v * along_v
    if trajectory.is_cell == 1:
        # The pixel has unit sides there.
        square += 1.0
    else:
        width = trajectory.filter_width
        square *= 3.0
        square += along_u * along_u * width[0] * width[0]
        square += along_v * along_v * (width[1] * width[1] + width[2] * width[2])
    return wp.length(way) / wp.sqrt(square)


@wp.func
def four_boxes(x: Lanes, a: float, b: float, c: float, d: float) -> Lanes:
    """Mean of a box over three others, with ∫ = 1 (beyond the paper); the narrowest two count as one.

    Of three boxes it is the third difference of x |x|/4.
    """
    wider = wp.min(wp.max(a, b), wp.max(c, d))
    narrower = wp.max(wp.min(a, b), wp.min(c, d))
    least = wp.min(wp.min(a, b), wp.min(c, d))
    first = 0.5 * wp.max(wp.max(a, b), wp.max(c, d))
    floor = NARROWEST_PART * first
    second = wp.max(0.5 * wp.max(wider, narrower), floor)
    third = wp.max(0.5 * wp.sqrt(wp.min(wider, narrower) * wp.min(wider, narrower) + least * least), floor)
    total = Lanes(0.0)
    for corner in range(8):
        sign = wp.vec3(
            float(1 - 2 * (corner % 2)), float(1 - 2 * (corner // 2 % 2)), float(1 - 2 * (corner // 4))
        )
        at = x + Lanes(wp.dot(sign, wp.vec3(first, second, third)))
        total += (sign[0] * sign[1] * sign[2]) * wp.cw_mul(at, wp.abs(at))
    # Beyond them differences are rounding.
    within = not_negative(Lanes(first + second + third) - wp.abs(x))
    return wp.cw_mul(within, wp.max(total, Lanes(0.0))) / (32.0 * first * second * third)


@wp.func
def line_weight(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
    """w(u, v, trajectory) of Eq. 8 of a footprint that :func:`is_line` (beyond the paper).

    What axes grow by is that of the mean time at which it passes the queries.
    """
    s = _time_of_passing(u, v, trajectory)
    inside = wp.min(wp.max(s, Lanes(-0.5)), Lanes(0.5))
    middle = wp.dot(inside, Lanes(1.0 / float(LANES)))

    # ---- Where queries are beside the line, and how fast it goes, with the axes as they are then
    inverse = wp.inverse(wp.identity(n=2, dtype=float) + middle * trajectory.jacobian_rate)
    velocity = trajectory.velocity
    acceleration = trajectory.acceleration
    jerk = trajectory.jerk
    apart_u = u - _place(s, velocity[0], acceleration[0], jerk[0])
    apart_v = v - _place(s, velocity[1], acceleration[1], jerk[1])
    speed_u = _speed(s, velocity[0], acceleration[0], jerk[0])
    speed_v = _speed(s, velocity[1], acceleration[1], jerk[1])
    along_u = inverse[0, 0] * speed_u + inverse[0, 1] * speed_v
    along_v = inverse[1, 0] * speed_u + inverse[1, 1] * speed_v
    z_u = inverse[0, 0] * apart_u + inverse[0, 1] * apart_v
    z_v = inverse[1, 0] * apart_u + inverse[1, 1] * apart_v
    slowness = wp.cw_mul(along_u, along_u) + wp.cw_mul(along_v, along_v)
    for lane in range(LANES):
        slowness[lane] = 1.0 / wp.sqrt(slowness[lane])
    across = wp.cw_mul(wp.cw_mul(z_u, along_v) - wp.cw_mul(z_v, along_u), slowness)

    # ---- The profile across it
    then = velocity + middle * (acceleration + (0.5 * middle) * jerk)
    ahead = wp.normalize(inverse * then)
    aside = wp.vec2(-ahead[1], ahead[0])
    profile = Lanes(0.0)
    if trajectory.is_cell == 1:
        pixel = inverse * trajectory.pixel
        p = wp.vec2(pixel[0, 0], pixel[1, 0])
        q = wp.vec2(pixel[0, 1], pixel[1, 1])
        profile = four_boxes(
            across, wp.abs(aside[0]), wp.abs(aside[1]), wp.abs(wp.dot(aside, p)), wp.abs(wp.dot(aside, q))
        )
    else:
        width = trajectory.filter_width
        box = inverse[0, 0] * width[0]
        wide = inverse[1, 1] * wp.max(width[1], width[2])
        narrow = inverse[1, 1] * wp.min(width[1], width[2])
        first = wp.max(wp.abs(aside[0]) * box, wp.abs(aside[1]) * wide)
        rest = wp.min(wp.abs(aside[0]) * box, wp.abs(aside[1]) * wide)
        second = wp.sqrt(rest * rest + aside[1] * aside[1] * narrow * narrow)
        profile = twice_averaged_bspline(across, wp.max(first, NARROWEST_BOX), wp.max(second, NARROWEST_SECOND))

    # ---- What passes within the shutter, with the flux that it has then
    rate = _lengths_passed(trajectory, then)
    part = Lanes(-1.0)
    for end in range(2):
        left = rate * (Lanes(0.5) + float(1 - 2 * end) * s)
        if trajectory.is_cell == 1:
            part += wp.min(wp.max(Lanes(0.5) + left, Lanes(0.0)), Lanes(1.0))
        else:
            beyond = bspline_tail(BOX_OF_BSPLINE * wp.abs(left))
            part += beyond + wp.cw_mul(not_negative(left), Lanes(1.0) - 2.0 * beyond)
    weight = wp.cw_mul(wp.cw_mul(profile, slowness), wp.max(part, Lanes(0.0)))
    scale = wp.determinant(inverse)
    return scale * wp.cw_mul(weight, Lanes(1.0) + trajectory.gain * inside)
