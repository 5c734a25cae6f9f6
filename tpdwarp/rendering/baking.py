"""Textures of receivers over a shutter: what photons leave on them, over their texture coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.device import Launcher
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.rendering.albedo import albedo_at
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Traced
from tpdwarp.rendering.surface_points import PointGroup, PointLight, SurfacePoints, irradiance_at
from tpdwarp.rendering.texels import Texels, overlap_of, texel_size, texels_of, tiles_of
from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.scene.device.loading import LoadedScene

# What a texture may hold.
QUANTITIES = ("irradiance", "caustic", "motion")
# Pixels [resolution, resolution] by channel.
Picture = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Atlas:
    """The texels of one receiver.

    Attributes:
        path: The receiver, as in ``MeshAtShutter``.
        coordinates: Of the corners of its triangles, shape [m, 3, 2].
        texels: Those of each tile, by the unit square of (s, t).
    """

    path: str
    coordinates: np.ndarray
    texels: dict[tuple[int, int], Texels]

    @classmethod
    def of(cls, path: str, coordinates: np.ndarray, resolution: int, gutter: float, launcher: Launcher) -> Atlas:
        """The texels of a receiver with these coordinates; arguments as of :func:`texels_of`."""
        found = {
            tile: texels_of(coordinates, tile, resolution, gutter, launcher) for tile in tiles_of(coordinates)
        }
        return cls(path, coordinates, {tile: texels for tile, texels in found.items() if len(texels.places)})

    @property
    def overlap(self) -> float:
        """How many times over charts lie on each other: 1 where they do not."""
        return overlap_of(self.coordinates, list(self.texels.values()))

    @property
    def points(self) -> SurfacePoints:
        """The texels of all tiles, one after the other."""
        parts = [texels.points for texels in self.texels.values()]
        return SurfacePoints(*(np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS))

    def pictures(self, values: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
        """Values [n, c] of :attr:`points` as a picture of each tile, [resolution, resolution, c]."""
        counts = np.cumsum([len(texels.places) for texels in self.texels.values()])[:-1]
        parts = np.split(values, counts)
        return {tile: t.picture(part) for (tile, t), part in zip(self.texels.items(), parts, strict=True)}

    @property
    def inside(self) -> np.ndarray:
        """Whether the middle of each of :attr:`points` lies on a chart, shape [n]."""
        return np.concatenate([texels.inside for texels in self.texels.values()])


_COLUMNS = ("triangles", "weights", "sides")


def bake_textures(
    context: RenderContext, shutter: Shutter, scenes: list[LoadedScene], atlases: Sequence[Atlas], quantity: str
) -> tuple[list[dict[tuple[int, int], Picture]], Traced]:
    """What photons leave on receivers over a shutter, both sides added up; photons are traced once.

    Args:
        context: The animation.
        shutter: The exposure.
        scenes: The scenes of its segments.
        atlases: The receivers, all of them in the scene; at least one.
        quantity: ``irradiance`` [W/m²], ``caustic`` (radiance, albedo/π × irradiance) or ``motion`` (flux-weighted
            mean of D_t x over the shutter [scene units]).

    Returns:
        Channels [resolution, resolution] of each atlas, by tile: three values in ``R``, ``G`` and ``B``, in ``A`` 1
        where a texel's middle lies on a chart, and those of light groups by the quantity and their names, as in
        ``irradiance_key.R``; the photons and where their flux went.
    """
    middle = scenes[len(scenes) // 2]
    groups: list[PointGroup] = []
    for atlas in atlases:
        points, pixel = scene_points(atlas, middle.scene), pixel_of(atlas, middle.scene, context)
        groups += [PointGroup(points, pixel), PointGroup(points.other_sides, pixel)]
    lights, traced = irradiance_at(context, shutter, scenes, groups, with_motion=quantity == "motion")
    out = []
    for k, atlas in enumerate(atlases):
        light, group = lights[2 * k], groups[2 * k]
        light.add(lights[2 * k + 1])
        columns = dict(zip("RGB", _values(quantity, light, group, context, middle).T, strict=True))
        columns["A"] = atlas.inside
        if quantity != "motion":
            for name, irradiance in light.by_group.items():
                apart = _radiance(irradiance, quantity, group, context, middle)
                columns |= {f"{quantity}_{name}.{channel}": apart[:, k] for k, channel in enumerate("RGB")}
        pictures = atlas.pictures(np.column_stack(list(columns.values())))
        out.append({tile: dict(zip(columns, np.moveaxis(p, -1, 0), strict=True)) for tile, p in pictures.items()})
    return out, traced


def scene_points(atlas: Atlas, scene: SceneAtShutter) -> SurfacePoints:
    """The points of an atlas by the triangles of the whole scene."""
    first = 0
    for mesh in scene.objects():
        if mesh.path == atlas.path:
            break
        first += len(mesh.triangles)
    return replace(atlas.points, triangles=(atlas.points.triangles + first).astype(np.int32))


def pixel_of(atlas: Atlas, scene: SceneAtShutter, context: RenderContext) -> PixelSize:
    """What a texel of an atlas stands for."""
    mesh = mesh_of(scene, atlas.path)
    resolution = next(iter(atlas.texels.values())).resolution
    corners = mesh.points[mesh.triangles]
    rigid = mesh.motions is None or np.ptp(mesh.motions, axis=0).max() <= 1e-6 * np.ptp(mesh.points, axis=0).max()
    return texel_size(corners, atlas.coordinates, resolution, rigid, context.normalization.scale)


def mesh_of(scene: SceneAtShutter, path: str) -> MeshAtShutter | None:
    """The mesh of that path; None where the scene has none."""
    return next((mesh for mesh in scene.objects() if mesh.path == path), None)


def _values(
    quantity: str, light: PointLight, group: PointGroup, context: RenderContext, scene: LoadedScene
) -> np.ndarray:
    if quantity == "motion":
        return light.mean_motion
    return _radiance(light.irradiance, quantity, group, context, scene)


def _radiance(
    irradiance: np.ndarray, quantity: str, group: PointGroup, context: RenderContext, scene: LoadedScene
) -> np.ndarray:
    """Irradiance as it is, or the radiance that it makes where ``caustic`` is wanted."""
    if quantity == "caustic":
        return irradiance * albedo_at(context, scene, group.points, group.pixel) / math.pi
    return irradiance
