"""Irradiance at points that ride on surfaces: what the camera's gather does, without a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.compiler_flags import own_module
from tpdwarp.estimators import estimator_of
from tpdwarp.estimators.estimator import IrradianceField, Part
from tpdwarp.footprints.irradiance import Lookup, QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import FramePhotons, Traced
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import hit_on, shading_normal
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

    @property
    def other_sides(self) -> SurfacePoints:
        """The same points on the other side of their surfaces."""
        return SurfacePoints(self.triangles, self.weights, -self.sides)


@dataclass(frozen=True, eq=False)
class PointGroup:
    """Points that stand for areas of one size.

    Attributes:
        points: The points.
        pixel: What each of them stands for.
    """

    points: SurfacePoints
    pixel: PixelSize


@dataclass(eq=False)
class PointLight:
    """What photons leave at points, averaged over a shutter.

    Attributes:
        irradiance: W/m², shape [n, 3] float64; NaN where a point lies on no diffuse surface.
        motion: Sum of D_t x over the whole shutter [scene units] weighted by ``weight``, shape [n, 3].
        weight: Sum of weights, shape [n].
        by_group: Irradiance from each light group, where these are kept apart.
    """

    irradiance: np.ndarray
    motion: np.ndarray
    weight: np.ndarray
    by_group: dict[str, np.ndarray]

    @classmethod
    def none(cls, count: int, groups: Sequence[str] = ()) -> PointLight:
        """No light at ``count`` points."""
        by_group = {name: np.zeros((count, 3)) for name in groups}
        return cls(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count), by_group)

    def add(self, other: PointLight) -> None:
        """Adds other light at the same points."""
        self.irradiance += other.irradiance
        self.motion += other.motion
        self.weight += other.weight
        for name, irradiance in other.by_group.items():
            self.by_group[name] += irradiance

    @property
    def mean_motion(self) -> np.ndarray:
        """Flux-weighted mean of D_t x over the whole shutter [scene units], shape [n, 3]; zero without light."""
        return self.motion / np.maximum(self.weight, 1e-30)[:, None]


def square(side: float, context: RenderContext) -> PixelSize:
    """What a point stands for that is the mean over a square, however it is turned; ``side`` in scene units."""
    size = PixelSize()
    size.base = side * context.normalization.scale
    return size


@wp.kernel(enable_backward=False)
def _find(
    base: int,
    surfaces: Surfaces,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    farthest: float,
    triangles: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.vec2),
    sides: wp.array(dtype=wp.float32),
):
    i = base + wp.tid()
    triangles[i] = -1
    found = wp.mesh_query_point_no_sign(mesh, points[i], farthest)
    if found.result:
        material = surfaces.material_of[found.face]
        if surfaces.interaction[material] == DIFFUSE:
            triangles[i] = found.face
            weights[i] = wp.vec2(found.u, found.v)
            n_g = wp.mesh_eval_face_normal(mesh, found.face)
            sides[i] = wp.where(wp.dot(n_g, normals[i]) < 0.0, -1.0, 1.0)


@cache
def _placing(smooth: bool, moves: bool) -> wp.Kernel:
    """The kernel that places queries where points of surfaces stand at the surfaces' time."""

    @wp.kernel(**own_module())
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
            beta = wp.vec3(weights[i][0], weights[i][1], 1.0 - weights[i][0] - weights[i][1])
            hit = hit_on(surfaces, triangle, beta, wp.static(moves))
            n_g = hit.n_g * sides[i]
            queries.receiver[i] = surfaces.object_of[triangle]
            queries.position[i] = hit.position
            queries.normal[i] = n_g
            if wp.static(smooth):
                n = shading_normal(surfaces, hit, False, wp.static(moves)).n
                if wp.dot(n, n_g) < 0.0:
                    n = -n
                queries.shading_normal[i] = n
            if wp.static(moves):
                queries.motion[i] = segments * hit.motion

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
    scene, since = _scene_at(0.5, scenes)
    surfaces, mesh = scene.geometry.mesh_at(since, launcher)
    triangles = launcher.zeros(count, wp.int32)
    weights, sides = launcher.zeros(count, wp.vec2), launcher.zeros(count, wp.float32)
    given = [
        launcher.array(context.normalization.points(np.asarray(points, np.float64)), wp.vec3),
        launcher.array(np.asarray(normals, np.float32), wp.vec3),
    ]
    launcher(_find, count, [surfaces, mesh.id, *given, FARTHEST, triangles, weights, sides])
    return SurfacePoints(triangles.numpy(), weights.numpy(), sides.numpy())


def irradiance_at(
    context: RenderContext,
    shutter: Shutter,
    scenes: list[LoadedScene],
    groups: Sequence[PointGroup],
    with_motion: bool = False,
) -> tuple[list[PointLight], Traced]:
    """Mean irradiance from photons over a shutter at points that ride on surfaces; photons are traced once.

    Args:
        context: The animation.
        shutter: The exposure.
        scenes: The scenes of its segments (``context.segmentation.load``).
        groups: Points on the surfaces of the scene in the middle; at least one group.
        with_motion: Whether the photons' motion is wanted.

    Returns:
        The light at each group; the photons and where their flux went.
    """
    clock = Clock()
    photons = FramePhotons()
    middle = scenes[len(scenes) // 2]
    names = context.light_groups.names
    lights = [PointLight.none(len(group.points.triangles), names) for group in groups]
    orders = [_curve_order(context, middle, group.points) for group in groups]
    estimator = estimator_of(context.settings)
    for part in estimator.parts(context.tracer, shutter, scenes, groups[0].pixel, clock):
        photons.add(part)
        fields, pixel = context.light_groups.fields(part, None, context.tracer, clock), groups[0].pixel
        for group, light, order in zip(groups, lights, orders, strict=True):
            if group.pixel is not pixel:
                fields, pixel = context.light_groups.fields(part, group.pixel, context.tracer, clock), group.pixel
            with clock.stage("gather"):
                for name, field in fields.items():
                    before = light.irradiance.copy() if name else light.irradiance
                    for first in range(0, len(order), BATCH):
                        chosen = order[first : first + BATCH]
                        _add_light(light, chosen, part, field, context, group.points.of(chosen), with_motion)
                    if name:
                        light.by_group[name] += light.irradiance - before
        # Makes room for the photons of the next part.
        del part, fields
    norm = context.normalization
    for group, light in zip(groups, lights, strict=True):
        for irradiance in (light.irradiance, *light.by_group.values()):
            irradiance *= norm.scale**2 * norm.power
            irradiance[group.points.triangles < 0] = np.nan
        light.motion /= norm.scale
    return lights, Traced(photons.landed(scenes), photons.energy, clock.seconds)


def _add_light(
    total: PointLight,
    chosen: np.ndarray,
    part: Part,
    field: IrradianceField,
    context: RenderContext,
    points: SurfacePoints,
    with_motion: bool,
) -> None:
    """Adds the light of one part of a frame, in the tracer's units, to the rows ``chosen`` of ``total``."""
    moves = any(scene.geometry.moves for scene in part.scenes)
    times, count = _times(part, field, points) if moves else 1, len(part.scenes)
    for number in range(times):
        surfaces, scene = surfaces_at((number + 0.5) / times, part.scenes, context)
        queries = _queries(surfaces, points, context, scene, moves, count)
        middle = (number + 0.5) / times - 0.5
        lookup = Lookup(middle, (middle, 1.0 / times), query_moves=moves, with_motion=with_motion)
        found = field.irradiance(queries, lookup)
        total.irradiance[chosen] += found.irradiance / times
        if with_motion:
            total.motion[chosen] += found.motion / times
            total.weight[chosen] += found.weight / times


def _times(part: Part, field: IrradianceField, points: SurfacePoints) -> int:
    """How often within the shutter points that move are looked at."""
    surfaces = part.scenes[len(part.scenes) // 2].geometry.surfaces
    corners = np.unique(surfaces.triangles.numpy()[points.triangles])
    way = len(part.scenes) * np.linalg.norm(surfaces.motions.numpy()[corners], axis=1).max(initial=0.0)
    return int(np.clip(np.ceil(way / field.longest_way), FEWEST_TIMES, MOST_TIMES))


def surfaces_at(time: float, scenes: list[LoadedScene], context: RenderContext) -> tuple[Surfaces, LoadedScene]:
    """The surfaces as they stand at ``time`` in the shutter (0 … 1), and the scene of the segment that is of."""
    scene, since = _scene_at(time, scenes)
    return scene.geometry.at(since, context.launcher), scene


def _scene_at(time: float, scenes: list[LoadedScene]) -> tuple[LoadedScene, float]:
    """The scene of the segment that ``time`` in the shutter (0 … 1) is of, and the time in that (−½ … ½)."""
    since = time * len(scenes)
    segment = min(int(since), len(scenes) - 1)
    return scenes[segment], since - segment - 0.5


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
