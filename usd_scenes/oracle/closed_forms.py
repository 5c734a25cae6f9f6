"""Closed forms of optics, and of optics that move. "Check k" is the number in the method's list of closed-form checks.

Angles are in radians, lengths in one unit, speeds ``w`` are displacements over the exposure.
"""

from __future__ import annotations

import math

import numpy as np

KERNEL_PEAKS = {
    "uniform": 1 / math.pi,
    "cone": 3 / math.pi,
    "epanechnikov": 2 / math.pi,
    "quartic": 3 / math.pi,
    "gaussian": 1 / (2 * math.pi * (1 - math.exp(-0.5))),
    "bspline": 9 / 16,
}
"""Check 17: K(0) of kernels that integrate to one (Table 1), in filter space; the B-spline per lattice cell."""

KERNEL_K1 = {
    "uniform": 2 / math.pi,
    "cone": 3 / math.pi,
    "epanechnikov": 8 / (3 * math.pi),
    "quartic": 16 / (5 * math.pi),
    "gaussian": math.erf(math.sqrt(0.5)) / (math.sqrt(2 * math.pi) * (1 - math.exp(-0.5))),
}
"""Check 17: k1 = ∫₋₁¹ K along a diameter, so that a footprint swept over σ has the weight 1 + σ k1 (Table 1)."""


def snell(theta_i: float, n_i: float, n_t: float) -> float:
    """Check 21: angle of refraction; NaN where light is totally reflected."""
    sine = n_i * math.sin(theta_i) / n_t
    return math.asin(sine) if abs(sine) <= 1 else math.nan


def critical_angle(n_i: float, n_t: float) -> float:
    """Check 21: incidence above which light is totally reflected (41.81° from 1.5 to 1)."""
    return math.asin(n_t / n_i)


def fresnel_reflectance(theta_i: float, n_i: float, n_t: float) -> float:
    """Check 21: unpolarised reflectance by Fresnel's sine and tangent laws (0.04 at normal incidence, 1 to 1.5)."""
    if abs(theta_i) < 1e-9:
        return ((n_i - n_t) / (n_i + n_t)) ** 2
    theta_t = snell(theta_i, n_i, n_t)
    if math.isnan(theta_t):
        return 1.0
    perpendicular = math.sin(theta_i - theta_t) / math.sin(theta_i + theta_t)
    parallel = math.tan(theta_i - theta_t) / math.tan(theta_i + theta_t)
    return 0.5 * (perpendicular**2 + parallel**2)


def slab_transmittance(reflectance: float) -> float:
    """Check 21: (1−R)/(1+R), all internal reflections summed (0.9231 for glass at normal incidence)."""
    return (1 - reflectance) / (1 + reflectance)


def brewster_angle(n_i: float, n_t: float) -> float:
    """Incidence at which the parallel component is not reflected."""
    return math.atan2(n_t, n_i)


def mirror_displacement(w: float, theta: float) -> float:
    """Check 1: |D_t x| on a receiver parallel to a flat mirror that moves by w along its normal."""
    return 2 * w * math.tan(theta)


def mirror_image_displacement(w: float) -> float:
    """Check 1: displacement of a point source's image in a flat mirror that moves by w along its normal."""
    return 2 * w


def interface_displacement(w: float, theta_i: float, n_i: float, n_t: float) -> float:
    """Check 2: D_t x along the ray's lateral direction, flat interface moving by w towards the light."""
    return w * (math.tan(snell(theta_i, n_i, n_t)) - math.tan(theta_i))


def slab_displacement() -> float:
    """Check 3: D_t x behind a parallel slab that moves along its normal."""
    return 0.0


def slab_shift(thickness: float, theta_i: float, n: float) -> float:
    """Check 3: how far behind the unrefracted ray a slab lets the light land, along a parallel receiver."""
    return thickness * (math.tan(theta_i) - math.tan(snell(theta_i, 1.0, n)))


def galilean_displacement(w: np.ndarray, stretch: np.ndarray, anchor: str) -> np.ndarray:
    """Check 4: object moving by w [k] across collimated light; ``stretch`` [k, k] is ∂x/∂x₀, receiver parallel."""
    w = np.asarray(w, dtype=np.float64)
    return w if anchor == "surface" else w - np.asarray(stretch) @ w


def travelling_wave_displacement(c: float, stretch: float) -> float:
    """Check 5: D_t x below a shape that travels by c under vertical light; ``stretch`` is ∂x/∂x₀ (0 at a focus)."""
    return c * (1 - stretch)


def receiver_normal_displacement(w: float, theta: float) -> float:
    """Check 7: |D_t x_rel| on a receiver that moves by w along its normal under light at angle theta."""
    return abs(w) * math.tan(theta)


def receiver_tangential_displacement(w: np.ndarray) -> np.ndarray:
    """Check 7: D_t x_rel on a receiver that moves by w within its plane under light that does not."""
    return -np.asarray(w, dtype=np.float64)


def coddington(distance: float, radius: float, theta_i: float, n1: float, n2: float) -> tuple[float, float]:
    """Check 8: (sagittal, tangential) width of a collimated beam behind a sphere, relative to the width before it.

    Args:
        distance: Along the refracted ray from the surface.
        radius: Positive where the surface is convex towards the light.
        theta_i: Incidence.
        n1, n2: Index before and behind.
    """
    cos_i, cos_t = math.cos(theta_i), math.cos(snell(theta_i, n1, n2))
    power = (n2 * cos_t - n1 * cos_i) / radius
    return 1 - distance * power / n2, cos_t / cos_i * (1 - distance * power / (n2 * cos_t**2))


def concave_mirror(distance: float, radius: float, theta_i: float) -> tuple[float, float]:
    """Check 9: (sagittal, tangential) width of a collimated beam after a concave mirror, relative to before."""
    return 1 - 2 * distance * math.cos(theta_i) / radius, 1 - 2 * distance / (radius * math.cos(theta_i))


def refraction_focus(radius: float, n1: float, n2: float) -> float:
    """Check 10: paraxial focus behind a sphere's vertex."""
    return n2 * radius / (n2 - n1)


def mirror_focus(radius: float) -> float:
    """Check 10: paraxial focus of a concave mirror."""
    return radius / 2


def thin_lens_displacement(w: float, distance: float, focal_length: float) -> float:
    """Check 11: D_t x at ``distance`` behind a thin lens moving by w across collimated light, emission fixed."""
    return w * distance / focal_length


def rotating_cylinder_lens_displacement(angle: float, radius: float, distance: float, focal_length: float) -> float:
    """Check 11: |D_t x| behind a thin cylinder lens that turns by ``angle`` about the optical axis, at ``radius``."""
    return angle * radius * distance / focal_length


def thin_lens_focal_length(radius1: float, radius2: float, n: float) -> float:
    """Check 11: lensmaker's focal length of a thin lens in air; radii positive where centres lie behind."""
    return 1 / ((n - 1) * (1 / radius1 - 1 / radius2))


def ball_lens_focal_length(radius: float, n: float) -> float:
    """Check 12: paraxial focal length of a ball, from its centre."""
    return n * radius / (2 * (n - 1))


def lagrange_invariant(
    dxdu: np.ndarray, dxdv: np.ndarray, domegadu: np.ndarray, domegadv: np.ndarray, eta: float
) -> np.ndarray:
    """Check 13: η (D_u ω·D_v x − D_v ω·D_u x), shape [n]; constant along a beam, 0 for light from a point or afar."""
    return eta * (np.sum(domegadu * dxdv, axis=-1) - np.sum(domegadv * dxdu, axis=-1))


def cartesian_ellipsoid(focal_distance: float, n: float) -> tuple[float, float]:
    """Check 14: (semi-axis along the light, semi-axis across) of the body with eccentricity 1/n.

    Light along the axis meets the far focus, which lies ``focal_distance`` behind the vertex.
    """
    along = focal_distance / (1 + 1 / n)
    return along, along * math.sqrt(1 - 1 / n**2)


def cusp_depth(amplitude: float, wave_number: float, n: float) -> float:
    """Check 15: first cusp of a sinusoid a cos kx under vertical light, below its crest."""
    return n / ((n - 1) * amplitude * wave_number**2)


def caustic_branch_sum(stretches: np.ndarray, irradiance: float = 1.0) -> float:
    """Check 16: irradiance Σ E0/|dx/dx0| over the branches that reach a point."""
    return float(np.sum(irradiance / np.abs(stretches)))


def point_light_footprint_area(
    solid_angle: float, count: int, distance: float, cosine: float, smoothing: float = 1.0
) -> float:
    """Check 18: parallelogram area s² Ω r²/(n cosθ) of a photon of a point light on a plane."""
    return smoothing**2 * solid_angle * distance**2 / (count * cosine)


def point_light_mean_irradiance(flux: float, solid_angle: float, distance: float, cosine: float) -> float:
    """Check 18: E = Φ cosθ/(Ω r²) of a flux Φ sent into a solid angle Ω."""
    return flux * cosine / (solid_angle * distance**2)


def flat_refraction_area(area_across: float, theta_i: float) -> float:
    """Check 19: area on a receiver parallel to a flat interface of a collimated beam of cross section A⊥."""
    return area_across / math.cos(theta_i)


def lit_edge_profile(x: np.ndarray, displacement: float) -> np.ndarray:
    """Check 20: mean exposure at x [n] of a lit half plane x < 0 whose edge moves from −½ to +½ displacement."""
    return np.clip(0.5 - np.asarray(x, dtype=np.float64) / displacement, 0, 1)


def shutter_error(exposure: float, acceleration: np.ndarray) -> np.ndarray:
    """Check 23: ½ e² D_tt x, the error at shutter close of motion predicted linearly from shutter open."""
    return 0.5 * exposure**2 * np.asarray(acceleration, dtype=np.float64)
