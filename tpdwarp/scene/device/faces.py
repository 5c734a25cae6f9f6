"""The faces of a scene on the device: what stays the same while points move, kept from one time to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter

# What faces are made of: arrays that are the same objects wherever a mesh is the same at another time.
_ARRAYS = ("triangles", "normal_indices", "colors", "color_indices", "triangle_materials")


@dataclass(frozen=True, eq=False)
class Faces:
    """Triangles, and what they refer to by number; of all meshes together, in their order.

    Attributes:
        triangles: Vertices of each, shape [t].
        normal_indices, color_indices: Normal and colour of each corner, −1 for none, shape [t].
        colors: Shape [c].
        material_of, object_of: Number of each one's material and object, shape [t].
        materials: The materials.
        object_count: How many objects there are, copies counted each.
        ends: Where the vertices and the triangles of each mesh end, shape [m, 2].
    """

    triangles: wp.array
    normal_indices: wp.array
    colors: wp.array
    color_indices: wp.array
    material_of: wp.array
    object_of: wp.array
    materials: tuple[Material, ...]
    object_count: int
    ends: np.ndarray
    _made_of: tuple[MeshAtShutter, ...]

    def of(self, meshes: Sequence[MeshAtShutter]) -> bool:
        """Whether these are the faces of ``meshes``, as far as can be told without looking at each."""
        return len(meshes) == len(self._made_of) and all(map(_alike, meshes, self._made_of))

    @cached_property
    def diffuse(self) -> np.ndarray:
        """1 for diffuse triangles, 0 for specular ones, shape [t] int32."""
        by_material = [material.interaction == Interaction.DIFFUSE for material in self.materials]
        return np.array(by_material, np.int32)[self.material_of.numpy()]

    @cached_property
    def by_object(self) -> tuple[np.ndarray, np.ndarray]:
        """How many triangles each object has, shape [o], and whether any of them is specular."""
        objects = self.object_of.numpy()
        counts = np.bincount(objects, minlength=self.object_count)
        return counts, np.bincount(objects[self.diffuse == 0], minlength=self.object_count) > 0


def faces_of(meshes: Sequence[MeshAtShutter], launcher: Launcher) -> Faces:
    """Packs the faces of ``meshes`` onto the launcher's device."""
    total = sum(len(mesh.triangles) for mesh in meshes)
    # Written in place: what is joined from parts is there twice, and the system clears the pages of both.
    triangles, normal_indices, color_indices = (np.empty((total, 3), np.int32) for _ in range(3))
    material_of, object_of = (np.empty(total, np.int32) for _ in range(2))
    colors: list[np.ndarray] = []
    materials: dict[Material, int] = {}
    begin = vertex_count = normal_count = color_count = object_count = 0
    for mesh in meshes:
        copies, count = len(mesh.objects), len(mesh.triangles)
        own = slice(begin, begin + count)
        begin += count
        np.add(mesh.triangles, np.int32(vertex_count), out=triangles[own], casting="same_kind")
        vertex_count += len(mesh.points)
        _move(mesh.normal_indices, normal_count, normal_indices[own])
        normal_count += 0 if mesh.normals is None else len(mesh.normals)
        _move(mesh.color_indices, color_count, color_indices[own])
        if mesh.colors is not None:
            colors.append(mesh.colors)
            color_count += len(mesh.colors)
        slots = np.array([materials.setdefault(m, len(materials)) for m in mesh.materials], np.int32)
        chosen = mesh.triangle_materials
        material_of[own] = slots[0] if chosen is None else slots[chosen]
        if copies:
            numbers = np.arange(object_count, object_count + copies, dtype=np.int32)
            object_of[own].reshape(copies, -1)[:] = numbers[:, None]
        object_count += copies
    return Faces(
        launcher.array(triangles, wp.vec3i),
        launcher.array(normal_indices, wp.vec3i),
        launcher.array(stacked(colors, 3), wp.vec3),
        launcher.array(color_indices, wp.vec3i),
        launcher.array(material_of, wp.int32),
        launcher.array(object_of, wp.int32),
        tuple(materials),
        object_count,
        np.cumsum([(len(mesh.points), len(mesh.triangles)) for mesh in meshes], axis=0),
        tuple(meshes),
    )


def stacked(arrays: list[np.ndarray], width: int) -> np.ndarray:
    """The rows of all arrays, shape [n, width] float32."""
    filled = [a for a in arrays if len(a)]
    if not filled:
        return np.zeros((0, width), np.float32)
    return np.concatenate(filled, dtype=np.float32, casting="same_kind")


def placed(arrays: Sequence[np.ndarray | None], counts: Sequence[int], scale: float) -> np.ndarray:
    """The rows of arrays [count, 3] one behind another, times ``scale``; zeros for None, shape [n, 3] float32.

    Zeros that nobody writes cost no memory: the system gives pages to what is written.
    """
    out = np.zeros((sum(counts), 3), np.float32)
    begin = 0
    for array, count in zip(arrays, counts, strict=True):
        if array is not None:
            np.multiply(array, scale, out=out[begin : begin + count], casting="same_kind")
        begin += count
    return out


def _alike(mesh: MeshAtShutter, other: MeshAtShutter) -> bool:
    if mesh is other:
        return True
    if len(mesh.points) != len(other.points) or len(mesh.objects) != len(other.objects):
        return False
    if (0 if mesh.normals is None else len(mesh.normals)) != (0 if other.normals is None else len(other.normals)):
        return False
    same = all(getattr(mesh, name) is getattr(other, name) for name in _ARRAYS)
    return same and mesh.materials == other.materials


def _move(indices: np.ndarray | None, offset: int, out: np.ndarray) -> None:
    """Writes indices of corners [count, 3] that begin at ``offset``; −1 for none stays, and is all without them."""
    if indices is None:
        out[:] = -1
        return
    np.add(indices, np.int32(offset), out=out, casting="same_kind")
    if len(indices) and np.min(indices) < 0:
        out[np.asarray(indices) < 0] = -1
