"""Shaping footprints: the metric M that maps a photon's tangent plane to filter space, regularised, with its bounds.

M and its determinant are those of the photon's area in Eqs. 6 and 7. Departs from the paper, whose footprints are those
of single points, in that they are averaged over a pixel.

A pixel's value is the mean over the parallelogram with sides P, Q that it sees on a surface, and so is what a footprint
adds to it. Let J = [D_u x, D_v x] in the tangent plane, σ1 ≥ σ2 its singular values in units of the pixel ([P, Q]⁻¹ J).

What is as small as a pixel is the cell of the lattice itself, and the pixel gets the part of it that it sees
(:mod:`tpdwarp.footprints.cells`). All others are B-splines:

- σ2 ≥ 1: the footprint is larger than a pixel. It keeps its own axes, along which translates of the B-spline sum to
  one, and is averaged over a box along them, whose sides are its filter width. Where the axes are not at right angles,
  by γ = √|cos ∠(Du, Dv)|, a box does not widen them all around: it then takes the part 1 − γ of the pixel's variance,
  and the singular values of J are widened by γ of it.
- σ1 ≤ 1: smaller than a pixel. The axes are the pixel's own, P and Q, the footprint has its deviations along them, and
  the box is the pixel: what falls on a pixel is counted exactly, and pixels side by side share it without rest.
- between them, long and thin: the axes are the singular vectors of J. Across the thin one the pixel is two boxes, of
  the widths that P and Q have there, which is exact for a line.

Radial kernels have no boxes: the singular values S of J are widened to √(S² + a²/(3κ)), where κ is the kernel's
variance along an axis (Table 1) and a² the square of P, Q along the singular vector, so that variances add up.

Where the wavefront folds |Du×Dv| → 0, where light grazes it grows without bound; so lengths and aspect are limited. The
metric, its determinant and the bounds all follow from the limited axes, so that every footprint keeps its flux.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.compiler_flags import calls_inlined, own_module
from tpdwarp.footprints.bspline import SUPPORT
from tpdwarp.footprints.cells import HALF, pixel_extent
from tpdwarp.footprints.kernels import VARIANCE
from tpdwarp.photons.light_columns import IMAGE_DISC, IMAGE_NONE, IMAGE_PARALLELOGRAM

# Longest axis of a footprint: the size of the scene, in the tracer's units.
LONGEST_AXIS = wp.constant(1.0)
# Filter widths, in cells, that are smaller are left out: a box adds width²/12 to the B-spline's variance of 1/4, at
# this width 2 % of it, which is 1 % of its width.
SMALLEST_FILTER_WIDTH = wp.constant(0.25)
# Longer axis of a footprint by its shorter one. Beyond it single precision no longer tells the two apart: their squares
# differ by a factor of 10⁶, and are rounded by 6e-8 of the larger one.
LARGEST_ASPECT = wp.constant(1000.0)
# Variances of the quadratic B-spline and of a cell, in cells².
BSPLINE_VARIANCE = wp.constant(0.25)
CELL_VARIANCE = wp.constant(1.0 / 12.0)
# Standard deviation of a box, as a part of its side.
BOX_DEVIATION = wp.constant(12.0**-0.5)
# Footprints are no finer than this part of a pixel, so that differences of tails stay exact in float32. That adds 7e-4
# to the variance of what falls on the pixel: 1/4 of its square, beside the pixel's 1/12.
FINEST_IN_PIXEL = wp.constant(1.0 / 64.0)
# Pixels count as seen under no smaller cosine than this: beyond it their parallelograms grow without bound. Chosen, not
# derived: 3° above the surface.
SMALLEST_VIEW_COSINE = wp.constant(0.05)
# Shortest axis: a part of the coordinates where the footprint lies, some 16 roundings of them; and at least this part
# of the scene, which keeps the squares of areas in the range of float32 (chosen, not derived).
SHORTEST_AXIS = wp.constant(1.0e-6)
SHORTEST_AXIS_AT_ORIGIN = wp.constant(1.0e-9)
# How far a query may lie off the footprint's plane, as a part of the footprint's own extent: on receivers that curve
# less than that it is one surface. Chosen, not derived.
PLANE_TOLERANCE = wp.constant(0.25)
# How far light goes aside where it goes down by one, at most: 14° above a receiver. Chosen, not derived.
LARGEST_SLANT = wp.constant(4.0)
# How much axes may grow or shrink from mid shutter to either end, as a part of themselves: what shrinks to nothing
# passes a fold, which first order does not describe. Chosen, not derived.
LARGEST_GROWTH = wp.constant(0.5)
# Trajectories that curve, together with what axes grow by, by less than this go straight, in cells: a footprint that is
# off by so much at the ends of the shutter alone errs by a hundredth of its peak, and the sum of a lattice by less.
SMALLEST_SAGITTA = wp.constant(1.0 / 32.0)
HALF_WIDTH = wp.constant(SUPPORT)


@wp.struct
class PixelSize:
    """What a query stands for on a receiver: the parallelogram that a pixel, or a part of one, sees there.

    ``right`` and ``up`` are the sides of the pixel in the plane at distance 1 before the eye (in tracer's units for an
    orthographic camera), ``back`` points against the view. Where ``right`` is zero, a query stands for a square of side
    ``base + slope · distance`` from ``eye`` instead, however it is turned.
    """

    eye: wp.vec3
    right: wp.vec3
    up: wp.vec3
    back: wp.vec3
    orthographic: int
    base: float
    slope: float


# Unit normals of lines as rows.
Mirrors = wp.types.matrix(shape=(2, 3), dtype=wp.float32)


@wp.struct
class FootprintArrays:
    """One row a photon, in the tracer's units. Filter coordinates of a displacement d are (row_u·d, row_v·d).

    At the part s (−½ … ½) of the photon's own shutter the footprint stands at
    center + s dxdt + ½ s² acceleration + ⅙ s³ jerk, its axes are those of the middle times 1 + s jacobian_rate, in
    filter coordinates, and its flux is that times 1 + s gain. Where no trajectory curves, these have no rows.
    ``filter_width`` holds the widths of the boxes that a B-spline is averaged over, in cells: one along u, two along v.
    Where ``is_cell`` is 1 the footprint is a cell (:mod:`.cells`), where the last of these widths is below zero a disc;
    both are averaged over the parallelogram whose sides in filter space are the columns of ``pixel``.
    ``density`` is Φ |det M|; ``long_axis`` and ``half_extent`` (along it, across it, along the normal) bound what the
    footprint sweeps over; ``plane_tolerance`` is how far off its plane it reaches. ``incidence`` is −ω/|ω·n|; no rows
    for flat receivers. ``mirrors`` are the normals of the lines that an image was mirrored about, zero of others; no
    rows where there are no images. ``clamped`` and ``growth_limited`` are 1 where lengths or aspect, and the growth of
    axes, were limited.
    """

    center: wp.array(dtype=wp.vec3)
    row_u: wp.array(dtype=wp.vec3)
    row_v: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdt: wp.array(dtype=wp.vec3)
    acceleration: wp.array(dtype=wp.vec3)
    jerk: wp.array(dtype=wp.vec3)
    jacobian_rate: wp.array(dtype=wp.mat22)
    gain: wp.array(dtype=wp.float32)
    filter_width: wp.array(dtype=wp.vec3)
    pixel: wp.array(dtype=wp.mat22)
    is_cell: wp.array(dtype=wp.int32)
    dxdt_relative: wp.array(dtype=wp.vec3)
    density: wp.array(dtype=wp.vec3)
    plane_tolerance: wp.array(dtype=wp.float32)
    receiver: wp.array(dtype=wp.int32)
    time: wp.array(dtype=wp.float32)
    long_axis: wp.array(dtype=wp.vec3)
    half_extent: wp.array(dtype=wp.vec3)
    incidence: wp.array(dtype=wp.vec3)
    mirrors: wp.array(dtype=Mirrors)
    clamped: wp.array(dtype=wp.int32)
    growth_limited: wp.array(dtype=wp.int32)


@wp.struct
class LightImageArrays:
    """Columns D_a x and D_b x of photons by the place on their light, and what they span: one row a photon.

    There are no rows where no light has an extent (:class:`tpdwarp.photons.light_columns.LightImage`). Footprints of
    lights with extent are ``narrowing`` times as wide as others (:func:`tpdwarp.scene.light_places.narrowing_of`).
    """

    dxda: wp.array(dtype=wp.vec3)
    dxdb: wp.array(dtype=wp.vec3)
    image: wp.array(dtype=wp.int32)
    narrowing: float


@wp.struct
class LightOnPlane:
    """What a photon's light spans on a receiver, in the coordinates of a tangent frame: D_a x and D_b x."""

    a: wp.vec2
    b: wp.vec2
    image: int


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
class PixelOnPlane:
    """Sides P, Q of a pixel's parallelogram in the coordinates of a tangent frame."""

    p: wp.vec2
    q: wp.vec2


@wp.struct
class Axes:
    """A footprint's axes after widening: lengths t1, t2 along two unit vectors, and its filter widths.

    ``turn`` is the angle from these vectors to the axes u, v of filter space: J = R(left) diag(t1, t2) R(turn)ᵀ. They
    may be oblique (``first``, ``second``), as those of a pixel are. ``growing`` is zero where axes do not grow.
    ``averaged`` is what a disc is averaged over.
    """

    first: wp.vec2
    second: wp.vec2
    t1: float
    t2: float
    turn: float
    width: wp.vec3
    growing: float
    averaged: PixelOnPlane
    clamped: int


@wp.func
def tangent_frame(n: wp.vec3) -> TangentFrame:
    """An orthonormal frame of the plane with unit normal n, in which J and M (Eq. 7) are written down."""
    frame = TangentFrame()
    e1 = wp.vec3(0.0, -n[2], n[1])
    if wp.abs(n[0]) > 0.5:
        e1 = wp.vec3(n[2], 0.0, -n[0])
    frame.e1 = wp.normalize(e1)
    frame.e2 = wp.cross(n, frame.e1)
    return frame


@wp.func
def within_scene(axis: wp.vec2) -> wp.vec2:
    """The axis of a light's image (beyond the paper), no longer than the scene: grazing light has endless ones."""
    out = axis
    if wp.length_sq(axis) > LONGEST_AXIS * LONGEST_AXIS:
        out *= LONGEST_AXIS / wp.length(axis)
    return out


@wp.func
def in_frame(frame: TangentFrame, x: wp.vec3) -> wp.vec2:
    """The part of a vector that lies in the tangent plane (Eq. 7, whose M works within it)."""
    return wp.vec2(wp.dot(frame.e1, x), wp.dot(frame.e2, x))


@wp.func
def out_of_frame(frame: TangentFrame, x: wp.vec2) -> wp.vec3:
    """The vector in space that one of the tangent plane is (Eq. 7, whose M works within it)."""
    return x[0] * frame.e1 + x[1] * frame.e2


@wp.func
def cell_in_frame(frame: TangentFrame, dxdu: wp.vec3, dxdv: wp.vec3) -> wp.mat22:
    """J, whose columns are D_u x and D_v x in the tangent plane: what Eq. 7 inverts."""
    u = in_frame(frame, dxdu)
    v = in_frame(frame, dxdv)
    return wp.mat22(u[0], v[0], u[1], v[1])


@wp.func
def light_on_plane(images: LightImageArrays, photon: int, frame: TangentFrame) -> LightOnPlane:
    """The image of a photon's light in a tangent frame (beyond the paper)."""
    out = LightOnPlane()
    out.image = images.image[photon]
    if out.image != IMAGE_NONE:
        out.a = within_scene(in_frame(frame, images.dxda[photon]))
        out.b = within_scene(in_frame(frame, images.dxdb[photon]))
    return out


@wp.func
def narrowing_at(images: LightImageArrays, photon: int) -> float:
    """How wide a photon's footprint is, in cells (beyond the paper)."""
    if images.image[photon] == IMAGE_DISC or images.image[photon] == IMAGE_PARALLELOGRAM:
        return images.narrowing
    return 1.0


@wp.func
def singular_values(a: float, b: float, c: float, d: float) -> SingularValues:
    """The singular value decomposition of J = [[a, b], [c, d]] in closed form: M = J⁻¹ of Eq. 7 follows from it."""
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
    """γ = √|cos ∠(Du, Dv)| for the columns (a, c) and (b, d); zero where one of them vanishes (beyond the paper)."""
    lengths = wp.sqrt((a * a + c * c) * (b * b + d * d))
    if lengths > 0.0:
        return wp.sqrt(wp.min(wp.abs(a * b + c * d) / lengths, 1.0))
    return 0.0


@wp.func
def pixel_on_plane(pixel: PixelSize, x: wp.vec3, n: wp.vec3, frame: TangentFrame) -> PixelOnPlane:
    """The parallelogram that a pixel sees at x on a plane with normal n, for its average (beyond the paper)."""
    out = PixelOnPlane()
    if wp.length_sq(pixel.right) == 0.0:
        side = pixel.base + pixel.slope * wp.length(x - pixel.eye)
        out.p = wp.vec2(side, 0.0)
        out.q = wp.vec2(0.0, side)
        return out
    w = -pixel.back
    scale = float(1.0)
    if pixel.orthographic == 0:
        scale = wp.abs(wp.dot(x - pixel.eye, w))
        w = wp.normalize(x - pixel.eye)
    cosine = wp.dot(n, w)
    if wp.abs(cosine) < SMALLEST_VIEW_COSINE:
        cosine = wp.where(cosine < 0.0, -SMALLEST_VIEW_COSINE, SMALLEST_VIEW_COSINE)
    p = scale * (pixel.right - w * (wp.dot(n, pixel.right) / cosine))
    q = scale * (pixel.up - w * (wp.dot(n, pixel.up) / cosine))
    out.p = wp.vec2(wp.dot(frame.e1, p), wp.dot(frame.e2, p))
    out.q = wp.vec2(wp.dot(frame.e1, q), wp.dot(frame.e2, q))
    return out


@wp.func
def direction(angle: float) -> wp.vec2:
    """The unit vector at ``angle``: a singular vector of J (Eq. 7)."""
    return wp.vec2(wp.cos(angle), wp.sin(angle))


@wp.func
def square_along(pixel: PixelOnPlane, axis: wp.vec2) -> float:
    """Twelve times the variance of a pixel along a unit vector: (P·e)² + (Q·e)² (beyond the paper)."""
    a = wp.dot(pixel.p, axis)
    b = wp.dot(pixel.q, axis)
    return a * a + b * b


@wp.func
def limited(axes: Axes, distance: float) -> Axes:
    """Axes of limited length and aspect; ``distance`` is that of the footprint from the origin of the units.

    Departs from the paper, whose area (Eq. 7) vanishes at folds. Flux stays, since |det M| follows.
    """
    out = axes
    longest = wp.max(axes.t1, axes.t2)
    shortest = wp.max(
        wp.min(longest, LONGEST_AXIS) / LARGEST_ASPECT, wp.max(SHORTEST_AXIS * distance, SHORTEST_AXIS_AT_ORIGIN)
    )
    out.t1 = wp.clamp(axes.t1, shortest, LONGEST_AXIS)
    out.t2 = wp.clamp(axes.t2, shortest, LONGEST_AXIS)
    if out.t1 != axes.t1 or out.t2 != axes.t2:
        out.clamped = 1
    return out


@wp.func
def _along_its_own(j: SingularValues) -> Axes:
    """Directions of J (Eq. 7) for axes of any length."""
    out = Axes()
    out.first = direction(j.left)
    out.second = wp.vec2(-out.first[1], out.first[0])
    out.turn = j.right
    if j.s2 < 0.0:
        out.second = -out.second
    return out


@wp.func
def own_axes(j: SingularValues, pixel: PixelOnPlane, gamma: float, kernel_variance: float, distance: float) -> Axes:
    """Axes of a footprint that is larger than a pixel: those of J (Eq. 7), widened.

    Beyond the paper: singular values take the part ``gamma`` of the pixel's variance, √(S² + γ a²/(3κ)), where κ is
    ``kernel_variance``.
    """
    out = _along_its_own(j)
    out.growing = 1.0
    part = gamma / (3.0 * kernel_variance)
    along = square_along(pixel, out.first)
    across = square_along(pixel, out.second)
    rest = BOX_DEVIATION * wp.sqrt(1.0 - gamma)
    out.t1 = wp.max(wp.sqrt(j.s1 * j.s1 + part * along), rest * wp.sqrt(along))
    out.t2 = wp.max(wp.sqrt(j.s2 * j.s2 + part * across), rest * wp.sqrt(across))
    return limited(out, distance)


@wp.func
def box_along_axes(axes: Axes, pixel: PixelOnPlane, part: float) -> wp.vec3:
    """Filter widths along u and v with the part ``part`` of a pixel's variance there, in cells (beyond the paper)."""
    c = wp.cos(axes.turn)
    s = wp.sin(axes.turn)
    u = c * axes.t1 * axes.first - s * axes.t2 * axes.second
    v = s * axes.t1 * axes.first + c * axes.t2 * axes.second
    length_u = wp.length(u)
    length_v = wp.length(v)
    width = wp.vec3(
        wp.sqrt(part * square_along(pixel, u / length_u)) / length_u,
        wp.sqrt(part * square_along(pixel, v / length_v)) / length_v,
        0.0,
    )
    if width[0] < SMALLEST_FILTER_WIDTH:
        width[0] = 0.0
    if width[1] < SMALLEST_FILTER_WIDTH:
        width[1] = 0.0
    return width


@wp.func
def thin_axes(j: SingularValues, pixel: PixelOnPlane, distance: float) -> Axes:
    """Axes of a footprint that is longer than a pixel, but not as wide: its singular vectors (beyond the paper)."""
    across = across_direction(j)
    return thin_axes_between(j, pixel, wp.abs(wp.dot(pixel.p, across)), wp.abs(wp.dot(pixel.q, across)), distance)


@wp.func
def across_direction(j: SingularValues) -> wp.vec2:
    """The unit vector across the longer axis of a footprint (Eq. 7)."""
    along = direction(j.left)
    return wp.vec2(-along[1], along[0])


@wp.func
def thin_axes_between(
    j: SingularValues, pixel: PixelOnPlane, one: float, other: float, distance: float
) -> Axes:
    """As :func:`thin_axes` (beyond the paper), averaged across by two boxes of the given sides."""
    out = Axes()
    out.first = direction(j.left)
    out.second = across_direction(j)
    out.growing = 1.0
    across = wp.sqrt(square_along(pixel, out.second))
    out.t1 = j.s1
    out.t2 = wp.max(wp.abs(j.s2), FINEST_IN_PIXEL * across)
    out = limited(out, distance)
    wide = wp.max(one, other) / out.t2
    narrow = wp.min(one, other) / out.t2
    if narrow < SMALLEST_FILTER_WIDTH:
        wide = wp.sqrt(wide * wide + narrow * narrow)
        narrow = 0.0
    along = wp.sqrt(square_along(pixel, out.first)) / out.t1
    if along < SMALLEST_FILTER_WIDTH:
        along = 0.0
    out.width = wp.vec3(along, wide, narrow)
    return out


@wp.func
def pixel_axes(pixel: PixelOnPlane, in_pixels: wp.mat22, distance: float) -> Axes:
    """Axes of a footprint that is smaller than a pixel: the pixel's (beyond the paper); ``in_pixels`` is [P, Q]⁻¹ J."""
    out = Axes()
    length_p = wp.length(pixel.p)
    length_q = wp.length(pixel.q)
    out.first = pixel.p / length_p
    out.second = pixel.q / length_q
    along = wp.sqrt(in_pixels[0, 0] * in_pixels[0, 0] + in_pixels[0, 1] * in_pixels[0, 1])
    across = wp.sqrt(in_pixels[1, 0] * in_pixels[1, 0] + in_pixels[1, 1] * in_pixels[1, 1])
    out.t1 = length_p * wp.max(along, FINEST_IN_PIXEL)
    out.t2 = length_q * wp.max(across, FINEST_IN_PIXEL)
    out = limited(out, distance)
    out.width = wp.vec3(length_p / out.t1, length_q / out.t2, 0.0)
    return out


@wp.func
def in_sides(pixel: PixelOnPlane, j: wp.mat22) -> wp.mat22:
    """[P, Q]⁻¹ J: a footprint (Eq. 7) in the units of a parallelogram."""
    area = pixel.p[0] * pixel.q[1] - pixel.p[1] * pixel.q[0]
    return wp.mat22(pixel.q[1], -pixel.q[0], -pixel.p[1], pixel.p[0]) * j / area


@wp.func
def cell_axes(j: SingularValues, pixel: PixelOnPlane, distance: float) -> Axes:
    """Axes of a cell of the lattice: those of J (Eq. 7), but no finer than a part of a pixel (beyond the paper)."""
    out = _along_its_own(j)
    out.t1 = wp.max(j.s1, FINEST_IN_PIXEL * wp.sqrt(square_along(pixel, out.first)))
    out.t2 = wp.max(wp.abs(j.s2), FINEST_IN_PIXEL * wp.sqrt(square_along(pixel, out.second)))
    return limited(out, distance)


@wp.func
def axes_of(
    j: SingularValues, a: float, b: float, c: float, d: float, pixel: PixelOnPlane, distance: float
) -> Axes:
    """Axes of a B-spline footprint with the columns (a, c) and (b, d) in its tangent frame, whose J is ``j``.

    Beyond the paper: which of the three cases of this module it is, by its singular values in pixels.
    """
    area = pixel.p[0] * pixel.q[1] - pixel.p[1] * pixel.q[0]
    if area != 0.0:
        p_row = wp.vec2(pixel.q[1], -pixel.q[0]) / area
        q_row = wp.vec2(-pixel.p[1], pixel.p[0]) / area
        in_pixels = wp.mat22(
            p_row[0] * a + p_row[1] * c, p_row[0] * b + p_row[1] * d,
            q_row[0] * a + q_row[1] * c, q_row[0] * b + q_row[1] * d,
        )  # fmt: skip
        sigma = singular_values(in_pixels[0, 0], in_pixels[0, 1], in_pixels[1, 0], in_pixels[1, 1])
        if sigma.s1 <= 1.0:
            return pixel_axes(pixel, in_pixels, distance)
        if wp.abs(sigma.s2) < 1.0:
            return thin_axes(j, pixel, distance)
    gamma = nonorthogonality(a, b, c, d)
    out = own_axes(j, pixel, gamma, 1.0, distance)
    out.width = box_along_axes(out, pixel, 1.0 - gamma)
    return out


@wp.func
def _along(a: wp.vec3, b: wp.vec3, c: wp.vec3, displacement: wp.vec3) -> wp.vec3:
    """How far a displacement goes along each of three axes: the extent of a sweep (Eq. 7)."""
    return wp.vec3(
        wp.abs(wp.dot(a, displacement)), wp.abs(wp.dot(b, displacement)), wp.abs(wp.dot(c, displacement))
    )


@wp.func
def rows_times(row_u: wp.vec3, row_v: wp.vec3, d: wp.vec3) -> wp.vec2:
    """M d (Eq. 7): a displacement in filter space."""
    return wp.vec2(wp.dot(row_u, d), wp.dot(row_v, d))


@wp.func
def in_filter_space(pixel: PixelOnPlane, frame: TangentFrame, row_u: wp.vec3, row_v: wp.vec3) -> wp.mat22:
    """M P and M Q (M of Eq. 7): the sides of a parallelogram in filter space, as columns."""
    p = out_of_frame(frame, pixel.p)
    q = out_of_frame(frame, pixel.q)
    return wp.mat22(wp.dot(row_u, p), wp.dot(row_u, q), wp.dot(row_v, p), wp.dot(row_v, q))


@wp.func
def slant_of(incidence: wp.vec3, n: wp.vec3) -> wp.vec3:
    """How far light goes aside on its way down by one: a curved receiver leaves the plane of a footprint (Eq. 7).

    No farther than ``LARGEST_SLANT``. Beyond the paper, whose receivers are flat.
    """
    height = wp.dot(incidence, n)
    aside = incidence - height * n
    return aside / (height * wp.max(1.0, wp.length(aside) / LARGEST_SLANT))


@cache
def footprint_kernel(radial: str | None, curved: bool, axes_in_light: wp.Function | None = None) -> wp.Kernel:
    """The kernel that shapes footprints (M, Φ |det M|, Eqs. 6 and 7), and bounds what they sweep over.

    Args:
        radial: A radial kernel of Table 1; None for the B-spline, whose trajectories may curve.
        curved: Whether they do.
        axes_in_light: Where lights have an extent, the function that gives axes of footprints averaged over it
            (``light_images``).
    """
    extended = axes_in_light is not None
    # M = 2 J⁻¹ for a radial kernel, whose ellipse has the semi-axes ½ D_u x and ½ D_v x; J⁻¹ for the B-spline's cells.
    scale = 2.0 if radial else 1.0
    variance = VARIANCE[radial] if radial else 1.0

    @wp.kernel(**own_module(calls_inlined()))
    def shape_footprints(
        base: int,
        in_turn: int,
        # In
        dxdu: wp.array(dtype=wp.vec3),
        dxdv: wp.array(dtype=wp.vec3),
        dxdut: wp.array(dtype=wp.vec3),
        dxdvt: wp.array(dtype=wp.vec3),
        receiver_motion: wp.array(dtype=wp.vec3),
        flux: wp.array(dtype=wp.vec3),
        bend: wp.array(dtype=wp.vec3),
        images: LightImageArrays,
        smoothing: float,
        pixel: PixelSize,
        # In and out (center), in (normal, dxdt, acceleration, jerk, is_cell) and out (all else)
        out: FootprintArrays,
    ):
        first_item = base + wp.tid() * in_turn
        for i in range(first_item, first_item + in_turn):
            n = out.normal[i]
            x = out.center[i]
            dxdt = out.dxdt[i]

            # ---- J in the tangent plane, and the axes that it has as seen by pixels
            frame = tangent_frame(n)
            width = smoothing
            if wp.static(extended):
                width *= narrowing_at(images, i)
            a = wp.dot(frame.e1, dxdu[i]) * width
            b = wp.dot(frame.e1, dxdv[i]) * width
            c = wp.dot(frame.e2, dxdu[i]) * width
            d = wp.dot(frame.e2, dxdv[i]) * width
            on_plane = pixel_on_plane(pixel, x, n, frame)
            j = singular_values(a, b, c, d)
            axes = Axes()
            if wp.static(extended):
                light = light_on_plane(images, i, frame)
                axes = axes_in_light(wp.mat22(a, b, c, d), on_plane, light, wp.length(x), out.is_cell[i])
            elif wp.static(radial is None):
                if out.is_cell[i] == 1:
                    axes = cell_axes(j, on_plane, wp.length(x))
                else:
                    axes = axes_of(j, a, b, c, d, on_plane, wp.length(x))
            else:
                axes = own_axes(j, on_plane, 1.0, wp.static(variance), wp.length(x))

            # ---- Where the light of the cell lies on average
            if wp.static(radial is None):
                if bend.shape[0] > 0:
                    out.center[i] = x + wp.where(out.is_cell[i] == 1, CELL_VARIANCE, BSPLINE_VARIANCE) * bend[i]

            # ---- The metric M: rows of J⁻¹, and its determinant
            first = axes.first[0] * frame.e1 + axes.first[1] * frame.e2
            second = axes.second[0] * frame.e1 + axes.second[1] * frame.e2
            sine = axes.first[0] * axes.second[1] - axes.first[1] * axes.second[0]
            first_row = (axes.second[1] * frame.e1 - axes.second[0] * frame.e2) / (sine * axes.t1)
            second_row = (axes.first[0] * frame.e2 - axes.first[1] * frame.e1) / (sine * axes.t2)
            cr = wp.cos(axes.turn)
            sr = wp.sin(axes.turn)
            row_u = wp.static(scale) * (cr * first_row - sr * second_row)
            row_v = wp.static(scale) * (sr * first_row + cr * second_row)
            slant = wp.vec3()
            if out.incidence.shape[0] > 0:
                slant = slant_of(out.incidence[i], n)
                row_u -= wp.dot(row_u, slant) * n
                row_v -= wp.dot(row_v, slant) * n
            out.row_u[i] = row_u
            out.row_v[i] = row_v
            out.dxdt_relative[i] = dxdt - receiver_motion[i]
            out.density[i] = flux[i] * (wp.static(scale * scale) / (axes.t1 * axes.t2 * wp.abs(sine)))
            out.clamped[i] = axes.clamped

            # ---- Extent along the longer axis and across it at mid shutter
            reach = wp.vec2(0.5, 0.5)
            if wp.static(radial is None):
                out.filter_width[i] = axes.width
                reach_u = wp.static(SUPPORT) + 0.5 * axes.width[0]
                reach_v = wp.static(SUPPORT) + 0.5 * (axes.width[1] + axes.width[2])
                if wp.static(extended):
                    if axes.width[2] < 0.0:
                        out.pixel[i] = in_filter_space(axes.averaged, frame, out.row_u[i], out.row_v[i])
                if out.is_cell[i] == 1:
                    sides = in_filter_space(on_plane, frame, out.row_u[i], out.row_v[i])
                    out.pixel[i] = sides
                    reach_u = HALF + pixel_extent(sides, 0)
                    reach_v = HALF + pixel_extent(sides, 1)
                reach = wp.vec2(
                    wp.abs(cr) * reach_u + wp.abs(sr) * reach_v, wp.abs(sr) * reach_u + wp.abs(cr) * reach_v
                )
            long_axis = first
            if axes.t2 * reach[1] > axes.t1 * reach[0]:
                long_axis = second
            other = wp.cross(n, long_axis)
            along1 = axes.t1 * reach[0] * wp.abs(wp.dot(long_axis, first))
            along2 = axes.t2 * reach[1] * wp.abs(wp.dot(long_axis, second))
            across1 = axes.t1 * reach[0] * wp.abs(wp.dot(other, first))
            across2 = axes.t2 * reach[1] * wp.abs(wp.dot(other, second))
            if wp.static(radial is None):
                if out.is_cell[i] == 1:
                    # The sum of two parallelograms: rows of M say more of what is long and thin.
                    side_u = cr * axes.t1 * first - sr * axes.t2 * second
                    side_v = sr * axes.t1 * first + cr * axes.t2 * second
                    along1 = HALF * (wp.abs(wp.dot(long_axis, side_u)) + wp.abs(wp.dot(long_axis, side_v)))
                    across1 = HALF * (wp.abs(wp.dot(other, side_u)) + wp.abs(wp.dot(other, side_v)))
                    p_side = out_of_frame(frame, on_plane.p)
                    q_side = out_of_frame(frame, on_plane.q)
                    along2 = HALF * (wp.abs(wp.dot(long_axis, p_side)) + wp.abs(wp.dot(long_axis, q_side)))
                    across2 = HALF * (wp.abs(wp.dot(other, p_side)) + wp.abs(wp.dot(other, q_side)))

            # ---- Sweep over the shutter: along these axes and the normal, and growth of the axes
            sweep = 0.5 * _along(long_axis, other, n, dxdt)
            normal_extent = 0.5 * wp.length(out.dxdt_relative[i])
            if wp.static(curved):
                acceleration = out.acceleration[i]
                jerk = out.jerk[i]
                sweep += 0.125 * _along(long_axis, other, n, acceleration) + _along(long_axis, other, n, jerk) / 48.0
                normal_extent += 0.125 * wp.length(acceleration) + wp.length(jerk) / 48.0
                # How singular values change up to either end of the shutter, by their own size. What they were widened
                # by stays; what axes turn by does, too: to follow that costs time and gains nothing.
                jc = wp.cos(j.right)
                js = wp.sin(j.right)
                rate1 = (0.5 * width) * (jc * dxdut[i] + js * dxdvt[i])
                rate2 = (0.5 * width) * (jc * dxdvt[i] - js * dxdut[i])
                growth1 = wp.min(j.s1 / axes.t1, 1.0) * wp.dot(first, rate1) / axes.t1
                growth2 = wp.min(wp.abs(j.s2) / axes.t2, 1.0) * wp.dot(second, rate2) / axes.t2
                if wp.static(radial is None):
                    # Axes that stand for more than J may point the other way.
                    if wp.dot(first, wp.cos(j.left) * frame.e1 + wp.sin(j.left) * frame.e2) < 0.0:
                        growth1 = -growth1
                    # Thin axes leave out the sign of s2, which the second one of J's own axes carries.
                    if wp.dot(second, -wp.sin(j.left) * frame.e1 + wp.cos(j.left) * frame.e2) * j.s2 < 0.0:
                        growth2 = -growth2
                if wp.max(wp.abs(growth1), wp.abs(growth2)) > LARGEST_GROWTH and axes.growing > 0.0:
                    out.growth_limited[i] = 1
                growth1 = axes.growing * wp.clamp(growth1, -LARGEST_GROWTH, LARGEST_GROWTH)
                growth2 = axes.growing * wp.clamp(growth2, -LARGEST_GROWTH, LARGEST_GROWTH)
                turn = wp.mat22(cr, -sr, sr, cr)
                sagitta = 0.125 * wp.length(rows_times(out.row_u[i], out.row_v[i], acceleration))
                sagitta += wp.length(rows_times(out.row_u[i], out.row_v[i], jerk)) / 48.0
                if sagitta + HALF_WIDTH * wp.max(wp.abs(growth1), wp.abs(growth2)) < SMALLEST_SAGITTA:
                    growth1 = 0.0
                    growth2 = 0.0
                    out.acceleration[i] = wp.vec3(0.0, 0.0, 0.0)
                    out.jerk[i] = wp.vec3(0.0, 0.0, 0.0)
                out.jacobian_rate[i] = 2.0 * (turn * wp.mat22(growth1, 0.0, 0.0, growth2) * wp.transpose(turn))
                along1 *= 1.0 + wp.abs(growth1)
                across1 *= 1.0 + wp.abs(growth1)
                along2 *= 1.0 + wp.abs(growth2)
                across2 *= 1.0 + wp.abs(growth2)
            tolerance = PLANE_TOLERANCE * (along1 + along2 + across1 + across2 + normal_extent)
            out.plane_tolerance[i] = tolerance
            out.long_axis[i] = long_axis
            sweep += tolerance * wp.vec3(wp.abs(wp.dot(long_axis, slant)), wp.abs(wp.dot(other, slant)), 0.0)
            out.half_extent[i] = wp.vec3(along1 + along2 + sweep[0], across1 + across2 + sweep[1], tolerance + sweep[2])

    return shape_footprints
