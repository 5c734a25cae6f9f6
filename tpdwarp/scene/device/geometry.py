"""The scene on the device: one mesh BVH over all triangles at mid shutter, with their motion over the shutter."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import Material, MeshAtShutter, SceneAtShutter
from tpdwarp.scene.device.contact import separate_coincident
from tpdwarp.scene.device.faces import Faces, faces_of, placed, stacked
from tpdwarp.scene.device.ray_tree import RayTree
from tpdwarp.scene.device.wide_tree import WideTree
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

    tree: RayTree
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
        trees: The BVH, which scenes of one frame may share.
        moves: Whether any vertex moves over the shutter.
        paths: Prim path of each object, indexed by ``surfaces.object_of``.
        faces: Its faces, which scenes of one frame may share too.
        meshes: What it is made of.
        vertices: Their points before those in contact were separated, in the tracer's units, shape [n, 3].
    """

    packed: Surfaces
    trees: WideTree
    moves: bool
    paths: tuple[str, ...]
    faces: Faces
    meshes: tuple[MeshAtShutter, ...]
    vertices: np.ndarray
    _moved: WideTree | None = None
    _there: wp.array | None = None
    _moving: tuple[int, ...] = ()

    @property
    def materials(self) -> tuple[Material, ...]:
        """The materials, indexed by ``surfaces.material_of``."""
        return self.faces.materials

    @property
    def shared(self) -> bool:
        """Whether scenes beside it may use its BVH, which is then fitted to the one that is looked at."""
        return len(self.packed.triangles) >= SHARED_FROM

    @property
    def surfaces(self) -> Surfaces:
        """The kernel's view of it, good until a scene that shares the BVH is looked at."""
        _fit(self.trees, self.packed.points)
        return self.packed

    def at(self, time: float, launcher: Launcher) -> Surfaces:
        """The same surfaces with their points moved to ``time`` in the shutter (−½ … ½).

        The BVH is refitted where something moves: what is returned is good until the next call.
        """
        if not self.moves:
            return replace_time(self.surfaces, time)
        of = self.packed
        if self._moved is None:
            # Built where the shutter is open half way, so that it does not matter which time is looked at first.
            self._moved = self.trees if self.shared else self.trees.beside(of.points)
            self._moved = self._moved or _trees(of.points, self.faces, launcher)
        surfaces = replace_time(of, time)
        if self._there is None:
            self._there = launcher.array(of.points.numpy().copy(), wp.vec3)
        points, motions, there = (array.numpy() for array in (of.points, of.motions, self._there))
        ends = self.faces.ends[:, 0]
        for part in self._moving:
            own = slice(ends[part - 1] if part else 0, ends[part])
            np.multiply(motions[own], np.float32(time), out=there[own])
            there[own] += points[own]
        if launcher.device.is_cuda:
            self._there.assign(there)
        self._moved.move(self._there, self._moving if self._moved.points is self._there else None)
        _stand(surfaces, self._moved)
        return surfaces

    def mesh_at(self, time: float, launcher: Launcher) -> tuple[Surfaces, wp.Mesh]:
        """The surfaces of :meth:`at`, and Warp's mesh of them, whose own tree stands there too."""
        surfaces = self.at(time, launcher)
        return surfaces, (self._moved or self.trees).mesh


def replace_time(surfaces: Surfaces, time: float) -> Surfaces:
    """A copy that stands at ``time``: normals, lights and the camera follow it, points are the caller's business."""
    copy = Surfaces()
    for name in Surfaces.vars:
        setattr(copy, name, getattr(surfaces, name))
    copy.time = time
    return copy


def _stand(surfaces: Surfaces, trees: WideTree) -> None:
    """Has the surfaces stand where the trees do."""
    surfaces.tree, surfaces.points = trees.tree, trees.points


def _trees(points: wp.array, faces: Faces, launcher: Launcher) -> WideTree:
    corners = faces.triangles.numpy().ravel()
    mesh = wp.Mesh(points=points, indices=wp.array(corners, dtype=wp.int32, device=launcher.device))
    return WideTree(mesh, launcher, faces.ends)


def _fit(trees: WideTree, points: wp.array) -> None:
    """Moves a BVH to ``points`` unless it stands there."""
    if trees.points is not points:
        trees.move(points)


def _has(known: Geometry, faces: Faces) -> bool:
    """Whether a scene has triangles of the same vertices as ``faces``."""
    if faces is known.faces:
        return True
    theirs = known.faces
    return np.array_equal(theirs.ends, faces.ends) and np.array_equal(theirs.triangles.numpy(), faces.triangles.numpy())


def _fitted(trees: WideTree, points: wp.array) -> WideTree:
    """A BVH that has moved to ``points``."""
    _fit(trees, points)
    return trees


def _not_grown(trees: WideTree | None) -> WideTree | None:
    """A BVH unless rays would enter far more of its boxes than as it was built."""
    return trees if trees is not None and trees.grown <= MOST_GROWN else None


# Beyond the box of solids so far there is no medium, in the tracer's units: more than by what solids in contact are
# separated (tpdwarp.scene.device.contact), and than rounding.
MEDIA_MARGIN = 1e-4
# A BVH is built anew where boxes have grown to more than so many times what they were, for rays then enter as many more
# of them. Chosen, not derived.
MOST_GROWN = 1.2
# From so many triangles on the scenes of a frame share a BVH; of fewer each has boxes of its own. Chosen, not derived.
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
    like: Faces | None = None,
    trees: WideTree | None = None,
) -> Geometry:
    """Packs the meshes of ``scene`` into one geometry on the launcher's device.

    Args:
        with_motions: Whether kernels will read motions (also where only a light or the camera moves).
        instead_of: The same scene a little earlier, which is good no longer then: its BVH is refitted where it has the
            same triangles, which takes a tenth of the time that building one does.
        beside: The same scene at another time of the frame, which stays good: they share a BVH where it is large.
        like: Faces that are taken, as those of scenes beside it are, where its meshes have the same.
        trees: The BVH of scenes with these faces, which are looked at no longer, or share it.
    """
    # A frame may show nothing at all; a tree of triangles wants at least one.
    meshes = scene.meshes or (NOTHING,)
    known = beside if instead_of is None else instead_of
    same = (faces for faces in (known and known.faces, like) if faces is not None and faces.of(meshes))
    faces = next(same, None) or faces_of(meshes, launcher)
    vertices = _vertices(meshes, normalization, known)
    # Rounding keeps the order of numbers, so that these are the boxes of what is rounded.
    boxes = normalization.points(np.concatenate([mesh.boxes for mesh in meshes]).reshape(-1, 3)).reshape(-1, 2, 3)
    extent = np.abs(boxes).max(axis=(0, 1)).astype(float)
    device_points = launcher.array(vertices, wp.vec3)
    fitted = None
    if known is not None and _has(known, faces):
        moves_on = instead_of is not None or known.shared
        fitted = _fitted(known.trees, device_points) if moves_on else _not_grown(known.trees.beside(device_points))
    if fitted is None and trees is not None and faces is like:
        large = len(faces.triangles) >= SHARED_FROM
        fitted = _not_grown(_fitted(trees, device_points) if large else trees.beside(device_points))
    trees = fitted or _trees(device_points, faces, launcher)
    nesting = nesting_of(scene)
    media = np.full(faces.object_count, -1, np.int32)
    if nesting is not None:
        media = np.repeat(nesting.media, [len(mesh.objects) for mesh in scene.meshes])
    separated = separate_coincident(trees, faces, boxes, media, launcher)
    if separated is not None:
        trees.move(launcher.array(separated, wp.vec3))
    surfaces = Surfaces()
    surfaces.magnitude = wp.vec3(*(extent + 1e-3 * extent.max()))
    _stand(surfaces, trees)
    surfaces.time = 0.0
    for name in ("triangles", "normal_indices", "colors", "color_indices", "material_of", "object_of"):
        setattr(surfaces, name, getattr(faces, name))
    shaded = [mesh for mesh in meshes if mesh.normals is not None]
    moving, turning = (meshes, shaded) if with_motions else ((), ())
    motions = placed([m.motions for m in moving], [len(m.points) for m in moving], normalization.scale)
    turns = placed([m.normal_motions for m in turning], [len(m.normals) for m in turning], 1.0)
    surfaces.motions = launcher.array(motions, wp.vec3)
    surfaces.normals = launcher.array(stacked([mesh.normals for mesh in shaded], 3), wp.vec3)
    surfaces.normal_motions = launcher.array(turns, wp.vec3)
    table = faces.materials
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
    parts = tuple(number for number, mesh in enumerate(moving) if mesh.moves)
    moves = any(m.moves for m in scene.meshes)
    return Geometry(surfaces, trees, moves, paths, faces, tuple(meshes), vertices, _moving=parts)


def _vertices(meshes: Sequence[MeshAtShutter], normalization: Normalization, known: Geometry | None) -> np.ndarray:
    """The points of all meshes in the tracer's units, shape [n, 3] float32; those that ``known`` has are copied."""
    ends = np.cumsum([len(mesh.points) for mesh in meshes])
    vertices = np.empty((ends[-1], 3), np.float32)
    there: dict[int, int] = {}
    if known is not None:
        there = dict(zip(map(id, known.meshes), (0, *known.faces.ends[:-1, 0]), strict=True))
    for end, mesh in zip(ends, meshes, strict=True):
        own, at = slice(end - len(mesh.points), end), there.get(id(mesh))
        if known is None or at is None:
            vertices[own] = normalization.points(mesh.points)
        else:
            vertices[own] = known.vertices[at : at + len(mesh.points)]
    return vertices
