"""What lights send off metal to the viewer, rough or polished: those without extent, those with it, and domes.

Of a light with extent some places are looked at, and some directions of the lobe, weighted by the balance heuristic
(Veach 1995): wide lights lie all over a narrow lobe, and narrow ones in a small part of a wide lobe. Of domes, some
directions of the lobe see the picture over as much of it as each stands for (Křivánek and Colbert 2008).
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.links import UNLIT
from tpdwarp.scene.device.shaping import shaped
from tpdwarp.scene.device.textures import TextureArrays
from tpdwarp.view.area_lights import (
    CYLINDER,
    DISK,
    OUTSIDE,
    ROUND,
    STRATA,
    AreaLight,
    AreaLightArrays,
    PlaceOnLight,
    before_surface,
    light_seen_from,
    place_on_light,
    within,
)
from tpdwarp.view.domes import DomeArrays, dome_radiance_about, hidden_from_dome
from tpdwarp.view.ggx import Lobe, chance_of, mirrored_by_a_facet, reflected
from tpdwarp.view.lights import FAR, LightArrays, lit_from

PI = wp.constant(math.pi)
# Directions of the lobe that look at a dome, of one camera sample, along either axis of the square. Chosen, not
# derived: as many rays as a diffuse surface sends.
DOME_STRATA = wp.constant(4)
# Each of them sees as much of the picture as one does of those of four samples, which share out the square.
SHARE = wp.constant(0.25)
# A light of a smaller sine than this part of α looks alike from the whole of the lobe: directions tell nothing of it.
SMALL = wp.constant(0.25)
# The rim of a cylinder, beyond which its side is not seen.
RIM = wp.constant(1.0e-3)


@cache
def point_reflection(share: wp.Function, linked: bool = False) -> wp.Function:
    """The function that sums the radiance that lights without extent send off a lobe.

    Args:
        share: What part of the light is counted, as in :func:`tpdwarp.view.lights.point_irradiance`.
        linked: Whether lights are linked to some objects only.
    """

    @wp.func
    def radiance(
        surfaces: Surfaces,
        textures: TextureArrays,
        lights: LightArrays,
        lobe: Lobe,
        x: wp.vec3,
        n_g: wp.vec3,
        offset: wp.vec3,
        object: int,
    ) -> wp.vec3:
        total = wp.vec3(0.0, 0.0, 0.0)
        for k in range(lights.power.shape[0]):
            row = int(0)
            shines = bool(True)
            if wp.static(linked):
                row = lights.link_row[k]
                shines = (lights.links[row, object] & UNLIT) == 0
            if shines:
                light = lit_from(surfaces, lights, k, x)
                if wp.dot(lobe.n, light.w) > 0.0 and wp.dot(n_g, light.w) > 0.0:
                    part = share(surfaces, textures, lights.links, row, x, light.w, offset, light.distance)
                    if part > 0.0:
                        total += wp.cw_mul(light.power, reflected(lobe, light.w)) * (part / light.falloff)
        return total

    return radiance


@wp.func
def sine_of(light: AreaLight) -> float:
    """Sine of the half angle of a round light, as it is seen."""
    if light.distant:
        return light.radius
    return 1.0 / wp.max(wp.length(light.d) / light.radius, OUTSIDE)


@wp.func
def area_of(light: AreaLight) -> float:
    """What the places of the unit square stand for: the area of a flat light or of the section of a cylinder along its
    axis, and of a round one the area of its disc of sines."""
    if light.shape == ROUND:
        sine = sine_of(light)
        return PI * sine * sine
    if light.shape == CYLINDER:
        return 4.0 * wp.length(light.a) * light.radius
    area = 4.0 * wp.length(wp.cross(light.a, light.b))
    if light.shape == DISK:
        return 0.25 * PI * area
    return area


@wp.func
def radiance_of(light: AreaLight) -> float:
    """Radiance of a light by its power: its largest intensity, or its irradiance at normal incidence."""
    if light.shape == ROUND:
        return 1.0 / (PI * light.radius * light.radius)
    return light.share / area_of(light)


@wp.func
def before_axis(light: AreaLight) -> wp.vec3:
    """Across the axis of a cylinder, away from who looks at it."""
    axis = wp.normalize(light.a)
    return wp.normalize(light.d - axis * wp.dot(axis, light.d))


@wp.func
def solid_angle(light: AreaLight, w: wp.vec3, distance: float) -> float:
    """Solid angle of the light about its place in direction ω, by its part of the unit square; 0 for what is turned
    away."""
    area = area_of(light)
    if light.shape == ROUND:
        return area / wp.max(wp.dot(w, wp.normalize(light.d)), RIM)
    facing = -wp.dot(w, light.facing)
    if light.depth > 0.0:
        # By the distance of the disk, behind the surface of the ellipsoid that it stands for.
        distance = wp.dot(light.d, light.facing) / wp.dot(w, light.facing)
    if light.shape == CYLINDER:
        before = before_axis(light)
        axis = wp.normalize(light.a)
        from_axis = distance * w - light.d
        normal = wp.normalize(from_axis - axis * wp.dot(axis, from_axis))
        facing = -wp.dot(w, normal) / wp.max(-wp.dot(normal, before), RIM)
    return area * wp.max(facing, 0.0) / (distance * distance)


@wp.func
def distance_to(light: AreaLight, w: wp.vec3) -> float:
    """How far off a light is along ω; below 0 where it is not there."""
    if light.shape == ROUND:
        sine = sine_of(light)
        away = wp.length(light.d)
        forward = wp.dot(w, light.d) / away
        off = wp.length(wp.cross(w, light.d)) / away
        if forward <= 0.0 or off > sine:
            return -1.0
        if light.distant:
            return FAR
        rest = wp.sqrt(wp.max(light.radius * light.radius - away * away * off * off, 0.0))
        return wp.max(away * forward - rest, 0.0)
    if light.shape == CYLINDER:
        axis = wp.normalize(light.a)
        across = w - axis * wp.dot(axis, w)
        d = light.d - axis * wp.dot(axis, light.d)
        square = wp.dot(across, across)
        middle = wp.dot(across, d)
        rest = middle * middle - square * (wp.dot(d, d) - light.radius * light.radius)
        if rest < 0.0 or middle <= 0.0:
            return -1.0
        distance = (middle - wp.sqrt(rest)) / square
        if distance <= 0.0 or wp.abs(wp.dot(distance * w - light.d, axis)) > wp.length(light.a):
            return -1.0
        return distance
    towards = wp.dot(w, light.facing)
    if towards >= 0.0:
        return -1.0
    distance = wp.dot(light.d, light.facing) / towards
    if distance <= 0.0:
        return -1.0
    p = distance * w - light.d
    # The axes may be skewed, where a light is.
    area = wp.cross(light.a, light.b)
    square = wp.length_sq(area)
    u = wp.dot(wp.cross(p, light.b), area) / square
    v = wp.dot(wp.cross(light.a, p), area) / square
    outside = wp.max(wp.abs(u), wp.abs(v)) > 1.0
    if light.shape == DISK:
        outside = u * u + v * v > 1.0
        if light.depth > 0.0:
            distance *= before_surface(light, u * u + v * v)
    return wp.where(outside, -1.0, distance)


@cache
def area_reflection(share: wp.Function, linked: bool = False, meshed: bool = True) -> wp.Function:
    """The function that sums the radiance that lights with extent send off a lobe.

    Args:
        share: What part of the light from a place on a light is counted, as in
            :func:`tpdwarp.view.lights.point_irradiance`.
        linked: Whether lights are linked to some objects only.
        meshed: Whether lights count in whose place a mesh shines, which is left out then.
    """

    @wp.func
    def radiance(
        surfaces: Surfaces,
        textures: TextureArrays,
        lights: AreaLightArrays,
        lobe: Lobe,
        x: wp.vec3,
        n_g: wp.vec3,
        offset: wp.vec3,
        place: wp.vec2,
        object: int,
    ) -> wp.vec3:
        total = wp.vec3(0.0, 0.0, 0.0)
        places = float(STRATA * STRATA)
        for k in range(lights.power.shape[0]):
            light = light_seen_from(lights, k, x, surfaces.time)
            row = int(0)
            shines = light.shape == ROUND or light.shape == CYLINDER or wp.dot(light.d, light.facing) < 0.0
            if wp.static(linked):
                row = lights.link_row[k]
                shines = shines and (lights.links[row, object] & UNLIT) == 0
            if wp.static(not meshed):
                shines = shines and lights.meshed[k] == 0
            if shines:
                facets = float(places)
                if light.shape == ROUND and sine_of(light) < SMALL * lobe.alpha:
                    facets = 0.0
                counted = wp.vec3(0.0, 0.0, 0.0)
                for number in range(2 * STRATA * STRATA):
                    of_light = number < STRATA * STRATA
                    cell = wp.vec2(float(number % STRATA), float((number // STRATA) % STRATA))
                    spot = (cell + within(place)) / float(STRATA)
                    there = PlaceOnLight()
                    if of_light:
                        there = place_on_light(light, lobe.n, spot)
                    elif facets > 0.0:
                        there.w = mirrored_by_a_facet(lobe, spot)
                        there.distance = distance_to(light, there.w)
                    else:
                        break
                    if there.distance > 0.0 and wp.dot(lobe.n, there.w) > 0.0 and wp.dot(n_g, there.w) > 0.0:
                        angle = solid_angle(light, there.w, there.distance)
                        if angle > 0.0:
                            part = share(surfaces, textures, lights.links, row, x, there.w, offset, there.distance)
                            if part > 0.0:
                                part *= shaped(lights.shaping[k], light.facing, -there.w)
                                often = places / angle + facets * chance_of(lobe, there.w)
                                counted += reflected(lobe, there.w) * (part / often)
                total += wp.cw_mul(lights.power[k], counted) * radiance_of(light)
        return total

    return radiance


@cache
def lights_along(share: wp.Function, linked: bool = False) -> wp.Function:
    """The function that sums the radiance of lights with extent that a ray meets, as smooth mirrors show them.

    A light hides nothing: what is behind it is seen as well.

    Args:
        share: What part of the light from a place on a light is counted, as in
            :func:`tpdwarp.view.lights.point_irradiance`.
        linked: Whether lights are linked to some objects only.
    """

    @wp.func
    def radiance(
        surfaces: Surfaces,
        textures: TextureArrays,
        lights: AreaLightArrays,
        x: wp.vec3,
        w: wp.vec3,
        offset: wp.vec3,
        object: int,
    ) -> wp.vec3:
        total = wp.vec3(0.0, 0.0, 0.0)
        for k in range(lights.power.shape[0]):
            light = light_seen_from(lights, k, x, surfaces.time)
            distance = distance_to(light, w)
            row = int(0)
            shines = distance > 0.0 and lights.meshed[k] == 0
            if wp.static(linked):
                row = lights.link_row[k]
                shines = shines and (lights.links[row, object] & UNLIT) == 0
            if shines:
                part = share(surfaces, textures, lights.links, row, x, w, offset, distance)
                if part > 0.0:
                    part *= shaped(lights.shaping[k], light.facing, -w)
                    total += lights.power[k] * (part * radiance_of(light))
        return total

    return radiance


@wp.func
def dome_reflection(
    surfaces: Surfaces,
    textures: TextureArrays,
    partial: bool,
    domes: DomeArrays,
    lobe: Lobe,
    x: wp.vec3,
    n_g: wp.vec3,
    offset: wp.vec3,
    place: wp.vec2,
) -> wp.vec3:
    """Radiance that domes send off a lobe, by some of its directions; ``place`` in the unit square moves them."""
    total = wp.vec3(0.0, 0.0, 0.0)
    count = float(DOME_STRATA * DOME_STRATA)
    for number in range(DOME_STRATA * DOME_STRATA):
        cell = wp.vec2(float(number % DOME_STRATA), float(number // DOME_STRATA))
        w = mirrored_by_a_facet(lobe, (cell + within(place)) / float(DOME_STRATA))
        if wp.dot(lobe.n, w) > 0.0 and wp.dot(n_g, w) > 0.0:
            often = count * chance_of(lobe, w)
            if not hidden_from_dome(surfaces, textures, partial, x, w, offset):
                total += wp.cw_mul(dome_radiance_about(domes, w, SHARE / often), reflected(lobe, w)) / often
    return total
