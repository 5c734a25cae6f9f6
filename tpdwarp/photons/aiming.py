"""Aim: where on a light's patch photons start that can reach specular surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpdwarp.photons.lattice_shape import specular_faces, turned
from tpdwarp.scene.description import LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter
from tpdwarp.scene.normalization import Normalization

Bounds = tuple[float, float, float, float]


def specular_triangles(mesh: MeshAtShutter) -> np.ndarray:
    """Vertex indices [k, 3] of the triangles that reflect or refract."""
    faces = specular_faces(mesh)
    return mesh.triangles if faces.all() else mesh.triangles[faces]


@dataclass(frozen=True, eq=False)
class Specular:
    """What photons are aimed at: the specular surfaces of a scene at mid shutter, in the tracer's units.

    Attributes:
        points: Vertices of specular triangles, shape [n, 3].
        triangles: Rows of ``points``, shape [k, 3].
    """

    points: np.ndarray
    triangles: np.ndarray

    @classmethod
    def of(cls, scene: SceneAtShutter, normalization: Normalization) -> Specular:
        """Those of ``scene``."""
        points, triangles = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)]
        count = 0
        for mesh in scene.meshes:
            if mesh.specular:
                found = specular_triangles(mesh)
                used = np.zeros(len(mesh.points), bool)
                used[found] = True
                all_used = used.all()
                there = normalization.points(mesh.points)
                points.append(there if all_used else there[used])
                triangles.append(count + (found if all_used else (np.cumsum(used) - 1)[found]))
                count += len(points[-1])
        return cls(np.concatenate(points).astype(np.float64), np.concatenate(triangles))

    def __len__(self) -> int:
        return len(self.triangles)


def area_of(bounds: Bounds) -> float:
    """Area of bounds, in squared patch coordinates."""
    return (bounds[1] - bounds[0]) * (bounds[3] - bounds[2])


def cube_axes(axis: np.ndarray) -> list[np.ndarray]:
    """Axes (rows u, v, w) of the six faces of a cube whose first face looks along ``axis``."""
    length = np.linalg.norm(axis)
    w = axis / length if length > 1e-9 else np.array([0.0, 0.0, -1.0])
    helper = np.eye(3)[int(np.argmin(np.abs(w)))]
    u = np.cross(helper, w)
    u /= np.linalg.norm(u)
    v = np.cross(w, u)
    return [np.array(face) for face in ((u, v, w), (-u, v, -w), (v, w, u), (v, -w, -u), (w, u, v), (-w, u, -v))]


def spread_of(light: LightAtShutter, points: np.ndarray, axis: np.ndarray, normalization: Normalization) -> float:
    """Largest angle [rad] between ``axis`` and the directions from a point light to ``points`` [n, 3]."""
    offsets = points - normalization.points(light.position[None])[0]
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), 1e-30)
    return float(np.arccos(np.clip((offsets @ axis / lengths).min(), -1.0, 1.0)))


def bounds_of(
    light: LightAtShutter,
    axes: np.ndarray | None,
    limit: float,
    specular: Specular,
    normalization: Normalization,
    turn: float = 0.0,
) -> Bounds | None:
    """Patch coordinates (u0, u1, v0, v1) that reach ``specular`` at mid shutter; None if none do.

    The patch of a distant light is turned by ``turn`` [rad] from the light's own axes. Of a light with a cone, what
    lies outside the cones of all its places is left out.
    """
    if light.kind == LightKind.DISTANT:
        uv = specular.points @ turned(light.axes, turn)[:2].T
    else:
        local = (specular.points - normalization.points(light.position[None])[0]) @ axes.T
        uv = np.arctan(_tangents_within(local, specular.triangles, math.tan(limit))).clip(-limit, limit)
    if not len(uv):
        return None
    lower, upper = uv.min(axis=0), uv.max(axis=0)
    if light.kind != LightKind.DISTANT and light.shaping is not None:
        angle = light.shaping.angle + _parallax(light, specular, normalization)
        least, most = _tangents_of_cone(axes @ light.cone_axis[0], angle)
        lower, upper = np.maximum(lower, np.arctan(least)), np.minimum(upper, np.arctan(most))
        if (lower > upper).any():
            return None
    return float(lower[0]), float(upper[0]), float(lower[1]), float(upper[1])


def _tangents_of_cone(axis: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """The least and largest x/z and y/z within ``angle`` [rad] of a unit ``axis``, shape [2] each; infinite where the
    cone reaches beyond what lies before a patch.

    A plane x = t z touches the cone where it is ``angle`` off the axis: (a_x − t a_z)² = (1 + t²) sin² angle.
    """
    sine = math.sin(angle) if angle < 0.5 * math.pi else 1.0
    across, z = axis[:2], axis[2]
    if angle >= 0.5 * math.pi or z <= sine:
        return np.full(2, -math.inf), np.full(2, math.inf)
    rest = sine * np.sqrt(across**2 + z**2 - sine**2)
    return (across * z - rest) / (z**2 - sine**2), (across * z + rest) / (z**2 - sine**2)


def _parallax(light: LightAtShutter, specular: Specular, normalization: Normalization) -> float:
    """By how much [rad], at most, a place on a light sees what is specular in another direction than its middle does.

    No triangle is nearer than its plane, nor than its nearest vertex less its longest side.
    """
    if light.extent is None:
        return 0.0
    reach = normalization.scale * light.extent.reach
    corners = specular.points[specular.triangles] - normalization.points(light.position[None])[0]
    sides = corners[:, (1, 2, 0)] - corners
    normals = np.cross(sides[:, 0], sides[:, 1])
    areas = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    heights = np.abs(np.einsum("ni,ni->n", normals, corners[:, 0])) / areas
    around = np.linalg.norm(corners, axis=2).min(axis=1) - np.linalg.norm(sides, axis=2).max(axis=1)
    nearest = float(np.maximum(heights, around).min())
    return math.asin(reach / nearest) if reach < nearest else math.pi


def _tangents_within(points: np.ndarray, triangles: np.ndarray, slope: float) -> np.ndarray:
    """(x/z, y/z) of corners of what triangles show of themselves within |x|, |y| ≤ slope · z, shape [m, 2].

    Tangents are greatest and least at corners: vertices that lie inside, edges that pass a side of the patch, and
    corners of the patch that a triangle hides.
    """
    x, y, z = points.T
    reach = slope * z
    # One bit for each side of the patch that a vertex lies beyond.
    beyond = (x > reach) | (x < -reach) << 1 | (y > reach) << 2 | (y < -reach) << 3
    inside = (beyond == 0) & (z > 0.0)
    a, b, c = beyond[triangles].T
    every, some = a & b & c, a | b | c
    cut = triangles[(every == 0) & (some != 0)]
    # A corner of the patch lies between two of its sides, and so does what hides it.
    wide = triangles[(every == 0) & (some & 0b0011 != 0) & (some & 0b1100 != 0)]
    edges = cut[:, ((0, 1), (1, 2), (2, 0))].reshape(-1, 2)
    first, second = beyond[edges].T
    edges = edges[(first & second == 0) & (first | second != 0)]
    ends = _passing(points[edges[:, 0]], points[edges[:, 1]], slope)
    return np.concatenate([points[inside, :2] / points[inside, 2:], ends, _hidden(points[wide], slope)])


def _passing(a: np.ndarray, b: np.ndarray, slope: float) -> np.ndarray:
    """(x/z, y/z) where edges from ``a`` to ``b``, both [n, 3], pass a side of the patch, shape [m, 2]."""
    found = []
    for axis in (0, 1):
        for side in (-slope, slope):
            from_a, from_b = (side * end[:, 2] - end[:, axis] for end in (a, b))
            passes = (from_a < 0.0) != (from_b < 0.0)
            start, away = from_a[passes, None], (from_a - from_b)[passes, None]
            there = a[passes] + (start / away) * (b[passes] - a[passes])
            there = there[(there[:, 2] > 0.0) & (np.abs(there[:, 1 - axis]) <= slope * there[:, 2])]
            tangents = there[:, :2] / there[:, 2:]
            tangents[:, axis] = side
            found.append(tangents)
    return np.concatenate(found)


def _hidden(corners: np.ndarray, slope: float) -> np.ndarray:
    """The corners (±slope, ±slope) of the patch that any of triangles [k, 3, 3] hides from the light, shape [m, 2]."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    # Volumes that the light spans with each edge, as functions of a direction: of one sign where the ray passes inside.
    sides = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a)])
    volumes = np.einsum("ki,ki->k", a, sides[1])
    found = []
    for tangents in ((-slope, -slope), (-slope, slope), (slope, -slope), (slope, slope)):
        spanned = sides @ np.array([*tangents, 1.0])
        before = spanned.sum(axis=0) * volumes > 0.0
        if (before & ((spanned >= 0.0).all(axis=0) | (spanned <= 0.0).all(axis=0))).any():
            found.append(tangents)
    return np.array(found).reshape(-1, 2)
