"""Lights that something specular passes through: a lamp half in the water, a tube through a pane.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpdwarp.scene.description import LightAtShutter, LightKind, SceneAtShutter
from tpdwarp.scene.light_places import place_lights

# Places on a light between which and its middle a surface is looked for. Chosen, not derived.
PLACES = 64


def cut_lights(scene: SceneAtShutter) -> list[LightAtShutter]:
    """The lights with extent of which some places lie beyond something specular, seen from their middle."""
    extended = [light for light in scene.lights if light.extent is not None and light.kind != LightKind.DISTANT]
    if not extended or not any(mesh.specular for mesh in scene.meshes):
        return []
    at_places = [place_lights(replace(scene, lights=tuple(extended)), number, PLACES) for number in range(PLACES)]
    places = np.array([[light.position for light in placed.lights] for placed in at_places])
    # Of many copies of a mesh, few lie where lights are.
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    specular = (mesh.points[mesh.triangles] for mesh in scene.objects() if mesh.specular)
    triangles = np.concatenate([corners[_meets(corners, low, high)] for corners in specular]).astype(np.float64)
    return [light for k, light in enumerate(extended) if _is_cut(light.position, places[:, k], triangles)]


def _meets(triangles: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Which of ``triangles`` [n, 3, 3] have a box that meets that from ``low`` to ``high``, shape [n]."""
    return (triangles.min(axis=1) <= high).all(axis=1) & (triangles.max(axis=1) >= low).all(axis=1)


def _is_cut(middle: np.ndarray, ends: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether any of ``triangles`` [n, 3, 3] stands between a point and others [m, 3] (Möller and Trumbore 1997)."""
    low, high = np.minimum(ends.min(axis=0), middle), np.maximum(ends.max(axis=0), middle)
    origin, second, third = triangles[_meets(triangles, low, high)].transpose(1, 0, 2)
    e1, e2 = second - origin, third - origin
    off = middle - origin
    across = np.cross(off, e1)
    for way in ends - middle:
        p = np.cross(way, e2)
        volume = np.einsum("ij,ij->i", e1, p)
        inverse = np.divide(1.0, volume, out=np.zeros_like(volume), where=volume != 0.0)
        u, v = inverse * np.einsum("ij,ij->i", off, p), inverse * (across @ way)
        along = inverse * np.einsum("ij,ij->i", across, e2)
        # A middle that lies in the surface has half of the light on either side of it.
        if ((volume != 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (along >= 0.0) & (along < 1.0)).any():
            return True
    return False
