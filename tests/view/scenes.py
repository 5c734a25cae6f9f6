"""Scenes, cameras and sources written down in code, and what the camera sees of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import (
    CameraAtShutter,
    SceneAtShutter,
    Shutter,
)
from tpdwarp.scene.device.geometry import geometry_of
from tpdwarp.scene.device.textures import TextureStore
from tpdwarp.scene.normalization import Normalization
from tpdwarp.scene.requirements import requirements_of
from tpdwarp.view.area_lights import area_light_arrays
from tpdwarp.view.camera import camera_of
from tpdwarp.view.lights import light_arrays
from tpdwarp.view.visibility import visible_points
from usd_scenes.in_memory import (  # noqa: F401 (what scripts render as well lives there)
    QUAD,
    SUN,
    WATER,
    WHITE,
    Source,
    bumpy,
    floor,
    looking_down,
    quad,
    rod,
    steady,
    turned,
    turning_rod_source,
    wave_source,
)

SHUTTER = Shutter(1.0, 1.0, 2.0)
ONE_THREAD = Launcher("cpu", 1)


def view_rays(
    camera: CameraAtShutter, width: int, height: int, films: np.ndarray, time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions [n, 3] of camera rays at ``time`` in the shutter (−½ … ½), float64, scene units."""
    axes = camera.axes + time * camera.axes_motion
    right, up, back = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    eye = camera.position + time * camera.position_motion
    left, end, bottom, top = camera.window
    x = (left + (end - left) * films[:, 0] / width)[:, None]
    y = (top - (top - bottom) * films[:, 1] / height)[:, None]
    if camera.orthographic:
        return eye + x * right + y * up, np.broadcast_to(-back, (len(films), 3))
    directions = x * right + y * up - back
    return np.broadcast_to(eye, directions.shape), directions / np.linalg.norm(directions, axis=1, keepdims=True)


@dataclass(frozen=True)
class Seen:
    """Camera paths of one pass, scene units; weights turn irradiance into radiance."""

    items: np.ndarray
    positions: np.ndarray
    motions: np.ndarray
    normals: np.ndarray
    receivers: np.ndarray
    weights: np.ndarray
    direct: np.ndarray
    depths: np.ndarray


def see(
    scene: SceneAtShutter,
    width: int,
    height: int,
    films,
    *,
    moves: bool = False,
    time: float = 0.0,
    samples: int = 1,
    rays: int = 1,
    **compiled: bool,
) -> list[Seen]:
    """What camera rays through ``films`` [n, 2] see at ``time`` in the shutter, pass by pass.

    Args:
        samples: How many of the films that follow each other are of one pixel, or of ``rays``.
        rays: How many films stand for each of these.
        **compiled: Requirements that the kernel is compiled for, whatever the scene has, so that tests share it.
    """
    norm = Normalization.of(scene)
    needs = replace(requirements_of(scene), **compiled)
    geometry = geometry_of(scene, norm, ONE_THREAD, with_motions=moves)
    surfaces = geometry.at(time, ONE_THREAD)
    camera = camera_of(scene.camera, width, height, norm, ONE_THREAD)
    lights = [make(scene.lights, norm, ONE_THREAD, geometry.paths) for make in (light_arrays, area_light_arrays)]
    textures = None
    if needs.material_arrays:
        textures = TextureStore(ONE_THREAD).arrays(scene.meshes, geometry.materials, norm.scale, norm.power)
    positions = ONE_THREAD.array(np.asarray(films, np.float32), wp.vec2)
    items = np.arange(len(films), dtype=np.int32)
    options = {"moves": moves, "textures": textures, "samples": samples, "rays": rays}
    passes = visible_points(surfaces, *lights, camera, positions, items, needs, ONE_THREAD, **options)
    found = []
    for batch in passes:
        queries, arrays = batch.queries, batch.arrays
        found.append(
            Seen(
                batch.items,
                norm.world_points(queries.position.numpy()),
                norm.world_vectors(queries.motion.numpy()),
                queries.normal.numpy(),
                queries.receiver.numpy(),
                arrays.weight.numpy().astype(float),
                arrays.direct.numpy().astype(float) * norm.scale**2 * norm.power,
                arrays.first_depth.numpy() / norm.scale,
            )
        )
    return found
