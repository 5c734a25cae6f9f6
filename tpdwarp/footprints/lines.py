"""Footprints that go far beside their own size: the integral over the shutter in closed form.

What passes a query in a small part of the shutter is, while it does, a profile that goes along a line: the integral
over time is that of the footprint across the line, over its speed,

    ∫ K(y − x(s)) ds = K⊥(q)/|ẋ|        q = (y − x(s*)) × ẋ/|ẋ|,  s* when it is next to y

and a part of that next to where the shutter opens and closes. Across the line a cell and its pixel are four boxes, the
projections of their sides, which is exact; a B-spline is one again, averaged over the boxes that it is averaged over
anyway. So nodes along the way are needed for footprints only that go slowly, or turn (:mod:`.bspline`).

Beyond the paper, whose swept footprints (Eq. 7) are lines as well, all along.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.footprints.bspline import HALF_CELL, HALF_WIDTH, Trajectory, box_extent, twice_averaged_bspline
from tpdwarp.footprints.cells import pixel_extent
from tpdwarp.footprints.lanes import LANES, Lanes, not_negative

# A line goes at least so many times half of what it covers, so that its ends, where the profile along it is taken for a
# box, are less than a quarter of it. Chosen, not derived.
SHORTEST_WAY = wp.constant(8.0)
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
NARROWEST_PART = wp.constant(0.04)


@wp.func
def _covers(trajectory: Trajectory, axis: int) -> float:
    """How far along an axis of filter space the footprint reaches while it stands (beyond the paper)."""
    if trajectory.is_cell == 1:
        return HALF_CELL + pixel_extent(trajectory.pixel, axis)
    return HALF_WIDTH + box_extent(trajectory.filter_width, axis)


@wp.func
def is_line(trajectory: Trajectory) -> bool:
    """Whether the footprint passes each query as a line (beyond the paper); soft discs have no such profile."""
    covers = wp.vec2(_covers(trajectory, 0), _covers(trajectory, 1))
    acceleration = wp.length(wp.cw_div(trajectory.acceleration, covers))
    jerk = wp.length(wp.cw_div(trajectory.jerk, covers))
    slowest = wp.length(wp.cw_div(trajectory.velocity, covers)) - 0.5 * acceleration - 0.125 * jerk
    turning = acceleration + 0.5 * jerk
    far = slowest > SHORTEST_WAY and trajectory.filter_width[2] >= 0.0
    return far and turning < LARGEST_TURN * slowest and turning < LARGEST_CURVATURE * slowest * slowest


@wp.func
def _place(s: Lanes, axis: int, trajectory: Trajectory) -> Lanes:
    """Where the footprint stands along an axis at the parts s of the shutter (beyond the paper)."""
    third = Lanes(0.5 * trajectory.acceleration[axis]) + (trajectory.jerk[axis] / 6.0) * s
    return wp.cw_mul(s, Lanes(trajectory.velocity[axis]) + wp.cw_mul(s, third))


@wp.func
def _speed(s: Lanes, axis: int, trajectory: Trajectory) -> Lanes:
    """How fast it goes along an axis then (beyond the paper)."""
    change = Lanes(trajectory.acceleration[axis]) + (0.5 * trajectory.jerk[axis]) * s
    return Lanes(trajectory.velocity[axis]) + wp.cw_mul(s, change)


@wp.func
def _time_of_passing(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
    """When the footprint passes the points (u, v): nearest by what it covers (beyond the paper)."""
    cover_u = _covers(trajectory, 0)
    cover_v = _covers(trajectory, 1)
    weight_u = 1.0 / (cover_u * cover_u)
    weight_v = 1.0 / (cover_v * cover_v)
    velocity = trajectory.velocity
    along = (weight_u * velocity[0]) * u + (weight_v * velocity[1]) * v
    s = along / (weight_u * velocity[0] * velocity[0] + weight_v * velocity[1] * velocity[1])
    s = wp.min(wp.max(s, Lanes(-LATEST)), Lanes(LATEST))
    for _step in range(STEPS):
        away = Lanes(0.0)
        slope = Lanes(0.0)
        for axis in range(2):
            at = u
            weight = weight_u
            if axis == 1:
                at = v
                weight = weight_v
            apart = at - _place(s, axis, trajectory)
            speed = _speed(s, axis, trajectory)
            change = Lanes(trajectory.acceleration[axis]) + trajectory.jerk[axis] * s
            away += weight * wp.cw_mul(apart, speed)
            slope += weight * (wp.cw_mul(speed, speed) - wp.cw_mul(apart, change))
        s = s + wp.cw_div(away, wp.max(slope, Lanes(1.0e-20)))
        s = wp.min(wp.max(s, Lanes(-LATEST)), Lanes(LATEST))
    return s


@wp.func
def four_boxes(x: Lanes, a: float, b: float, c: float, d: float) -> Lanes:
    """Mean of a box over three others, with ∫ = 1, by fourth differences of |x|³/12 (beyond the paper)."""
    floor = NARROWEST_PART * wp.max(wp.max(a, b), wp.max(c, d))
    w = 0.5 * wp.vec4(wp.max(a, floor), wp.max(b, floor), wp.max(c, floor), wp.max(d, floor))
    reach = w[0] + w[1] + w[2] + w[3]
    total = Lanes(0.0)
    for corner in range(8):
        sign_b = float(1 - 2 * (corner % 2))
        sign_c = float(1 - 2 * (corner // 2 % 2))
        sign_d = float(1 - 2 * (corner // 4))
        shift = sign_b * w[1] + sign_c * w[2] + sign_d * w[3]
        right = wp.abs(x + Lanes(shift + w[0]))
        left = wp.abs(x + Lanes(shift - w[0]))
        cubes = wp.cw_mul(wp.cw_mul(right, right), right) - wp.cw_mul(wp.cw_mul(left, left), left)
        total += (sign_b * sign_c * sign_d) * cubes
    # Beyond them differences are rounding.
    within = not_negative(Lanes(reach) - wp.abs(x))
    return wp.cw_mul(within, wp.max(total, Lanes(0.0))) / (192.0 * w[0] * w[1] * w[2] * w[3])


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
    apart_u = u - _place(s, 0, trajectory)
    apart_v = v - _place(s, 1, trajectory)
    speed_u = _speed(s, 0, trajectory)
    speed_v = _speed(s, 1, trajectory)
    along_u = inverse[0, 0] * speed_u + inverse[0, 1] * speed_v
    along_v = inverse[1, 0] * speed_u + inverse[1, 1] * speed_v
    z_u = inverse[0, 0] * apart_u + inverse[0, 1] * apart_v
    z_v = inverse[1, 0] * apart_u + inverse[1, 1] * apart_v
    slowness = wp.cw_mul(along_u, along_u) + wp.cw_mul(along_v, along_v)
    for lane in range(LANES):
        slowness[lane] = 1.0 / wp.sqrt(slowness[lane])
    across = wp.cw_mul(wp.cw_mul(z_u, along_v) - wp.cw_mul(z_v, along_u), slowness)

    # ---- The profile across it, and the variance along it
    then = trajectory.velocity + middle * (trajectory.acceleration + (0.5 * middle) * trajectory.jerk)
    ahead = wp.normalize(inverse * then)
    aside = wp.vec2(-ahead[1], ahead[0])
    profile = Lanes(0.0)
    square = float(0.0)
    if trajectory.is_cell == 1:
        pixel = inverse * trajectory.pixel
        p = wp.vec2(pixel[0, 0], pixel[1, 0])
        q = wp.vec2(pixel[0, 1], pixel[1, 1])
        profile = four_boxes(
            across, wp.abs(aside[0]), wp.abs(aside[1]), wp.abs(wp.dot(aside, p)), wp.abs(wp.dot(aside, q))
        )
        square = 1.0 + wp.dot(ahead, p) * wp.dot(ahead, p) + wp.dot(ahead, q) * wp.dot(ahead, q)
    else:
        width = trajectory.filter_width
        box = inverse[0, 0] * width[0]
        wide = inverse[1, 1] * wp.max(width[1], width[2])
        narrow = inverse[1, 1] * wp.min(width[1], width[2])
        first = wp.max(wp.abs(aside[0]) * box, wp.abs(aside[1]) * wide)
        rest = wp.min(wp.abs(aside[0]) * box, wp.abs(aside[1]) * wide)
        second = wp.sqrt(rest * rest + aside[1] * aside[1] * narrow * narrow)
        profile = twice_averaged_bspline(across, wp.max(first, NARROWEST_BOX), wp.max(second, NARROWEST_SECOND))
        square = 3.0 + ahead[0] * ahead[0] * box * box + ahead[1] * ahead[1] * (wide * wide + narrow * narrow)

    # ---- What passes within the shutter, with the flux that it has then
    part = Lanes(0.0)
    rate = wp.cw_div(Lanes(1.0 / wp.sqrt(square)), slowness)
    for end in range(2):
        left = Lanes(0.5) + wp.cw_mul(Lanes(0.5) + float(1 - 2 * end) * s, rate)
        part += wp.min(wp.max(left, Lanes(0.0)), Lanes(1.0))
    weight = wp.cw_mul(wp.cw_mul(profile, slowness), wp.max(part - Lanes(1.0), Lanes(0.0)))
    scale = wp.determinant(inverse)
    return scale * wp.cw_mul(weight, Lanes(1.0) + trajectory.gain * inside)
