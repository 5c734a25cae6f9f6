"""The scene on the device: one mesh BVH over all triangles at mid shutter, with their motion over the shutter."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter
from tpdwarp.scene.device.contact import separate_coincident
from tpdwarp.scene.nesting import nesting_of
from tpdwarp.scene.normalization import Normalization


@wp.struct
class Surfaces:
    """Triangles with everything a ray needs to know where it lands; positions in the tracer's units.

    ``time`` is where in the shutter (−½ … ½) ``points`` stand; normals are moved there on the fly. ``magnitude``
    is how large the coordinates of the scene are along each axis. Where solids are nested, ``medium_of`` has the medium
    of each object and ``medium_index`` the index of each medium (:mod:`tpdwarp.scene.nesting`); outside of the box from
    ``media_low`` to ``media_high`` there is none at any time of the shutter.
    """

    mesh: wp.uint64
    time: float
    magnitude: wp.vec3
    triangles: wp.array(dtype=wp.vec3i)
    points: wp.array(dtype=wp.vec3)
    motions: wp.array(dtype=wp.vec3)
    normals: wp.array(dtype=wp.vec3)
    normal_motions: wp.array(dtype=wp.vec3)
    normal_indices: wp.array(dtype=wp.vec3i)
    colors: wp.array(dtype=wp.vec3)
    color_indices: wp.array(dtype=wp.vec3i)
    material_of: wp.array(dtype=wp.int32)
    object_of: wp.array(dtype=wp.int32)
    interaction: wp.array(dtype=wp.int32)
    tint: wp.array(dtype=wp.vec3)
    ior: wp.array(dtype=wp.float32)
    medium_of: wp.array(dtype=wp.int32)
    medium_index: wp.array(dtype=wp.float32)
    media_low: wp.vec3
    media_high: wp.vec3


@dataclass
class Geometry:
    """Device-side scene over one shutter.

    Attributes:
        packed: All but the BVH, which may be fitted to another scene.
        mesh: The BVH, which scenes of one frame may share.
        moves: Whether any vertex moves over the shutter.
        paths: Prim path of each object, indexed by ``surfaces.object_of``.
        materials: The materials, indexed by ``surfaces.material_of``.
    """

    packed: Surfaces
    mesh: wp.Mesh
    moves: bool
    paths: tuple[str, ...]
    materials: tuple[Material, ...] = ()
    _moved: wp.Mesh | None = None

    @property
    def shared(self) -> bool:
        """Whether scenes beside it may use its BVH, which is then fitted to the one that is looked at."""
        return len(self.packed.triangles) >= SHARED_FROM

    @property
    def surfaces(self) -> Surfaces:
        """The kernel's view of it, good until a scene that shares the BVH is looked at."""
        _fit(self.mesh, self.packed.points)
        return self.packed

    def at(self, time: float, launcher: Launcher) -> Surfaces:
        """The same surfaces with their points moved to ``time`` in the shutter (−½ … ½).

        The BVH is refitted: what is returned is good until the next call.
        """
        if not self.moves:
            return replace_time(self.surfaces, time)
        of = self.packed
        if self._moved is None:
            # Built where the shutter is open half way, so that it does not matter which time is looked at first.
            self._moved = self.mesh if self.shared else _mesh(of.points, of.triangles.numpy(), launcher)
        surfaces = replace_time(of, time)
        points = of.points.numpy() + np.float32(time) * of.motions.numpy()
        surfaces.mesh, surfaces.points = self._moved.id, launcher.array(points, wp.vec3)
        _fit(self._moved, surfaces.points)
        return surfaces


def replace_time(surfaces: Surfaces, time: float) -> Surfaces:
    """A copy that stands at ``time``: normals, lights and the camera follow it, points are the caller's business."""
    copy = Surfaces()
    for name in Surfaces.vars:
        setattr(copy, name, getattr(surfaces, name))
    copy.time = time
    return copy


def _mesh(points: wp.array, triangles: np.ndarray, launcher: Launcher) -> wp.Mesh:
    return wp.Mesh(points=points, indices=wp.array(triangles.ravel(), dtype=wp.int32, device=launcher.device))


def _fit(mesh: wp.Mesh, points: wp.array) -> None:
    """Moves a BVH to ``points`` unless it stands there."""
    if mesh.points is not points:
        mesh.points = points


def _fitted(before: Geometry | None, points: wp.array, triangles: np.ndarray) -> wp.Mesh | None:
    """The BVH of another scene fitted to ``points``; None where that has other triangles."""
    if before is None or not np.array_equal(before.packed.triangles.numpy(), triangles):
        return None
    _fit(before.mesh, points)
    return before.mesh


def _stack(arrays: list[np.ndarray], width: int, dtype: type) -> np.ndarray:
    filled = [a for a in arrays if len(a)]
    if not filled:
        return np.zeros((0, width), dtype)
    return np.concatenate(filled).astype(dtype)


# Beyond the box of solids so far there is no medium, in the tracer's units: more than by what solids in contact are
# separated (tpdwarp.scene.device.contact), and than rounding.
MEDIA_MARGIN = 1e-4
# From so many triangles on the scenes of a frame share a BVH. Chosen, not derived: to build one for fewer takes less
# than 50 ms.
SHARED_FROM = 100_000
# A triangle without area, which no ray hits, for scenes that have none at all.
NOTHING = MeshAtShutter("", np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))


def geometry_of(
    scene: SceneAtShutter,
    normalization: Normalization,
    launcher: Launcher,
    *,
    with_motions: bool,
    instead_of: Geometry | None = None,
    beside: Geometry | None = None,
) -> Geometry:
    """Packs the meshes of ``scene`` into one geometry on the launcher's device.

    Args:
        with_motions: Whether kernels will read motions (also where only a light or the camera moves).
        instead_of: The same scene a little earlier, which is good no longer then: its BVH is refitted where it has the
            same triangles, which takes a tenth of the time that building one does.
        beside: The same scene at another time of the frame, which stays good: they share a BVH where it is large.
    """
    moves = with_motions
    points, motions, triangles = [], [], []
    normals, normal_motions, normal_indices = [], [], []
    colors, color_indices, material_of, object_of = [], [], [], []
    materials: dict[Material, int] = {}
    vertex_count = normal_count = color_count = object_count = 0
    boxes = []
    # A frame may show nothing at all; a tree of triangles wants at least one.
    for mesh in scene.meshes or (NOTHING,):
        copies = len(mesh.objects)
        points.append(normalization.points(mesh.points))
        boxes.append(_boxes(points[-1], copies))
        if moves:
            motions.append(_or_zeros(mesh.motions, mesh.points) * normalization.scale)
        triangles.append(mesh.triangles + vertex_count)
        vertex_count += len(mesh.points)
        normal_indices.append(_indices(mesh, mesh.normal_indices, normal_count))
        if mesh.normals is not None:
            normals.append(mesh.normals)
            if moves:
                normal_motions.append(_or_zeros(mesh.normal_motions, mesh.normals))
            normal_count += len(mesh.normals)
        color_indices.append(_indices(mesh, mesh.color_indices, color_count))
        if mesh.colors is not None:
            colors.append(mesh.colors)
            color_count += len(mesh.colors)
        slots = np.array([materials.setdefault(m, len(materials)) for m in mesh.materials], np.int32)
        chosen = mesh.triangle_materials
        material_of.append(slots[chosen] if chosen is not None else np.full(len(mesh.triangles), slots[0], np.int32))
        numbers = np.arange(object_count, object_count + copies, dtype=np.int32)
        object_of.append(np.repeat(numbers, len(mesh.triangles) // copies))
        object_count += copies

    corners, vertices = np.concatenate(triangles).astype(np.int32), np.concatenate(points)
    if instead_of is None and beside is not None and beside.shared:
        instead_of = beside
    device_points = launcher.array(vertices, wp.vec3)
    mesh = _fitted(instead_of, device_points, corners) or _mesh(device_points, corners, launcher)
    owners, materials_of = np.concatenate(object_of), np.concatenate(material_of)
    table = list(materials)
    diffuse = np.array([material.interaction == Interaction.DIFFUSE for material in table], np.int32)[materials_of]
    nesting = nesting_of(scene)
    media = np.full(object_count, -1, np.int32)
    if nesting is not None:
        media = np.repeat(nesting.media, [len(mesh.objects) for mesh in scene.meshes])
    separated = separate_coincident(mesh, corners, owners, diffuse, np.concatenate(boxes), media, launcher)
    if separated is not None:
        mesh.points.assign(separated)
        mesh.refit()
    surfaces = Surfaces()
    extent = np.abs(vertices).max(axis=0).astype(float)
    surfaces.magnitude = wp.vec3(*(extent + 1e-3 * extent.max()))
    surfaces.mesh, surfaces.time, surfaces.points = mesh.id, 0.0, mesh.points
    surfaces.triangles = launcher.array(corners, wp.vec3i)
    surfaces.motions = launcher.array(_stack(motions, 3, np.float32), wp.vec3)
    surfaces.normals = launcher.array(_stack(normals, 3, np.float32), wp.vec3)
    surfaces.normal_motions = launcher.array(_stack(normal_motions, 3, np.float32), wp.vec3)
    surfaces.normal_indices = launcher.array(np.concatenate(normal_indices), wp.vec3i)
    surfaces.colors = launcher.array(_stack(colors, 3, np.float32), wp.vec3)
    surfaces.color_indices = launcher.array(np.concatenate(color_indices), wp.vec3i)
    surfaces.material_of = launcher.array(materials_of, wp.int32)
    surfaces.object_of = launcher.array(owners, wp.int32)
    surfaces.interaction = launcher.array(np.array([int(m.interaction) for m in table], np.int32), wp.int32)
    surfaces.tint = launcher.array(np.array([m.color for m in table], np.float32), wp.vec3)
    surfaces.ior = launcher.array(np.array([m.ior for m in table], np.float32), wp.float32)
    surfaces.medium_of = launcher.array(media, wp.int32)
    indices = np.zeros(0) if nesting is None else nesting.indices
    surfaces.medium_index = launcher.array(indices.astype(np.float32), wp.float32)
    if nesting is not None:
        box = normalization.points(nesting.box)
        surfaces.media_low, surfaces.media_high = wp.vec3(*(box[0] - MEDIA_MARGIN)), wp.vec3(*(box[1] + MEDIA_MARGIN))
    paths = tuple(itertools.chain.from_iterable(mesh.objects for mesh in scene.meshes))
    return Geometry(surfaces, mesh, any(m.moves for m in scene.meshes), paths, tuple(table))


def _boxes(points: np.ndarray, copies: int) -> np.ndarray:
    """Least and greatest corner of each of several copies of a mesh, shape [copies, 2, 3]."""
    # Coordinate by coordinate, which is ten times as fast.
    by_coordinate = np.ascontiguousarray(points.reshape(copies, -1, 3).transpose(2, 0, 1))
    return np.stack([by_coordinate.min(axis=2), by_coordinate.max(axis=2)]).transpose(2, 0, 1)


def _or_zeros(values: np.ndarray | None, like: np.ndarray) -> np.ndarray:
    return np.zeros_like(like) if values is None else values


def _indices(mesh: MeshAtShutter, indices: np.ndarray | None, offset: int) -> np.ndarray:
    if indices is None:
        return np.full((len(mesh.triangles), 3), -1, np.int32)
    return np.where(indices >= 0, indices + offset, -1).astype(np.int32)
