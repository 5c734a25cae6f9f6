"""Axes of footprints that are averaged over the image of a light with extent, beside the pixel.

Light from the place (a, b) on a light lands, at first order, a D_a x + b D_b x beside that from its middle. So all of
it leaves the footprint averaged over a disc or a parallelogram on the receiver, the light's image. Image and
pixel together have the variance S = (P Pᵀ + Q Qᵀ)/12 + k (D_a x D_a xᵀ + D_b x D_b xᵀ), k of a disc ¼, of a
parallelogram ⅓. With P', Q' along the principal axes of S, a parallelogram of that variance, footprints are told apart
as they are by pixels (:mod:`tpdwarp.footprints.shaping`):

- larger than P', Q': their own axes, with boxes of P' and Q' along them; translates still sum to one.
- smaller, and the light's image larger than the pixel: the image itself, averaged over the rest: a disc (an ellipse
  on the receiver) over a parallelogram, or a box along D_a x and D_b x. Where the pixel is the larger one, the pixel is
  the box, and the image widens the footprint.
- thin: across the line, the projection of the image; that of a disc (a half ellipse) is made of two boxes. Where the
  image is thinner than the footprint, it is a disc. Where the pixel is the larger one, the pixel is the boxes, exactly:
  pixels side by side then share the line without rest.

The lobes of rough surfaces (:mod:`tpdwarp.photons.rough_lobes`) have no edges: their variance widens the footprint.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bspline import disc_widths
from tpdwarp.footprints.kernels import VARIANCE
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.footprints.shaping import (
    BSPLINE_VARIANCE,
    Axes,
    LightImageArrays,
    LightOnPlane,
    PixelOnPlane,
    across_direction,
    axes_of,
    box_along_axes,
    cell_axes,
    in_sides,
    limited,
    nonorthogonality,
    own_axes,
    pixel_axes,
    singular_values,
    square_along,
    thin_axes,
    thin_axes_between,
)
from tpdwarp.photons.light_columns import (
    IMAGE_DISC,
    IMAGE_LOBE,
    IMAGE_NONE,
    VARIANCE_OF_DISC,
    VARIANCE_OF_INTERVAL,
)
from tpdwarp.scene.light_places import narrowing_of

# An image of less than this part of the pixel's variance is left out: it would widen the pixel by half of that.
NEGLIGIBLE = wp.constant(0.01)
# Footprints that are larger than this part of the image keep their own axes, along which they sum to one: cells no
# wider than that make sums of discs smooth. With a half of it, the shipped wave under a sun of 5 degrees lacked 2.2 %
# of its light where pixels were just eight cells wide; with a quarter, the shipped sea errs by a fifth more (16 k).
FINE = wp.constant(0.35)
# A parallelogram with a smaller sine between its sides is a disc. Chosen, not derived: 6°.
SMALLEST_SINE = wp.constant(0.1)
# The projection of a disc of deviation s, half an ellipse, is 1/(π s) high in the middle. So are two boxes π s and
# √(12 − π²) s wide, which have its variance; their sides by √12 s:
WIDE_BOX = wp.constant(math.pi / math.sqrt(12.0))
NARROW_BOX = wp.constant(math.sqrt(12.0 - math.pi**2) / math.sqrt(12.0))
# A disc has no less than this part of the variance of what it stands for: the parabola that its rim is to pixels falls
# short of it where they are wider than its radius.
LEAST_DISC = wp.constant(2.0 / 3.0)
# What a disc is averaged over has no less than this part of the variance, so that the differences that make parabolas
# of wide footprints see its edge; its height is less than 1 % off by it.
SHARPEST = wp.constant(0.04)


@wp.func
def _outer(v: wp.vec2) -> wp.mat22:
    return wp.outer(v, v)


@wp.struct
class PrincipalAxes:
    """A variance along its principal axes: s1 ≥ s2 ≥ 0, and the direction of s1."""

    s1: float
    s2: float
    first: wp.vec2


@wp.func
def principal_axes(variance: wp.mat22) -> PrincipalAxes:
    """Eigenvalues and the first eigenvector of a variance, without the angles that a general matrix takes."""
    half = 0.5 * (variance[0, 0] - variance[1, 1])
    off = variance[0, 1]
    mean = 0.5 * (variance[0, 0] + variance[1, 1])
    apart = wp.sqrt(half * half + off * off)
    out = PrincipalAxes()
    out.s1 = mean + apart
    out.s2 = wp.abs(mean - apart)
    # Of the two rows of the matrix less s2, which both lie along it, the one that is not lost to rounding.
    along = wp.vec2(off, apart - half)
    if half > 0.0:
        along = wp.vec2(apart + half, off)
    length = wp.length(along)
    out.first = wp.vec2(1.0, 0.0)
    if length > 0.0:
        out.first = along / length
    return out


@wp.func
def variance_root(variance: wp.mat22) -> wp.mat22:
    """The symmetric square root of a variance, a footprint W with W Wᵀ = variance: (V + √|V| 1)/√(tr V + 2 √|V|)."""
    determinant = wp.sqrt(wp.max(wp.determinant(variance), 0.0))
    square = wp.trace(variance) + 2.0 * determinant
    if square <= 0.0:
        return wp.mat22(0.0, 0.0, 0.0, 0.0)
    return (variance + wp.diag(wp.vec2(determinant, determinant))) / wp.sqrt(square)


@wp.func
def light_variance(light: LightOnPlane) -> wp.mat22:
    """The variance of a light's image on the receiver."""
    k = VARIANCE_OF_INTERVAL
    if light.image == IMAGE_DISC:
        k = VARIANCE_OF_DISC
    elif light.image == IMAGE_LOBE:
        k = 1.0
    return k * (_outer(light.a) + _outer(light.b))


@wp.func
def spline_over_image(j: wp.mat22, light: LightOnPlane) -> wp.mat22:
    """A cell of the B-spline, along principal axes, that spreads light as far as J does with the image of its light.

    A B-spline has the variance ¼ J Jᵀ, and the image adds its own.
    """
    of = principal_axes(BSPLINE_VARIANCE * j * wp.transpose(j) + light_variance(light))
    one = wp.sqrt(of.s1 / BSPLINE_VARIANCE) * of.first
    two = wp.sqrt(of.s2 / BSPLINE_VARIANCE) * wp.vec2(-of.first[1], of.first[0])
    return wp.mat22(one[0], two[0], one[1], two[1])


@wp.func
def parallelogram_of(variance: wp.mat22) -> PixelOnPlane:
    """The rectangle that has a variance."""
    s = principal_axes(variance)
    out = PixelOnPlane()
    out.p = wp.sqrt(12.0 * s.s1) * s.first
    out.q = wp.sqrt(12.0 * s.s2) * wp.vec2(-s.first[1], s.first[0])
    return out


@wp.func
def sides_of(variance: wp.mat22) -> PixelOnPlane:
    """Sides of a parallelogram that has a variance, whichever: one of them along the first axis."""
    out = PixelOnPlane()
    first = wp.sqrt(12.0 * variance[0, 0])
    if first > 0.0:
        along = 12.0 * variance[0, 1] / first
        out.p = wp.vec2(first, along)
        out.q = wp.vec2(0.0, wp.sqrt(wp.max(12.0 * variance[1, 1] - along * along, 0.0)))
    else:
        out.p = wp.vec2(0.0, wp.sqrt(12.0 * variance[1, 1]))
    return out


@wp.func
def turned_as(j: wp.mat22) -> wp.mat22:
    """The turn in J, (J Jᵀ)^−½ J: a symmetric footprint times it is the one of that variance that is nearest to J.

    It is J and its cofactors, which have the same turn and changed singular values, together; of a J that mirrors their
    difference.
    """
    cofactors = wp.mat22(j[1, 1], -j[1, 0], -j[0, 1], j[0, 0])
    both = j + wp.where(wp.determinant(j) < 0.0, -1.0, 1.0) * cofactors
    length = wp.sqrt(0.5 * wp.ddot(both, both))
    if length <= 0.0:
        return wp.mat22(1.0, 0.0, 0.0, 1.0)
    return both / length


@wp.func
def disc_axes(light: wp.mat22, total: wp.mat22, pixel: PixelOnPlane, distance: float) -> Axes:
    """Axes of a disc of the variance ``light``, averaged over a parallelogram that has the rest of ``total``.

    The disc has no less than a part of ``total`` (``LEAST_DISC``) in any direction, and the rest is no less than
    another (``SHARPEST``). The parallelogram is turned as the pixel is.
    """
    root = variance_root(total)
    part = wp.inverse(root) * light * wp.inverse(root)
    s = principal_axes(part)
    along = root * s.first
    across = root * wp.vec2(-s.first[1], s.first[0])
    of_disc = wp.vec2(wp.clamp(s.s1, LEAST_DISC, 1.0), wp.clamp(s.s2, LEAST_DISC, 1.0))
    rest = wp.vec2(wp.max(1.0 - of_disc[0], SHARPEST), wp.max(1.0 - of_disc[1], SHARPEST))
    disc = of_disc[0] * _outer(along) + of_disc[1] * _outer(across)
    around = variance_root(12.0 * (rest[0] * _outer(along) + rest[1] * _outer(across)))
    sides = around * turned_as(wp.mat22(pixel.p[0], pixel.q[0], pixel.p[1], pixel.q[1]))
    of = principal_axes(disc)
    out = Axes()
    out.first = of.first
    out.second = wp.vec2(-out.first[1], out.first[0])
    out.t1 = wp.sqrt(of.s1)
    out.t2 = wp.sqrt(of.s2)
    out = limited(out, distance)
    out.averaged.p = wp.vec2(sides[0, 0], sides[1, 0])
    out.averaged.q = wp.vec2(sides[0, 1], sides[1, 1])
    u = out.first / out.t1
    v = out.second / out.t2
    in_disc = wp.mat22(
        wp.dot(u, out.averaged.p), wp.dot(u, out.averaged.q), wp.dot(v, out.averaged.p), wp.dot(v, out.averaged.q)
    )
    # Half of a box of that variance, by the radius of two.
    softness = 0.5 * wp.sqrt(3.0 * wp.min(rest[0] / of_disc[0], rest[1] / of_disc[1]))
    out.width = disc_widths(in_disc, softness)
    return out


@wp.func
def image_axes(j: wp.mat22, pixel: PixelOnPlane, light: LightOnPlane, distance: float) -> Axes:
    """Axes of a B-spline footprint J that is averaged over a pixel and the image of its light."""
    singular = singular_values(j[0, 0], j[0, 1], j[1, 0], j[1, 1])
    by_light = light_variance(light)
    by_pixel = (_outer(pixel.p) + _outer(pixel.q)) / 12.0
    if light.image == IMAGE_NONE or wp.trace(by_light) <= NEGLIGIBLE * wp.trace(by_pixel):
        return axes_of(singular, j[0, 0], j[0, 1], j[1, 0], j[1, 1], pixel, distance)
    if light.image == IMAGE_LOBE:
        wide = 2.0 * variance_root(0.25 * j * wp.transpose(j) + by_light)
        of_lobe = singular_values(wide[0, 0], wide[0, 1], wide[1, 0], wide[1, 1])
        return axes_of(of_lobe, wide[0, 0], wide[0, 1], wide[1, 0], wide[1, 1], pixel, distance)
    total = by_light + by_pixel
    both = sides_of(total)
    lit = wp.trace(by_light) > wp.trace(by_pixel)
    limit = wp.where(lit, FINE, 1.0)
    if wp.length_sq(both.q) > 0.0:
        in_both = in_sides(both, j)
        sigma = singular_values(in_both[0, 0], in_both[0, 1], in_both[1, 0], in_both[1, 1])
        own = 0.25 * j * wp.transpose(j)
        # ---- Smaller than image and pixel
        if sigma.s1 <= limit:
            if not lit:
                return pixel_axes(pixel, in_sides(pixel, 2.0 * variance_root(own + by_light)), distance)
            sine = wp.abs(light.a[0] * light.b[1] - light.a[1] * light.b[0])
            if light.image != IMAGE_DISC and sine > SMALLEST_SINE * wp.length(light.a) * wp.length(light.b):
                box = PixelOnPlane()
                box.p = 2.0 * light.a
                box.q = 2.0 * light.b
                return pixel_axes(box, in_sides(box, 2.0 * variance_root(own + by_pixel)), distance)
            return disc_axes(by_light, own + total, pixel, distance)
        # ---- The image is a line, and the footprint none
        of_both = principal_axes(total)
        rounder = singular.s2 * singular.s2 * of_both.s1 > singular.s1 * singular.s1 * of_both.s2
        if wp.abs(sigma.s2) < limit and lit and rounder:
            return disc_axes(by_light, own + total, pixel, distance)
        # ---- A line
        if wp.abs(sigma.s2) < limit:
            if not lit:
                wide = variance_root(j * wp.transpose(j) + 4.0 * by_light)
                return thin_axes(singular_values(wide[0, 0], wide[0, 1], wide[1, 0], wide[1, 1]), pixel, distance)
            across = across_direction(singular)
            side = wp.sqrt(square_along(both, across))
            one = WIDE_BOX * side
            other = NARROW_BOX * side
            if light.image != IMAGE_DISC:
                one = wp.abs(wp.dot(light.a, across))
                other = wp.abs(wp.dot(light.b, across))
                scale = side / wp.max(wp.sqrt(one * one + other * other), 1.0e-30)
                one *= scale
                other *= scale
            return thin_axes_between(singular, both, one, other, distance)
    # ---- Larger
    gamma = nonorthogonality(j[0, 0], j[0, 1], j[1, 0], j[1, 1])
    out = own_axes(singular, both, gamma, 1.0, distance)
    out.width = box_along_axes(out, both, 1.0 - gamma)
    return out


@wp.func
def cell_in_light(j: wp.mat22, light: LightOnPlane) -> wp.mat22:
    """The cell W that stands for a cell J averaged over the image of its light: W Wᵀ/12 = J Jᵀ/12 + its variance.

    W = (W Wᵀ)^½ (J Jᵀ)^−½ J, the one nearest to J.
    """
    return variance_root(j * wp.transpose(j) + 12.0 * light_variance(light)) * turned_as(j)


@wp.func
def is_widened(pixel: PixelOnPlane, light: LightOnPlane) -> bool:
    """Whether the image of a light counts beside a pixel."""
    if light.image == IMAGE_NONE:
        return False
    return wp.trace(light_variance(light)) > NEGLIGIBLE * pixel_variance_trace(pixel)


@wp.func
def pixel_variance_trace(pixel: PixelOnPlane) -> float:
    """The variance of a pixel along both axes together."""
    return (wp.length_sq(pixel.p) + wp.length_sq(pixel.q)) / 12.0


@wp.func
def spline_or_cell_axes(j: wp.mat22, pixel: PixelOnPlane, light: LightOnPlane, distance: float, is_cell: int) -> Axes:
    """Axes of a B-spline footprint, or a cell, that is averaged over a pixel and the image of its light."""
    if is_cell == 1:
        w = j
        if is_widened(pixel, light):
            w = cell_in_light(j, light)
        return cell_axes(singular_values(w[0, 0], w[0, 1], w[1, 0], w[1, 1]), pixel, distance)
    return image_axes(j, pixel, light, distance)


@cache
def axes_in_light(radial: str | None) -> wp.Function:
    """The function that gives the axes of a footprint, averaged over a pixel and its light's image.

    Args:
        radial: A radial kernel of Table 1, whose singular values are widened by both; None for the B-spline.
    """
    if radial is None:
        return spline_or_cell_axes
    variance = VARIANCE[radial]

    @wp.func
    def radial_axes(j: wp.mat22, pixel: PixelOnPlane, light: LightOnPlane, distance: float, is_cell: int) -> Axes:
        both = pixel
        if light.image != IMAGE_NONE:
            both = parallelogram_of(light_variance(light) + (_outer(pixel.p) + _outer(pixel.q)) / 12.0)
        return own_axes(
            singular_values(j[0, 0], j[0, 1], j[1, 0], j[1, 1]), both, 1.0, wp.static(variance), distance
        )

    return radial_axes


def images_of(parts: Sequence[PhotonRows], kernel: str, launcher: Launcher) -> LightImageArrays:
    """What the lights of photons span, one row a photon; no rows where no light has an extent."""
    out = LightImageArrays()
    out.narrowing = 1.0
    if all(part.has("image") for part in parts):
        if kernel == "bspline":
            out.narrowing = narrowing_of(max(part.photons.light_parts for part in parts))
        out.dxda, out.dxdb = (launcher.array(stacked(parts, name), wp.vec3) for name in ("dxda", "dxdb"))
        out.image = launcher.array(stacked(parts, "image"), wp.int32)
    return out
