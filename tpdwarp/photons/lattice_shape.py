"""Lattice shape: along which axes the lattice of a distant light lies, and how much finer it is along u than along v.

Where specular surfaces deflect light in one direction only, as a swell or a rod does, the light on the receiver varies
in that direction alone, and photons side by side in the other carry the same light. The blur of footprints goes with
h_u² G_u + h_v² G_v, where h are lattice steps and G the mean squares of how normals turn along u and v; at equal cells
of h_u h_v it is least at h_v/h_u = √(G_u/G_v). That holds for a sheet, such as water, that is all the light sees: at
the ends of a rod, say, light stops whatever normals do, and long cells would blur them. Its axes are those along which
the tensor ∫ ∂_a N · ∂_b N is diagonal: what surfaces do to light has axes of its own, whatever the light's roll.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpdwarp.scene.description import Interaction, LightAtShutter, MeshAtShutter, SceneAtShutter

# Ratios beyond this gain nothing more: light varies along the other direction, too. Chosen, not derived.
LARGEST_ASPECT = 16.0
# Where light grazes, normals turn without bound along its plane; triangles under a smaller cosine are left out. Chosen,
# not derived.
LEAST_COSINE = 0.25
# How much a sheet's area in the plane of the light may differ from that of the rectangle around it, as a part of it.
# Chosen, not derived.
SHEET = 0.05
# A rectangle has to be smaller than the one along the light's own axes by this factor to be worth a turn. Chosen, not
# derived: so many photons more would meet something specular.
LEAST_GAIN = 0.95
# By how much blur h_u² G_u + h_v² G_v, at the same cells on a sheet, has to be less along other axes than those of the
# sheet, to be worth cells that are cut obliquely where it ends and those beside it (at 1.25 the shipped sea errs by
# 1.15 times less with twice as many cells).
LEAST_BLUR_GAIN = 1.3
# Turns that differ by less [rad] are one: a row of 100 cells ends within two cells of where it would. Chosen, not
# derived.
SAME_TURN = 0.02
# Strips in which points are looked through for a convex hull, which is exact to one part in as many.
STRIPS = 1024
# Where normals turn by less than this over the whole sheet [rad] its light is nearly even, and cells stay square.
# Chosen, not derived.
FLAT = 0.1


def specular_faces(mesh: MeshAtShutter) -> np.ndarray:
    """Which triangles of ``mesh`` reflect or refract, shape [m] bool."""
    special = np.array([m.interaction != Interaction.DIFFUSE for m in mesh.materials])
    if mesh.triangle_materials is None:
        return np.full(len(mesh.triangles), special[0])
    return special[mesh.triangle_materials]


@dataclass(frozen=True)
class LatticeShape:
    """How the lattice of a distant light lies in its plane.

    Attributes:
        turn: Angle [rad] from the light's own x axis to the lattice's u axis, about the light's z axis.
        aspect: h_v/h_u, how much finer it is along u than along v.
        excess: Area of the rectangle around what the light sees, along the lattice's axes, by that of a sheet in it.
    """

    turn: float = 0.0
    aspect: float = 1.0
    excess: float = 1.0


OWN_AXES = LatticeShape()
"""Square cells along the light's own axes."""


def turned(axes: np.ndarray, turn: float) -> np.ndarray:
    """Axes (rows x, y, z), or their motions, turned about z by ``turn`` [rad]; just the same without a turn."""
    if turn == 0.0:
        return axes
    c, s = math.cos(turn), math.sin(turn)
    return np.array([c * axes[0] + s * axes[1], c * axes[1] - s * axes[0], axes[2]])


def lattice_shape(views: Sequence[tuple[LightAtShutter, SceneAtShutter]]) -> LatticeShape:
    """The shape that suits all stills; the light's own axes and square cells where nothing speaks for others.

    What is no sheet, or deflects light alike in all directions, gets the rectangle of least area around it. The turn is
    one from the light's own axes, so that the lattice of a light that turns turns with it.
    """
    seen = [(light, [mesh for mesh in scene.meshes if mesh.specular]) for light, scene in views]
    corners = [_corners(meshes, light.axes) for light, meshes in seen if meshes]
    if not corners:
        return OWN_AXES
    hull = convex_hull(np.concatenate([found.reshape(-1, 2) for found in corners]))
    around = rectangle_turn(hull)
    if not all(meshes for _, meshes in seen) or not all(_is_sheet(found, around) for found in corners):
        return LatticeShape(around)
    tensor = sum((_turning(mesh, light.axes) for light, meshes in seen for mesh in meshes), np.zeros((2, 2)))
    if np.trace(tensor) < FLAT**2:
        return LatticeShape(around)
    along = _principal_turn(tensor)
    best, there = _variation(tensor, along), _variation(tensor, around)
    gains = math.sqrt(there.prod() / best.prod()) > LEAST_BLUR_GAIN
    turn, (along_u, along_v) = (along, best) if gains and abs(along - around) > SAME_TURN else (around, there)
    ratio = math.sqrt(along_u / along_v)
    aspect = 2.0 ** round(math.log2(min(max(ratio, 1.0 / LARGEST_ASPECT), LARGEST_ASPECT)))
    if aspect == 1.0:
        return LatticeShape(around)
    return LatticeShape(turn, aspect, _area_around(hull, turn) / _area_around(hull, around))


def _variation(tensor: np.ndarray, turn: float) -> np.ndarray:
    """G_u and G_v along axes turned by ``turn``; neither counts as less than what the largest aspect ratio is for."""
    c, s = math.cos(turn), math.sin(turn)
    axes = np.array([[c, s], [-s, c]])
    return np.maximum(np.einsum("ai,ij,aj->a", axes, tensor, axes), np.trace(tensor) / LARGEST_ASPECT**4)


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull of points [n, 2], counter-clockwise; of many points, to within a part in 1 000."""
    points = np.unique(_outermost(points), axis=0)
    if len(points) < 3:
        return points

    def chain(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
        found: list[tuple[float, float]] = []
        for x, y in ordered:
            while len(found) > 1:
                (x0, y0), (x1, y1) = found[-2:]
                if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0.0:
                    break
                found.pop()
            found.append((x, y))
        return found[:-1]

    # Python's own numbers: of two at a time arrays take ten times as long.
    ordered = points.astype(np.float64).tolist()
    return np.array(chain(ordered) + chain(ordered[::-1]))


def rectangle_turn(hull: np.ndarray) -> float:
    """By how much, −45° … 45°, the rectangle of least area around ``hull`` is turned; 0 where that gains little."""
    edges = np.roll(hull, -1, axis=0) - hull
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    angles = angles - np.round(angles / (0.5 * math.pi)) * (0.5 * math.pi)
    areas = [_area_around(hull, angle) for angle in angles]
    best = int(np.argmin(areas))
    return float(angles[best]) if areas[best] < LEAST_GAIN * _area_around(hull, 0.0) else 0.0


def _outermost(points: np.ndarray) -> np.ndarray:
    """Those of points [n, 2] that are first or last in a strip along either axis."""
    if len(points) < 4 * STRIPS:
        return points
    rows = []
    for axis in (0, 1):
        along, across = points[:, axis], points[:, 1 - axis]
        size = max(float(np.ptp(along)), np.finfo(float).tiny)
        strip = np.minimum(((along - along.min()) / size * STRIPS).astype(np.int64), STRIPS - 1)
        order = np.lexsort((across, strip))
        starts = np.flatnonzero(np.diff(strip[order], prepend=-1))
        rows += [order[starts], order[np.append(starts[1:], len(order)) - 1]]
    return points[np.unique(np.concatenate(rows))]


def _area_around(hull: np.ndarray, turn: float) -> float:
    c, s = math.cos(turn), math.sin(turn)
    return float(np.ptp(hull @ np.array([[c, -s], [s, c]]), axis=0).prod())


def _principal_turn(tensor: np.ndarray) -> float:
    """Turn, −45° … 45°, of the axes along which a symmetric 2 × 2 tensor is diagonal."""
    difference, mixed = tensor[0, 0] - tensor[1, 1], 2.0 * tensor[0, 1]
    return 0.5 * (math.atan2(mixed, difference) if difference >= 0.0 else math.atan2(-mixed, -difference))


def _corners(meshes: list[MeshAtShutter], axes: np.ndarray) -> np.ndarray:
    """Corners of specular faces in the plane of a light with ``axes``, shape [n, 3, 2]."""
    return np.concatenate([mesh.points[mesh.triangles[specular_faces(mesh)]] for mesh in meshes]) @ axes[:2].T


def _is_sheet(corners: np.ndarray, turn: float) -> bool:
    """Whether specular faces fill a rectangle, turned by ``turn``, in the plane of a light, and face one way."""
    (u1, v1), (u2, v2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    areas = 0.5 * (u1 * v2 - u2 * v1)
    filled, whole = float(np.abs(areas).sum()), _area_around(corners.reshape(-1, 2), turn)
    # Faces may be there more than once, but all look the same way: so a body, with a near and a far side, is no sheet.
    layers = max(1, round(filled / whole)) if whole > 0.0 else 1
    limit = SHEET * layers * whole
    return filled - abs(float(areas.sum())) <= limit and abs(filled - layers * whole) <= limit


def _turning(mesh: MeshAtShutter, axes: np.ndarray) -> np.ndarray:
    """∫ ∂_a N · ∂_b N over the plane of a light with ``axes``, for a, b ∈ {u, v}, without a unit, shape [2, 2]."""
    if mesh.normals is None:
        return np.zeros((2, 2))
    faces = specular_faces(mesh)
    corners = mesh.points[mesh.triangles[faces]]
    normals = mesh.normals[mesh.normal_indices[faces]]
    edges = (corners[:, 1:] - corners[:, :1]) @ axes.T
    turns = normals[:, 1:] - normals[:, :1]
    (u1, v1), (u2, v2) = edges[:, 0, :2].T, edges[:, 1, :2].T
    area = u1 * v2 - u2 * v1
    true_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    seen = np.abs(area) > LEAST_COSINE * true_area
    along = [
        (v2[:, None] * turns[:, 0] - v1[:, None] * turns[:, 1])[seen],
        (u1[:, None] * turns[:, 1] - u2[:, None] * turns[:, 0])[seen],
    ]
    whole = np.abs(area[seen])
    return np.array([[float(np.sum(np.sum(a * b, axis=1) / whole)) for b in along] for a in along])
