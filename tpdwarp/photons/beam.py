"""A beam: its state, transfer to the next surface, and specular interaction there.

Photons and camera rays are both beams; a camera ray uses the time column only.
"""

import warp as wp

from tpdwarp.photons.differentials import (
    fresnel_reflectance,
    normal_differential,
    reflect,
    reflect_differential,
    refract,
    refract_differential,
    refracted_cosine_squared,
    transfer,
)
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import Hit, ShadingNormal, normal_variation, shading_normal


@wp.struct
class Beam:
    """Ray x, ω and its columns D_a x, D_a ω.

    ``offset`` moves the start off the surface that the beam left, ``magnitude`` is as in :class:`Hit`.
    """

    x: wp.vec3
    w: wp.vec3
    dxdu: wp.vec3
    dxdv: wp.vec3
    dxdt: wp.vec3
    dwdu: wp.vec3
    dwdv: wp.vec3
    dwdt: wp.vec3
    offset: wp.vec3
    magnitude: wp.vec3


@wp.struct
class Interface:
    """A specular surface as this beam meets it: n towards the beam, cosines, relative index, reflectance.

    ``shading`` is the normal that counts there; ``flat`` is set where it is not the interpolated one, which would send
    the beam through the wrong side of the surface.
    """

    n: wp.vec3
    cos_t: float
    eta: float
    reflectance: float
    side: float
    flat: bool
    shading: ShadingNormal


@wp.func
def transfer_to(beam: Beam, hit: Hit, footprint: bool, moves: bool) -> Beam:
    """Transfers the beam's position and its columns to ``hit`` (Eqs. 3, 4); directions stay.

    Args:
        footprint: Whether it has columns u and v.
        moves: Whether it has a column t.
    """
    still = wp.vec3(0.0, 0.0, 0.0)
    out = beam
    out.x = hit.position
    if footprint:
        out.dxdu = transfer(beam.dxdu, beam.dwdu, beam.w, hit.distance, hit.n_g, still)
        out.dxdv = transfer(beam.dxdv, beam.dwdv, beam.w, hit.distance, hit.n_g, still)
    if moves:
        out.dxdt = transfer(beam.dxdt, beam.dwdt, beam.w, hit.distance, hit.n_g, hit.motion)
    return out


@wp.func
def passed(incident: Beam, hit: Hit) -> Beam:
    """The beam at ``hit``, which goes straight on behind a surface that is not there (beyond the paper).

    Its columns already lie on the surface. They differ from those of a beam that met nothing by multiples of ω, which
    the next transfer (Eqs. 3, 4) takes away.
    """
    out = incident
    out.offset = wp.sign(wp.dot(hit.n_g, incident.w)) * hit.offset * hit.n_g
    out.magnitude = hit.magnitude
    return out


@wp.func
def relative_index(surfaces: Surfaces, hit: Hit, w: wp.vec3) -> float:
    """η = η_i/η_t (Igehy 1999) of a dielectric with nothing around it, whose front is outside."""
    ior = surfaces.ior[surfaces.material_of[hit.triangle]]
    if wp.dot(hit.n_g, w) < 0.0:
        return 1.0 / ior
    return ior


@wp.func
def interface_at(surfaces: Surfaces, hit: Hit, w: wp.vec3, dielectric: bool, eta: float, moves: bool) -> Interface:
    """Orientation, and what the laws of Snell and Fresnel say at ``hit``: what Igehy's differentials (1999) need.

    ``eta`` is the relative index η_i/η_t of a ``dielectric``.

    The shading normal counts where it sends light to the right side of the triangle, and the flat one elsewhere. Total
    internal reflection is decided here: the reflectance stays one where cos²θ_t is not positive.
    """
    at = Interface()
    at.side = -wp.sign(wp.dot(hit.n_g, w))
    n_g = at.side * hit.n_g
    flat = bool(False)
    found = bool(False)
    while not found:
        at.flat = flat
        at.shading = shading_normal(surfaces, hit, flat, moves)
        at.n = at.shading.n * at.side
        at.reflectance = 1.0
        at.cos_t = 0.0
        at.eta = 1.0
        cos_i = -wp.dot(w, at.n)
        consistent = cos_i > 0.0 and wp.dot(reflect(w, at.n), n_g) > 0.0
        if dielectric:
            at.eta = eta
            cos_t_squared = refracted_cosine_squared(cos_i, at.eta)
            if cos_t_squared > 0.0:
                at.cos_t = wp.sqrt(cos_t_squared)
                at.reflectance = fresnel_reflectance(cos_i, at.cos_t, at.eta)
                consistent = consistent and wp.dot(refract(w, at.n, at.eta, at.cos_t), n_g) < 0.0
        # Not in an if: Warp reads a field of a struct again after a branch that changes it.
        found = consistent or flat
        flat = True
    return at


@wp.func
def scatter(incident: Beam, hit: Hit, at: Interface, reflected: bool, footprint: bool, moves: bool) -> Beam:
    """The beam after reflection or refraction: new ω and D_a ω (Igehy 1999, with the paper's time column).

    Positions and their columns pass unchanged. The normal's own columns are D_a N = Σ_j (n_j − n_0) D_a β_j, to which
    a = t adds Σ β_i D_t n_i. ``footprint`` and ``moves`` are as for :func:`transfer_to`.
    """
    s = at.shading
    w = incident.w
    out = incident
    if reflected:
        out.w = reflect(w, at.n)
        out.offset = hit.offset * at.side * hit.n_g
    else:
        out.w = refract(w, at.n, at.eta, at.cos_t)
        out.offset = -hit.offset * at.side * hit.n_g
    if footprint:
        dndu = at.side * normal_differential(s.n, s.length, normal_variation(s, hit, incident.dxdu))
        dndv = at.side * normal_differential(s.n, s.length, normal_variation(s, hit, incident.dxdv))
        out.dwdu = _direction_differential(w, at, reflected, incident.dwdu, dndu)
        out.dwdv = _direction_differential(w, at, reflected, incident.dwdv, dndv)
    if moves:
        dndt = at.side * normal_differential(
            s.n, s.length, normal_variation(s, hit, incident.dxdt - hit.motion) + s.rate
        )
        out.dwdt = _direction_differential(w, at, reflected, incident.dwdt, dndt)
    out.w = wp.normalize(out.w)
    out.magnitude = hit.magnitude
    return out


@wp.func
def _direction_differential(w: wp.vec3, at: Interface, reflected: bool, dw: wp.vec3, dn: wp.vec3) -> wp.vec3:
    """D_a ω after reflection or refraction (Igehy 1999)."""
    if reflected:
        return reflect_differential(w, at.n, dw, dn)
    return refract_differential(w, at.n, at.eta, at.cos_t, dw, dn)
