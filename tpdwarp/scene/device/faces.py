"""The faces of a scene on the device: what stays the same while points move, kept from one time to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """

    triangles: wp.array
    normal_indices: wp.array
    colors: wp.array
    color_indices: wp.array
    material_of: wp.array
    object_of: wp.array
    materials: tuple[Material, ...]
    object_count: int
    _made_of: tuple[MeshAtShutter, ...]

    def of(self, meshes: Sequence[MeshAtShutter]) -> bool:
        """Whether these are the faces of ``meshes``, as far as can be told without looking at each."""
        return len(meshes) == len(self._made_of) and all(map(_alike, meshes, self._made_of))

    @property
    def diffuse(self) -> np.ndarray:
        """1 for diffuse triangles, 0 for specular ones, shape [t] int32."""
        by_material = [material.interaction == Interaction.DIFFUSE for material in self.materials]
        return np.array(by_material, np.int32)[self.material_of.numpy()]


def faces_of(meshes: Sequence[MeshAtShutter], launcher: Launcher) -> Faces:
    """Packs the faces of ``meshes`` onto the launcher's device."""
    triangles, normal_indices, colors, color_indices, material_of, object_of = [], [], [], [], [], []
    materials: dict[Material, int] = {}
    vertex_count = normal_count = color_count = object_count = 0
    for mesh in meshes:
        copies, count = len(mesh.objects), len(mesh.triangles)
        triangles.append(mesh.triangles + np.int32(vertex_count))
        vertex_count += len(mesh.points)
        normal_indices.append(_moved(mesh.normal_indices, normal_count, count))
        normal_count += 0 if mesh.normals is None else len(mesh.normals)
        color_indices.append(_moved(mesh.color_indices, color_count, count))
        if mesh.colors is not None:
            colors.append(mesh.colors)
            color_count += len(mesh.colors)
        slots = np.array([materials.setdefault(m, len(materials)) for m in mesh.materials], np.int32)
        chosen = mesh.triangle_materials
        material_of.append(slots[chosen] if chosen is not None else np.full(count, slots[0], np.int32))
        numbers = np.arange(object_count, object_count + copies, dtype=np.int32)
        object_of.append(np.repeat(numbers, count // copies))
        object_count += copies
    return Faces(
        launcher.array(_joined(triangles), wp.vec3i),
        launcher.array(_joined(normal_indices), wp.vec3i),
        launcher.array(stacked(colors, 3), wp.vec3),
        launcher.array(_joined(color_indices), wp.vec3i),
        launcher.array(_joined(material_of), wp.int32),
        launcher.array(_joined(object_of), wp.int32),
        tuple(materials),
        object_count,
        tuple(meshes),
    )


def stacked(arrays: list[np.ndarray], width: int) -> np.ndarray:
    """The rows of all arrays, shape [n, width] float32."""
    filled = [a for a in arrays if len(a)]
    return np.concatenate(filled).astype(np.float32, copy=False) if filled else np.zeros((0, width), np.float32)


def _alike(mesh: MeshAtShutter, other: MeshAtShutter) -> bool:
    if mesh is other:
        return True
    if len(mesh.points) != len(other.points) or len(mesh.objects) != len(other.objects):
        return False
    if (0 if mesh.normals is None else len(mesh.normals)) != (0 if other.normals is None else len(other.normals)):
        return False
    same = all(getattr(mesh, name) is getattr(other, name) for name in _ARRAYS)
    return same and mesh.materials == other.materials


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(arrays).astype(np.int32, copy=False)


def _moved(indices: np.ndarray | None, offset: int, count: int) -> np.ndarray:
    """Indices of corners [count, 3] that begin at ``offset``; −1 for none stays, and is all there is without them."""
    if indices is None:
        return np.full((count, 3), -1, np.int32)
    return np.where(indices >= 0, indices + np.int32(offset), np.int32(-1)).astype(np.int32, copy=False)
