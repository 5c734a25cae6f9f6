"""The lobe in which rough metal reflects: GGX facets (Walter et al. 2007) that hide each other (Heitz 2014).

f = F D V/(4 cos θ_i cos θ_o), with D the density of facets, V the height-correlated masking and shadowing of Smith, and
F Schlick's reflectance, which is the metal's colour at normal incidence and white at grazing. What bounces between
facets goes where the rest does (Turquin 2019): f is multiplied by 1 + F₀ (1 − E)/E, with E what white facets reflect at
once (all but two thirds at α = 1). So a white surface reflects all that it receives, and a coloured one is
the more coloured the rougher it is.
"""

import math

import warp as wp

from tpdwarp.scene.device.shaping import across_of

PI = wp.constant(math.pi)
TURN = wp.constant(2.0 * math.pi)
# A surface seen at less than this cosine, as interpolated normals have it, is seen at it.
GRAZING = wp.constant(1.0e-3)
# Width α of the narrowest lobe. Chosen, not derived: below it, single precision knows D by less than a thousandth.
NARROWEST = wp.constant(1.0e-3)

# E of view directions by α = 0, .1 … 1 (rows) and x = μ (1 + α)/(μ + α) = 0, .1 … 1, with μ the cosine of the view.
# Means of G₂/G₁ over 600² visible facets; linear in between, is up to .016 above it.
ROWS = 11
ONCE = (
    0.98, 0.978, 0.953, 0.927, 0.905, 0.892, 0.897, 0.925, 0.964, 0.993, 1.0,
    1.0, 0.976, 0.952, 0.927, 0.905, 0.888, 0.883, 0.896, 0.927, 0.964, 0.988,
    1.0, 0.97, 0.943, 0.916, 0.891, 0.871, 0.858, 0.859, 0.878, 0.911, 0.948,
    1.0, 0.96, 0.927, 0.896, 0.868, 0.843, 0.824, 0.815, 0.82, 0.841, 0.877,
    1.0, 0.947, 0.906, 0.87, 0.837, 0.807, 0.782, 0.764, 0.757, 0.763, 0.787,
    1.0, 0.931, 0.882, 0.839, 0.8, 0.765, 0.734, 0.708, 0.69, 0.682, 0.688,
    1.0, 0.915, 0.856, 0.806, 0.761, 0.72, 0.683, 0.651, 0.623, 0.603, 0.592,
    0.999, 0.897, 0.829, 0.771, 0.72, 0.674, 0.631, 0.593, 0.558, 0.528, 0.504,
    0.999, 0.879, 0.8, 0.735, 0.678, 0.627, 0.58, 0.537, 0.497, 0.46, 0.427,
    0.999, 0.861, 0.772, 0.7, 0.637, 0.582, 0.531, 0.484, 0.44, 0.4, 0.362,
    0.999, 0.842, 0.744, 0.665, 0.598, 0.538, 0.484, 0.435, 0.389, 0.347, 0.307,
)  # fmt: skip
ALBEDOS = wp.constant(wp.types.vector(length=ROWS * ROWS, dtype=wp.float32)(*ONCE))
LAST = wp.constant(ROWS - 1)
# The line between two places of the table lies up to so much below E: no surface reflects more than it receives.
MARGIN = wp.constant(1.006)


@wp.struct
class Lobe:
    """How a point of rough metal reflects towards the viewer.

    ``n`` is the normal, ``to_viewer`` the direction there and ``cosine`` its cosine, ``alpha`` the width of the
    distribution, ``color`` the reflectance at normal incidence, ``gain`` what bounces between facets adds, ``t1`` and
    ``t2`` lie across n.
    """

    n: wp.vec3
    to_viewer: wp.vec3
    cosine: float
    alpha: float
    color: wp.vec3
    gain: wp.vec3
    t1: wp.vec3
    t2: wp.vec3


@wp.func
def reflected_once(cosine: float, alpha: float) -> float:
    """E: what white facets reflect without another bounce, seen at ``cosine``."""
    x = cosine * (1.0 + alpha) / (cosine + alpha) * float(LAST)
    y = alpha * float(LAST)
    column = wp.clamp(int(x), 0, LAST - 1)
    row = wp.clamp(int(y), 0, LAST - 1)
    at = row * (LAST + 1) + column
    a = x - float(column)
    lower = wp.lerp(ALBEDOS[at], ALBEDOS[at + 1], a)
    upper = wp.lerp(ALBEDOS[at + LAST + 1], ALBEDOS[at + LAST + 2], a)
    return wp.lerp(lower, upper, y - float(row))


@wp.func
def lobe_at(n: wp.vec3, to_viewer: wp.vec3, alpha: float, color: wp.vec3) -> Lobe:
    """The lobe of a surface of normal n, seen from the unit direction ``to_viewer``."""
    lobe = Lobe()
    lobe.n = n
    below = GRAZING - wp.dot(n, to_viewer)
    if below > 0.0:
        lobe.to_viewer = wp.normalize(to_viewer + below * n)
    else:
        lobe.to_viewer = to_viewer
    lobe.cosine = wp.dot(n, lobe.to_viewer)
    lobe.alpha = wp.clamp(alpha, NARROWEST, 1.0)
    lobe.color = wp.min(color, wp.vec3(1.0, 1.0, 1.0))
    once = wp.min(MARGIN * reflected_once(lobe.cosine, lobe.alpha), 1.0)
    lobe.gain = wp.vec3(1.0, 1.0, 1.0) + ((1.0 - once) / once) * lobe.color
    lobe.t1 = across_of(n)
    lobe.t2 = wp.cross(n, lobe.t1)
    return lobe


@wp.func
def _slant(cosine: float, alpha: float) -> float:
    """√(α² + (1 − α²) cos² θ), in terms of which Smith's functions are written."""
    return wp.sqrt(alpha * alpha + (1.0 - alpha * alpha) * cosine * cosine)


@wp.func
def _facet_density(lobe: Lobe, h: wp.vec3) -> float:
    """D of the facets that face h."""
    cosine = wp.dot(lobe.n, h)
    sine = wp.length(wp.cross(lobe.n, h))
    a2 = lobe.alpha * lobe.alpha
    spread = a2 * cosine * cosine + sine * sine
    return a2 / (PI * spread * spread)


@wp.func
def reflected(lobe: Lobe, w: wp.vec3) -> wp.vec3:
    """f cos θ_i of light from the unit direction ω: radiance seen by irradiance at normal incidence [1/sr]."""
    cosine = wp.dot(lobe.n, w)
    if cosine <= 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    h = wp.normalize(lobe.to_viewer + w)
    hidden = cosine * _slant(lobe.cosine, lobe.alpha) + lobe.cosine * _slant(cosine, lobe.alpha)
    steep = 1.0 - wp.clamp(wp.dot(h, w), 0.0, 1.0)
    square = steep * steep
    fresnel = lobe.color + (wp.vec3(1.0, 1.0, 1.0) - lobe.color) * (square * square * steep)
    return wp.cw_mul(lobe.gain, fresnel) * (_facet_density(lobe, h) * 0.5 * cosine / hidden)


@wp.func
def chance_of(lobe: Lobe, w: wp.vec3) -> float:
    """Density [1/sr] of ω among the directions of :func:`mirrored_by_a_facet`."""
    if wp.dot(lobe.n, w) <= 0.0:
        return 0.0
    h = wp.normalize(lobe.to_viewer + w)
    return 0.5 * _facet_density(lobe, h) / (lobe.cosine + _slant(lobe.cosine, lobe.alpha))


@wp.func
def share_of_facet(lobe: Lobe, w: wp.vec3) -> wp.vec3:
    """What the surface reflects of light from ω, by how often :func:`mirrored_by_a_facet` looks there."""
    chance = chance_of(lobe, w)
    if chance <= 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    return reflected(lobe, w) / chance


@wp.func
def mirrored_by_a_facet(lobe: Lobe, place: wp.vec2) -> wp.vec3:
    """Where one of the facets that the viewer sees mirrors the viewer's direction to, by ``place`` in the unit square.

    Visible facets of a surface are the caps of a sphere seen from there (Dupuy and Benyoub 2023). The direction may lie
    below the surface.
    """
    local = wp.vec3(wp.dot(lobe.t1, lobe.to_viewer), wp.dot(lobe.t2, lobe.to_viewer), lobe.cosine)
    stretched = wp.normalize(wp.vec3(lobe.alpha * local[0], lobe.alpha * local[1], local[2]))
    z = (1.0 - place[1]) * (1.0 + stretched[2]) - stretched[2]
    sine = wp.sqrt(wp.clamp(1.0 - z * z, 0.0, 1.0))
    h = wp.vec3(sine * wp.cos(TURN * place[0]), sine * wp.sin(TURN * place[0]), z) + stretched
    h = wp.normalize(wp.vec3(lobe.alpha * h[0], lobe.alpha * h[1], h[2]))
    m = h[0] * lobe.t1 + h[1] * lobe.t2 + h[2] * lobe.n
    return wp.normalize(2.0 * wp.dot(lobe.to_viewer, m) * m - lobe.to_viewer)
