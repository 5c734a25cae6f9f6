"""Shaping footprints: the metric M that maps a photon's tangent plane to filter space, regularised, with its bounds.

A query stands for a square of side a, about a pixel, and a footprint is as wide as what it is on average over that. Let
J = [D_u x, D_v x] in the tangent plane. Where the wavefront folds |Du×Dv| → 0, where light grazes it grows without
bound; so the singular values S of J are widened to √(S² + 4ε²), which adds ε²I to the footprint's covariance
C = ¼(DuDuᵀ + DvDvᵀ), with ε² = a²/12, the variance of the square along either side. They are then limited in length and
aspect. The singular vectors stay.

The B-spline, whose translates sum to one over the cells of its lattice only, is averaged over a box along its own axes
instead, whose sides are its filter width. Where these axes are not at right angles, by γ = √|cos ∠(Du, Dv)|, a box does
not widen them all around: it then takes the part 1 − γ of a², and singular values are widened by γ of it. They are no
less than ε: a bare box would have hard edges.

The metric, its determinant and the bounds all follow from the widened J, so that every footprint keeps its flux.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.footprints.bspline import SUPPORT

# Longest axis of a footprint in the tracer's units, in which the scene is of unit size.
LONGEST_AXIS = wp.constant(1.0)
# Filter widths along axes of which they are a smaller part are left out: they would widen these by less than 1 %.
SMALLEST_FILTER_WIDTH = wp.constant(0.25)
# Beyond it single precision no longer tells the two axes of the metric apart.
LARGEST_ASPECT = wp.constant(1000.0)
# Standard deviation of a box, as a part of its side.
BOX_DEVIATION = wp.constant(12.0**-0.5)
# Shortest axis: a part of the coordinates where the footprint lies, ten or so units in their last place; and at least
# this part of the scene.
SHORTEST_AXIS = wp.constant(1.0e-6)
SHORTEST_AXIS_AT_ORIGIN = wp.constant(1.0e-9)
# How far a query may lie off the footprint's plane, as a part of the footprint's own extent.
PLANE_TOLERANCE = wp.constant(0.25)
# How much axes may grow or shrink from mid shutter to either end: what shrinks to nothing passes a fold.
LARGEST_GROWTH = wp.constant(0.5)


@wp.struct
class PixelSize:
    """Side of the square on a receiver that a query stands for: ``base + slope · distance`` from ``eye``."""

    eye: wp.vec3
    base: float
    slope: float


@wp.struct
class FootprintArrays:
    """One row a photon, in the tracer's units. Filter coordinates of a displacement d are (row_u·d, row_v·d).

    At the part s (−½ … ½) of the photon's own shutter the footprint stands at
    center + s dxdt + ½ s² acceleration + ⅙ s³ jerk, and its axes are those of the middle times 1 + s jacobian_rate, in
    filter coordinates. Where no trajectory curves, these three have no rows. ``filter_width`` holds the sides of what a
    B-spline is averaged over, in cells. ``density`` is Φ |det M|; ``long_axis`` and ``half_extent`` (along it, across
    it, along the normal) bound what the footprint sweeps over; ``plane_tolerance`` is how far off its plane it reaches.
    """

    center: wp.array(dtype=wp.vec3)
    row_u: wp.array(dtype=wp.vec3)
    row_v: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdt: wp.array(dtype=wp.vec3)
    acceleration: wp.array(dtype=wp.vec3)
    jerk: wp.array(dtype=wp.vec3)
    jacobian_rate: wp.array(dtype=wp.mat22)
    filter_width: wp.array(dtype=wp.vec2)
    dxdt_relative: wp.array(dtype=wp.vec3)
    density: wp.array(dtype=wp.vec3)
    plane_tolerance: wp.array(dtype=wp.float32)
    receiver: wp.array(dtype=wp.int32)
    time: wp.array(dtype=wp.float32)
    long_axis: wp.array(dtype=wp.vec3)
    half_extent: wp.array(dtype=wp.vec3)
    clamped: wp.array(dtype=wp.int32)


@wp.struct
class TangentFrame:
    """Two unit vectors that span the tangent plane at a normal."""

    e1: wp.vec3
    e2: wp.vec3


@wp.struct
class SingularValues:
    """J = R(left) diag(s1, s2) R(right)ᵀ; s1 ≥ |s2|, and s2 carries the sign of the determinant."""

    s1: float
    s2: float
    left: float
    right: float


@wp.struct
class Widened:
    """Singular values after widening and limiting, and the side of the box that is left to the filter width."""

    t1: float
    t2: float
    box: float
    clamped: int


@wp.func
def tangent_frame(n: wp.vec3) -> TangentFrame:
    """An orthonormal frame of the plane with unit normal n."""
    frame = TangentFrame()
    e1 = wp.vec3(0.0, -n[2], n[1])
    if wp.abs(n[0]) > 0.5:
        e1 = wp.vec3(n[2], 0.0, -n[0])
    frame.e1 = wp.normalize(e1)
    frame.e2 = wp.cross(n, frame.e1)
    return frame


@wp.func
def singular_values(a: float, b: float, c: float, d: float) -> SingularValues:
    """The singular value decomposition of [[a, b], [c, d]] in closed form."""
    out = SingularValues()
    sum_angle = wp.atan2(c - b, a + d)
    difference_angle = wp.atan2(c + b, a - d)
    q = 0.5 * wp.sqrt((a + d) * (a + d) + (c - b) * (c - b))
    r = 0.5 * wp.sqrt((a - d) * (a - d) + (c + b) * (c + b))
    out.s1 = q + r
    out.s2 = q - r
    out.left = 0.5 * (sum_angle + difference_angle)
    out.right = 0.5 * (difference_angle - sum_angle)
    return out


@wp.func
def nonorthogonality(a: float, b: float, c: float, d: float) -> float:
    """γ = √|cos ∠(Du, Dv)| for the columns (a, c) and (b, d); zero where one of them vanishes."""
    lengths = wp.sqrt((a * a + c * c) * (b * b + d * d))
    if lengths > 0.0:
        return wp.sqrt(wp.min(wp.abs(a * b + c * d) / lengths, 1.0))
    return 0.0


@wp.func
def widened(j: SingularValues, side: float, gamma: float, distance: float) -> Widened:
    """Singular values √(S² + 4ε²) for the part γ of the pixel's square, limited in length and aspect.

    Args:
        side: Side a of the square that a query stands for.
        gamma: Part of it by which singular values are widened; the box takes the rest.
        distance: Of the footprint from the origin of the tracer's units.
    """
    out = Widened()
    out.box = side * wp.sqrt(1.0 - gamma)
    widening = (gamma / 3.0) * side * side
    out.t1 = wp.max(wp.sqrt(j.s1 * j.s1 + widening), BOX_DEVIATION * out.box)
    out.t2 = wp.max(wp.sqrt(j.s2 * j.s2 + widening), BOX_DEVIATION * out.box)
    if out.t1 > LONGEST_AXIS:
        out.t1 = LONGEST_AXIS
        out.t2 = wp.min(out.t2, LONGEST_AXIS)
        out.clamped = 1
    shortest = wp.max(out.t1 / LARGEST_ASPECT, wp.max(SHORTEST_AXIS * distance, SHORTEST_AXIS_AT_ORIGIN))
    if out.t2 < shortest:
        out.t2 = shortest
        out.clamped = 1
    out.t1 = wp.max(out.t1, out.t2)
    return out


@wp.func
def _along(a: wp.vec3, b: wp.vec3, c: wp.vec3, displacement: wp.vec3) -> wp.vec3:
    """How far a displacement goes along each of three axes."""
    return wp.vec3(
        wp.abs(wp.dot(a, displacement)), wp.abs(wp.dot(b, displacement)), wp.abs(wp.dot(c, displacement))
    )


@cache
def footprint_kernel(radial: bool, curved: bool) -> wp.Kernel:
    """The kernel that shapes footprints, for radial kernels or the B-spline, whose trajectories may curve."""
    # The rows of M are 2(Dv×n)/… for a radial kernel, whose support is the unit disc (§5); one cell for the B-spline.
    scale = 2.0 if radial else 1.0

    @wp.kernel(module="unique", enable_backward=False)
    def shape_footprints(
        base: int,
        # In
        dxdu: wp.array(dtype=wp.vec3),
        dxdv: wp.array(dtype=wp.vec3),
        dxdut: wp.array(dtype=wp.vec3),
        dxdvt: wp.array(dtype=wp.vec3),
        receiver_motion: wp.array(dtype=wp.vec3),
        flux: wp.array(dtype=wp.vec3),
        smoothing: float,
        pixel: PixelSize,
        # In (center, normal, dxdt, acceleration, jerk) and out (all else)
        out: FootprintArrays,
    ):
        i = base + wp.tid()
        n = out.normal[i]
        x = out.center[i]
        dxdt = out.dxdt[i]

        # ---- J in the tangent plane, its singular values, and the pixel's share in them
        frame = tangent_frame(n)
        a = wp.dot(frame.e1, dxdu[i]) * smoothing
        b = wp.dot(frame.e1, dxdv[i]) * smoothing
        c = wp.dot(frame.e2, dxdu[i]) * smoothing
        d = wp.dot(frame.e2, dxdv[i]) * smoothing
        j = singular_values(a, b, c, d)
        side = pixel.base + pixel.slope * wp.length(x - pixel.eye)
        gamma = float(1.0)
        if wp.static(not radial):
            gamma = nonorthogonality(a, b, c, d)
        w = widened(j, side, gamma, wp.length(x))
        t1 = w.t1
        t2 = w.t2

        # ---- The metric M: rows of J⁻¹, and its determinant
        sign = float(1.0)
        if j.s2 < 0.0:
            sign = -1.0
        cl = wp.cos(j.left)
        sl = wp.sin(j.left)
        cr = wp.cos(j.right)
        sr = wp.sin(j.right)
        left1 = cl * frame.e1 + sl * frame.e2
        left2 = cl * frame.e2 - sl * frame.e1
        row_u = (cr / t1) * left1 - (sign * sr / t2) * left2
        row_v = (sr / t1) * left1 + (sign * cr / t2) * left2
        out.row_u[i] = wp.static(scale) * row_u
        out.row_v[i] = wp.static(scale) * row_v
        out.dxdt_relative[i] = dxdt - receiver_motion[i]
        out.density[i] = flux[i] * (wp.static(scale * scale) / (t1 * t2))
        out.clamped[i] = w.clamped

        # ---- Extent along both singular axes at mid shutter
        along = 0.5 * t1
        across = 0.5 * t2
        if wp.static(not radial):
            length_u = wp.sqrt(cr * cr * t1 * t1 + sr * sr * t2 * t2)
            length_v = wp.sqrt(sr * sr * t1 * t1 + cr * cr * t2 * t2)
            width = wp.vec2(w.box / length_u, w.box / length_v)
            if width[0] < SMALLEST_FILTER_WIDTH:
                width[0] = 0.0
            if width[1] < SMALLEST_FILTER_WIDTH:
                width[1] = 0.0
            out.filter_width[i] = width
            extent_u = wp.static(SUPPORT) + 0.5 * width[0]
            extent_v = wp.static(SUPPORT) + 0.5 * width[1]
            along = t1 * (wp.abs(cr) * extent_u + wp.abs(sr) * extent_v)
            across = t2 * (wp.abs(sr) * extent_u + wp.abs(cr) * extent_v)

        # ---- Sweep over the shutter: to either side along these axes and the normal, and growth of the axes
        sweep = 0.5 * _along(left1, left2, n, dxdt)
        normal_extent = 0.5 * wp.length(out.dxdt_relative[i])
        if wp.static(curved):
            acceleration = out.acceleration[i]
            jerk = out.jerk[i]
            sweep += 0.125 * _along(left1, left2, n, acceleration) + _along(left1, left2, n, jerk) / 48.0
            normal_extent += 0.125 * wp.length(acceleration) + wp.length(jerk) / 48.0
            # How singular values change up to either end of the shutter, by their own size. What they were widened by
            # stays; what axes turn by does, too: to follow that costs time and gains nothing.
            right1 = (0.5 * smoothing) * (cr * dxdut[i] + sr * dxdvt[i])
            right2 = (0.5 * smoothing) * (cr * dxdvt[i] - sr * dxdut[i])
            growth1 = wp.min(j.s1 / t1, 1.0) * wp.dot(left1, right1) / t1
            growth2 = wp.clamp(j.s2 / t2, -1.0, 1.0) * wp.dot(left2, right2) / t2
            growth1 = wp.clamp(growth1, -LARGEST_GROWTH, LARGEST_GROWTH)
            growth2 = wp.clamp(growth2, -LARGEST_GROWTH, LARGEST_GROWTH)
            turn = wp.mat22(cr, -sr, sr, cr)
            out.jacobian_rate[i] = 2.0 * (turn * wp.mat22(growth1, 0.0, 0.0, growth2) * wp.transpose(turn))
            along *= 1.0 + wp.abs(growth1)
            across *= 1.0 + wp.abs(growth2)
        tolerance = PLANE_TOLERANCE * (along + across + normal_extent)
        out.plane_tolerance[i] = tolerance
        along += sweep[0]
        across += sweep[1]
        if along >= across:
            out.long_axis[i] = left1
            out.half_extent[i] = wp.vec3(along, across, tolerance + sweep[2])
        else:
            out.long_axis[i] = left2
            out.half_extent[i] = wp.vec3(across, along, tolerance + sweep[2])

    return shape_footprints
