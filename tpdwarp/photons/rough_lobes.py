"""Rough glass and metal: a lobe of directions as a beam that is widened (beyond the paper).

A rough surface is many small facets, whose normals m lie about that of the surface as GGX says (Walter et al. 2007):
tan θ_m is α in the median. A photon goes as at the smooth surface, and its columns a and b take on what its direction
would change by with a normal that is off by the lobe's deviation, by Igehy's differentials (1999). From there on they
go as any column does, and the footprint is widened by their variance. The deviation σ = α/√(2 ln 2) is that of the
Gaussian with the same median: GGX has no variance, and the light in its long tails stays near the footprint.

Where a beam has columns a and b already, of a light's extent or of a rough surface before, the variance of its
direction adds up, W' = √(W Wᵀ + L Lᵀ), and X' = X Wᵀ W'⁻ᵀ keeps how its place goes with its direction.

Camera rays take one facet a sample, so that what is seen through a rough surface is as noisy as there are few samples.
"""

import math

import warp as wp

from tpdwarp.photons.beam import Interface
from tpdwarp.photons.differentials import (
    fresnel_reflectance,
    reflect,
    reflect_differential,
    refract,
    refract_differential,
    refracted_cosine_squared,
)
from tpdwarp.photons.light_columns import IMAGE_DISC, IMAGE_LOBE, IMAGE_PARALLELOGRAM, LightColumns
from tpdwarp.scene.device.intersection import Hit
from tpdwarp.scene.device.shaping import across_of

# Deviation of the Gaussian whose median is 1.
DEVIATION = wp.constant(1.0 / math.sqrt(2.0 * math.log(2.0)))
# Deviations of a disc of radius 1 and of an interval from −1 to 1.
OF_DISC = wp.constant(0.5)
OF_INTERVAL = wp.constant(math.sqrt(1.0 / 3.0))
TURN = wp.constant(2.0 * math.pi)
# Deviation of the sum of two alike.
BOTH_SIDES = wp.constant(math.sqrt(2.0))
# Facets that are steeper than this many times α are not sampled: one in ten thousand.
STEEPEST = wp.constant(100.0)


@wp.func
def _variance_root(v: wp.mat22) -> wp.mat22:
    """The symmetric square root of a variance."""
    s = wp.sqrt(wp.max(wp.determinant(v), 0.0))
    t = wp.sqrt(wp.max(v[0, 0] + v[1, 1] + 2.0 * s, 1.0e-30))
    return wp.mat22(v[0, 0] + s, v[0, 1], v[1, 0], v[1, 1] + s) / t


@wp.func
def _off(w: wp.vec3, at: Interface, reflected: bool, dnda: wp.vec3) -> wp.vec3:
    """By how much the direction of a beam changes with the normal (Igehy 1999)."""
    still = wp.vec3(0.0, 0.0, 0.0)
    if reflected:
        return reflect_differential(w, at.n, still, dnda)
    return refract_differential(w, at.n, at.eta, at.cos_t, still, dnda)


@wp.func
def widened(
    columns: LightColumns, w: wp.vec3, after: wp.vec3, at: Interface, reflected: bool, roughness: float
) -> LightColumns:
    """The columns a and b of a beam that a rough surface sends from the direction ω on into ``after``."""
    t1 = across_of(at.n)
    one = _off(w, at, reflected, DEVIATION * roughness * t1)
    other = _off(w, at, reflected, DEVIATION * roughness * wp.cross(at.n, t1))
    return _taken_on(columns, after, one, other)


@wp.func
def widened_by_sheet(columns: LightColumns, w: wp.vec3, index: float, roughness: float) -> LightColumns:
    """The columns a and b of a beam of direction ω behind a sheet that is rough on both of its sides.

    Either side turns light by n − 1 times the slope of its facet, where the sheet is not much tilted.
    """
    spread = DEVIATION * roughness * BOTH_SIDES * (index - 1.0)
    t1 = across_of(w)
    return _taken_on(columns, w, spread * t1, spread * wp.cross(w, t1))


@wp.func
def _taken_on(columns: LightColumns, after: wp.vec3, one: wp.vec3, other: wp.vec3) -> LightColumns:
    """The columns of a beam that goes on into ``after``, where its direction varies by ``one`` and ``other`` too."""
    out = columns
    scale = float(1.0)
    if columns.image == IMAGE_DISC:
        scale = OF_DISC
    elif columns.image == IMAGE_PARALLELOGRAM:
        scale = OF_INTERVAL
    out.image = IMAGE_LOBE
    e1 = across_of(after)
    e2 = wp.cross(after, e1)
    a = scale * columns.dwda
    b = scale * columns.dwdb
    before = wp.mat22(wp.dot(e1, a), wp.dot(e1, b), wp.dot(e2, a), wp.dot(e2, b))
    lobe = wp.mat22(wp.dot(e1, one), wp.dot(e1, other), wp.dot(e2, one), wp.dot(e2, other))
    now = _variance_root(before * wp.transpose(before) + lobe * wp.transpose(lobe))
    out.dwda = now[0, 0] * e1 + now[1, 0] * e2
    out.dwdb = now[0, 1] * e1 + now[1, 1] * e2
    keeps = wp.mat22(0.0, 0.0, 0.0, 0.0)
    if wp.abs(wp.determinant(now)) > 1.0e-20:
        keeps = scale * wp.transpose(before) * wp.inverse(now)
    out.dxda = keeps[0, 0] * columns.dxda + keeps[1, 0] * columns.dxdb
    out.dxdb = keeps[0, 1] * columns.dxda + keeps[1, 1] * columns.dxdb
    return out


@wp.func
def _slope(roughness: float, u: float) -> float:
    """Slope of a facet of GGX, by u in 0 … 1."""
    return roughness * wp.min(wp.sqrt(u / wp.max(1.0 - u, 1.0e-6)), STEEPEST)


@wp.func
def behind_sheet(w: wp.vec3, index: float, roughness: float, u: float, v: float) -> wp.vec3:
    """The direction of a camera ray behind a rough sheet, chosen by u and v as :func:`facet` is."""
    turn = BOTH_SIDES * (index - 1.0) * _slope(roughness, u)
    t1 = across_of(w)
    return wp.normalize(w + turn * (wp.cos(TURN * v) * t1 + wp.sin(TURN * v) * wp.cross(w, t1)))


@wp.func
def facet(at: Interface, hit: Hit, w: wp.vec3, dielectric: bool, roughness: float, u: float, v: float) -> Interface:
    """The interface at one facet of a rough surface, chosen by u and v in 0 … 1; the surface where it would turn light
    to the wrong side."""
    slope = _slope(roughness, u)
    t1 = across_of(at.n)
    t2 = wp.cross(at.n, t1)
    m = wp.normalize(at.n + slope * (wp.cos(TURN * v) * t1 + wp.sin(TURN * v) * t2))
    n_g = at.side * hit.n_g
    out = Interface()
    out.side = at.side
    out.flat = at.flat
    out.shading = at.shading
    out.eta = at.eta
    out.n = m
    out.reflectance = 1.0
    out.cos_t = 0.0
    cos_i = -wp.dot(w, m)
    consistent = cos_i > 0.0 and wp.dot(reflect(w, m), n_g) > 0.0
    if dielectric:
        square = refracted_cosine_squared(cos_i, at.eta)
        if square > 0.0:
            out.cos_t = wp.sqrt(square)
            out.reflectance = fresnel_reflectance(cos_i, out.cos_t, at.eta)
            consistent = consistent and wp.dot(refract(w, m, at.eta, out.cos_t), n_g) < 0.0
    if consistent:
        return out
    return at
