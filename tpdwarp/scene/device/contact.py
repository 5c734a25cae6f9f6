"""Coincident surfaces, separated: glass that stands on a table, or touches other glass, gets a gap that rays resolve.

Of surfaces closer together than a ray offset, single precision cannot say which comes first, and light that leaves one
passes the other by. So a specular triangle in the plane of a triangle of another mesh is
moved off it by some times that distance: off a diffuse surface to its front, off a specular one that faces it to its
own inside. Specular ones that face the same way are one surface written twice, of which rays meet one; they stay.
Of nested solids there is no gap between: the one that gives way is moved into the one that holds.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.device.faces import Faces
from tpdwarp.scene.device.ray_offset import OFFSET_BY_MAGNITUDE, ray_offset
from tpdwarp.scene.device.wide_tree import WideTree

# In units of the ray offset and of the rounding of rays from afar together: what counts as contact, and how far it is
# moved. The gap is twice what counts as contact, so that separated surfaces stay separated.
CONTACT = wp.constant(2.0)
GAP = wp.constant(4.0)
# Triangles within this cosine of each other (0.8°) may lie in one plane. Chosen, not derived.
PARALLEL = wp.constant(0.9999)
# Four half units in the last place of single precision.
ROUNDING = wp.constant(2.4e-7)
# Moves of one vertex that differ in direction by less than about the inverse of this [rad] are one. Chosen, not
# derived: about as much as PARALLEL.
DIRECTIONS = 64


@wp.struct
class Triangle:
    """Corners and unit normal of a triangle.

    ``resolution`` is the distance within which rays cannot separate other surfaces from it, ``rounding`` how exactly
    its own plane is known.
    """

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    n: wp.vec3
    resolution: float
    rounding: float


@wp.func
def _triangle(points: wp.array(dtype=wp.vec3), corner: wp.vec3i) -> Triangle:
    t = Triangle()
    t.a = points[corner[0]]
    t.b = points[corner[1]]
    t.c = points[corner[2]]
    t.n = wp.normalize(wp.cross(t.b - t.a, t.c - t.a))
    edges = wp.abs(t.b - t.a) + wp.abs(t.c - t.a)
    magnitude = wp.max(wp.max(wp.abs(t.a), wp.abs(t.b)), wp.abs(t.c))
    offset = ray_offset(t.n, magnitude, edges[0] + edges[1] + edges[2])
    t.resolution = offset + OFFSET_BY_MAGNITUDE * wp.max(magnitude)
    t.rounding = ROUNDING * wp.dot(wp.abs(t.n), magnitude)
    return t


@wp.func
def _off_plane(t: Triangle, other: Triangle) -> float:
    """Largest distance of a corner of ``t`` from the plane of ``other``."""
    origin = wp.vec3d(other.a)
    n = wp.normalize(wp.cross(wp.vec3d(other.b) - origin, wp.vec3d(other.c) - origin))
    off = wp.abs(wp.dot(n, wp.vec3d(t.a) - origin))
    off = wp.max(off, wp.abs(wp.dot(n, wp.vec3d(t.b) - origin)))
    return float(wp.max(off, wp.abs(wp.dot(n, wp.vec3d(t.c) - origin))))


@wp.func
def _move(n: wp.vec3, other: wp.vec3, other_is_diffuse: bool, gap: float) -> wp.vec3:
    if other_is_diffuse:
        return gap * other
    if wp.dot(n, other) < 0.0:
        return -gap * n
    return wp.vec3(0.0, 0.0, 0.0)


@wp.kernel(enable_backward=False)
def find_contacts(
    base: int,
    # Scene
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    object_of: wp.array(dtype=wp.int32),
    diffuse: wp.array(dtype=wp.int32),
    media: wp.array(dtype=wp.int32),
    # In
    chosen: wp.array(dtype=wp.int32),
    # Out
    moves: wp.array(dtype=wp.vec3),
):
    """Where to move each specular triangle that lies in the plane of one of another mesh, one thread a chosen one."""
    i = chosen[base + wp.tid()]
    mine = _triangle(points, triangles[i])
    grown = 2.0 * CONTACT * wp.vec3(mine.resolution, mine.resolution, mine.resolution)
    low = wp.min(wp.min(mine.a, mine.b), mine.c) - grown
    high = wp.max(wp.max(mine.a, mine.b), mine.c) + grown
    query = wp.mesh_query_aabb(mesh, low, high)
    face = int(0)
    while wp.mesh_query_aabb_next(query, face):
        if object_of[face] != object_of[i] and (diffuse[i] == 0 or diffuse[face] == 0):
            theirs = _triangle(points, triangles[face])
            # A huge floor is no reason to move a tiny lens far, but by what its plane is rounded.
            resolution = wp.max(mine.resolution, theirs.resolution)
            if diffuse[i] == 1:
                resolution = theirs.resolution + mine.rounding
            elif diffuse[face] == 1:
                resolution = mine.resolution + theirs.rounding
            off = wp.min(_off_plane(mine, theirs), _off_plane(theirs, mine))
            if wp.abs(wp.dot(mine.n, theirs.n)) > PARALLEL and off < CONTACT * resolution:
                medium = media[object_of[i]]
                other = media[object_of[face]]
                if medium >= 0 and other >= 0 and medium != other and diffuse[i] == 0 and diffuse[face] == 0:
                    if medium < other:
                        moves[i] = -GAP * resolution * theirs.n
                    else:
                        moves[face] = -GAP * resolution * mine.n
                else:
                    if diffuse[i] == 0:
                        moves[i] = _move(mine.n, theirs.n, diffuse[face] == 1, GAP * resolution)
                    if diffuse[face] == 0:
                        moves[face] = _move(theirs.n, mine.n, diffuse[i] == 1, GAP * resolution)


def separate_coincident(
    trees: WideTree, faces: Faces, boxes: np.ndarray, media: np.ndarray, launcher: Launcher
) -> np.ndarray | None:
    """The scene's points with surfaces in contact separated.

    Args:
        trees: The scene's triangles, in the tracer's units.
        faces: What they are.
        boxes: Lower and upper corner of each mesh of the stage, shape [m, 2, 3].
        media: Medium of each nested solid, of which higher ones hold, −1 for other meshes, shape [m].
        launcher: Where to look for contacts.

    Returns:
        Points, shape [n, 3] float32; None where nothing is in contact.
    """
    points, triangles = trees.points.numpy(), faces.triangles.numpy()
    chosen = _suspects(points, triangles, *faces.by_object, boxes)
    if not len(chosen):
        return None
    moves = launcher.zeros(len(triangles), wp.vec3)
    diffuse, media, chosen = (launcher.array(of, wp.int32) for of in (faces.diffuse, media, chosen))
    arrays = [trees.points, faces.triangles, faces.object_of, diffuse, media, chosen]
    launcher(find_contacts, len(chosen), [trees.mesh.id, *arrays, moves])
    found = moves.numpy()
    touching = np.flatnonzero(np.any(found, axis=1))
    if not len(touching):
        return None
    # A vertex in an edge or a corner of contact moves off all surfaces there, but off each of them once.
    vertices, shifts = triangles[touching].ravel(), np.repeat(found[touching], 3, axis=0)
    directions = np.rint(DIRECTIONS * shifts / np.linalg.norm(shifts, axis=1, keepdims=True)).astype(np.int64)
    _, once = np.unique(np.column_stack([vertices, directions]), axis=0, return_index=True)
    changed = points.copy()
    np.add.at(changed, vertices[once], shifts[once])
    return changed


def _suspects(
    points: np.ndarray, triangles: np.ndarray, counts: np.ndarray, special: np.ndarray, boxes: np.ndarray
) -> np.ndarray:
    """Triangles to look around for contacts, shape [k] int32: of two meshes that may touch, those of the smaller."""
    ends = np.cumsum(counts)
    # Grown by more than what counts as contact.
    slack = 4.0e-5 * np.abs(boxes).max(axis=(1, 2))[:, None]
    low, high = boxes[:, 0] - slack, boxes[:, 1] + slack
    found = [np.zeros(0, np.int32)]
    for first in np.flatnonzero(special):
        near = np.all((low[first] <= high) & (low <= high[first]), axis=1)
        # Pairs of specular meshes come up once.
        near[:first] &= ~special[:first]
        near[first] = False
        for second in np.flatnonzero(near):
            smaller = min(first, second, key=lambda number: counts[number])
            rows = np.arange(ends[smaller] - counts[smaller], ends[smaller], dtype=np.int32)
            corners = points[triangles[rows]]
            meet_low, meet_high = np.maximum(low[first], low[second]), np.minimum(high[first], high[second])
            inside = (corners.min(axis=1) <= meet_high) & (corners.max(axis=1) >= meet_low)
            found.append(rows[inside.all(axis=1)])
    return np.unique(np.concatenate(found))
