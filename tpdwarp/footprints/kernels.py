"""Footprint kernels: Table 1 of the paper, the quadratic B-spline, and their averages over the shutter.

All live in filter space, where a radial footprint is the unit disc and a B-spline footprint the lattice with unit
cells. ``y`` is the query relative to the footprint at shutter open, ``v`` the footprint's way over the shutter, so
that the footprint stands at τv for τ ∈ [0, 1]. Weights integrate to one over filter space; multiply by |det M|.

Departs from the paper: Eq. 6 × Eq. 8 with the constants of its Table 1 deposits Φ/π; the constants here are the
correct ones. Its Eq. 7 area is exact for the uniform kernel only; the swept form below uses each kernel's own.

The B-spline is quadratic: translates by one cell of every B-spline sum to one, and blur over the light by its variance
(d + 1)/12 cells² for degree d. The cubic one errs more at folds and costs nine sixteenths more; the linear one errs
less there, but leaves the lattice's creases in smooth light. It is averaged over a box, what a query stands for: its
translates still sum to one, as those of a B-spline that is wider than its cells do not.
"""

from __future__ import annotations

import itertools
import math
from functools import cache

import warp as wp

RADIAL = ("uniform", "cone", "epanechnikov", "quartic", "gaussian")
SUPPORT = {**dict.fromkeys(RADIAL, 1.0), "bspline": 1.5}

# Line integral k1 = ∫₋₁¹ K of each radial kernel through its centre.
LINE_INTEGRAL = {
    "uniform": 2.0 / math.pi,
    "cone": 3.0 / math.pi,
    "epanechnikov": 8.0 / (3.0 * math.pi),
    "quartic": 16.0 / (5.0 * math.pi),
    "gaussian": math.erf(math.sqrt(0.5)) * math.sqrt(2.0 * math.pi) / (2.0 * math.pi * (1.0 - math.exp(-0.5))),
}

# ∫₀¹ ω of each time filter of Eq. 9, ω(τ) = profile(1 − τ) with profile(0) = 1: the shutter's close weighs most.
TIME_INTEGRAL = {
    "uniform": 1.0,
    "cone": 0.5,
    "epanechnikov": 2.0 / 3.0,
    "quartic": 8.0 / 15.0,
    "gaussian": math.sqrt(0.5 * math.pi) * math.erf(math.sqrt(0.5)),
}
TIME_START = {"uniform": 1.0, "cone": 0.0, "epanechnikov": 0.0, "quartic": 0.0, "gaussian": math.exp(-0.5)}

INV_PI = wp.constant(1.0 / math.pi)
GAUSSIAN_SCALE = wp.constant(1.0 / (2.0 * math.pi * (1.0 - math.exp(-0.5))))
SQRT_HALF = wp.constant(math.sqrt(0.5))
SQRT_HALF_PI = wp.constant(math.sqrt(0.5 * math.pi))
THIRD = wp.constant(1.0 / 3.0)
SIXTH = wp.constant(1.0 / 6.0)
GAUSS_OFFSET = wp.constant(0.5 / math.sqrt(3.0))
MOST_PANELS = wp.constant(1.0e6)
BSPLINE_SUPPORT = wp.constant(SUPPORT["bspline"])


@wp.func
def uniform(r2: float) -> float:
    if r2 >= 1.0:
        return 0.0
    return INV_PI


@wp.func
def cone(r2: float) -> float:
    if r2 >= 1.0:
        return 0.0
    return 3.0 * INV_PI * (1.0 - wp.sqrt(r2))


@wp.func
def epanechnikov(r2: float) -> float:
    if r2 >= 1.0:
        return 0.0
    return 2.0 * INV_PI * (1.0 - r2)


@wp.func
def quartic(r2: float) -> float:
    if r2 >= 1.0:
        return 0.0
    return 3.0 * INV_PI * (1.0 - r2) * (1.0 - r2)


@wp.func
def gaussian(r2: float) -> float:
    if r2 >= 1.0:
        return 0.0
    return GAUSSIAN_SCALE * wp.exp(-0.5 * r2)


@wp.func
def uniform_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    return INV_PI * tau


@wp.func
def cone_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    q2 = q * q
    r0 = wp.sqrt(z0 * z0 + q2)
    r1 = wp.sqrt(z1 * z1 + q2)
    bend = z1 * r1 - z0 * r0
    if q2 > 1.0e-12:
        bend += q2 * (_asinh(z1 / wp.abs(q)) - _asinh(z0 / wp.abs(q)))
    return 3.0 * INV_PI * (z1 - z0 - 0.5 * bend) / sigma


@wp.func
def epanechnikov_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    return 2.0 * INV_PI * tau * (c2 - (z1 * z1 + z1 * z0 + z0 * z0) / 3.0)


@wp.func
def quartic_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    s2 = z1 * z1 + z1 * z0 + z0 * z0
    s4 = z1 * z1 * z1 * (z1 + z0) + z0 * z0 * (z1 * z1 + z1 * z0 + z0 * z0)
    return 3.0 * INV_PI * tau * (c2 * c2 - c2 * s2 * (2.0 / 3.0) + 0.2 * s4)


@wp.func
def gaussian_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    along = wp.erf(z1 * SQRT_HALF) - wp.erf(z0 * SQRT_HALF)
    return GAUSSIAN_SCALE * wp.exp(-0.5 * q * q) * SQRT_HALF_PI * along / sigma


@wp.func
def _asinh(x: float) -> float:
    return wp.sign(x) * wp.log(wp.abs(x) + wp.sqrt(x * x + 1.0))


STATIC = {"uniform": uniform, "cone": cone, "epanechnikov": epanechnikov, "quartic": quartic, "gaussian": gaussian}
PATH = {
    "uniform": uniform_path,
    "cone": cone_path,
    "epanechnikov": epanechnikov_path,
    "quartic": quartic_path,
    "gaussian": gaussian_path,
}
# The difference of two nearly equal terms is divided by σ in these; below this σ a midpoint rule is more exact.
SMALLEST_SIGMA = {"cone": 0.02, "gaussian": 0.02}


@wp.func
def _beyond(x: float) -> float:
    """Integral of the centred quadratic B-spline, whose support is (−3/2, 3/2), from x ≥ 0 on."""
    # Without branches: footprints are narrow, so that which one is taken is anyone's guess.
    outer = wp.max(1.5 - x, 0.0)
    inner = wp.max(0.5 - x, 0.0)
    return outer * outer * outer * SIXTH - 0.5 * inner * inner * inner


@wp.func
def quadratic_bspline(x: float) -> float:
    """The B-spline itself; translates by one sum to one."""
    away = wp.abs(x)
    outer = wp.max(1.5 - away, 0.0)
    inner = wp.max(0.5 - away, 0.0)
    return 0.5 * outer * outer - 1.5 * inner * inner


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
    return BSPLINE_SUPPORT * (1.0 + growth) + 0.5 * way.box[axis] + aside


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


@cache
def static_weight(kernel: str) -> wp.Function:
    """w(y) of a radial footprint that stands still."""
    K = STATIC[kernel]

    @wp.func
    def weight(y: wp.vec2) -> float:
        return K(wp.dot(y, y))

    return weight


@cache
def moving_weight(kernel: str, form: str, time_filter: str = "none") -> wp.Function:
    """w(y, v) of a radial footprint that moves by v over the shutter, y relative to where it stands at shutter open.

    Args:
        kernel: A radial kernel of Table 1.
        form: ``shutter`` for the true time average, ``swept`` for the distance to the swept segment (Eq. 7).
        time_filter: Shutter response of Eq. 9 (a product, not the printed ratio); for ``swept`` only.
    """
    if form == "swept":
        return _swept_weight(kernel, time_filter)
    K, path = STATIC[kernel], PATH[kernel]
    smallest = wp.constant(SMALLEST_SIGMA.get(kernel, 1.0e-6))

    @wp.func
    def shutter_weight(y: wp.vec2, v: wp.vec2) -> float:
        sigma = wp.length(v)
        if sigma < smallest:
            a = y - 0.25 * v
            b = y - 0.75 * v
            return 0.5 * (K(wp.dot(a, a)) + K(wp.dot(b, b)))
        p = wp.dot(y, v) / sigma
        q = (y[0] * v[1] - y[1] * v[0]) / sigma
        if wp.abs(q) >= 1.0:
            return 0.0
        c2 = (1.0 - wp.abs(q)) * (1.0 + wp.abs(q))
        c = wp.sqrt(c2)
        z0 = wp.clamp(-p, -c, c)
        z1 = wp.clamp(sigma - p, -c, c)
        # Not (z1 − z0)/σ: below σ ≈ 0.01 the difference of two rounded numbers is no longer σ where it should be.
        part = wp.clamp((p + c) / sigma, 0.0, 1.0) - wp.clamp((p - c) / sigma, 0.0, 1.0)
        if part <= 0.0:
            return 0.0
        return path(z0, z1, q, c2, part, sigma)

    return shutter_weight


@cache
def _swept_weight(kernel: str, time_filter: str) -> wp.Function:
    K = STATIC[kernel]
    k1 = wp.constant(LINE_INTEGRAL[kernel])
    if time_filter == "none":

        @wp.func
        def swept_weight(y: wp.vec2, v: wp.vec2) -> float:
            sigma2 = wp.dot(v, v)
            tau = float(0.0)
            if sigma2 > 0.0:
                tau = wp.clamp(wp.dot(y, v) / sigma2, 0.0, 1.0)
            d = y - tau * v
            return K(wp.dot(d, d)) / (1.0 + wp.sqrt(sigma2) * k1)

        return swept_weight

    profile = _profile(time_filter)
    ends = wp.constant(0.5 * (TIME_START[time_filter] + 1.0))
    whole = wp.constant(TIME_INTEGRAL[time_filter])

    @wp.func
    def filtered_weight(y: wp.vec2, v: wp.vec2) -> float:
        sigma2 = wp.dot(v, v)
        tau = float(1.0)
        if sigma2 > 0.0:
            tau = wp.clamp(wp.dot(y, v) / sigma2, 0.0, 1.0)
        d = y - tau * v
        response = profile(1.0 - tau)
        if sigma2 == 0.0:
            response = ends
        return K(wp.dot(d, d)) * response / (ends + wp.sqrt(sigma2) * k1 * whole)

    return filtered_weight


@cache
def _profile(time_filter: str) -> wp.Function:
    """ω as a function of the distance in time s ∈ [0, 1] from the shutter's close, one at s = 0."""
    K = STATIC[time_filter]
    peak = wp.constant(
        {"uniform": 1.0, "cone": 3.0, "epanechnikov": 2.0, "quartic": 3.0}.get(time_filter, 0.0) / math.pi
        or 1.0 / (2.0 * math.pi * (1.0 - math.exp(-0.5)))
    )

    @wp.func
    def profile(s: float) -> float:
        return K(wp.min(s * s, 0.9999999)) / peak

    return profile
