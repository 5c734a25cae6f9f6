"""The columns D_a, D_b of a beam: where its light would be if it came from another place on a light with extent.

(a, b) are coordinates on the light: on a unit disc, or from −1 to 1 on either axis. A photon stays on the point of the
first specular surface that it meets, whichever place its light comes from (it rides there, as it does over time): D_a x
is zero at that point, and D_a ω is how the direction there changes. From then on the columns go as D_u and D_v do.
Kernels have them only where a scene has lights with extent, or rough glass or metal (``rough_lobes``).

Beyond the paper, whose lights are points or parallel.
"""

from enum import IntEnum

import warp as wp

from tpdwarp.photons.beam import Beam, Interface
from tpdwarp.photons.differentials import normal_differential, reflect_differential, refract_differential, transfer
from tpdwarp.photons.emission import Patch
from tpdwarp.scene.description import ExtentShape
from tpdwarp.scene.device.intersection import Hit, normal_variation
from tpdwarp.scene.device.shaping import across_of, shaped


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
IMAGE_LOBE = wp.constant(int(LightImage.LOBE))
ROUND = wp.constant(int(ExtentShape.ROUND))
DISK = wp.constant(int(ExtentShape.DISK))
CYLINDER = wp.constant(int(ExtentShape.CYLINDER))
# Variance of places along either axis of a disc, and of an interval.
VARIANCE_OF_DISC = wp.constant(0.25)
VARIANCE_OF_INTERVAL = wp.constant(1.0 / 3.0)


@wp.struct
class LightColumns:
    """D_a x, D_b x, D_a ω, D_b ω, what they span (:class:`LightImage`), and D_a ln Φ, D_b ln Φ in ``gain``."""

    dxda: wp.vec3
    dxdb: wp.vec3
    dwda: wp.vec3
    dwdb: wp.vec3
    image: int
    gain: wp.vec2


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
            b = patch.extent_radius * wp.normalize(wp.cross(a, beam.w))
    out.dwda = (beam.w * wp.dot(beam.w, a) - a) / d
    out.dwdb = (beam.w * wp.dot(beam.w, b) - b) / d
    return out


@wp.func
def _flux_from(patch: Patch, beam: Beam, columns: LightColumns, n_g: wp.vec3, a: float, b: float) -> wp.vec2:
    """Flux from the place (a, b) through the surface of normal n_g that the beam meets, by area and up to a factor, and
    the part of it that the light's shaping leaves."""
    w = wp.normalize(beam.w + a * columns.dwda + b * columns.dwdb)
    facing = wp.max(wp.dot(w, n_g) * wp.sign(wp.dot(beam.w, n_g)), 0.0)
    if patch.domain == 0:
        return wp.vec2(facing, 1.0)
    d = wp.length(beam.x - patch.position)
    along = beam.w * d + d * (a * columns.dwda + b * columns.dwdb)
    if patch.extent_shape != ROUND:
        along = beam.w * d - a * patch.span_a
        if patch.extent_shape != CYLINDER:
            along -= b * patch.span_b
    left = float(1.0)
    if patch.is_shaped == 1:
        left = shaped(patch.shaping, patch.shaping_axis, wp.normalize(along))
    return wp.vec2(facing / wp.length_sq(along), left)


@wp.func
def flux_changes(patch: Patch, beam: Beam, columns: LightColumns, n_g: wp.vec3) -> wp.vec3:
    """D_a ln Φ and D_b ln Φ of light through a point of the first specular surface, and the mean of Φ by what the
    middle would send without shaping: where a cone leaves the middle out, it may not do so with the rim.

    Both by differences from rim to rim; changes are limited to all of the light, means to half and twice what there is.
    What the surface reflects is left out.
    """
    middle = _flux_from(patch, beam, columns, n_g, 0.0, 0.0)
    if middle[0] <= 0.0:
        return wp.vec3(0.0, 0.0, middle[1])
    right = _flux_from(patch, beam, columns, n_g, 1.0, 0.0)
    left = _flux_from(patch, beam, columns, n_g, -1.0, 0.0)
    upper = _flux_from(patch, beam, columns, n_g, 0.0, 1.0)
    lower = _flux_from(patch, beam, columns, n_g, 0.0, -1.0)
    k = VARIANCE_OF_INTERVAL
    if columns.image == IMAGE_DISC:
        k = VARIANCE_OF_DISC
    rims = wp.vec4(right[0] * right[1], left[0] * left[1], upper[0] * upper[1], lower[0] * lower[1]) / middle[0]
    most = wp.max(wp.max(wp.max(right[1], left[1]), wp.max(upper[1], lower[1])), middle[1])
    mean = middle[1] + 0.5 * k * (rims[0] + rims[1] + rims[2] + rims[3] - 4.0 * middle[1])
    mean = wp.clamp(mean, 0.5 * middle[1], 2.0 * most)
    if mean <= 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    change = 0.5 * wp.vec2(rims[0] - rims[1], rims[2] - rims[3]) / mean
    change /= wp.max(wp.length(change), 1.0)
    return wp.vec3(change[0], change[1], mean)


@wp.func
def centroid_shift(columns: LightColumns) -> wp.vec3:
    """How far the middle of a light's image lies from where its middle lands: k (D_a ln Φ D_a x + D_b ln Φ D_b x)."""
    k = float(0.0)
    if columns.image == IMAGE_PARALLELOGRAM:
        k = VARIANCE_OF_INTERVAL
    elif columns.image == IMAGE_DISC:
        k = VARIANCE_OF_DISC
    return k * (columns.gain[0] * columns.dxda + columns.gain[1] * columns.dxdb)


@wp.func
def transfer_columns(columns: LightColumns, w: wp.vec3, hit: Hit) -> LightColumns:
    """Transfers the columns to ``hit`` (Eq. 3), as those of the beam; directions stay."""
    still = wp.vec3(0.0, 0.0, 0.0)
    out = columns
    out.dxda = transfer(columns.dxda, columns.dwda, w, hit.distance, hit.n_g, still)
    out.dxdb = transfer(columns.dxdb, columns.dwdb, w, hit.distance, hit.n_g, still)
    return out


@wp.func
def scatter_columns(columns: LightColumns, w: wp.vec3, hit: Hit, at: Interface, reflected: bool) -> LightColumns:
    """The columns after reflection or refraction of a beam of direction ω (Igehy 1999)."""
    s = at.shading
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
