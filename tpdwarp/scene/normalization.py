"""Where float32 works: the scene moved to its own centre and scaled to unit size."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpdwarp.scene.description import SceneAtShutter


@dataclass(frozen=True)
class Normalization:
    """Maps scene units to the tracer's: ``x' = (x − origin) · scale``.

    Attributes:
        origin: Centre of the scene, scene units.
        scale: A power of two that brings the scene to about unit size, so that scaling rounds nothing.
        radius: Radius of a sphere about the centre that holds the scene, in the tracer's units.
    """

    origin: tuple[float, float, float]
    scale: float
    radius: float

    @classmethod
    def of(cls, scene: SceneAtShutter) -> Normalization:
        """The normalization that suits ``scene``; the same scene always gives the same one, and none a plain one."""
        if not scene.meshes:
            return cls((0.0, 0.0, 0.0), 1.0, 0.5)
        lower = np.min([mesh.points.min(axis=0) for mesh in scene.meshes], axis=0)
        upper = np.max([mesh.points.max(axis=0) for mesh in scene.meshes], axis=0)
        size = 0.5 * float(np.linalg.norm(upper - lower))
        scale = 2.0 ** -math.ceil(math.log2(size)) if size > 0.0 else 1.0
        return cls(tuple(0.5 * (lower + upper)), scale, max(size * scale, 0.5))

    def points(self, positions: np.ndarray) -> np.ndarray:
        """Positions [n, 3] float64 in scene units → float32 in the tracer's."""
        return ((positions - np.asarray(self.origin)) * self.scale).astype(np.float32)

    def vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements [n, 3] in scene units → float32 in the tracer's."""
        return (vectors * self.scale).astype(np.float32)

    def world_points(self, positions: np.ndarray) -> np.ndarray:
        """Positions in the tracer's units → float64 in scene units."""
        return positions.astype(np.float64) / self.scale + np.asarray(self.origin)

    def world_vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements in the tracer's units → float64 in scene units."""
        return vectors.astype(np.float64) / self.scale
