"""Aim: where on a light's patch photons start that can reach specular surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tpdwarp.photons.lattice_shape import specular_faces, turned
from tpdwarp.scene.description import LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter
from tpdwarp.scene.normalization import Normalization

# Triangles that look larger than this from the light [rad] are cut before their directions are bounded. Between its
# ends an edge of this size departs from that bound by its square over eight, a thousandth.
FINEST_ANGLE = 0.1

Bounds = tuple[float, float, float, float]


def specular_triangles(mesh: MeshAtShutter) -> np.ndarray:
    """Vertex indices [k, 3] of the triangles that reflect or refract."""
    return mesh.triangles[specular_faces(mesh)]


def specular_corners(scene: SceneAtShutter, normalization: Normalization) -> np.ndarray:
    """Corners [k, 3, 3] of the specular triangles in the tracer's units, at mid shutter: that is where photons go."""
    meshes = [mesh for mesh in scene.meshes if mesh.specular]
    corners = [normalization.points(mesh.points)[specular_triangles(mesh)] for mesh in meshes]
    return np.concatenate(corners).astype(np.float64) if corners else np.zeros((0, 3, 3))


def specular_points(scene: SceneAtShutter, normalization: Normalization) -> np.ndarray:
    """The vertices of specular triangles, each but once, in the tracer's units, at mid shutter; shape [m, 3]."""
    meshes = [mesh for mesh in scene.meshes if mesh.specular]
    points = [normalization.points(mesh.points)[np.unique(specular_triangles(mesh))] for mesh in meshes]
    return np.concatenate(points).astype(np.float64) if points else np.zeros((0, 3))


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


def spread_of(light: LightAtShutter, corners: np.ndarray, axis: np.ndarray, normalization: Normalization) -> float:
    """Largest angle [rad] between ``axis`` and the directions from a point light to ``corners``."""
    offsets = corners.reshape(-1, 3) - normalization.points(light.position[None])[0]
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), 1e-30)
    return float(np.arccos(np.clip((offsets @ axis / lengths).min(), -1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Seen:
    """Triangles as a point light sees them, whichever way it looks.

    Attributes:
        corners: From the light, in the tracer's units, shape [k, 3, 3].
        points: The same, each but once, shape [m, 3]; None where that is not known.
    """

    corners: np.ndarray
    points: np.ndarray | None = None

    @cached_property
    def centres(self) -> np.ndarray:
        """Their middles, shape [k, 3]."""
        return (self.corners[:, 0] + self.corners[:, 1] + self.corners[:, 2]) / 3.0

    @cached_property
    def edges(self) -> np.ndarray:
        """Lengths of their edges, shape [k, 3]."""
        return _lengths(self.corners - self.corners[:, (1, 2, 0)])

    @cached_property
    def angles(self) -> np.ndarray:
        """The largest angle [rad] that each may span, shape [k]."""
        return _largest(self.edges) / np.maximum(-_largest(-_lengths(self.corners)), 1e-9)


def seen_from(
    light: LightAtShutter, corners: np.ndarray, normalization: Normalization, points: np.ndarray | None = None
) -> Seen | None:
    """What a point light sees of triangles; None for parallel light, which sees them by their corners alone.

    ``points`` [m, 3] are the corners, each but once.
    """
    if light.kind == LightKind.DISTANT:
        return None
    place = normalization.points(light.position[None])[0]
    return Seen(corners - place, None if points is None else points - place)


def bounds_of(
    light: LightAtShutter,
    axes: np.ndarray | None,
    limit: float,
    corners: np.ndarray,
    normalization: Normalization,
    turn: float = 0.0,
    seen: Seen | None = None,
) -> Bounds | None:
    """Patch coordinates (u0, u1, v0, v1) that reach ``corners`` at mid shutter; None if none do.

    The patch of a distant light is turned by ``turn`` [rad] from the light's own axes. ``seen`` is what
    :func:`seen_from` gives, where several patches of a light are bounded.
    """
    if light.kind == LightKind.DISTANT:
        uv = corners.reshape(-1, 3) @ turned(light.axes, turn)[:2].T
    else:
        uv = _angles(seen or seen_from(light, corners, normalization), axes, limit)
    if not len(uv):
        return None
    lower, upper = uv.min(axis=0), uv.max(axis=0)
    return float(lower[0]), float(upper[0]), float(lower[1]), float(upper[1])


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors [..., 3], shape [...]."""
    return np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2 + vectors[..., 2] ** 2)


def _largest(corners: np.ndarray) -> np.ndarray:
    """The largest of each row of [k, 3], shape [k]: column by column, which is several times as fast."""
    return np.maximum(np.maximum(corners[:, 0], corners[:, 1]), corners[:, 2])


def _inside(corners: np.ndarray, slope: float) -> np.ndarray:
    """Whether triangles [k, 3, 3] lie within |x|, |y| ≤ slope · z as a whole, shape [k]."""
    x, y, z = corners[..., 0], corners[..., 1], corners[..., 2]
    return _largest(np.maximum(np.abs(x), np.abs(y)) - slope * z) <= 0.0


def _outside(corners: np.ndarray, slope: float) -> np.ndarray:
    """Whether triangles [k, 3, 3] lie beyond one of the planes x, y = ±slope · z as a whole, shape [k]."""
    x, y, reach = corners[..., 0], corners[..., 1], slope * corners[..., 2]
    sides = (_largest(reach - part) < 0.0 for part in (x, -x, y, -y))
    return np.logical_or.reduce(list(sides))


def _widened(low: np.ndarray, high: np.ndarray, points: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of tangents within the patch, [2] and [2], with those of more points [n, 3]."""
    points = points[points[:, 2] > 0.0]
    tangents = points[:, :2] / points[:, 2:]
    kept = tangents[(np.abs(tangents) <= math.tan(limit + FINEST_ANGLE)).all(axis=1)]
    if not len(kept):
        return low, high
    slope = math.tan(limit)
    return np.minimum(low, kept.min(axis=0).clip(-slope, slope)), np.maximum(high, kept.max(axis=0).clip(-slope, slope))


def _widen(corners: np.ndarray, low: np.ndarray, high: np.ndarray, limit: float) -> np.ndarray:
    """Whether what triangles [k, 3, 3] show of themselves in the patch may lie outside of bounds of tangents, [k]."""
    x, y, z = corners[..., 0], corners[..., 1], corners[..., 2]
    front, slope = _largest(-z) < 0.0, math.tan(limit)
    wider = ~front
    for axis, part in enumerate((x, y)):
        tangents = part / np.where(z > 0.0, z, 1.0)
        wider |= np.minimum(_largest(tangents), slope) > high[axis]
        wider |= np.maximum(-_largest(-tangents), -slope) < low[axis]
    return wider


def _angles(seen: Seen, axes: np.ndarray, limit: float) -> np.ndarray:
    """(u, v) angles that bound the parts of triangles inside the patch, shape [m, 2].

    Triangles that look large from the light are cut across their longest edge until they look small, so that bounds
    stay tight where a surface surrounds the light.
    """
    points = seen.corners.reshape(-1, 3) if seen.points is None else seen.points
    if len(points) and (points @ axes[2]).min() > 0.0:
        # All of it lies before the patch: tangents are greatest and least at corners.
        flat = points @ axes.T
        tangents = flat[:, :2] / flat[:, 2:]
        ends = flat[np.concatenate([tangents.argmin(axis=0), tangents.argmax(axis=0)])]
        uv = np.arctan2(ends[:, :2], ends[:, 2:])
        if np.abs(uv).max() <= limit:
            return uv
    found = []
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    # Most triangles lie on another side of the light: only the others are turned to the patch.
    parts = seen
    centre = parts.centres @ axes.T
    turn = axes.T
    for _ in range(24):
        reach = np.arctan2(np.maximum(np.abs(centre[:, 0]), np.abs(centre[:, 1])), centre[:, 2])
        near = (reach <= limit + parts.angles) | (parts.angles > 1.0)
        local, edges, small = parts.corners[near] @ turn, parts.edges[near], parts.angles[near] <= FINEST_ANGLE
        # What lies inside as a whole is bounded by its corners; of what lies outside as a whole nothing is kept below.
        inside, outside = _inside(local, math.tan(limit)), _outside(local, math.tan(limit + FINEST_ANGLE))
        found.append(local[inside | small].reshape(-1, 3))
        low, high = _widened(low, high, found[-1], limit)
        cut = ~(inside | small | outside)
        cut[cut] = _widen(local[cut], low, high, limit)
        local, edges = local[cut], edges[cut]
        if not len(local) or len(local) > 200_000:
            break
        rows, longest = np.arange(len(local)), edges.argmax(axis=1)
        a, b, c = (local[rows, (longest + corner) % 3] for corner in range(3))
        middle = 0.5 * (a + b)
        parts = Seen(np.concatenate([np.stack(part, axis=1) for part in ((a, middle, c), (middle, b, c))]))
        centre, turn = parts.centres, np.eye(3)
    found.append(local.reshape(-1, 3))
    points = np.concatenate(found)
    points = points[points[:, 2] > 0.0]
    if not len(points):
        return np.zeros((0, 2))
    uv = np.arctan2(points[:, :2], points[:, 2:])
    inside = np.all(np.abs(uv) <= limit + FINEST_ANGLE, axis=1)
    return np.clip(uv[inside], -limit, limit)
