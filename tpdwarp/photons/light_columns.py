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
from tpdwarp.photons.differentials import (
    fresnel_reflectance,
    normal_differential,
    reflect_differential,
    refract_differential,
    refracted_cosine_squared,
    transfer,
)
from tpdwarp.photons.emission import Patch
from tpdwarp.scene.description import ExtentShape
from tpdwarp.scene.device.ellipsoids import SeenEllipsoid, ellipsoid_from, ellipsoid_irradiance
from tpdwarp.scene.device.intersection import Hit, normal_variation
from tpdwarp.scene.device.round_lights import VISIBLE_SIDE, round_irradiance
from tpdwarp.scene.device.shaping import across_of, area_shown, shaped


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
RECT = wp.constant(int(ExtentShape.RECT))
SIXTH = wp.constant(math.pi / 3.0)
# Where the nodes of a disc (beside its middle) and of an interval lie.
NODE_OF_DISC = wp.constant(math.sqrt(2.0 / 3.0))
NODE = wp.constant(math.sqrt(0.6))
# Light of what all but touches a surface is no narrower by its flux than this. Chosen, not derived.
LEAST_NARROWING = wp.constant(0.05)
CYLINDER = wp.constant(int(ExtentShape.CYLINDER))
ELLIPSOID = wp.constant(int(ExtentShape.ELLIPSOID))
# Variance of places along either axis of a disc, and of an interval.
VARIANCE_OF_DISC = wp.constant(0.25)
VARIANCE_OF_INTERVAL = wp.constant(1.0 / 3.0)
# Beyond that ratio of squares a lamp touches the surface.
NEAREST = wp.constant(1.0e4)


@wp.struct
class LightColumns:
    """D_a x, D_b x, D_a ω, D_b ω, what they span (:class:`LightImage`), and D_a ln Φ, D_b ln Φ in ``gain``."""

    dxda: wp.vec3
    dxdb: wp.vec3
    dwda: wp.vec3
    dwdb: wp.vec3
    image: int
    gain: wp.vec2


@wp.struct
class VisibleSide:
    """The side of a cylinder that is seen from a point: ``across`` goes from the axis to the point, across the axis.

    ``rho`` is how far off the axis the point lies, or the radius within it. What is seen of the cylinder lies on
    average ``part`` of ``across`` before the axis.
    """

    across: wp.vec3
    rho: float
    part: float


@wp.func
def visible_side(patch: Patch, x: wp.vec3) -> VisibleSide:
    """The side of a cylinder that is seen from x."""
    axis = wp.normalize(patch.span_a)
    off = x - patch.position
    out = VisibleSide()
    out.across = off - axis * wp.dot(axis, off)
    out.rho = wp.max(wp.length(out.across), patch.extent_radius)
    if out.rho > 0.0:
        out.part = VISIBLE_SIDE * patch.extent_radius / out.rho
    return out


@wp.func
def from_visible_side(patch: Patch, beam: Beam) -> Beam:
    """A beam of a cylinder's axis as one that comes from before it, where what is seen of the cylinder lies on average.

    With c across axis and view, ρ from the axis, the place s before it moves by s c (c · D x)/ρ as the beam does.
    """
    out = beam
    if patch.extent_shape != CYLINDER or patch.domain == 0:
        return out
    side = visible_side(patch, beam.x)
    if side.rho <= 0.0:
        return out
    way = beam.x - patch.position - side.part * side.across
    d = wp.length(way)
    out.w = way / d
    c = wp.normalize(wp.cross(patch.span_a, side.across))
    along_u = beam.dxdu - side.part * c * wp.dot(c, beam.dxdu)
    along_v = beam.dxdv - side.part * c * wp.dot(c, beam.dxdv)
    moved = beam.dxdt - patch.position_motion
    along_t = moved - side.part * c * wp.dot(c, moved)
    out.dwdu = (along_u - out.w * wp.dot(out.w, along_u)) / d
    out.dwdv = (along_v - out.w * wp.dot(out.w, along_v)) / d
    out.dwdt = (along_t - out.w * wp.dot(out.w, along_t)) / d
    return out


@wp.func
def nearness_of_place(patch: Patch, n: wp.vec3, off: wp.vec3, a: float, b: float) -> float:
    """:func:`nearness` of the point of a plane of normal n to which the middle of a lamp sends what the place (a, b)
    sends to x, if all of the lamp lies before the plane; ``off`` leads from the middle to x."""
    way = off - a * patch.span_a - b * patch.span_b
    height = wp.dot(n, way)
    if height <= 0.0:
        return 1.0
    farther = wp.dot(n, off) / height
    spread = (wp.length_sq(patch.span_a) + wp.length_sq(patch.span_b)) / (farther * farther * wp.length_sq(way))
    fourth = wp.pow(wp.min(spread, NEAREST), 4.0)
    return fourth / (1.0 + fourth)


@wp.func
def nearness(patch: Patch, x: wp.vec3, n: wp.vec3) -> float:
    """Whether x is nearer to a lamp than that is large: 1 where it touches, 0 far off, ½ at its own size; 0 as well for
    lamps that the plane with normal n through x cuts, of which it is lit by what stands before it alone.

    Chosen, not derived: the fourth power of the square of the ratio leaves lights alone that are half as large as they
    are far off, and what is left of first order for lights that are twice as large. Photons from one place are followed
    through one point: how far first order misses them says what parts are worth, which lie farther off for their size.
    """
    has_depth = patch.extent_shape == ROUND or patch.extent_shape == ELLIPSOID
    if patch.domain == 0 or has_depth or patch.is_place == 1:
        return 0.0
    depth = wp.abs(wp.dot(n, patch.span_a)) + wp.abs(wp.dot(n, patch.span_b))
    height = wp.abs(wp.dot(n, x - patch.position))
    # Half as deep as high up and less, it is all before the plane.
    before = wp.clamp(2.0 - 2.0 * depth / wp.max(height, 1.0e-30), 0.0, 1.0)
    return before * nearness_of_place(patch, n * wp.sign(wp.dot(n, x - patch.position)), x - patch.position, 0.0, 0.0)


@wp.func
def seen_ellipsoid(patch: Patch, x: wp.vec3) -> SeenEllipsoid:
    """A light that is an ellipsoid, from x."""
    return ellipsoid_from(patch.span_a, patch.span_b, patch.span_c, patch.position - x)


@wp.func
def columns_at(patch: Patch, beam: Beam, n_g: wp.vec3) -> LightColumns:
    """The columns of a beam on the first specular surface: D_a ω = −(I − ωωᵀ) a/d for a place a on a light d away.

    Of parallel light they are the sine of its half angle, across the beam; what is round is a disc across the beam
    from everywhere, and an ellipsoid what a disc across the beam is where that is a sphere. A cylinder ρ away from its
    axis turns ω about that by its radius, b, over ρ.

    From a lamp that nearly touches the surface, light of one direction is followed in the place of light through one
    point: D_a ω is 0 and D_a x is a, along ω into the surface.
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
    elif patch.extent_shape == ELLIPSOID:
        seen = seen_ellipsoid(patch, beam.x)
        a = seen.a
        b = seen.b
    elif patch.extent_shape != DISK:
        out.image = IMAGE_PARALLELOGRAM
    out.dwdb = (beam.w * wp.dot(beam.w, b) - b) / d
    if patch.extent_shape == CYLINDER:
        side = visible_side(patch, beam.x)
        out.dwdb = (patch.extent_radius / side.rho) * wp.cross(beam.w, wp.normalize(a))
        d = wp.length(beam.x - patch.position - side.part * side.across)
    out.dwda = (beam.w * wp.dot(beam.w, a) - a) / d
    near = nearness(patch, beam.x, n_g)
    facing = wp.dot(n_g, beam.w)
    if near > 0.0 and facing != 0.0:
        out.dxda = near * (a - beam.w * (wp.dot(n_g, a) / facing))
        out.dwda *= 1.0 - near
        if patch.extent_shape != CYLINDER:
            out.dxdb = near * (b - beam.w * (wp.dot(n_g, b) / facing))
            out.dwdb *= 1.0 - near
    return out


@wp.func
def _flux_from(patch: Patch, beam: Beam, columns: LightColumns, n: wp.vec3, a: float, b: float) -> wp.vec2:
    """Flux from the place (a, b) through the surface of normal n that the beam meets, by area and up to a factor, and
    the part of it that the light's shaping leaves."""
    if patch.domain == 0:
        # By the sines of its directions, a part of the sun sends cosines over theirs to its own axis.
        return wp.vec2(wp.max(wp.dot(beam.w + a * columns.dwda + b * columns.dwdb, n), 0.0), 1.0)
    off = beam.x - patch.position
    if patch.extent_shape == ROUND or patch.extent_shape == ELLIPSOID:
        d = wp.length(off)
        way = off + d * (a * columns.dwda + b * columns.dwdb)
    elif patch.extent_shape == CYLINDER:
        side = visible_side(patch, beam.x)
        nearer = side.part
        way = off - nearer * side.across - a * patch.span_a
    else:
        way = off - a * patch.span_a - b * patch.span_b
    d2 = wp.length_sq(way)
    left = float(1.0)
    if patch.is_shaped == 1:
        left = shaped(patch.shaping, patch.shaping_axis, wp.normalize(way))
    if patch.extent_shape == CYLINDER:
        # What lies nearer than the axis is as much narrower. Angles about the axis are alike, not chords.
        left *= 1.0 - nearer
        way += wp.sqrt(d2) * b * columns.dwdb
    return wp.vec2(wp.max(wp.dot(way, n), 0.0) / (d2 * wp.sqrt(d2)), left)


@wp.func
def shaping_of_place(patch: Patch, beam: Beam, columns: LightColumns, n: wp.vec3) -> float:
    """The part of the light of the photons' place on a light that its shaping leaves, where they meet a surface."""
    if patch.is_shaped == 0:
        return 1.0
    return _flux_from(patch, beam, columns, n, patch.light_place[0], patch.light_place[1])[1]


@wp.func
def moments_of_flux(patch: Patch, beam: Beam, columns: LightColumns, n: wp.vec3) -> wp.vec3:
    """The means of f, a² f and b² f over a flat lamp, whose place (a, b) sends the flux f through a surface.

    By nodes that are exact to the fifth order, shaping included. Light of one direction is not: as much as is followed
    so from the point of the surface to which each place sends what the middle sends here, that all of it is counted
    once.
    """
    out = wp.vec3(0.0, 0.0, 0.0)
    off = beam.x - patch.position
    own = nearness_of_place(patch, n, off, 0.0, 0.0)
    before = float(0.0)
    if own > 0.0:
        before = nearness(patch, beam.x, n) / own
    if patch.extent_shape == DISK:
        middle = _flux_from(patch, beam, columns, n, 0.0, 0.0)
        out[0] = 0.25 * middle[0] * middle[1] * (1.0 - before * own)
        for k in range(6):
            a = NODE_OF_DISC * wp.cos(float(k) * SIXTH)
            b = NODE_OF_DISC * wp.sin(float(k) * SIXTH)
            f = _flux_from(patch, beam, columns, n, a, b)
            rest = 1.0 - before * nearness_of_place(patch, n, off, a, b)
            out += (0.125 * rest * f[0] * f[1]) * wp.vec3(1.0, a * a, b * b)
        return out
    for i in range(3):
        for j in range(3):
            a = NODE * float(i - 1)
            b = NODE * float(j - 1)
            f = _flux_from(patch, beam, columns, n, a, b)
            rest = 1.0 - before * nearness_of_place(patch, n, off, a, b)
            weight = (5.0 + 3.0 * float(i % 2)) * (5.0 + 3.0 * float(j % 2)) / 324.0
            out += (weight * rest * f[0] * f[1]) * wp.vec3(1.0, a * a, b * b)
    return out


@wp.struct
class FluxOfPlaces:
    """What the places on a light send through a point of the first specular surface, by what its middle sends.

    ``mean`` is that of all of it, ``gain`` D_a ln Φ and D_b ln Φ. ``middle`` and ``rims`` (a = ±1, b = ±1) are the
    parts of the mean that stand for the middle and the four places on the rim; all 0 where the middle stands for all.
    ``narrowing`` is what D_a ω and D_b ω are multiplied by to be the deviations of that light: where the rim sends less
    than the middle, it deviates by less than places do.
    """

    gain: wp.vec2
    mean: float
    middle: float
    rims: wp.vec4
    narrowing: wp.vec2


@wp.func
def flux_of_directions(patch: Patch, beam: Beam, columns: LightColumns, n_g: wp.vec3) -> FluxOfPlaces:
    """:func:`flux_of_places` of the directions of a sun: cosines, whose mean is that of its middle unless the horizon
    cuts it."""
    out = FluxOfPlaces()
    facing = wp.dot(beam.w, n_g)
    cosine = wp.abs(facing)
    out.mean = 1.0
    out.narrowing = wp.vec2(1.0, 1.0)
    if cosine <= 0.0 or (patch.extent_shape == ROUND and patch.extent_radius <= 0.0):
        return out
    change = wp.vec2(wp.dot(columns.dwda, n_g), wp.dot(columns.dwdb, n_g)) / facing
    k = VARIANCE_OF_INTERVAL
    if columns.image == IMAGE_DISC:
        k = VARIANCE_OF_DISC
    out.middle = 1.0 - 2.0 * k
    rims = wp.vec4(1.0 + change[0], 1.0 - change[0], 1.0 + change[1], 1.0 - change[1])
    if wp.length_sq(change) > 1.0:
        # Some of the rim lies below the horizon.
        rims = wp.max(rims, wp.vec4(0.0, 0.0, 0.0, 0.0))
        change = 0.5 * wp.vec2(rims[0] - rims[1], rims[2] - rims[3])
        mean = out.middle + 0.5 * k * (rims[0] + rims[1] + rims[2] + rims[3])
        change /= wp.max(mean, wp.length(change))
        if patch.extent_shape == ROUND:
            mean = round_irradiance(cosine, wp.max(1.0 / patch.extent_radius, 1.0)) / cosine
        out.mean = wp.clamp(mean, 0.1, 2.0)
    out.rims = 0.5 * k * rims
    out.gain = change
    return out


@wp.func
def flux_of_places(
    patch: Patch, beam: Beam, columns: LightColumns, n_g: wp.vec3, from_middle: wp.vec3
) -> FluxOfPlaces:
    """The flux of the middle and of four places on the rim of a light by that of its middle without shaping: where a
    cone leaves the middle out, it may not do so with the rim.

    Changes are limited to all of the light, means to a tenth and twice what there is. The mean of what is round is
    known in closed form, the horizon included: its depth makes up for its breadth; that of what is flat is of more
    places.

    Args:
        from_middle: The direction ω of light from the middle of the light; that of a cylinder lies on its axis.
    """
    out = FluxOfPlaces()
    n = n_g * wp.sign(wp.dot(from_middle, n_g))
    cosine = wp.dot(from_middle, n)
    of_middle = float(cosine)
    if patch.domain == 1:
        of_middle /= wp.length_sq(beam.x - patch.position)
    middle = _flux_from(patch, beam, columns, n, 0.0, 0.0)
    out.mean = middle[1]
    out.narrowing = wp.vec2(1.0, 1.0)
    if of_middle <= 0.0 or (patch.extent_shape == ROUND and patch.extent_radius <= 0.0):
        return out
    right = _flux_from(patch, beam, columns, n, 1.0, 0.0)
    left = _flux_from(patch, beam, columns, n, -1.0, 0.0)
    upper = _flux_from(patch, beam, columns, n, 0.0, 1.0)
    lower = _flux_from(patch, beam, columns, n, 0.0, -1.0)
    k = VARIANCE_OF_INTERVAL
    if columns.image == IMAGE_DISC:
        k = VARIANCE_OF_DISC
    rims = wp.vec4(right[0] * right[1], left[0] * left[1], upper[0] * upper[1], lower[0] * lower[1]) / of_middle
    out.middle = (1.0 - 2.0 * k) * middle[1] * middle[0] / of_middle
    out.rims = 0.5 * k * rims
    mean = out.middle + out.rims[0] + out.rims[1] + out.rims[2] + out.rims[3]
    change = 0.5 * wp.vec2(rims[0] - rims[1], rims[2] - rims[3]) / wp.max(mean, 1.0e-30)
    if patch.extent_shape == ROUND:
        unshaped = (1.0 - 2.0 * k) * middle[0] + 0.5 * k * (right[0] + left[0] + upper[0] + lower[0])
        h = 1.0 / patch.extent_radius
        if patch.domain == 1:
            h *= wp.length(beam.x - patch.position)
        mean *= of_middle / unshaped * round_irradiance(cosine, wp.max(h, 1.0)) / cosine
    elif patch.extent_shape == ELLIPSOID:
        # The same light without its cone, by the area that it shows to each of these directions.
        unshaped = (1.0 - 2.0 * k) * middle[0] * area_shown(patch.shaping, beam.w)
        unshaped += 0.5 * k * right[0] * area_shown(patch.shaping, wp.normalize(beam.w + columns.dwda))
        unshaped += 0.5 * k * left[0] * area_shown(patch.shaping, wp.normalize(beam.w - columns.dwda))
        unshaped += 0.5 * k * upper[0] * area_shown(patch.shaping, wp.normalize(beam.w + columns.dwdb))
        unshaped += 0.5 * k * lower[0] * area_shown(patch.shaping, wp.normalize(beam.w - columns.dwdb))
        sent = ellipsoid_irradiance(seen_ellipsoid(patch, beam.x), -n)
        mean *= sent / wp.max(unshaped, 1.0e-30) / (math.pi * patch.extent_radius * patch.extent_radius)
    else:
        if patch.domain == 1 and (patch.extent_shape == DISK or patch.extent_shape == RECT):
            moments = moments_of_flux(patch, beam, columns, n)
            mean = moments[0] / of_middle
            for axis in range(2):
                deviation = wp.sqrt(moments[1 + axis] / wp.max(k * moments[0], 1.0e-30))
                out.narrowing[axis] = wp.clamp(deviation, LEAST_NARROWING, 1.0)
            change = wp.cw_div(change, out.narrowing)
            # All places send alike in one direction.
            mean += nearness(patch, beam.x, n_g) * middle[1]
        else:
            mean = wp.lerp(mean, middle[1], nearness(patch, beam.x, n_g))
    most = wp.max(wp.max(wp.max(right[1], left[1]), wp.max(upper[1], lower[1])), middle[1])
    out.mean = wp.clamp(mean, 0.1 * middle[1], 2.0 * most)
    if out.mean > 0.0:
        out.gain = change / wp.max(wp.length(change), 1.0)
    return out


@wp.func
def reflectance_at(at: Interface, cos_i: float) -> float:
    """What an interface reflects of light of another direction than that it was made for."""
    cos_t_squared = refracted_cosine_squared(cos_i, at.eta)
    if cos_i <= 0.0 or cos_t_squared <= 0.0:
        return 1.0
    return fresnel_reflectance(cos_i, wp.sqrt(cos_t_squared), at.eta)


@wp.func
def mean_reflectance(at: Interface, w: wp.vec3, columns: LightColumns, places: FluxOfPlaces) -> float:
    """What the first specular surface reflects of light from all of a light, where it lets that of the middle in."""
    total = places.middle + places.rims[0] + places.rims[1] + places.rims[2] + places.rims[3]
    if total <= 0.0 or at.cos_t <= 0.0:
        return at.reflectance
    # The columns are perpendicular to ω.
    cos_i = -wp.dot(w, at.n)
    a = -wp.dot(columns.dwda, at.n)
    b = -wp.dot(columns.dwdb, at.n)
    of_a = 1.0 / wp.sqrt(1.0 + wp.length_sq(columns.dwda))
    of_b = 1.0 / wp.sqrt(1.0 + wp.length_sq(columns.dwdb))
    of_rims = wp.vec4(
        reflectance_at(at, wp.min((cos_i + a) * of_a, 1.0)),
        reflectance_at(at, wp.min((cos_i - a) * of_a, 1.0)),
        reflectance_at(at, wp.min((cos_i + b) * of_b, 1.0)),
        reflectance_at(at, wp.min((cos_i - b) * of_b, 1.0)),
    )
    return (places.middle * at.reflectance + wp.dot(places.rims, of_rims)) / total


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
