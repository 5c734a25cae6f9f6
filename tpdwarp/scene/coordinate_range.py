"""How far from the scene something may lie before single precision no longer holds what is computed with it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.scene.description import LightKind, SceneAtShutter
from tpdwarp.scene.normalization import Normalization

# In the tracer's units: the fourth power of an edge, which squares of areas are, must fit in single precision.
FARTHEST = 1.0e9
# Rays end there: a point light beyond reaches nothing.
FARTHEST_LAMP = 1.0e6


def require_reach(scene: SceneAtShutter, normalization: Normalization, file: str) -> None:
    """Refuses what lies or moves more than 10⁹ times the size of the scene away.

    Raises:
        InputError: Naming the first such mesh, light or camera of ``file``.
    """
    for path, what, farthest, positions, motions in _placed(scene):
        reach = float(np.abs(positions - np.asarray(normalization.origin)).max(initial=0.0))
        if motions is not None:
            reach += 0.5 * float(np.abs(motions).max(initial=0.0))
        if not reach * normalization.scale <= farthest:
            raise InputError(
                f"{what} {reach:.3g} scene units from the middle of the scene, more than {farthest:g} times its size "
                "(correct it)",
                file,
                path,
            )


def _placed(scene: SceneAtShutter) -> Iterator[tuple[str, str, float, np.ndarray, np.ndarray | None]]:
    for mesh in scene.meshes:
        yield mesh.path, "reaches", FARTHEST, mesh.points, mesh.motions
    for light in scene.lights:
        if light.kind == LightKind.POINT:
            yield light.path, "lies", FARTHEST_LAMP, light.position, light.position_motion
    if scene.camera is not None:
        yield scene.camera.path, "lies", FARTHEST, scene.camera.position, scene.camera.position_motion
