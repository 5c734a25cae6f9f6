"""What compositing asks of the surfaces seen: what dielectrics shade, how they move over the screen, whose they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import own_module
from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays, has_shading_normals
from tpdwarp.scene.description import Interaction
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import is_plane_left, occluded, plane_of
from tpdwarp.scene.device.links import PASSED, linked_share
from tpdwarp.scene.device.ray_tree import first_met
from tpdwarp.scene.device.textures import TextureArrays
from tpdwarp.view.area_lights import OF_LIGHTS, AreaLightArrays, area_irradiance
from tpdwarp.view.camera import Camera
from tpdwarp.view.lights import LightArrays, point_irradiance

# Which AOVs take this module's kernel.
SURFACE_AOVS = ("albedo", "shadow", "vector", "id", "cryptomatte")
DIELECTRIC = wp.constant(int(Interaction.DIELECTRIC))
# Dielectric surfaces that a shadow ray goes through. Chosen, not derived: a stack of sixteen panes.
MOST_CROSSED = wp.constant(32)


@wp.struct
class SurfaceArrays:
    """One row a camera path: irradiance that dielectrics take away, screen motion [pixels], object first met (or −1).

    Screen motion is that over the whole shutter, to the right and up.
    """

    shaded: wp.array(dtype=wp.vec3)
    vector: wp.array(dtype=wp.vec2)
    object: wp.array(dtype=wp.int32)


@cache
def only_by_glass(linked: bool) -> wp.Function:
    """The function that gives 1 where dielectrics alone hide x + distance·ω from x, but for the plane of x, else 0.

    It is a share of :func:`tpdwarp.view.lights.point_irradiance`: what would come directly without them.

    Args:
        linked: Whether light passes some objects as if they were not there: those that ``links`` names in ``row``.
    """
    share_of_light = linked_share(False)

    @wp.func
    def hidden_by_glass(
        surfaces: Surfaces,
        textures: TextureArrays,
        links: wp.array2d(dtype=wp.int32),
        row: int,
        x: wp.vec3,
        w: wp.vec3,
        offset: wp.vec3,
        distance: float,
    ) -> float:
        if wp.static(linked):
            if share_of_light(surfaces, textures, links, row, x, w, offset, distance) > 0.0:
                return 0.0
        elif not occluded(surfaces, x, w, offset, distance):
            return 0.0
        offset_length = wp.length(offset)
        side = wp.normalize(offset)
        origin = x + offset
        gone = float(0.0)
        for _crossed in range(MOST_CROSSED):
            met = first_met(surfaces.tree, origin + gone * w, w, distance - gone)
            if met.triangle < 0:
                return 1.0
            plane = plane_of(surfaces, met.triangle)
            lets_by = surfaces.interaction[surfaces.material_of[met.triangle]] == DIELECTRIC
            if wp.static(linked):
                lets_by = lets_by or (links[row, surfaces.object_of[met.triangle]] & PASSED) != 0
            if not lets_by and not is_plane_left(plane, x, side, offset_length):
                return 0.0
            # Off the surface by as much as a ray that leaves it.
            gone += met.distance + 2.0 * plane.offset / wp.max(wp.abs(wp.dot(plane.n_g, w)), 1.0e-3)
            if gone >= distance:
                return 1.0
        return 0.0

    return hidden_by_glass


@wp.func
def film_position(camera: Camera, x: wp.vec3, time: float) -> wp.vec2:
    """Where on the film [pixels, from the upper left] x is seen at ``time`` in the shutter (−½ … ½)."""
    d = x - (camera.position + time * camera.position_motion)
    a = wp.dot(d, wp.normalize(camera.right + time * camera.right_motion))
    b = wp.dot(d, wp.normalize(camera.up + time * camera.up_motion))
    if camera.orthographic == 0:
        depth = -wp.dot(d, wp.normalize(camera.back + time * camera.back_motion))
        a /= wp.max(depth, 1.0e-9)
        b /= wp.max(depth, 1.0e-9)
    return wp.vec2((a - camera.corner[0]) / camera.pixel[0], (camera.corner[1] - b) / camera.pixel[1])


@cache
def _kernel(shadow: bool, vector: bool, moves: bool, smooth: bool, extended: bool, linked: bool) -> wp.Kernel:
    by_glass = only_by_glass(linked)
    shaded_points, shaded_areas = point_irradiance(by_glass, linked), area_irradiance(by_glass, linked)

    @wp.kernel(**own_module())
    def surface_aovs(
        base: int,
        surfaces: Surfaces,
        lights: LightArrays,
        area_lights: AreaLightArrays,
        camera: Camera,
        queries: QueryArrays,
        triangles: wp.array(dtype=wp.int32),
        first_triangles: wp.array(dtype=wp.int32),
        first_positions: wp.array(dtype=wp.vec3),
        rows: wp.array(dtype=wp.int32),
        segments: float,
        out: SurfaceArrays,
    ):
        i = rows[base + wp.tid()]
        first = first_triangles[i]
        out.object[i] = -1
        if first >= 0:
            out.object[i] = surfaces.object_of[first]
            if wp.static(vector):
                motion = wp.vec3(0.0, 0.0, 0.0)
                x = first_positions[i]
                if wp.static(moves):
                    corners = surfaces.triangles[first]
                    p0 = surfaces.points[corners[0]]
                    e1 = surfaces.points[corners[1]] - p0
                    e2 = surfaces.points[corners[2]] - p0
                    area = wp.cross(e1, e2)
                    inverse = 1.0 / wp.max(wp.dot(area, area), 1.0e-30)
                    b1 = wp.dot(wp.cross(x - p0, e2), area) * inverse
                    b2 = wp.dot(wp.cross(e1, x - p0), area) * inverse
                    m0 = surfaces.motions[corners[0]]
                    motion = m0 + b1 * (surfaces.motions[corners[1]] - m0) + b2 * (surfaces.motions[corners[2]] - m0)
                opened = film_position(camera, x - (surfaces.time + 0.5) * motion, -0.5)
                closed = film_position(camera, x + (0.5 - surfaces.time) * motion, 0.5)
                way = segments * (closed - opened)
                out.vector[i] = wp.vec2(way[0], -way[1])
        if wp.static(shadow):
            if queries.receiver[i] >= 0:
                n_g = queries.normal[i]
                n = n_g
                if wp.static(smooth):
                    n = queries.shading_normal[i]
                offset = plane_of(surfaces, triangles[i]).offset * n_g
                shaded = shaded_points(
                    surfaces, TextureArrays(), lights, queries.position[i], n, n_g, offset, queries.receiver[i]
                )
                if wp.static(extended):
                    chance = wp.rand_init(int(OF_LIGHTS), i)
                    place = wp.vec2(wp.randf(chance), wp.randf(chance))
                    shaded += shaded_areas(
                        surfaces, TextureArrays(), area_lights, queries.position[i], n, n_g, offset, place,
                        queries.receiver[i],
                    )  # fmt: skip
                out.shaded[i] = shaded

    return surface_aovs


@dataclass(frozen=True, eq=False)
class SurfaceExtras:
    """What one pass of camera paths saw besides; one row a path.

    Attributes:
        albedo: Of the diffuse surface where the path ends, shape [n, 3].
        shaded: Irradiance there that dielectrics take away, in the tracer's units, shape [n, 3].
        vector: Screen motion of what was met first, over the whole shutter [pixels, right and up], shape [n, 2].
        objects: The object met first, −1 for none, shape [n].
    """

    albedo: np.ndarray
    shaded: np.ndarray
    vector: np.ndarray
    objects: np.ndarray


def find_surfaces(
    surfaces: Surfaces,
    lights: LightArrays,
    area_lights: AreaLightArrays,
    camera: Camera,
    queries: QueryArrays,
    seen: object,
    rows: wp.array,
    aovs: tuple[str, ...],
    launcher: Launcher,
    moves: bool,
    segments: int,
    out: SurfaceArrays,
) -> None:
    """Looks again at what camera paths saw.

    Args:
        queries: Where they ended.
        seen: The :class:`tpdwarp.view.visibility.VisibleArrays` of the paths, with their triangles.
        rows: Which of them to look at, int32.
        aovs: What is wanted.
        moves: Whether triangles have motions.
        segments: Segments of the shutter; scene and camera are those of one of them.
        out: Takes what is found, in the same rows.
    """
    extended = area_lights.power.shape[0] > 0
    linked = lights.link_row.shape[0] > 0 or area_lights.link_row.shape[0] > 0
    kernel = _kernel("shadow" in aovs, "vector" in aovs, moves, has_shading_normals(queries), extended, linked)
    arrays = [seen.triangle, seen.first_triangle, seen.first_position, rows]
    inputs = [surfaces, lights, area_lights, camera, queries, *arrays, float(segments), out]
    launcher(kernel, rows.shape[0], inputs)


def surface_extras(albedo: wp.array, found: SurfaceArrays) -> SurfaceExtras:
    """What was found, on the host, with the albedo where paths ended."""
    return SurfaceExtras(albedo.numpy(), found.shaded.numpy(), found.vector.numpy(), found.object.numpy())
