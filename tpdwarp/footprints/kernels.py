"""Radial footprint kernels: Table 1 of the paper, and their averages over the shutter.

All live in filter space, where a footprint is the unit disc. ``y`` is the query relative to the footprint at shutter
open, ``v`` the footprint's displacement over the shutter, so that the footprint stands at τv for τ ∈ [0, 1]. Weights
integrate to one over filter space; multiply by |det M|.

Departs from the paper: Eq. 6 × Eq. 8 with the constants of its Table 1 deposits Φ/π; the constants here are the
correct ones. Its Eq. 7 area is exact for the uniform kernel only; the swept form below uses each kernel's own.
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

# The kernels of Table 1.
RADIAL = ("uniform", "cone", "epanechnikov", "quartic", "gaussian")
# All of them vanish beyond the unit disc.
SUPPORT = 1.0

# Line integral k1 = ∫₋₁¹ K of each radial kernel through its centre.
LINE_INTEGRAL = {
    "uniform": 2.0 / math.pi,
    "cone": 3.0 / math.pi,
    "epanechnikov": 8.0 / (3.0 * math.pi),
    "quartic": 16.0 / (5.0 * math.pi),
    "gaussian": math.erf(math.sqrt(0.5)) * math.sqrt(2.0 * math.pi) / (2.0 * math.pi * (1.0 - math.exp(-0.5))),
}

# Variance of each radial kernel along an axis, ∫ y_u² K(|y|²) dy, in squared radii of its support.
VARIANCE = {
    "uniform": 1.0 / 4.0,
    "cone": 3.0 / 20.0,
    "epanechnikov": 1.0 / 6.0,
    "quartic": 1.0 / 8.0,
    "gaussian": 0.5 * (2.0 - 3.0 * math.exp(-0.5)) / (1.0 - math.exp(-0.5)),
}

# ∫₀¹ ω of each time filter of Eq. 9, ω(τ) = profile(1 − τ) with profile(0) = 1: the shutter's close weighs most.
TIME_INTEGRAL = {
    "uniform": 1.0,
    "cone": 0.5,
    "epanechnikov": 2.0 / 3.0,
    "quartic": 8.0 / 15.0,
    "gaussian": math.sqrt(0.5 * math.pi) * math.erf(math.sqrt(0.5)),
}
# ω at the shutter's opening: profile(1).
TIME_START = {"uniform": 1.0, "cone": 0.0, "epanechnikov": 0.0, "quartic": 0.0, "gaussian": math.exp(-0.5)}

# Normalisations of Table 1.
INV_PI = wp.constant(1.0 / math.pi)
GAUSSIAN_SCALE = wp.constant(1.0 / (2.0 * math.pi * (1.0 - math.exp(-0.5))))
SQRT_HALF = wp.constant(math.sqrt(0.5))
SQRT_HALF_PI = wp.constant(math.sqrt(0.5 * math.pi))


@wp.func
def uniform(r2: float) -> float:
    """K of the uniform kernel at |y|² (Table 1): 1/π."""
    if r2 >= 1.0:
        return 0.0
    return INV_PI


@wp.func
def cone(r2: float) -> float:
    """K of the cone at |y|² (Table 1): (3/π)(1 − |y|)."""
    if r2 >= 1.0:
        return 0.0
    return 3.0 * INV_PI * (1.0 - wp.sqrt(r2))


@wp.func
def epanechnikov(r2: float) -> float:
    """K of Epanechnikov's kernel at |y|² (Table 1): (2/π)(1 − |y|²)."""
    if r2 >= 1.0:
        return 0.0
    return 2.0 * INV_PI * (1.0 - r2)


@wp.func
def quartic(r2: float) -> float:
    """K of the quartic kernel at |y|² (Table 1): (3/π)(1 − |y|²)²."""
    if r2 >= 1.0:
        return 0.0
    return 3.0 * INV_PI * (1.0 - r2) * (1.0 - r2)


@wp.func
def gaussian(r2: float) -> float:
    """K of the Gaussian at |y|² (Table 1), cut off and normalised at |y| = 1: exp(−|y|²/2)/(2π(1 − e^−½))."""
    if r2 >= 1.0:
        return 0.0
    return GAUSSIAN_SCALE * wp.exp(-0.5 * r2)


@wp.func
def uniform_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    """∫₀¹ K dτ of the uniform kernel (beyond the paper): Δ/π.

    Args:
        z0, z1: Where the path enters and leaves the unit disc, along itself from the point closest to the centre.
        q: Distance of the path from the centre.
        c2: 1 − q².
        tau: Δ, the part of the shutter between z0 and z1.
        sigma: Length of the path, |v|.
    """
    return INV_PI * tau


@wp.func
def cone_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    """∫₀¹ K dτ of the cone (beyond the paper): (3/π)[z − ½(z√(z²+q²) + q² asinh(z/|q|))]/σ from z0 to z1."""
    q2 = q * q
    r0 = wp.sqrt(z0 * z0 + q2)
    r1 = wp.sqrt(z1 * z1 + q2)
    twice = z1 * r1 - z0 * r0
    if q2 > 1.0e-12:
        twice += q2 * (_asinh(z1 / wp.abs(q)) - _asinh(z0 / wp.abs(q)))
    return 3.0 * INV_PI * (z1 - z0 - 0.5 * twice) / sigma


@wp.func
def epanechnikov_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    """∫₀¹ K dτ of Epanechnikov's kernel (beyond the paper): (2/π)Δ[c² − (z1² + z1 z0 + z0²)/3]."""
    return 2.0 * INV_PI * tau * (c2 - (z1 * z1 + z1 * z0 + z0 * z0) / 3.0)


@wp.func
def quartic_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    """∫₀¹ K dτ of the quartic kernel (beyond the paper): (3/π)Δ[c⁴ − ⅔c² Σ₂ + Σ₄/5], Σ_k = Σ_j z1^j z0^(k−j)."""
    s2 = z1 * z1 + z1 * z0 + z0 * z0
    s4 = z1 * z1 * z1 * (z1 + z0) + z0 * z0 * (z1 * z1 + z1 * z0 + z0 * z0)
    return 3.0 * INV_PI * tau * (c2 * c2 - c2 * s2 * (2.0 / 3.0) + 0.2 * s4)


@wp.func
def gaussian_path(z0: float, z1: float, q: float, c2: float, tau: float, sigma: float) -> float:
    """∫₀¹ K dτ of the Gaussian (beyond the paper): e^(−q²/2) √(π/2) [erf(z/√2)]/σ from z0 to z1, normalised as K is."""
    along = wp.erf(z1 * SQRT_HALF) - wp.erf(z0 * SQRT_HALF)
    return GAUSSIAN_SCALE * wp.exp(-0.5 * q * q) * SQRT_HALF_PI * along / sigma


@wp.func
def _asinh(x: float) -> float:
    """Inverse hyperbolic sine, for the cone's average over the shutter (beyond the paper)."""
    return wp.sign(x) * wp.log(wp.abs(x) + wp.sqrt(x * x + 1.0))


STATIC = {"uniform": uniform, "cone": cone, "epanechnikov": epanechnikov, "quartic": quartic, "gaussian": gaussian}
PATH = {
    "uniform": uniform_path,
    "cone": cone_path,
    "epanechnikov": epanechnikov_path,
    "quartic": quartic_path,
    "gaussian": gaussian_path,
}
# The difference of two nearly equal terms is divided by σ in these, which rounds by 6e-8/σ; two midpoints err by σ²/96
# of the kernel's second derivative. Both are some 4e-6 at this σ.
SMALLEST_SIGMA = {"cone": 0.02, "gaussian": 0.02}


@cache
def static_weight(kernel: str) -> wp.Function:
    """w(y) = K(|y|²) of a footprint that stands still, with K of Table 1."""
    K = STATIC[kernel]

    @wp.func
    def weight(y: wp.vec2) -> float:
        return K(wp.dot(y, y))

    return weight


@cache
def moving_weight(kernel: str, form: str, time_filter: str = "none") -> wp.Function:
    """w(y, v) of a footprint that moves by v over the shutter, y relative to where it stands at shutter open.

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
    """w(y, v) = K(|y − τ* v|²)/(1 + σ k1) with τ* the closest time (Eq. 7), or times ω(τ*)/Z with a filter (Eq. 9).

    Departs from the paper: k1 is each kernel's own line integral, and the filter is a factor, not a divisor, with
    Z = ½(ω(0) + ω(1)) + σ k1 ∫ ω, so that one photon stays one.
    """
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
    """ω of Eq. 9 as a function of the distance in time s ∈ [0, 1] from the shutter's close, one at s = 0."""
    K = STATIC[time_filter]
    peak = wp.constant(
        {"uniform": 1.0, "cone": 3.0, "epanechnikov": 2.0, "quartic": 3.0}.get(time_filter, 0.0) / math.pi
        or 1.0 / (2.0 * math.pi * (1.0 - math.exp(-0.5)))
    )

    @wp.func
    def profile(s: float) -> float:
        return K(wp.min(s * s, 0.9999999)) / peak

    return profile
