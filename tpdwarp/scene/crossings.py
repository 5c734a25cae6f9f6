"""Specular surfaces that stand between two places."""

from __future__ import annotations

import numpy as np

from tpdwarp.scene.description import SceneAtShutter


def specular_triangles(scene: SceneAtShutter, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """What is specular near the box from ``low`` to ``high``, shape [n, 3, 3]: the triangles whose boxes meet it."""
    found = [np.zeros((0, 3, 3))]
    # Of many copies of a mesh, few lie where lights are.
    for mesh in scene.objects():
        if mesh.specular and len(mesh.points) and _meet(mesh.points[None], low, high)[0]:
            corners = mesh.points[mesh.triangles]
            found.append(corners[_meet(corners, low, high)])
    return np.concatenate(found).astype(np.float64)


def is_crossed(middle: np.ndarray, ends: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether any of ``triangles`` [n, 3, 3] stands between a point and others [m, 3] (Möller and Trumbore 1997)."""
    low, high = np.minimum(ends.min(axis=0), middle), np.maximum(ends.max(axis=0), middle)
    origin, second, third = triangles[_meet(triangles, low, high)].transpose(1, 0, 2)
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


def _meet(corners: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Which of several sets of points [n, k, 3] have a box that meets that from ``low`` to ``high``, shape [n]."""
    return (corners.min(axis=1) <= high).all(axis=1) & (corners.max(axis=1) >= low).all(axis=1)
