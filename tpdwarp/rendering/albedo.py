"""The albedo of surfaces at points that ride on them: by material, display colour or texture."""

from __future__ import annotations

from functools import cache

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import own_module
from tpdwarp.footprints.shaping import PixelSize, tangent_frame
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.surface_points import SurfacePoints
from tpdwarp.scene.description import Interaction
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import diffuse_color, hit_on
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.device.textures import TextureArrays, textured_color

DIFFUSE = wp.constant(int(Interaction.DIFFUSE))


@cache
def _albedo(textured: bool) -> wp.Kernel:
    @wp.kernel(**own_module())
    def albedo(
        base: int,
        surfaces: Surfaces,
        textures: TextureArrays,
        triangles: wp.array(dtype=wp.int32),
        weights: wp.array(dtype=wp.vec2),
        pixel: PixelSize,
        colors: wp.array(dtype=wp.vec3),
    ):
        i = base + wp.tid()
        triangle = triangles[i]
        material = surfaces.material_of[triangle]
        if surfaces.interaction[material] != DIFFUSE:
            return
        beta = wp.vec3(weights[i][0], weights[i][1], 1.0 - weights[i][0] - weights[i][1])
        hit = hit_on(surfaces, triangle, beta, False)
        color = diffuse_color(surfaces, hit)
        if wp.static(textured):
            across = pixel.right
            down = pixel.up
            if wp.length_sq(across) == 0.0:
                frame = tangent_frame(hit.n_g)
                across = pixel.base * frame.e1
                down = pixel.base * frame.e2
            color = textured_color(textures, material, hit, color, across, down)
        colors[i] = color

    return albedo


def albedo_at(context: RenderContext, scene: LoadedScene, points: SurfacePoints, pixel: PixelSize) -> np.ndarray:
    """Albedo at points of surfaces as they stand in the middle of a scene's shutter.

    Args:
        context: The animation.
        scene: One of its scenes.
        points: All of them on triangles.
        pixel: What each of them stands for: textures are averaged over it.

    Returns:
        Linear Rec.709, shape [n, 3]; zero on what is not diffuse.
    """
    launcher, count = context.launcher, len(points.triangles)
    colors = launcher.zeros(count, wp.vec3)
    given = [launcher.array(points.triangles, wp.int32), launcher.array(points.weights, wp.vec2)]
    kernel = _albedo(scene.requirements.textures)
    launcher(kernel, count, [scene.geometry.surfaces, scene.textures, *given, pixel, colors])
    return colors.numpy()
