"""Lights without extent on the device."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import LightAtShutter, LightKind
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import occluded
from tpdwarp.scene.device.links import UNLIT, linked_share, links_of
from tpdwarp.scene.device.presence import share_that_passes
from tpdwarp.scene.device.shaping import SHAPING_COUNT, ShapingValues, is_shaped, shaped, shaping_axis, shaping_values
from tpdwarp.scene.device.textures import TextureArrays
from tpdwarp.scene.normalization import Normalization

# Distant lights are as far away as rays go, in the tracer's units, in which the scene is of unit size.
FAR = wp.constant(1.0e6)


@wp.struct
class LightArrays:
    """Lights in the tracer's units: direction of travel or position, and how these change over the shutter.

    ``links`` are those of lights (rows) to objects, ``link_row`` is the row of each; none where no light is linked.

    ``power`` is irradiance at normal incidence per square unit, or radiant intensity. ``shaping``, about ``axis``, is
    that of point lights; there are no rows where none is shaped.
    """

    distant: wp.array(dtype=wp.int32)
    place: wp.array(dtype=wp.vec3)
    place_motion: wp.array(dtype=wp.vec3)
    power: wp.array(dtype=wp.vec3)
    shaping: wp.array(dtype=ShapingValues)
    axis: wp.array(dtype=wp.vec3)
    axis_motion: wp.array(dtype=wp.vec3)
    links: wp.array2d(dtype=wp.int32)
    link_row: wp.array(dtype=wp.int32)


def light_arrays(
    lights: tuple[LightAtShutter, ...], normalization: Normalization, launcher: Launcher, paths: Sequence[str] = ()
) -> LightArrays:
    """The kernel's view of those of ``lights`` that have no extent.

    Args:
        paths: Paths of the objects that lights may be linked to.
    """
    lights = tuple(light for light in lights if light.extent is None)
    out = LightArrays()
    set_links(out, lights, launcher, paths)
    distant = np.array([light.kind == LightKind.DISTANT for light in lights], bool)
    place, motion, power = (np.zeros((len(lights), 3)) for _ in range(3))
    for i, light in enumerate(lights):
        power[i] = normalization.light_power(light)
        if distant[i]:
            place[i], motion[i] = -light.axes[2], -light.axes_motion[2]
        else:
            place[i] = normalization.points(light.position[None])[0]
            motion[i] = light.position_motion * normalization.scale
    out.distant = launcher.array(distant.astype(np.int32), wp.int32)
    out.place = launcher.array(place.astype(np.float32), wp.vec3)
    out.place_motion = launcher.array(motion.astype(np.float32), wp.vec3)
    out.power = launcher.array(power.astype(np.float32), wp.vec3)
    chosen = lights if any(map(is_shaped, lights)) else ()
    axes = np.array([shaping_axis(light) for light in chosen]).reshape(-1, 2, 3).swapaxes(0, 1)
    values = np.array(list(map(shaping_values, chosen)), np.float32)
    out.shaping = launcher.array(values.reshape(-1, SHAPING_COUNT), ShapingValues)
    for name, rows in (("axis", axes[0]), ("axis_motion", axes[1])):
        setattr(out, name, launcher.array(np.array(rows, np.float32).reshape(-1, 3), wp.vec3))
    return out


def set_links(
    out: wp.types.StructInstance, lights: Sequence[LightAtShutter], launcher: Launcher, paths: Sequence[str]
) -> None:
    """Sets the links of ``lights`` to the objects of ``paths`` in their arrays; one row for all that are alike."""
    links = links_of(lights, paths)
    rows, row_of = (links, np.zeros(0)) if not links.size else np.unique(links, axis=0, return_inverse=True)
    out.links = launcher.array(np.ascontiguousarray(rows, np.int32), wp.int32)
    out.link_row = launcher.array(row_of.reshape(-1).astype(np.int32), wp.int32)


@wp.struct
class LitFrom:
    """Where light comes from at a point: direction towards it, distance, and what ``power`` is divided by there."""

    w: wp.vec3
    distance: float
    falloff: float
    power: wp.vec3


@wp.func
def lit_from(surfaces: Surfaces, lights: LightArrays, k: int, x: wp.vec3) -> LitFrom:
    """What light ``k`` sends to x if nothing hides it: irradiance at normal incidence is power/falloff."""
    out = LitFrom()
    place = lights.place[k] + surfaces.time * lights.place_motion[k]
    out.power = lights.power[k]
    if lights.distant[k] == 1:
        out.w = -wp.normalize(place)
        out.distance = FAR
        out.falloff = 1.0
    else:
        d = place - x
        out.distance = wp.length(d)
        out.w = d / out.distance
        out.falloff = out.distance * out.distance
        if lights.shaping.shape[0] > 0:
            axis = wp.normalize(lights.axis[k] + surfaces.time * lights.axis_motion[k])
            out.power = out.power * shaped(lights.shaping[k], axis, -out.w)
    return out


@cache
def point_irradiance(share: wp.Function, linked: bool = False) -> wp.Function:
    """The function that sums what lights without extent send to a point.

    The cosine is that of the shading normal ``n``; what the surface itself hides, ``n_g`` decides.

    Args:
        share: What part of the light from x + distance·ω is counted: share(surfaces, textures, links, row, x, ω,
            offset, distance), with the light's row of ``links``.
        linked: Whether lights are linked to some objects only.
    """

    @wp.func
    def irradiance(
        surfaces: Surfaces,
        textures: TextureArrays,
        lights: LightArrays,
        x: wp.vec3,
        n: wp.vec3,
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
                cosine = wp.dot(n, light.w)
                if cosine > 0.0 and wp.dot(n_g, light.w) > 0.0:
                    part = share(surfaces, textures, lights.links, row, x, light.w, offset, light.distance)
                    if part > 0.0:
                        total += light.power * (cosine / light.falloff * part)
        return total

    return irradiance


@cache
def share_that_arrives(linked: bool, partial: bool) -> wp.Function:
    """The function that gives the share of light from x + distance·ω which nothing hides from x.

    Whatever is specular hides it too (its light comes as photons).

    Args:
        linked: Whether light passes some objects as if they were not there.
        partial: Whether surfaces that are there in part let the rest of the light pass.
    """
    if linked:
        return linked_share(partial)

    @wp.func
    def share(
        surfaces: Surfaces,
        textures: TextureArrays,
        links: wp.array2d(dtype=wp.int32),
        row: int,
        x: wp.vec3,
        w: wp.vec3,
        offset: wp.vec3,
        distance: float,
    ) -> float:
        if wp.static(partial):
            return share_that_passes(surfaces, textures, x, w, offset, distance)
        else:
            return wp.where(occluded(surfaces, x, w, offset, distance), 0.0, 1.0)

    return share
