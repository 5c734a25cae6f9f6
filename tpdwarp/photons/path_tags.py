"""Path tags: numbers of triangles that tell paths of light through a scene apart, by the surfaces that they meet.

Light that goes through the same bodies and facets in the same order changes smoothly over the light and in time. Two
triangles have one tag where they belong to one smooth surface, or to one plane facet of it, of one mesh.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary
from zlib import crc32

import numpy as np

from tpdwarp.photons.lattice_shape import specular_faces
from tpdwarp.photons.row_numbers import row_numbers
from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter

# Facets that fewer photons than this fall on have hardly any that is not at their border: of 8 × 8 cells, 28 are.
FEWEST_PHOTONS_ON_FACET = 64
# Facets are one where their normals, and their distances from the middle as parts of the mesh, differ by less. Chosen,
# not derived: far more than rounding, far less than what turns light by a pixel.
SAME_PLANE = 1e-3
# Corners of a plane facet have one normal up to rounding; on the crest of a wave they differ by its curvature.
SAME_NORMAL = 1e-6
# A diffuse mesh of more planes than this is round, and light goes on over its edges as it does over those of a smooth
# one; over a box's it ends. Chosen, not derived.
MOST_PLANES_OF_RECEIVER = 32
# Larger ones are taken for round unseen, for that takes time. Chosen.
MOST_TRIANGLES_OF_RECEIVER = 1 << 14


class PathTags:
    """Tags of the triangles of an animation over one shutter, made for each mesh: so they stay as bodies come and go.

    Args:
        scene: The scene that shows which facets there are.
        photons: Photons that fall on it.
    """

    def __init__(self, scene: SceneAtShutter, photons: int) -> None:
        least = min(1.0, FEWEST_PHOTONS_ON_FACET / photons)
        # Of a surface that is written twice, rays meet now the one, now the other.
        first: dict[tuple[int, int], str] = {}
        single = [mesh for mesh in scene.meshes if not mesh.copies]
        self._names = {mesh.path: first.setdefault(_shape_of(mesh), mesh.path) for mesh in single}
        self._facets = {mesh.path: facets_of(mesh, least) for mesh in scene.meshes}
        self._known: WeakKeyDictionary[MeshAtShutter, np.ndarray] = WeakKeyDictionary()

    def of(self, scene: SceneAtShutter) -> np.ndarray:
        """A tag for each triangle of ``scene``, in the order of its meshes, shape [m] int32."""
        tags = [self._tags(mesh) for mesh in scene.meshes]
        return np.concatenate(tags) if tags else np.zeros(0, np.int32)

    def _tags(self, mesh: MeshAtShutter) -> np.ndarray:
        # What does not move is the same object at all times.
        if mesh not in self._known:
            self._known[mesh] = self._tags_of(mesh)
        return self._known[mesh]

    def _tags_of(self, mesh: MeshAtShutter) -> np.ndarray:
        count = len(mesh.triangles)
        facets = self._facets.get(mesh.path)
        if facets is None or len(facets) != count:
            facets = np.zeros(count, np.int32)
        names = mesh.copies or (self._names.get(mesh.path, mesh.path),)
        return np.repeat(_hashes_of(names), count // len(names)) ^ facets


# A scene is loaded for several times of a shutter, with the same names each time.
@lru_cache(maxsize=1024)
def _hashes_of(names: tuple[str, ...]) -> np.ndarray:
    """A number for each name, whose last eight bits are zero, shape [n] int32."""
    hashes = np.fromiter((crc32(name.encode()) for name in names), np.uint32, len(names))
    return (hashes & np.uint32(0x7FFFFF00)).astype(np.int32)


def _shape_of(mesh: MeshAtShutter) -> tuple[int, int]:
    return crc32(np.ascontiguousarray(mesh.points)), crc32(np.ascontiguousarray(mesh.triangles))


class _Planes(NamedTuple):
    """Triangles of a mesh that are flat, the number of the plane that each of them lies in, and the parts of the mesh
    that lie in each."""

    rows: np.ndarray
    numbers: np.ndarray
    parts: np.ndarray


# What does not move is the same object from shutter to shutter.
_PLANES: WeakKeyDictionary[MeshAtShutter, _Planes | None] = WeakKeyDictionary()


def facets_of(mesh: MeshAtShutter, least: float) -> np.ndarray:
    """Numbers, from 1 on, of plane facets that make up more than the part ``least`` of ``mesh``; else 0; [m] int32."""
    facets = np.zeros(len(mesh.triangles), np.int32)
    if mesh not in _PLANES:
        _PLANES[mesh] = _planes_of(mesh)
    planes = _PLANES[mesh]
    if planes is not None:
        large = np.flatnonzero(planes.parts > least)
        names = np.zeros(len(planes.parts), np.int32)
        names[large] = 1 + np.arange(len(large), dtype=np.int32)
        facets[planes.rows] = names[planes.numbers]
    return facets


def _planes_of(mesh: MeshAtShutter) -> _Planes | None:
    """The planes that matter in ``mesh``; None where none does."""
    if not mesh.specular and len(mesh.triangles) > MOST_TRIANGLES_OF_RECEIVER:
        return None
    flat = np.flatnonzero((specular_faces(mesh) if mesh.specular else True) & _is_flat(mesh))
    if not len(flat):
        return None
    a, b, c = (mesh.points[mesh.triangles[flat, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, np.finfo(float).tiny)[:, None]
    centre = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    size = max(float(np.ptp(mesh.points, axis=0).max()), np.finfo(float).tiny)
    planes = np.column_stack([normals, np.einsum("ij,ij->i", (a + b + c) / 3.0 - centre, normals) / size])
    numbers = _clusters(planes)
    if not mesh.specular and numbers.max() >= MOST_PLANES_OF_RECEIVER:
        return None
    parts = np.bincount(numbers, weights=areas) / max(float(_areas(mesh).sum()), np.finfo(float).tiny)
    return _Planes(flat, numbers, parts)


def _is_flat(mesh: MeshAtShutter) -> np.ndarray:
    """Which triangles have one normal all over, shape [m]."""
    if mesh.normals is None:
        return np.ones(len(mesh.triangles), bool)
    indices = mesh.normal_indices
    same = np.all(indices == indices[:, :1], axis=1)
    others = np.flatnonzero(~same)
    corners = mesh.normals[indices[others]]
    same[others] = np.abs(corners - corners[:, :1]).max(axis=(1, 2)) < SAME_NORMAL
    return same | np.any(indices < 0, axis=1)


def _areas(mesh: MeshAtShutter) -> np.ndarray:
    a, b, c = (mesh.points[mesh.triangles[:, corner]] for corner in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _clusters(rows: np.ndarray) -> np.ndarray:
    """Numbers of groups of ``rows`` [n, k] that are the same up to ``SAME_PLANE``, shape [n]."""
    # Whole numbers of steps, which planes along the axes lie on, are not where rounding cuts.
    keys = np.floor(rows / SAME_PLANE + 1.0 / math.pi).astype(np.int64)
    return row_numbers(*keys.T)
