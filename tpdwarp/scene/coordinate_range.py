"""How far from the scene something may lie before single precision no longer holds what is computed with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.scene.description import LightKind, SceneAtShutter
from tpdwarp.scene.normalization import Normalization

# In the tracer's units: squares of areas go with the fourth power of an edge, 1e36, and must fit in single precision,
# which ends at 3e38.
LARGEST_COORDINATE = 1.0e9
# In the tracer's units: rays end there, so that a point light beyond it would reach nothing.
LARGEST_LIGHT_COORDINATE = 1.0e6


def require_within_range(scene: SceneAtShutter, normalization: Normalization, file: str) -> None:
    """Refuses what lies or moves more than 10⁹ times the size of the scene away.

    Raises:
        InputError: Naming the first such mesh, light or camera of ``file``.
    """
    for path, what, largest, positions, motions in _placed(scene, _still_within(scene, normalization)):
        extent = _largest(positions, normalization.origin)
        if motions is not None:
            extent += 0.5 * _largest(motions, (0.0, 0.0, 0.0))
        if not extent * normalization.scale <= largest:
            raise InputError(
                f"{what} {extent:.3g} scene units from the middle of the scene, more than {largest:g} times its size "
                "(correct it)",
                file,
                path,
            )


def _largest(positions: np.ndarray, origin: Sequence[float]) -> float:
    """The largest coordinate of positions [n, 3] or [3], whatever its sign, seen from ``origin``; NaN if one is."""
    columns = positions.reshape(-1, 3).T
    if columns.size == 0:
        return 0.0
    ends = [(column.max() - at, at - column.min()) for column, at in zip(columns, origin, strict=True)]
    return float(np.max(ends))


def _still_within(scene: SceneAtShutter, normalization: Normalization) -> bool:
    """Whether all meshes that stand still are within the range: asked of thousands at once."""
    boxes = [mesh.boxes for mesh in scene.meshes if mesh.motions is None]
    extent = _largest(np.concatenate(boxes), normalization.origin) if boxes else 0.0
    return extent * normalization.scale <= LARGEST_COORDINATE


def _placed(
    scene: SceneAtShutter, but_still: bool
) -> Iterator[tuple[str, str, float, np.ndarray, np.ndarray | None]]:
    """What is placed in a scene, ``but_still`` without meshes that stand still."""
    for mesh in scene.meshes:
        if but_still and mesh.motions is None:
            continue
        yield mesh.path, "reaches", LARGEST_COORDINATE, mesh.boxes, mesh.motions
    for light in scene.lights:
        if light.kind == LightKind.POINT:
            yield light.path, "lies", LARGEST_LIGHT_COORDINATE, light.position, light.position_motion
    if scene.camera is not None:
        yield scene.camera.path, "lies", LARGEST_COORDINATE, scene.camera.position, scene.camera.position_motion
