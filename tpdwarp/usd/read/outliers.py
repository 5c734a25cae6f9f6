"""Meshes so far off, or so large for a stray point, that beside them nothing else would have a size; lamps likewise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from tpdwarp.errors import WarnOnce
from tpdwarp.scene.coordinate_range import LARGEST_COORDINATE, LARGEST_LIGHT_COORDINATE
from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, LightKind, MeshAtShutter

# In sizes of the scene: where a camera of parallel rays is brought. Chosen, not derived: it need only lie outside.
PARALLEL_DISTANCE = 10.0


class Outliers:
    """Leaves out what reaches 10⁹ times the size of an ordinary mesh away: of what is specular, where anything is.

    The scene is scaled to all that it holds, and single precision has no areas of what is so much smaller. The ordinary
    mesh is the one of median size.

    Args:
        warnings: Takes what is left out.
    """

    def __init__(self, warnings: WarnOnce) -> None:
        self._warnings = warnings
        self._bounds: WeakKeyDictionary[MeshAtShutter, tuple[np.ndarray, np.ndarray]] = WeakKeyDictionary()

    def without(self, meshes: list[MeshAtShutter]) -> list[MeshAtShutter]:
        """The meshes but those."""
        if len(meshes) < 2:
            return meshes
        low, high = (np.array(corners) for corners in zip(*map(self._of, meshes), strict=True))
        sizes = 0.5 * np.linalg.norm(high - low, axis=1)
        specular = np.array([mesh.specular for mesh in meshes])
        chosen = np.flatnonzero((specular if specular.any() else True) & (sizes > 0))
        if not len(chosen):
            return meshes
        ordinary = chosen[np.argsort(sizes[chosen], kind="stable")[(len(chosen) - 1) // 2]]
        middle = 0.5 * (low[ordinary] + high[ordinary])
        reach = np.maximum(np.abs(low - middle), np.abs(high - middle)).max(axis=1)
        near = reach <= LARGEST_COORDINATE * sizes[ordinary]
        for number in np.flatnonzero(~near):
            self._warnings(
                meshes[number].path,
                f"reaches {reach[number]:.3g} scene units away, more than {LARGEST_COORDINATE:g} times the size of "
                f"{meshes[ordinary].path}; until then the mesh is left out (correct its points)",
                "reaches too far",
            )
        return [mesh for mesh, kept in zip(meshes, near, strict=True) if kept]

    def lit(self, lights: tuple[LightAtShutter, ...], meshes: Sequence[MeshAtShutter]) -> tuple[LightAtShutter, ...]:
        """The lights but points that lie 10⁶ times the size of what is there away, where rays end."""
        if not meshes or all(light.kind != LightKind.POINT for light in lights):
            return lights
        low, high = (np.array(corners) for corners in zip(*map(self._of, meshes), strict=True))
        low, high = low.min(axis=0), high.max(axis=0)
        size, kept = 0.5 * float(np.linalg.norm(high - low)), []
        for light in lights:
            reach = np.abs(light.position - 0.5 * (low + high)).max() + 0.5 * np.abs(light.position_motion).max()
            if light.kind != LightKind.POINT or size == 0 or reach <= LARGEST_LIGHT_COORDINATE * size:
                kept.append(light)
                continue
            self._warnings(
                light.path,
                f"lies {reach:.3g} scene units away, more than {LARGEST_LIGHT_COORDINATE:g} times the size of the "
                "scene; until then the light is left out (correct its place)",
                "lies too far",
            )
        return tuple(kept)

    def seen_from(self, camera: CameraAtShutter, meshes: Sequence[MeshAtShutter]) -> CameraAtShutter:
        """The camera; brought nearer where it lies 10⁹ times the size of what is there away.

        It looks the same way. What it sees in perspective stays less than a hundred millionth of its distance wide, and
        parallel rays do not care where along them it stands.
        """
        middle, size = np.zeros(3), 1.0
        if meshes:
            low, high = (np.array(corners) for corners in zip(*map(self._of, meshes), strict=True))
            low, high = low.min(axis=0), high.max(axis=0)
            middle, size = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0
        offset = camera.position - middle
        reach = np.linalg.norm(offset) + 0.5 * np.linalg.norm(camera.position_motion)
        # Specular meshes, where the tracer's origin may lie, and other frames leave some of it to spare.
        nearest = 0.25 * LARGEST_COORDINATE * size
        if reach <= nearest:
            return camera
        self._warnings(
            camera.path,
            f"lies {reach:.3g} scene units from the middle of the scene, whose size is {size:.3g}: "
            "it is brought nearer (correct its place)",
            "camera too far",
        )
        if camera.orthographic:
            back = camera.axes[2]
            along = float(offset @ back)
            # What is across first: beside the whole distance it would be lost to rounding.
            offset = (offset - along * back) + math.copysign(min(abs(along), PARALLEL_DISTANCE * size), along) * back
        factor = min(1.0, nearest / (np.linalg.norm(offset) + 0.5 * np.linalg.norm(camera.position_motion)))
        return replace(camera, position=middle + factor * offset, position_motion=factor * camera.position_motion)

    def _of(self, mesh: MeshAtShutter) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest corner of a mesh, shapes [3] and [3]."""
        if mesh not in self._bounds:
            boxes = mesh.boxes
            self._bounds[mesh] = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        return self._bounds[mesh]
