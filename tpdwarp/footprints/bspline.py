"""The quadratic B-spline along its way: averaged over a pixel, and over the shutter while it moves, bends and grows.

It lives in filter space, where the cells of its lattice have unit sides; weights integrate to one there. It is
quadratic: translates by one cell of every B-spline sum to one, and blur over the light by its variance (d + 1)/12
cells² for degree d. The cubic one errs more at folds and costs nine sixteenths more; the linear one errs less there,
but leaves the lattice's creases in smooth light. Averaged over a box, what a query stands for, its translates still sum
to one, as those of a B-spline that is wider than its cells do not.
"""

from __future__ import annotations

import itertools
import math
from functools import cache

import warp as wp

SUPPORT = 1.5

THIRD = wp.constant(1.0 / 3.0)
SIXTH = wp.constant(1.0 / 6.0)
GAUSS_OFFSET = wp.constant(0.5 / math.sqrt(3.0))
MOST_PANELS = wp.constant(1.0e6)
REACH = wp.constant(SUPPORT)


@wp.func
def quadratic_bspline(x: float) -> float:
    """The B-spline itself, centred, with support (−3/2, 3/2)."""
    # Without branches: footprints are narrow, so that which one is taken is anyone's guess.
    away = wp.abs(x)
    outer = wp.max(1.5 - away, 0.0)
    inner = wp.max(0.5 - away, 0.0)
    return 0.5 * outer * outer - 1.5 * inner * inner


@wp.func
def _beyond(x: float) -> float:
    """Its integral from x ≥ 0 on."""
    outer = wp.max(1.5 - x, 0.0)
    inner = wp.max(0.5 - x, 0.0)
    return outer * outer * outer * SIXTH - 0.5 * inner * inner * inner


@wp.func
def averaged_bspline(x: float, box: float) -> float:
    """Its mean over a box around x; what little is left of it near the rim of the support is exact."""
    away = wp.abs(x)
    half = 0.5 * box
    near = _beyond(wp.abs(away - half))
    return (wp.where(away < half, 1.0 - near, near) - _beyond(away + half)) / box


@wp.struct
class Way:
    """How a footprint moves over the shutter, in its own filter space at mid shutter.

    At the part s (−½ … ½) of the shutter it stands at s velocity + ½ s² bend + ⅙ s³ jerk, and its axes are those of
    mid shutter times 1 + s stretch. Only the B-spline's way is bent, and its axes stretched; ``box`` holds the sides of
    what it is averaged over, which stay.
    """

    velocity: wp.vec2
    bend: wp.vec2
    jerk: wp.vec2
    stretch: wp.mat22
    box: wp.vec2


@wp.func
def _while_near(y: wp.vec2, velocity: wp.vec2, reach: wp.vec2) -> wp.vec2:
    """From when to when, in −½ … ½, y lies within ``reach`` of what moves by ``velocity``."""
    low = float(-0.5)
    high = float(0.5)
    for axis in range(2):
        # A factor is the same for all queries, a divisor would divide anew for each.
        slowness = 1.0e9
        if wp.abs(velocity[axis]) > 1.0e-9:
            slowness = 1.0 / velocity[axis]
        a = (y[axis] - reach[axis]) * slowness
        b = (y[axis] + reach[axis]) * slowness
        low = wp.max(low, wp.min(a, b))
        high = wp.min(high, wp.max(a, b))
    return wp.vec2(low, high)


@wp.func
def _fineness(box: float) -> float:
    """A cell as a part of that of a B-spline that is as wide as one averaged over a box with this side."""
    return 1.0 / wp.sqrt(1.0 + THIRD * box * box)


@wp.func
def way_reach(way: Way, axis: int) -> float:
    """How far along an axis a B-spline that goes a bent way reaches to either side of the straight one."""
    growth = 0.5 * (wp.abs(way.stretch[axis, 0]) + wp.abs(way.stretch[axis, 1]))
    aside = 0.125 * wp.abs(way.bend[axis]) + wp.abs(way.jerk[axis]) / 48.0
    return REACH * (1.0 + growth) + 0.5 * way.box[axis] + aside


@cache
def bspline_weight(moves: bool, curved: bool) -> wp.Function:
    """w(y, way) of a B-spline, y relative to where it stands in the middle of its way.

    Means over boxes cost twice what the B-spline does, so that axes without a box have functions of their own.
    """
    both, u, v, neither = (_along_way(moves, curved, *boxed) for boxed in itertools.product((True, False), repeat=2))

    @wp.func
    def weight(y: wp.vec2, way: Way) -> float:
        if way.box[0] > 0.0:
            if way.box[1] > 0.0:
                return both(y, way)
            return u(y, way)
        if way.box[1] > 0.0:
            return v(y, way)
        return neither(y, way)

    return weight


@cache
def _along_way(moves: bool, curved: bool, boxed_u: bool, boxed_v: bool) -> wp.Function:
    """∫ b(y − x(s)) ds over s ∈ [−½, ½], by two Gauss nodes a cell; those inside the support are visited.

    The nodes do not depend on y, so that translates by one sum to one while they sweep, too.
    """

    @wp.func
    def tensor(y: wp.vec2, box: wp.vec2) -> float:
        along_u = float(0.0)
        along_v = float(0.0)
        if wp.static(boxed_u):
            along_u = averaged_bspline(y[0], box[0])
        else:
            along_u = quadratic_bspline(y[0])
        if wp.static(boxed_v):
            along_v = averaged_bspline(y[1], box[1])
        else:
            along_v = quadratic_bspline(y[1])
        return along_u * along_v

    @wp.func
    def still(y: wp.vec2, way: Way) -> float:
        return tensor(y, way.box)

    if not moves:
        return still

    @wp.func
    def moving(y: wp.vec2, way: Way) -> float:
        near = _while_near(y, way.velocity, wp.vec2(way_reach(way, 0), way_reach(way, 1)))
        if near[1] <= near[0]:
            return 0.0
        speed = float(0.0)
        grown = float(0.0)
        for axis in range(2):
            fastest = wp.abs(way.velocity[axis])
            if wp.static(curved):
                fastest += 0.5 * wp.abs(way.bend[axis]) + 0.125 * wp.abs(way.jerk[axis])
                grown = wp.max(grown, 0.5 * (wp.abs(way.stretch[axis, 0]) + wp.abs(way.stretch[axis, 1])))
            speed = wp.max(speed, fastest * _fineness(way.box[axis]))
        if speed == 0.0 and grown == 0.0:
            return tensor(y, way.box)
        panels = wp.ceil(wp.clamp(speed, 1.0, MOST_PANELS))
        total = float(0.0)
        for k in range(int(wp.floor((near[0] + 0.5) * panels)), int(wp.ceil((near[1] + 0.5) * panels))):
            for half in range(2):
                s = (float(k) + 0.5 + GAUSS_OFFSET * float(2 * half - 1)) / panels - 0.5
                if wp.static(curved):
                    grown_u = 1.0 + s * way.stretch[0, 0]
                    grown_v = 1.0 + s * way.stretch[1, 1]
                    area = grown_u * grown_v - s * s * way.stretch[0, 1] * way.stretch[1, 0]
                    scale = 1.0 / area
                    z = y - s * (way.velocity + (0.5 * s) * (way.bend + (s / 3.0) * way.jerk))
                    z_u = scale * (grown_v * z[0] - s * way.stretch[0, 1] * z[1])
                    z_v = scale * (grown_u * z[1] - s * way.stretch[1, 0] * z[0])
                    box = scale * wp.vec2(grown_v * way.box[0], grown_u * way.box[1])
                    total += scale * tensor(wp.vec2(z_u, z_v), box)
                else:
                    total += tensor(y - s * way.velocity, way.box)
        return 0.5 * total / panels

    return moving


