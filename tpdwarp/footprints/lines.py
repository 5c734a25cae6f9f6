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
from tpdwarp.footprints.lanes import LANES, Lanes, between, greater, lesser

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


@wp.struct
class _Way:
    """A trajectory in the space in which what the footprint covers is as long as wide."""

    measure: wp.mat22
    velocity: wp.vec2
    acceleration: wp.vec2
    jerk: wp.vec2


@wp.func
def _way_of(trajectory: Trajectory) -> _Way:
    """The same trajectory as it is measured by what the footprint covers (beyond the paper)."""
    out = _Way()
    out.measure = _measure(trajectory)
    out.velocity = out.measure * trajectory.velocity
    out.acceleration = out.measure * trajectory.acceleration
    out.jerk = out.measure * trajectory.jerk
    return out


@wp.func
def _place(s: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Where the footprint stands along an axis at the part s of the shutter (beyond the paper)."""
    return s * (velocity + s * (0.5 * acceleration + (jerk / 6.0) * s))


@wp.func
def _speed(s: float, velocity: float, acceleration: float, jerk: float) -> float:
    """How fast it goes along an axis then (beyond the paper)."""
    return velocity + s * (acceleration + (0.5 * jerk) * s)


@wp.func
def _time_of_passing(u: float, v: float, way: _Way) -> float:
    """When the footprint passes the point (u, v): when it is next to it by what it covers (beyond the paper)."""
    first = way.measure[0, 0] * u + way.measure[0, 1] * v
    second = way.measure[1, 0] * u + way.measure[1, 1] * v
    s = (way.velocity[0] * first + way.velocity[1] * second) / wp.length_sq(way.velocity)
    s = between(s, -LATEST, LATEST)
    for _step in range(STEPS):
        away = float(0.0)
        slope = float(0.0)
        for axis in range(2):
            at = first
            if axis == 1:
                at = second
            apart = at - _place(s, way.velocity[axis], way.acceleration[axis], way.jerk[axis])
            speed = _speed(s, way.velocity[axis], way.acceleration[axis], way.jerk[axis])
            away += apart * speed
            slope += speed * speed - apart * (way.acceleration[axis] + way.jerk[axis] * s)
        s = between(s + away / greater(slope, 1.0e-20), -LATEST, LATEST)
    return s


@wp.func
def _length(x: float, y: float) -> float:
    """√(x² + y²), for profiles across lines (beyond the paper)."""
    return wp.sqrt(x * x + y * y)


@wp.func
def four_boxes(x: float, a: float, b: float, c: float, d: float) -> float:
    """Mean of a box over three others, with ∫ = 1 (beyond the paper); the narrowest two count as one.

    Of three boxes it is the third difference of x |x|/4.
    """
    wider = lesser(greater(a, b), greater(c, d))
    narrower = greater(lesser(a, b), lesser(c, d))
    first = 0.5 * greater(greater(a, b), greater(c, d))
    floor = NARROWEST_PART * first
    second = greater(0.5 * greater(wider, narrower), floor)
    third = greater(0.5 * _length(lesser(wider, narrower), lesser(lesser(a, b), lesser(c, d))), floor)
    total = float(0.0)
    for corner in range(8):
        sign_a = float(1 - 2 * (corner % 2))
        sign_b = float(1 - 2 * (corner // 2 % 2))
        sign_c = float(1 - 2 * (corner // 4))
        at = x + sign_a * first + sign_b * second + sign_c * third
        total += (sign_a * sign_b * sign_c) * (at * wp.abs(at))
    # Beyond them differences are rounding.
    within = first + second + third >= wp.abs(x)
    return wp.where(within, greater(total, 0.0), 0.0) / (32.0 * first * second * third)


@wp.func
def bspline_and_boxes(x: float, cell: float, first: float, second: float) -> float:
    """Mean of a B-spline with cells of a width over two boxes, with ∫ = 1 (beyond the paper)."""
    one = greater(first / cell, NARROWEST_BOX)
    other = greater(second / cell, NARROWEST_SECOND)
    at = x / cell
    both = 0.5 * (one + other)
    apart = 0.5 * (one - other)
    total = double_tail(at + both) + double_tail(at - both) - double_tail(at + apart) - double_tail(at - apart)
    return greater(total, 0.0) / (one * other * cell)


@wp.struct
class _Passing:
    """How a footprint passes a query.

    ``s`` is when it does, ``inside`` when within the shutter, ``slowness`` the inverse of its speed then, ``ahead``
    where it goes, and ``apart`` how far the query lies beside the line. ``one`` and ``other`` are how long the sides of
    its cell are across the line, ``length`` how long the cell is along it, both by what the footprint covers; so is the
    speed ``way``, and ``along`` where it goes.
    """

    s: float
    inside: float
    slowness: float
    ahead_u: float
    ahead_v: float
    apart: float
    one: float
    other: float
    length: float
    way: float
    along_u: float
    along_v: float


@wp.func
def _passing(u: float, v: float, trajectory: Trajectory, way: _Way) -> _Passing:
    """How the footprint passes the point (u, v) (beyond the paper)."""
    velocity = trajectory.velocity
    acceleration = trajectory.acceleration
    jerk = trajectory.jerk
    measure = way.measure
    out = _Passing()
    out.s = _time_of_passing(u, v, way)
    out.inside = between(out.s, -0.5, 0.5)
    speed_u = _speed(out.s, velocity[0], acceleration[0], jerk[0])
    speed_v = _speed(out.s, velocity[1], acceleration[1], jerk[1])
    out.slowness = 1.0 / _length(speed_u, speed_v)
    out.ahead_u = out.slowness * speed_u
    out.ahead_v = out.slowness * speed_v
    apart_u = u - _place(out.s, velocity[0], acceleration[0], jerk[0])
    apart_v = v - _place(out.s, velocity[1], acceleration[1], jerk[1])
    out.apart = apart_u * out.ahead_v - apart_v * out.ahead_u

    # ---- The sides of its cell as they are then: across the line, and along it by what the footprint covers
    rate = trajectory.jacobian_rate
    one_u = 1.0 + rate[0, 0] * out.inside
    one_v = rate[1, 0] * out.inside
    other_u = rate[0, 1] * out.inside
    other_v = 1.0 + rate[1, 1] * out.inside
    out.one = wp.abs(one_u * out.ahead_v - one_v * out.ahead_u)
    out.other = wp.abs(other_u * out.ahead_v - other_v * out.ahead_u)
    way_u = measure[0, 0] * speed_u + measure[0, 1] * speed_v
    way_v = measure[1, 0] * speed_u + measure[1, 1] * speed_v
    out.way = _length(way_u, way_v)
    out.along_u = way_u / out.way
    out.along_v = way_v / out.way
    one_along = out.along_u * (measure[0, 0] * one_u + measure[0, 1] * one_v)
    one_along += out.along_v * (measure[1, 0] * one_u + measure[1, 1] * one_v)
    other_along = out.along_u * (measure[0, 0] * other_u + measure[0, 1] * other_v)
    other_along += out.along_v * (measure[1, 0] * other_u + measure[1, 1] * other_v)
    out.length = _length(one_along, other_along)
    return out


@wp.func
def _cell_line(u: float, v: float, trajectory: Trajectory, way: _Way) -> float:
    """w(u, v, trajectory) of Eq. 8 of a cell that :func:`is_line` (beyond the paper)."""
    at = _passing(u, v, trajectory, way)
    pixel = trajectory.pixel
    p = wp.abs(pixel[0, 0] * at.ahead_v - pixel[1, 0] * at.ahead_u)
    q = wp.abs(pixel[0, 1] * at.ahead_v - pixel[1, 1] * at.ahead_u)
    profile = four_boxes(at.apart, at.one, at.other, p, q)
    # How long it is along the line: the pixel has unit sides as it is measured.
    length = _length(at.length, 1.0)
    part = float(-1.0)
    for end in range(2):
        left = at.way * (0.5 + float(1 - 2 * end) * at.s) / length
        part += between(0.5 + left, 0.0, 1.0)
    return profile * at.slowness * greater(part, 0.0) * (1.0 + trajectory.gain * at.inside)


@wp.func
def _bspline_line(u: float, v: float, trajectory: Trajectory, way: _Way) -> float:
    """w(u, v, trajectory) of Eq. 8 of a B-spline that :func:`is_line` (beyond the paper)."""
    at = _passing(u, v, trajectory, way)
    width = trajectory.filter_width
    box_u = width[0] * wp.abs(at.ahead_v)
    box_v = wp.max(width[1], width[2]) * wp.abs(at.ahead_u)
    rest = _length(lesser(box_u, box_v), wp.min(width[1], width[2]) * at.ahead_u)
    profile = bspline_and_boxes(at.apart, _length(at.one, at.other), greater(box_u, box_v), rest)
    across = _length(width[1], width[2]) * way.measure[1, 1]
    boxes = _length(width[0] * way.measure[0, 0] * at.along_u, across * at.along_v)
    # How long it is along the line: as a box of its variance.
    length = _length(BOX_OF_BSPLINE * at.length, boxes)
    part = float(-1.0)
    for end in range(2):
        left = at.way * (0.5 + float(1 - 2 * end) * at.s) / length
        beyond = bspline_tail(BOX_OF_BSPLINE * wp.abs(left))
        part += wp.where(left >= 0.0, 1.0 - beyond, beyond)
    return profile * at.slowness * greater(part, 0.0) * (1.0 + trajectory.gain * at.inside)


@lane_func
def line_weights(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
    """w(u, v, trajectory) of Eq. 8 of a footprint that :func:`is_line` (beyond the paper)."""
    way = _way_of(trajectory)
    out = Lanes(0.0)
    lane = int(0)
    if trajectory.is_cell == 1:
        while lane < LANES:
            out[lane] = _cell_line(u[lane], v[lane], trajectory, way)
            lane += 1
    else:
        while lane < LANES:
            out[lane] = _bspline_line(u[lane], v[lane], trajectory, way)
            lane += 1
    return out
