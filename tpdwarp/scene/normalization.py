"""Where float32 works: the scene moved to its own centre and scaled to unit size, its lights to unit power."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.scene.description import LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter

# How much brighter than all that the stills show a light may become. Of float32's range, which ends at 3e38, the rest
# is for footprints of a ten millionth of the scene, whose |det M| is 1e14.
BRIGHTEST = 1e24


@dataclass(frozen=True)
class Normalization:
    """Maps scene units to the tracer's: ``x' = (x − origin) · scale``, and watts to its unit of power.

    Attributes:
        origin: Centre of what is specular (or of the scene), scene units: where float32 is finest.
        scale: One over the radius of the scene.
        radius: Radius of a sphere about the origin that holds the scene, in the tracer's units.
        power: The tracer's unit of power [W], a power of two.
    """

    origin: tuple[float, float, float]
    scale: float
    radius: float
    power: float = 1.0

    @classmethod
    def of(cls, *scenes: SceneAtShutter) -> Normalization:
        """The normalization that suits all of ``scenes``; the same ones always give the same."""
        meshes = [mesh for scene in scenes for mesh in scene.meshes]
        bounds = _bounds(meshes)
        size = 0.5 * float(np.linalg.norm(bounds[1] - bounds[0]))
        scale = 1.0 / size if size > 1e-150 else 1.0
        special = [mesh for mesh in meshes if mesh.specular]
        origin = 0.5 * np.sum(_bounds(special) if special else bounds, axis=0)
        reach = float(np.linalg.norm(np.abs(bounds - origin).max(axis=0)))
        strongest = max((_strength(light, scale) for scene in scenes for light in scene.lights), default=0.0)
        power = 2.0 ** math.floor(math.log2(strongest)) if strongest > 0.0 else 1.0
        return cls(tuple(map(float, origin)), scale, max(reach * scale, 0.5), power)

    def points(self, positions: np.ndarray) -> np.ndarray:
        """Positions [n, 3] float64 in scene units → float32 in the tracer's."""
        moved = positions - np.asarray(self.origin)
        moved *= self.scale
        return moved.astype(np.float32)

    def vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements [n, 3] in scene units → float32 in the tracer's."""
        return (vectors * self.scale).astype(np.float32)

    def world_points(self, positions: np.ndarray) -> np.ndarray:
        """Positions in the tracer's units → float64 in scene units."""
        return positions.astype(np.float64) / self.scale + np.asarray(self.origin)

    def world_vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Displacements in the tracer's units → float64 in scene units."""
        return vectors.astype(np.float64) / self.scale

    def light_power(self, light: LightAtShutter) -> np.ndarray:
        """Power of a light in the tracer's units, by channel: per square unit (distant) or per steradian (point).

        Raises:
            InputError: It is too much for the unit of power that the lights of the stills gave.
        """
        power = np.asarray(light.power) / self.power
        if light.kind == LightKind.DISTANT:
            power = power / self.scale**2
        if power.max() > BRIGHTEST:
            raise InputError(
                f"outshines the lights of the stills by more than {BRIGHTEST:g} (author a lower intensity)",
                prim=light.path,
            )
        return power


def _bounds(meshes: list[MeshAtShutter]) -> np.ndarray:
    """Lower and upper corner of what holds ``meshes``, shape [2, 3]; zero without any."""
    if not meshes:
        return np.zeros((2, 3))
    corners = np.concatenate([mesh.boxes for mesh in meshes])
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def _strength(light: LightAtShutter, scale: float) -> float:
    return max(light.power) / scale**2 if light.kind == LightKind.DISTANT else max(light.power)
