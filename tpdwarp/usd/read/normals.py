"""Normals of triangles: of faces, smooth over vertices, and authored ones carried into the world."""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.vectors import cross, lengths
from tpdwarp.usd.read.topology import Topology


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors [n, 3] scaled to length one; zero vectors become (0, 0, 1), for want of any direction."""
    sizes = lengths(vectors)[:, None]
    # Not greater: what is no number stays none.
    if not (some := ~(sizes > 0)).any():
        return vectors / sizes
    return np.where(some, [0.0, 0.0, 1.0], vectors / np.where(some, 1.0, sizes))


def area_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the vector area of each triangle, pointing to its front, shape [m, 3]."""
    a, b, c = (points.take(triangles[:, k], axis=0) for k in range(3))
    (u_x, u_y, u_z), (v_x, v_y, v_z) = (b - a).T, (c - a).T
    return np.stack([u_y * v_z - u_z * v_y, u_z * v_x - u_x * v_z, u_x * v_y - u_y * v_x], axis=1)


def smooth_normals(points: np.ndarray, topology: Topology) -> np.ndarray:
    """Unit vertex normals weighted by the area of the faces around each point, shape [v, 3].

    A face counts with its whole vector area at each of its corners, so that the diagonals of its fan do not matter.
    """
    areas = area_vectors(points, topology.triangles)
    face_areas = np.stack(
        [np.bincount(topology.faces, weights=areas[:, k], minlength=topology.face_count) for k in range(3)], axis=1
    )
    vertices, faces = topology.face_corners
    spread = face_areas[faces]
    summed = np.stack([np.bincount(vertices, weights=spread[:, k], minlength=len(points)) for k in range(3)], axis=1)
    return unit(summed)


def transform_normals(normals: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Unit normals [k, 3] carried by row-vector matrices [n, 4, 4], those of one after those of the other, [n k, 3].

    They are multiplied by the inverse transpose, and what was in front stays there. The cofactors stand in for the
    inverse, so that a matrix which flattens things still has normals.
    """
    cofactors = cross(matrices[:, [1, 2, 0], :3], matrices[:, [2, 0, 1], :3])
    mirrored = np.einsum("nk,nk->n", matrices[:, 0, :3], cofactors[:, 0]) < 0
    cofactors[mirrored] *= -1.0
    return unit((normals @ cofactors).reshape(-1, 3))
