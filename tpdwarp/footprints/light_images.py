"""Axes of footprints that are averaged over the image of a light with extent, beside the pixel.

Light from the place (a, b) on a light lands, at first order, a D_a x + b D_b x beside that from its middle. So all of
it leaves the footprint averaged over a disc or a parallelogram on the receiver, the light's image. Image and
pixel together have the variance S = (P Pᵀ + Q Qᵀ)/12 + k (D_a x D_a xᵀ + D_b x D_b xᵀ), k of a disc ¼, of a
parallelogram ⅓. With P', Q' along the principal axes of S, a parallelogram of that variance, footprints are told apart
as they are by pixels (:mod:`tpdwarp.footprints.shaping`):

- larger than P', Q': their own axes, with boxes of P' and Q' along them; translates still sum to one.
- smaller, and the light's image larger than the pixel: the image itself, whose edge the rest makes soft: a soft disc
  (an ellipse on the receiver), or a box along D_a x and D_b x. Where the pixel is the larger one, the pixel is the box.
- thin: across the line, the projection of the image; that of a disc (a half ellipse) is made of two boxes. Where the
  image is thinner than the footprint, it is a soft disc.

The lobes of rough surfaces (:mod:`tpdwarp.photons.rough_lobes`) have no edges: their variance widens the footprint.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bspline import disc_widths
from tpdwarp.footprints.kernels import VARIANCE
from tpdwarp.footprints.shaping import (
    Axes,
    LightImageArrays,
    LightOnPlane,
    PixelOnPlane,
    across_direction,
    axes_of,
    box_along_axes,
    cell_axes,
    direction,
    in_sides,
    limited,
    nonorthogonality,
    own_axes,
    pixel_axes,
    singular_values,
    square_along,
    thin_axes_between,
)
from tpdwarp.photons.light_columns import (
    IMAGE_DISC,
    IMAGE_LOBE,
    IMAGE_NONE,
    VARIANCE_OF_DISC,
    VARIANCE_OF_INTERVAL,
)
from tpdwarp.photons.photon_map import PhotonMap, joined
from tpdwarp.scene.light_places import narrowing_of

# An image of less than this part of the pixel's variance is left out: it would widen the pixel by half of that.
NEGLIGIBLE = wp.constant(0.01)
# Footprints that are larger than this part of the image keep their own axes, along which they sum to one: cells no
# wider than that make sums of discs smooth.
FINE = wp.constant(0.5)
# A parallelogram with a smaller sine between its sides is a soft disc. Chosen, not derived: 6°.
SMALLEST_SINE = wp.constant(0.1)
# The projection of a disc of deviation s, half an ellipse, is 1/(π s) high in the middle. So are two boxes π s and
# √(12 − π²) s wide, which have its variance; their sides by √12 s:
WIDE_BOX = wp.constant(math.pi / math.sqrt(12.0))
NARROW_BOX = wp.constant(math.sqrt(12.0 - math.pi**2) / math.sqrt(12.0))
# The edge of a soft disc is no sharper than this part of its radius, so that the differences that make parabolas of
# wide footprints see it; its height is less than 1 % off by it.
SHARPEST = wp.constant(0.2)


@wp.func
def _outer(v: wp.vec2) -> wp.mat22:
    return wp.outer(v, v)


@wp.func
def _root(variance: wp.mat22) -> wp.mat22:
    """The symmetric square root of a variance: a footprint W with W Wᵀ = variance."""
    s = singular_values(variance[0, 0], variance[0, 1], variance[1, 0], variance[1, 1])
    first = direction(s.left)
    second = wp.vec2(-first[1], first[0])
    return wp.sqrt(s.s1) * _outer(first) + wp.sqrt(wp.abs(s.s2)) * _outer(second)


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
def parallelogram_of(variance: wp.mat22) -> PixelOnPlane:
    """The rectangle that has a variance."""
    s = singular_values(variance[0, 0], variance[0, 1], variance[1, 0], variance[1, 1])
    out = PixelOnPlane()
    first = direction(s.left)
    out.p = wp.sqrt(12.0 * s.s1) * first
    out.q = wp.sqrt(12.0 * wp.abs(s.s2)) * wp.vec2(-first[1], first[0])
    return out


@wp.func
def softness_of(share: float) -> float:
    """Softness q of a disc that has the part ``share`` of the variance of what it stands for.

    A soft disc of radius R has the variance R²/4 (1 + 6/5 q² + 3/35 q⁴)/(1 + q²/5), that of its disc by the share.
    """
    a = 3.0 / 35.0
    b = 1.2 - 0.2 / share
    c = 1.0 - 1.0 / share
    return wp.clamp(wp.sqrt((wp.sqrt(b * b - 4.0 * a * c) - b) / (2.0 * a)), SHARPEST, 1.0)


@wp.func
def disc_axes(light: wp.mat22, total: wp.mat22, distance: float) -> Axes:
    """Axes of a soft disc of the variance ``total``, of which the disc itself has ``light``."""
    s = singular_values(total[0, 0], total[0, 1], total[1, 0], total[1, 1])
    share = wp.clamp(0.5 * wp.trace(wp.inverse(total) * light), 1.0e-3, 1.0)
    q = softness_of(share)
    square = q * q
    widened = (1.0 + 1.2 * square + 3.0 / 35.0 * square * square) / (1.0 + 0.2 * square)
    scale = wp.max(1.0 / widened, share)
    out = Axes()
    out.first = direction(s.left)
    out.second = wp.vec2(-out.first[1], out.first[0])
    out.t1 = wp.sqrt(scale * s.s1)
    out.t2 = wp.sqrt(scale * wp.abs(s.s2))
    out = limited(out, distance)
    out.width = disc_widths(q)
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
        wide = 2.0 * _root(0.25 * j * wp.transpose(j) + by_light)
        of_lobe = singular_values(wide[0, 0], wide[0, 1], wide[1, 0], wide[1, 1])
        return axes_of(of_lobe, wide[0, 0], wide[0, 1], wide[1, 0], wide[1, 1], pixel, distance)
    both = parallelogram_of(by_light + by_pixel)
    lit = wp.trace(by_light) > wp.trace(by_pixel)
    limit = wp.where(lit, FINE, 1.0)
    if wp.length_sq(both.q) > 0.0:
        in_both = in_sides(both, j)
        sigma = singular_values(in_both[0, 0], in_both[0, 1], in_both[1, 0], in_both[1, 1])
        own = 0.25 * j * wp.transpose(j)
        # ---- Smaller than image and pixel
        if sigma.s1 <= limit:
            if not lit:
                return pixel_axes(pixel, in_sides(pixel, 2.0 * _root(own + by_light)), distance)
            sine = wp.abs(light.a[0] * light.b[1] - light.a[1] * light.b[0])
            if light.image != IMAGE_DISC and sine > SMALLEST_SINE * wp.length(light.a) * wp.length(light.b):
                box = PixelOnPlane()
                box.p = 2.0 * light.a
                box.q = 2.0 * light.b
                return pixel_axes(box, in_sides(box, 2.0 * _root(own + by_pixel)), distance)
            return disc_axes(by_light, own + by_light + by_pixel, distance)
        # ---- The image is a line, and the footprint none
        rounder = wp.abs(singular.s2) * wp.length(both.p) > singular.s1 * wp.length(both.q)
        if wp.abs(sigma.s2) < limit and lit and rounder:
            return disc_axes(by_light, own + by_light + by_pixel, distance)
        # ---- A line
        if wp.abs(sigma.s2) < limit:
            across = across_direction(singular)
            side = wp.sqrt(square_along(both, across))
            one = WIDE_BOX * side
            other = NARROW_BOX * side
            if not lit or light.image != IMAGE_DISC:
                one = wp.abs(wp.dot(pixel.p, across))
                other = wp.abs(wp.dot(pixel.q, across))
                if lit:
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
def cell_in_light(j: wp.mat22, pixel: PixelOnPlane, light: LightOnPlane) -> wp.mat22:
    """The cell W that stands for a cell J averaged over the image of its light: W Wᵀ/12 = J Jᵀ/12 + its variance.

    W = (W Wᵀ)^½ (J Jᵀ)^−½ J, the one nearest to J.
    """
    by_light = light_variance(light)
    if light.image == IMAGE_NONE or wp.trace(by_light) <= NEGLIGIBLE * pixel_variance_trace(pixel):
        return j
    s = singular_values(j[0, 0], j[0, 1], j[1, 0], j[1, 1])
    left = wp.mat22(wp.cos(s.left), -wp.sin(s.left), wp.sin(s.left), wp.cos(s.left))
    right = wp.mat22(wp.cos(s.right), -wp.sin(s.right), wp.sin(s.right), wp.cos(s.right))
    turn = left * wp.mat22(1.0, 0.0, 0.0, wp.where(s.s2 < 0.0, -1.0, 1.0)) * wp.transpose(right)
    return _root(j * wp.transpose(j) + 12.0 * by_light) * turn


@wp.func
def pixel_variance_trace(pixel: PixelOnPlane) -> float:
    """The variance of a pixel along both axes together."""
    return (wp.length_sq(pixel.p) + wp.length_sq(pixel.q)) / 12.0


@wp.func
def spline_or_cell_axes(j: wp.mat22, pixel: PixelOnPlane, light: LightOnPlane, distance: float, is_cell: int) -> Axes:
    """Axes of a B-spline footprint, or a cell, that is averaged over a pixel and the image of its light."""
    if is_cell == 1:
        w = cell_in_light(j, pixel, light)
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


def images_of(maps: list[PhotonMap], kernel: str, launcher: Launcher) -> LightImageArrays:
    """What the lights of photons span, one row a photon; no rows where no light has an extent."""
    out = LightImageArrays()
    out.narrowing = 1.0
    if all(len(photons.image) == len(photons) for photons in maps):
        if kernel == "bspline":
            out.narrowing = narrowing_of(max(photons.light_parts for photons in maps))
        out.dxda, out.dxdb = (
            launcher.array(joined([getattr(photons, name) for photons in maps]), wp.vec3) for name in ("dxda", "dxdb")
        )
        out.image = launcher.array(joined([photons.image for photons in maps]), wp.int32)
    return out
