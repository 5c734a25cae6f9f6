"""Irradiance of round lights in closed form, for direct light and photons alike."""

import math

import warp as wp

PI = wp.constant(math.pi)
# A sphere whose distance is more than this many radii is a flat disc where the horizon cuts it: that errs by the square
# of the ratio, 0.4 %, of what is little there, while the closed form of the sphere loses digits.
FLAT_FROM = wp.constant(16.0)
# How far before its axis, in radii, the visible side of a cylinder lies on average over what is seen of it.
VISIBLE_SIDE = wp.constant(0.25 * math.pi)


@wp.func
def round_irradiance(cosine: float, h: float) -> float:
    """Irradiance of a sphere at h radii distance, by that of a point of the same intensity at normal incidence.

    ``cosine`` is that of the direction to its middle; where the horizon cuts the sphere, see Snyder (1996).
    """
    sine = 1.0 / h
    if cosine >= sine:
        return cosine
    if cosine <= -sine:
        return 0.0
    if h > FLAT_FROM:
        q = cosine * h
        rest = wp.sqrt(wp.max(1.0 - q * q, 0.0))
        share = 0.5 + (wp.asin(wp.clamp(q, -1.0, 1.0)) + q * rest) / PI
        return sine * (q * share + 2.0 / (3.0 * PI) * rest * rest * rest)
    h2 = h * h
    k2 = wp.max(1.0 - h2 * cosine * cosine, 0.0)
    root = wp.sqrt(h2 - 1.0)
    angle = wp.acos(wp.clamp(-cosine * root / wp.sqrt(1.0 - cosine * cosine), -1.0, 1.0))
    return (cosine * angle - wp.sqrt(k2) * root + h2 * wp.atan(wp.sqrt(k2) / root)) / PI
