"""The columns D_a, D_b of a beam: where its light would be if it came from another place on a light with extent.

(a, b) are coordinates on the light: on a unit disc, or from −1 to 1 on either axis. A photon stays on the point of the
first specular surface that it meets, whichever place its light comes from (it rides there, as it does over time): D_a x
is zero at that point, and D_a ω is how the direction there changes. From then on the columns go as D_u and D_v do.
Kernels have them only where a scene has lights with extent, or rough glass or metal (``rough_lobes``).

Beyond the paper, whose lights are points or parallel.
"""

import math
from enum import IntEnum

import warp as wp

from tpdwarp.photons.beam import Beam, Interface
from tpdwarp.photons.differentials import normal_differential, reflect_differential, refract_differential, transfer
from tpdwarp.photons.emission import Patch
from tpdwarp.scene.description import ExtentShape
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import Hit, normal_variation, shading_normal
from tpdwarp.scene.device.shaping import across_of


class LightImage(IntEnum):
    """What the columns a and b span: nothing, a disc (|(a, b)| < 1), a parallelogram (|a|, |b| < 1) or a lobe.

    A lobe is that of rough surfaces: the columns are its deviations.
    """

    NONE = 0
    DISC = 1
    PARALLELOGRAM = 2
    LOBE = 3


IMAGE_NONE = wp.constant(int(LightImage.NONE))
IMAGE_DISC = wp.constant(int(LightImage.DISC))
IMAGE_PARALLELOGRAM = wp.constant(int(LightImage.PARALLELOGRAM))
ROUND = wp.constant(int(ExtentShape.ROUND))
DISK = wp.constant(int(ExtentShape.DISK))
CYLINDER = wp.constant(int(ExtentShape.CYLINDER))
# Across a cylinder places are as dense as chords of a circle, whose variance is R²/4; that of an interval is h²/3.
CHORD = wp.constant(math.sqrt(0.75))


@wp.struct
class LightColumns:
    """D_a x, D_b x, D_a ω, D_b ω, and what they span (:class:`LightImage`)."""

    dxda: wp.vec3
    dxdb: wp.vec3
    dwda: wp.vec3
    dwdb: wp.vec3
    image: int


@wp.func
def columns_at(patch: Patch, beam: Beam) -> LightColumns:
    """The columns of a beam on the first specular surface: D_a ω = −(I − ωωᵀ) a/d for a place a on a light d away.

    Of parallel light they are the sine of its half angle, across the beam; what is round is a disc across the beam
    from everywhere.
    """
    out = LightColumns()
    out.image = IMAGE_NONE
    if patch.extent_shape < 0:
        return out
    out.image = IMAGE_DISC
    if patch.domain == 0:
        out.dwda = patch.extent_radius * patch.axis_u
        out.dwdb = patch.extent_radius * patch.axis_v
        if patch.extent_shape != ROUND:
            # A part of the sun's disc.
            out.dwda = patch.span_a - beam.w * wp.dot(beam.w, patch.span_a)
            out.dwdb = patch.span_b - beam.w * wp.dot(beam.w, patch.span_b)
            if patch.extent_shape != DISK:
                out.image = IMAGE_PARALLELOGRAM
        return out
    d = wp.length(beam.x - patch.position)
    a = patch.span_a
    b = patch.span_b
    if patch.extent_shape == ROUND:
        a = patch.extent_radius * across_of(beam.w)
        b = wp.cross(beam.w, a)
    elif patch.extent_shape != DISK:
        out.image = IMAGE_PARALLELOGRAM
        if patch.extent_shape == CYLINDER:
            b = CHORD * patch.extent_radius * wp.normalize(wp.cross(a, beam.w))
    out.dwda = (beam.w * wp.dot(beam.w, a) - a) / d
    out.dwdb = (beam.w * wp.dot(beam.w, b) - b) / d
    return out


@wp.func
def transfer_columns(columns: LightColumns, w: wp.vec3, hit: Hit) -> LightColumns:
    """Transfers the columns to ``hit`` (Eq. 3), as those of the beam; directions stay."""
    still = wp.vec3(0.0, 0.0, 0.0)
    out = columns
    out.dxda = transfer(columns.dxda, columns.dwda, w, hit.distance, hit.n_g, still)
    out.dxdb = transfer(columns.dxdb, columns.dwdb, w, hit.distance, hit.n_g, still)
    return out


@wp.func
def scatter_columns(
    surfaces: Surfaces, columns: LightColumns, w: wp.vec3, hit: Hit, at: Interface, reflected: bool, moves: bool
) -> LightColumns:
    """The columns after reflection or refraction of a beam of direction ω (Igehy 1999)."""
    s = shading_normal(surfaces, hit, at.flat, moves)
    dnda = at.side * normal_differential(s.n, s.length, normal_variation(s, hit, columns.dxda))
    dndb = at.side * normal_differential(s.n, s.length, normal_variation(s, hit, columns.dxdb))
    out = columns
    if reflected:
        out.dwda = reflect_differential(w, at.n, columns.dwda, dnda)
        out.dwdb = reflect_differential(w, at.n, columns.dwdb, dndb)
    else:
        out.dwda = refract_differential(w, at.n, at.eta, at.cos_t, columns.dwda, dnda)
        out.dwdb = refract_differential(w, at.n, at.eta, at.cos_t, columns.dwdb, dndb)
    return out
