"""The differential algebra of a beam: transfer, reflection, refraction.

A beam is a ray x + λω with the columns D_a x, D_a ω for a ∈ {u, v, t}. D_t is scaled to the whole shutter: D_t x is
the displacement between its opening and its closing (the exposure e of Eq. 5 is folded into D_t q). Everything here
is one column at a time; it knows nothing of meshes or lights.

Source: Schjøth, Frisvad, Erleben, Sporring, *Photon Differentials in Space and Time* (2011); Igehy, *Tracing Ray
Differentials* (1999).
"""

import warp as wp


@wp.func
def transfer(dxda: wp.vec3, dwda: wp.vec3, w: wp.vec3, distance: float, n_g: wp.vec3, motion: wp.vec3) -> wp.vec3:
    """D_a x' (Eqs. 3, 4) on a surface that moves by ``motion`` (δ q̇, zero for a ∈ {u, v}).

    It lies in the tangent plane, but for the part of the motion along the normal.

    Departs from the paper (Eq. 4): there is no ∂n_g/∂t term, since q̇ is taken at the hit itself.
    """
    y = dxda + distance * dwda
    return y - w * (wp.dot(n_g, y - motion) / wp.dot(n_g, w))


@wp.func
def normal_differential(n: wp.vec3, length: float, dNda: wp.vec3) -> wp.vec3:
    """D_a n = (I − n nᵀ) D_a N / |N| of the unit normal n = N/|N| (Igehy 1999), for a ∈ {u, v, t} alike."""
    return (dNda - n * wp.dot(n, dNda)) / length


@wp.func
def reflect(w: wp.vec3, n: wp.vec3) -> wp.vec3:
    """ω' = ω − 2(ω·n)n: the direction of reflection, whose differential is Igehy's (1999)."""
    return w - 2.0 * wp.dot(w, n) * n


@wp.func
def reflect_differential(w: wp.vec3, n: wp.vec3, dwda: wp.vec3, dnda: wp.vec3) -> wp.vec3:
    """D_a ω' = D_a ω − 2[(ω·n) D_a n + (D_a ω·n + ω·D_a n) n] of a reflection (Igehy 1999), for a ∈ {u, v, t} alike."""
    return dwda - 2.0 * (wp.dot(w, n) * dnda + (wp.dot(dwda, n) + wp.dot(w, dnda)) * n)


@wp.func
def refract(w: wp.vec3, n: wp.vec3, eta: float, cos_t: float) -> wp.vec3:
    """ω' = ηω + (η cosθ_i − cosθ_t)n by Snell's law; its differential is Igehy's (1999).

    The normal n lies on the side of the incident ray, and η = η_i/η_t.
    """
    return eta * w + (eta * -wp.dot(w, n) - cos_t) * n


@wp.func
def refract_differential(w: wp.vec3, n: wp.vec3, eta: float, cos_t: float, dwda: wp.vec3, dnda: wp.vec3) -> wp.vec3:
    """D_a ω' = η D_a ω + (η cosθ_i − cosθ_t) D_a n + (η − η² cosθ_i/cosθ_t) D_a(cosθ_i) n of a refraction (Igehy 1999).

    D_a(cosθ_i) = −(D_a ω·n + ω·D_a n), and a ∈ {u, v, t}.
    """
    cos_i = -wp.dot(w, n)
    dcos_i = -(wp.dot(dwda, n) + wp.dot(w, dnda))
    return eta * dwda + (eta * cos_i - cos_t) * dnda + ((eta - eta * eta * cos_i / cos_t) * dcos_i) * n


@wp.func
def refracted_cosine_squared(cos_i: float, eta: float) -> float:
    """cos²θ_t = 1 − η²(1 − cos²θ_i) for Igehy's refraction (1999); negative under total internal reflection.

    It is written as the sum that rounds least near η = 1.
    """
    return (1.0 - eta) * (1.0 + eta) + eta * eta * cos_i * cos_i


@wp.func
def fresnel_reflectance(cos_i: float, cos_t: float, eta: float) -> float:
    """Fresnel's reflectance R of a dielectric for unpolarised light, η = η_i/η_t.

    Beyond the paper's algebra: flux splits as R and 1 − R, and both branches are followed.
    """
    parallel = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    perpendicular = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return 0.5 * (parallel * parallel + perpendicular * perpendicular)


@wp.func
def riding_shift(dxdu: wp.vec3, dxdv: wp.vec3, n: wp.vec3, slip: wp.vec3) -> wp.vec2:
    """(a, b) with D_u x a + D_v x b = ``slip`` in the tangent plane; zero where the light grazes the surface.

    Beyond the paper: shearing D_t by (a, b) keeps a photon on the material point that it first hit.
    """
    area = wp.dot(n, wp.cross(dxdu, dxdv))
    if wp.abs(area) <= 1.0e-4 * wp.length(dxdu) * wp.length(dxdv):
        return wp.vec2(0.0, 0.0)
    return wp.vec2(wp.dot(n, wp.cross(slip, dxdv)), wp.dot(n, wp.cross(dxdu, slip))) / area
