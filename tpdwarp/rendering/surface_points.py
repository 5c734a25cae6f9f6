"""Irradiance at points that ride on surfaces: what the camera's gather does, without a camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.estimators import ESTIMATORS
from tpdwarp.estimators.estimator import Part
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.rendering.context import RenderContext
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.loading import LoadedScene

# Points further than this from all surfaces lie on none, in scenes of unit size. Chosen, not derived: what callers
# compute in single precision, on meshes finer than ours, must be found.
FARTHEST = 1.0e-3
# A receiver that moves is looked at so often within a shutter, as by four camera samples: light may come and go. Where
# it moves far over the light, as often as the gather takes for the whole of its way, up to a limit that is chosen.
FEWEST_TIMES, MOST_TIMES = 4, 64
# Points that are looked up together, which limits memory.
BATCH = 1 << 20
# Points are looked up in the order of cells of 2^-10 of their extent along a Z-shaped curve: near ones together.
CURVE_BITS = 10
DIFFUSE = wp.constant(int(Interaction.DIFFUSE))


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points that ride on triangles of a scene.

    Attributes:
        triangles: Triangle of each, shape [n] int32; −1 where there is none.
        weights: Barycentric weights of the triangle's first and second corner, shape [n, 2] float32.
        sides: 1 on the side that the triangle's winding faces, −1 on the other, shape [n] float32.
    """

    triangles: np.ndarray
    weights: np.ndarray
    sides: np.ndarray

    def of(self, chosen: np.ndarray) -> SurfacePoints:
        """Some of the points, in the order of ``chosen``."""
        return SurfacePoints(self.triangles[chosen], self.weights[chosen], self.sides[chosen])


@wp.kernel(module="unique", enable_backward=False)
def _find(
    base: int,
    surfaces: Surfaces,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    farthest: float,
    triangles: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.vec2),
    sides: wp.array(dtype=wp.float32),
):
    i = base + wp.tid()
    triangles[i] = -1
    found = wp.mesh_query_point_no_sign(surfaces.mesh, points[i], farthest)
    if found.result:
        material = surfaces.material_of[found.face]
        if surfaces.interaction[material] == DIFFUSE:
            triangles[i] = found.face
            weights[i] = wp.vec2(found.u, found.v)
            n_g = wp.mesh_eval_face_normal(surfaces.mesh, found.face)
            sides[i] = wp.where(wp.dot(n_g, normals[i]) < 0.0, -1.0, 1.0)


@cache
def _placing(smooth: bool, moves: bool) -> wp.Kernel:
    """The kernel that places queries where points of surfaces stand at the surfaces' time."""

    @wp.kernel(module="unique", enable_backward=False)
    def place(
        base: int,
        surfaces: Surfaces,
        triangles: wp.array(dtype=wp.int32),
        weights: wp.array(dtype=wp.vec2),
        sides: wp.array(dtype=wp.float32),
        segments: float,
        queries: QueryArrays,
    ):
        i = base + wp.tid()
        queries.receiver[i] = -1
        triangle = triangles[i]
        if triangle >= 0:
            corners = surfaces.triangles[triangle]
            a = weights[i][0]
            b = weights[i][1]
            c = 1.0 - a - b
            p0 = surfaces.points[corners[0]]
            p1 = surfaces.points[corners[1]]
            p2 = surfaces.points[corners[2]]
            n_g = wp.normalize(wp.cross(p1 - p0, p2 - p0)) * sides[i]
            queries.receiver[i] = surfaces.object_of[triangle]
            queries.position[i] = a * p0 + b * p1 + c * p2
            queries.normal[i] = n_g
            if wp.static(smooth):
                n = n_g
                indices = surfaces.normal_indices[triangle]
                if indices[0] >= 0:
                    s0 = surfaces.normals[indices[0]]
                    s1 = surfaces.normals[indices[1]]
                    s2 = surfaces.normals[indices[2]]
                    if wp.static(moves):
                        s0 += surfaces.time * surfaces.normal_motions[indices[0]]
                        s1 += surfaces.time * surfaces.normal_motions[indices[1]]
                        s2 += surfaces.time * surfaces.normal_motions[indices[2]]
                    n = wp.normalize(a * s0 + b * s1 + c * s2)
                    if wp.dot(n, n_g) < 0.0:
                        n = -n
                queries.shading_normal[i] = n
            if wp.static(moves):
                m0 = surfaces.motions[corners[0]]
                m1 = surfaces.motions[corners[1]]
                m2 = surfaces.motions[corners[2]]
                queries.motion[i] = segments * (a * m0 + b * m1 + c * m2)

    return place


def points_on_surfaces(
    context: RenderContext, scenes: list[LoadedScene], points: np.ndarray, normals: np.ndarray
) -> SurfacePoints:
    """The points of diffuse surfaces that lie next to given ones as the scene stands in the middle of a shutter.

    Args:
        scenes: The scenes of the shutter's segments.
        points: Scene units, shape [n, 3].
        normals: The side of the surface that is meant, shape [n, 3]; of any length.
    """
    launcher, count = context.launcher, len(points)
    surfaces = _surfaces_at(0.5, scenes, context)[0]
    triangles = launcher.zeros(count, wp.int32)
    weights, sides = launcher.zeros(count, wp.vec2), launcher.zeros(count, wp.float32)
    given = [
        launcher.array(context.normalization.points(np.asarray(points, np.float64)), wp.vec3),
        launcher.array(np.asarray(normals, np.float32), wp.vec3),
    ]
    launcher(_find, count, [surfaces, *given, FARTHEST, triangles, weights, sides])
    return SurfacePoints(triangles.numpy(), weights.numpy(), sides.numpy())


def irradiance_at(
    context: RenderContext,
    shutter: Shutter,
    scenes: list[LoadedScene],
    points: SurfacePoints,
    spacing: float = 0.0,
) -> tuple[np.ndarray, EnergyAccount]:
    """Mean irradiance from photons over a shutter at points that ride on surfaces.

    Args:
        context: The animation.
        shutter: The exposure.
        scenes: The scenes of its segments (``context.segmentation.load``).
        points: On the surfaces of the scene in the middle.
        spacing: Side of the square [scene units] that each value is the mean over.

    Returns:
        Irradiance [W/m²], shape [n, 3] float64, NaN where a point lies on no diffuse surface; where the flux went.
    """
    clock = Clock()
    total, energy = np.zeros((len(points.triangles), 3)), EnergyAccount()
    size = PixelSize()
    size.base = spacing * context.normalization.scale
    order = _curve_order(context, scenes[len(scenes) // 2], points)
    for part in ESTIMATORS[context.settings.estimator]().parts(context.tracer, shutter, scenes, size, clock):
        energy.add(part.energy)
        for first in range(0, len(order), BATCH):
            chosen = order[first : first + BATCH]
            total[chosen] += _irradiance_of(part, context, points.of(chosen))
    total *= context.normalization.scale**2 * context.normalization.power
    total[points.triangles < 0] = np.nan
    return total, energy


def _irradiance_of(part: Part, context: RenderContext, points: SurfacePoints) -> np.ndarray:
    """The irradiance of one part of a frame, in the tracer's units, shape [n, 3]."""
    light = part.light
    if light is None:
        return np.zeros((len(points.triangles), 3))
    moves = any(scene.geometry.moves for scene in part.scenes)
    times, count = _times(part, points) if moves else 1, len(part.scenes)
    total = np.zeros((len(points.triangles), 3))
    for number in range(times):
        surfaces, scene = _surfaces_at((number + 0.5) / times, part.scenes, context)
        queries = _queries(surfaces, points, context, scene, moves, count)
        middle = (number + 0.5) / times - 0.5
        found = light.irradiance(
            queries, time=middle, window=(middle, 1.0 / times), query_moves=moves, with_motion=False
        )
        total += found.irradiance / times
    return total


def _times(part: Part, points: SurfacePoints) -> int:
    """How often within the shutter points that move are looked at."""
    surfaces = part.scenes[len(part.scenes) // 2].geometry.surfaces
    corners = np.unique(surfaces.triangles.numpy()[points.triangles])
    way = len(part.scenes) * np.linalg.norm(surfaces.motions.numpy()[corners], axis=1).max(initial=0.0)
    return int(np.clip(np.ceil(way / part.light.longest_way), FEWEST_TIMES, MOST_TIMES))


def _surfaces_at(
    time: float, scenes: list[LoadedScene], context: RenderContext
) -> tuple[Surfaces, LoadedScene]:
    """The surfaces as they stand at ``time`` in the shutter (0 … 1), and the scene of the segment that is of."""
    since = time * len(scenes)
    segment = min(int(since), len(scenes) - 1)
    return scenes[segment].geometry.at(since - segment - 0.5, context.launcher), scenes[segment]


def _queries(
    surfaces: Surfaces, points: SurfacePoints, context: RenderContext, scene: LoadedScene, moves: bool, segments: int
) -> QueryArrays:
    launcher, smooth = context.launcher, scene.requirements.smooth_receivers
    left_out = [name for name, there in (("shading_normal", smooth), ("motion", moves)) if not there]
    queries = launcher.rows(QueryArrays, len(points.triangles), but=left_out)
    for name in left_out:
        setattr(queries, name, launcher.zeros(0, wp.vec3))
    given = [
        launcher.array(points.triangles, wp.int32),
        launcher.array(points.weights, wp.vec2),
        launcher.array(points.sides, wp.float32),
    ]
    launcher(_placing(smooth, moves), len(points.triangles), [surfaces, *given, float(segments), queries])
    return queries


def _curve_order(context: RenderContext, scene: LoadedScene, points: SurfacePoints) -> np.ndarray:
    """An order in which points that lie near each other follow each other; those on no surface are left out."""
    on_surface = np.flatnonzero(points.triangles >= 0)
    there = points.of(on_surface)
    surfaces = scene.geometry.surfaces
    corners = surfaces.triangles.numpy()[there.triangles]
    a, b = there.weights.T[..., None]
    places = np.einsum("knc,kn->nc", surfaces.points.numpy()[corners.T], np.stack([a, b, 1 - a - b])[..., 0])
    low = places.min(axis=0, initial=np.inf)
    extent = max(float((places - low).max(initial=0.0)), 1e-30)
    cells = np.minimum((places - low) / extent * 2**CURVE_BITS, 2**CURVE_BITS - 1).astype(np.int64)
    keys = np.zeros(len(places), np.int64)
    for bit in range(CURVE_BITS):
        for axis in range(3):
            keys |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return on_surface[np.argsort(keys, kind="stable")]
