"""Ellipsoids of one radiance as they are seen from a point: as a flat ellipse that all rays to them pass.

In the space where an ellipsoid is the unit sphere, rays that touch it from a point D away do so on a circle of radius
√(1 − 1/D²), 1/D before its middle; its image is an ellipse on the way from the point to the middle of the ellipsoid.
"""

import math

import warp as wp

from tpdwarp.scene.device.shaping import across_of

# A point within an ellipsoid counts as one just outside of it.
OUTSIDE_ELLIPSOID = wp.constant(1.001)
# Nodes about the middle of what is seen, in two rings that are exact to the third order in its solid angle.
AROUND = wp.constant(8)
INNER_RING = wp.constant(0.5 * (1.0 - math.sqrt(1.0 / 3.0)))
OUTER_RING = wp.constant(0.5 * (1.0 + math.sqrt(1.0 / 3.0)))
NODE_STEP = wp.constant(2.0 * math.pi / 8)


@wp.struct
class SeenEllipsoid:
    """An ellipsoid from a point: ``away`` is the distance of its middle where it is the unit sphere, ``middle`` the
    unit direction to its middle there, ``a`` and ``b`` what two radii across that and each other are, and ``c`` what
    the radius along it is."""

    away: float
    middle: wp.vec3
    a: wp.vec3
    b: wp.vec3
    c: wp.vec3


@wp.func
def ellipsoid_from(first: wp.vec3, second: wp.vec3, third: wp.vec3, d: wp.vec3) -> SeenEllipsoid:
    """The ellipsoid of these radii whose middle lies at ``d`` from the point that looks at it."""
    across = wp.cross(second, third)
    volume = wp.dot(first, across)
    own = wp.vec3(wp.dot(across, d), wp.dot(wp.cross(third, first), d), wp.dot(wp.cross(first, second), d)) / volume
    out = SeenEllipsoid()
    length = wp.length(own)
    out.away = wp.max(length, OUTSIDE_ELLIPSOID)
    out.middle = wp.vec3(0.0, 0.0, 1.0)
    if length > 0.0:
        out.middle = own / length
    one = across_of(out.middle)
    other = wp.cross(out.middle, one)
    out.a = one[0] * first + one[1] * second + one[2] * third
    out.b = other[0] * first + other[1] * second + other[2] * third
    out.c = out.middle[0] * first + out.middle[1] * second + out.middle[2] * third
    return out


@wp.func
def ellipsoid_irradiance(seen: SeenEllipsoid, n: wp.vec3) -> float:
    """Irradiance of an ellipsoid of radiance one that it sends to a surface of normal n, by nodes.

    Directions ω' on the unit sphere are Mω'/|Mω'|, of solid angle |det M|/|Mω'|³ dω'.
    """
    # One less the cosine of half the angle at which it is seen there; the difference itself would lose digits.
    square = 1.0 / (seen.away * seen.away)
    cap = square / (1.0 + wp.sqrt(1.0 - square))
    total = float(0.0)
    for ring in range(2):
        nearer = wp.where(ring == 0, INNER_RING, OUTER_RING) * cap
        forward = 1.0 - nearer
        aside = wp.sqrt(nearer * (2.0 - nearer))
        for number in range(AROUND):
            turn = (float(number) + 0.5 * float(ring)) * NODE_STEP
            w = forward * seen.c + aside * (wp.cos(turn) * seen.a + wp.sin(turn) * seen.b)
            squared = wp.length_sq(w)
            total += wp.max(wp.dot(w, n), 0.0) / (squared * squared)
    volume = wp.abs(wp.dot(seen.c, wp.cross(seen.a, seen.b)))
    # 2 π cap is their solid angle.
    return total * NODE_STEP * cap * volume / 2.0
