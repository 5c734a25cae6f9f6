"""First hits on triangles in double precision; a float32 tree over padded boxes names the candidates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from .description import Mesh, between

# Float32 boxes and rays err by some 2⁻²³ of the coordinates (3e-6 for coordinates below 24); padded by several of it.
PADDING = 2.0e-6
# Rounding of barycentric coordinates in double precision: an edge belongs to both of its triangles.
SLACK = wp.constant(wp.float64(1.0e-12))
# A zero component of a direction would make 0 · ∞ in the test against boxes.
SMALLEST = wp.constant(1.0e-18)
# Measured on a ball of 9 000 triangles: 1, 2 and 4 trace equally fast within a tenth.
LEAF_SIZE = 2


@wp.struct
class Surfaces:
    """All triangles over a part of the shutter.

    ``bvh`` is the tree over the boxes in which they move; ``points`` [v] and ``normals`` [v] at the opening of the
    shutter, ``motions`` and ``turns`` their change until it closes; ``triangles`` [m], ``mesh_of`` [m]; per mesh its
    ``interaction``, ``ior``, ``tint``, and ``smooth``, which is 1 where it has normals.
    """

    bvh: wp.uint64
    points: wp.array(dtype=wp.vec3d)
    motions: wp.array(dtype=wp.vec3d)
    normals: wp.array(dtype=wp.vec3d)
    turns: wp.array(dtype=wp.vec3d)
    triangles: wp.array(dtype=wp.vec3i)
    mesh_of: wp.array(dtype=wp.int32)
    smooth: wp.array(dtype=wp.int32)
    interaction: wp.array(dtype=wp.int32)
    ior: wp.array(dtype=wp.float64)
    tint: wp.array(dtype=wp.float64)


@wp.struct
class Hit:
    """Triangle (−1 for none), distance along the ray, barycentric coordinates of the second and third corner."""

    triangle: wp.int32
    distance: wp.float64
    b1: wp.float64
    b2: wp.float64


@wp.func
def nonzero(component: wp.float64) -> wp.float32:
    """A component of a direction as float32 whose inverse is finite."""
    value = wp.float32(component)
    if wp.abs(value) < SMALLEST:
        value = SMALLEST
    return value


@wp.func
def vertex(surfaces: Surfaces, index: wp.int32, s: wp.float64) -> wp.vec3d:
    """Where a vertex is at the part ``s`` in 0 ... 1 of the shutter."""
    return surfaces.points[index] + s * surfaces.motions[index]


@wp.func
def vertex_normal(surfaces: Surfaces, index: wp.int32, s: wp.float64) -> wp.vec3d:
    """The unit normal of a vertex at the part ``s`` in 0 ... 1 of the shutter."""
    return wp.normalize(surfaces.normals[index] + s * surfaces.turns[index])


@wp.func
def first_hit(surfaces: Surfaces, x: wp.vec3d, w: wp.vec3d, s: wp.float64, left: wp.int32, limit: wp.float64) -> Hit:
    """The nearest triangle along x + λw for 0 < λ < ``limit``, but for triangle ``left`` (Möller and Trumbore)."""
    hit = Hit()
    hit.triangle = -1
    hit.distance = limit
    reach = wp.float32(limit)
    query = wp.bvh_query_ray(
        surfaces.bvh,
        wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2])),
        wp.vec3(nonzero(w[0]), nonzero(w[1]), nonzero(w[2])),
    )
    candidate = wp.int32(0)
    while wp.bvh_query_next(query, candidate, reach):
        if candidate != left:
            corner = surfaces.triangles[candidate]
            a = vertex(surfaces, corner[0], s)
            e1 = vertex(surfaces, corner[1], s) - a
            e2 = vertex(surfaces, corner[2], s) - a
            p = wp.cross(w, e2)
            determinant = wp.dot(e1, p)
            if determinant != wp.float64(0.0):
                inverse = wp.float64(1.0) / determinant
                offset = x - a
                b1 = wp.dot(offset, p) * inverse
                if b1 >= -SLACK and b1 <= wp.float64(1.0) + SLACK:
                    q = wp.cross(offset, e1)
                    b2 = wp.dot(w, q) * inverse
                    if b2 >= -SLACK and b1 + b2 <= wp.float64(1.0) + SLACK:
                        distance = wp.dot(e2, q) * inverse
                        if distance > wp.float64(0.0) and distance < hit.distance:
                            hit.triangle = candidate
                            hit.distance = distance
                            hit.b1 = b1
                            hit.b2 = b2
                            # A box is left out only where it surely lies behind: one part in 10⁵ and the padding.
                            reach = wp.float32(distance) * 1.00001 + 1.0e-5
    return hit


@wp.func
def geometric_normal(surfaces: Surfaces, triangle: wp.int32, s: wp.float64) -> wp.vec3d:
    """Unit normal of a triangle, to its front."""
    corner = surfaces.triangles[triangle]
    a = vertex(surfaces, corner[0], s)
    return wp.normalize(wp.cross(vertex(surfaces, corner[1], s) - a, vertex(surfaces, corner[2], s) - a))


@wp.func
def shading_normal(surfaces: Surfaces, hit: Hit, s: wp.float64, geometric: wp.vec3d) -> wp.vec3d:
    """The interpolated unit normal at a hit; the geometric one where there are none."""
    if surfaces.smooth[surfaces.mesh_of[hit.triangle]] == 0:
        return geometric
    corner = surfaces.triangles[hit.triangle]
    b0 = wp.float64(1.0) - hit.b1 - hit.b2
    return wp.normalize(
        b0 * vertex_normal(surfaces, corner[0], s)
        + hit.b1 * vertex_normal(surfaces, corner[1], s)
        + hit.b2 * vertex_normal(surfaces, corner[2], s)
    )


class Geometry:
    """The triangles of a scene over one part of the shutter after another; each thread has its own.

    Args:
        meshes: What there is; triangles are numbered through in their order.
    """

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        first_points = np.cumsum([0, *(len(mesh.points[0]) for mesh in meshes)])
        counts = [len(mesh.triangles) for mesh in meshes]
        self._points = [np.concatenate([mesh.points[end] for mesh in meshes]).astype(np.float64) for end in range(2)]
        normals = [
            np.concatenate(
                [np.zeros_like(mesh.points[0]) if mesh.normals is None else mesh.normals[end] for mesh in meshes]
            ).astype(np.float64)
            for end in range(2)
        ]
        self._triangles = np.concatenate(
            [mesh.triangles + first for mesh, first in zip(meshes, first_points, strict=False)]
        ).astype(np.int32)
        self._padding = PADDING * max(1.0, *(float(np.abs(points).max()) for points in self._points))
        self._boxes = [np.zeros((len(self._triangles), 3), np.float32) for _ in range(2)]
        self._bound(0.0, 1.0)
        # Warp shares the memory of these arrays, so that boxes are moved without copies.
        self._tree = wp.Bvh(*(_shared(box, wp.vec3) for box in self._boxes), leaf_size=LEAF_SIZE)
        self.surfaces = Surfaces()
        self.surfaces.bvh = self._tree.id
        self.surfaces.points = _shared(self._points[0], wp.vec3d)
        self.surfaces.motions = _shared(self._points[1] - self._points[0], wp.vec3d)
        self.surfaces.normals = _shared(normals[0], wp.vec3d)
        self.surfaces.turns = _shared(normals[1] - normals[0], wp.vec3d)
        self.surfaces.triangles = _shared(self._triangles, wp.vec3i)
        self.surfaces.mesh_of = _shared(np.repeat(np.arange(len(meshes), dtype=np.int32), counts), wp.int32)
        self.surfaces.smooth = _shared(np.array([m.normals is not None for m in meshes], np.int32), wp.int32)
        self.surfaces.interaction = _shared(np.array([m.interaction for m in meshes], np.int32), wp.int32)
        self.surfaces.ior = _shared(np.array([m.ior for m in meshes], np.float64), wp.float64)
        self.surfaces.tint = _shared(np.array([m.tint for m in meshes], np.float64), wp.float64)

    def open(self, start: float, end: float) -> None:
        """Makes the tree good for times from ``start`` to ``end``, parts in 0 ... 1 of the shutter."""
        self._bound(start, end)
        self._tree.rebuild()

    def _bound(self, start: float, end: float) -> None:
        corners = [between(self._points, s)[self._triangles] for s in (start, end)]
        self._boxes[0][:] = np.minimum(*(corner.min(axis=1) for corner in corners)) - self._padding
        self._boxes[1][:] = np.maximum(*(corner.max(axis=1) for corner in corners)) + self._padding


def _shared(values: np.ndarray, dtype: type) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu", copy=False)
