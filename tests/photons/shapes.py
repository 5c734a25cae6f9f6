"""Meshes to trace through, and how they move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tpdwarp.scene.description import Interaction, Material, MeshAtShutter
from usd_scenes.oracle.shapes import grid_points, grid_triangles

DIFFUSE = Material(color=(0.5, 0.5, 0.5), path="/grey")
MIRROR = Material(Interaction.MIRROR, (1.0, 1.0, 1.0), path="/mirror")


def glass(ior: float = 1.5) -> Material:
    return Material(Interaction.DIELECTRIC, (1.0, 1.0, 1.0), ior, "/glass")


def mesh(path: str, points: np.ndarray, triangles: np.ndarray, material: Material, **more: object) -> MeshAtShutter:
    """A mesh of one material; normals, where given, go with the vertices."""
    points, triangles = np.asarray(points, dtype=np.float64), np.asarray(triangles, dtype=np.int32)
    if "normals" in more:
        more.setdefault("normal_indices", triangles)
    return MeshAtShutter(path, points, triangles, materials=(material,), **more)


def quad(
    path: str, centre: tuple[float, float, float], u: tuple[float, ...], v: tuple[float, ...], material: Material
) -> MeshAtShutter:
    """A parallelogram centre ± u ± v with its front along u × v."""
    centre, u, v = (np.asarray(a, dtype=np.float64) for a in (centre, u, v))
    points = [centre - u - v, centre + u - v, centre + u + v, centre - u + v]
    return mesh(path, points, [[0, 1, 2], [0, 2, 3]], material)


def floor(height: float = 0.0, half: float = 4.0, material: Material = DIFFUSE, path: str = "/floor") -> MeshAtShutter:
    """A horizontal square, front side up."""
    return quad(path, (0, 0, height), (half, 0, 0), (0, half, 0), material)


def upside_down(surface: MeshAtShutter) -> MeshAtShutter:
    """The same surface with front and back exchanged."""
    changed = replace(surface, triangles=surface.triangles[:, ::-1].copy())
    if surface.normals is not None:
        changed = replace(
            changed, normals=-surface.normals, normal_indices=surface.normal_indices[:, ::-1].copy()
        )
    return changed


def field(
    path: str,
    x: np.ndarray,
    y: np.ndarray,
    height: Callable[[np.ndarray, np.ndarray], np.ndarray],
    slopes: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None,
    material: Material,
) -> MeshAtShutter:
    """A height field over a grid, front side up, smooth where its slopes are given and flat shaded else."""
    points, triangles = grid_points(x, y, height), grid_triangles(len(x), len(y))
    if slopes is None:
        return mesh(path, points, triangles, material)
    return mesh(path, points, triangles, material, normals=field_normals(points, slopes))


def field_normals(
    points: np.ndarray, slopes: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Unit normals of a height field at its vertices, shape [v, 3]."""
    zx, zy = slopes(points[:, 0], points[:, 1])
    normals = np.stack(np.broadcast_arrays(-zx, -zy, np.ones(len(points))), axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def ball(
    path: str, centre: tuple[float, float, float], radius: float, cells: int, material: Material, smooth: bool = True
) -> MeshAtShutter:
    """A sphere from the six faces of a cube, equal angles on each."""
    angles = np.tan(np.linspace(-0.25, 0.25, cells + 1) * np.pi)
    side = grid_points(angles, angles, lambda x, y: 1.0)
    faces = grid_triangles(cells + 1, cells + 1)
    turns = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    points, triangles = [], []
    for turn in turns:
        for sign in (1.0, -1.0):
            vertices = side * (sign, 1.0, sign)
            points.append(vertices[:, turn])
            triangles.append(faces + len(side) * (len(points) - 1))
    normals = np.concatenate(points)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    more = {"normals": normals} if smooth else {}
    return mesh(path, np.asarray(centre) + radius * normals, np.concatenate(triangles), material, **more)


def cap(
    path: str,
    centre: tuple[float, float, float],
    radius: float,
    axis: tuple[float, float, float],
    half_angle: float,
    cells: int,
    material: Material,
    semi_axes: tuple[float, float, float] = (1, 1, 1),
) -> MeshAtShutter:
    """The part of a sphere (or of an ellipsoid with ``semi_axes`` times the radius) around ``axis``, front outside."""
    w = np.asarray(axis, dtype=np.float64)
    w /= np.linalg.norm(w)
    u = np.cross([0, 1, 0], w)
    u /= np.linalg.norm(u)
    across = np.tan(np.linspace(-half_angle, half_angle, cells + 1))
    directions = grid_points(across, across, lambda x, y: 1.0) @ np.array([u, np.cross(w, u), w])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = directions / np.asarray(semi_axes)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.asarray(centre) + radius * directions * np.asarray(semi_axes)
    return mesh(path, points, grid_triangles(cells + 1, cells + 1), material, normals=normals)


def box(path: str, low: tuple[float, ...], high: tuple[float, ...], material: Material) -> MeshAtShutter:
    """An axis-aligned closed box, front outside, flat shaded."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) * (np.array(high) - low) + low
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return mesh(path, corners, [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], material)


def prism(path: str, centre: tuple[float, float, float], radius: float, length: float, material: Material):
    """A closed triangular prism along y, one face down, flat shaded."""
    angles = np.pi * (0.5 + np.array([0, 2, 4]) / 3)
    ring = np.stack([radius * np.cos(angles), np.zeros(3), radius * np.sin(angles)], axis=1)
    half = np.array([0, length, 0])
    points = np.concatenate([ring - half, ring + half]) + np.asarray(centre)
    triangles = [[0, 2, 1], [3, 4, 5]]
    for a, b in ((0, 1), (1, 2), (2, 0)):
        triangles += [[a, b, b + 3], [a, b + 3, a + 3]]
    return outward(mesh(path, points, triangles, material), centre)


def cylinder(
    path: str, centre: tuple[float, float, float], radius: float, length: float, sides: int, material: Material
) -> MeshAtShutter:
    """A closed cylinder along y, its side smooth, its ends flat."""
    angles = 2 * np.pi * np.arange(sides) / sides
    normals = np.stack([np.cos(angles), np.zeros(sides), np.sin(angles)], axis=1)
    points = np.concatenate([radius * normals - [0, length, 0], radius * normals + [0, length, 0]])
    points = np.concatenate([points, [[0, -length, 0], [0, length, 0]]]) + np.asarray(centre)
    all_normals = np.concatenate([normals, [[0, -1, 0], [0, 1, 0]]])
    triangles, indices = [], []
    for a in range(sides):
        b = (a + 1) % sides
        triangles += [[a, b + sides, b], [a, a + sides, b + sides], [2 * sides, a, b]]
        triangles += [[2 * sides + 1, b + sides, a + sides]]
        indices += [[a, b, b], [a, a, b], [sides] * 3, [sides + 1] * 3]
    made = mesh(
        path, points, triangles, material, normals=all_normals, normal_indices=np.array(indices, dtype=np.int32)
    )
    return outward(made, centre)


def outward(closed: MeshAtShutter, centre: tuple[float, float, float]) -> MeshAtShutter:
    """A convex mesh with every triangle turned so that its front is outside."""
    a, b, c = (closed.points[closed.triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - np.asarray(centre)) < 0
    turned = {"triangles": np.where(inward[:, None], closed.triangles[:, ::-1], closed.triangles)}
    if closed.normal_indices is not None:
        indices = closed.normal_indices
        turned["normal_indices"] = np.where(inward[:, None], indices[:, ::-1], indices)
    return replace(closed, **turned)


def moving(surface: MeshAtShutter, by: tuple[float, float, float] | np.ndarray) -> MeshAtShutter:
    """The surface displaced by ``by`` (one vector, or one a vertex) over the shutter."""
    motions = np.broadcast_to(np.asarray(by, dtype=np.float64), surface.points.shape).copy()
    still = None if surface.normals is None else np.zeros_like(surface.normals)
    return replace(surface, motions=motions, normal_motions=still)


def turning(
    surface: MeshAtShutter, axis: tuple[float, float, float], angle: float, about: tuple[float, float, float]
) -> MeshAtShutter:
    """The surface turned about a point, by ``angle`` from shutter open to close, its vertices moving linearly."""
    about = np.asarray(about, dtype=np.float64)
    first, last = rotation(axis, -0.5 * angle), rotation(axis, 0.5 * angle)
    a, b = (about + (surface.points - about) @ turn.T for turn in (first, last))
    changed = replace(surface, points=0.5 * (a + b), motions=b - a)
    if surface.normals is not None:
        a, b = (surface.normals @ turn.T for turn in (first, last))
        middle = 0.5 * (a + b)
        lengths = np.linalg.norm(middle, axis=1, keepdims=True)
        changed = replace(changed, normals=middle / lengths, normal_motions=(b - a) / lengths)
    return changed


def rotation(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    """Rotation matrix (Rodrigues), shape [3, 3]."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def ripples(
    x: np.ndarray, y: np.ndarray, height: float, amplitude: float, material: Material, smooth: bool
) -> MeshAtShutter:
    """Water of two crossing waves that travel over the shutter, at height ``height``."""

    def angles(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 4 * x + y + 0.3, 3 * y - 2 * x

    def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        a, b = angles(x, y)
        return height + amplitude * (np.sin(a) + 0.6 * np.sin(b))

    def slopes(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = (np.cos(angle) for angle in angles(x, y))
        return amplitude * (4 * a - 1.2 * b), amplitude * (a + 1.8 * b)

    water = field("/water", x, y, level, slopes if smooth else None, material)
    a, b = (np.cos(angle) for angle in angles(*water.points[:, :2].T))
    rates = np.zeros_like(water.points)
    rates[:, 2] = -amplitude * (0.9 * a + 0.5 * b)
    if not smooth:
        return replace(water, motions=rates)
    a, b = (np.sin(angle) for angle in angles(*water.points[:, :2].T))
    slope_rates = np.stack([amplitude * (3.6 * a - 0.6 * b), amplitude * (0.9 * a + 0.9 * b)], axis=1)
    # N = (−s_x, −s_y, 1)/L: the change of the unit normal with its slopes.
    n = water.normals
    change = np.append(-slope_rates, np.zeros((len(n), 1)), axis=1) * n[:, 2:]
    change -= n * np.einsum("ij,ij->i", n, change)[:, None]
    return replace(water, motions=rates, normal_motions=change)
