"""Scenes written down in code, without a file: what tests and benchmarks both render.

Everything here is made of the dataclasses of ``tpdwarp.scene.description``, with points, normals and motions exact at
any time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tpdwarp.scene.description import (
    CameraAtShutter,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    SceneAtShutter,
    Shutter,
)
from usd_scenes.oracle import Wave
from usd_scenes.oracle.caustic_rod import DEGREES, HALF, HEIGHT, LENGTH, RADIUS, irradiance_of_rod
from usd_scenes.oracle.shapes import grid_points, grid_triangles

QUAD = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
WHITE = Material(color=(1.0, 1.0, 1.0))
WATER = Material(Interaction.DIELECTRIC, ior=1.33)
SUN = LightAtShutter("/sun", LightKind.DISTANT, (1.0, 1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Source:
    """A scene source made of a function of the shutter."""

    scene: Callable[[Shutter], SceneAtShutter]
    file: str = "memory"

    def at(self, shutter: Shutter) -> SceneAtShutter:
        return self.scene(shutter)

    def reference_shutters(self) -> list[Shutter]:
        return [Shutter.still(0.0)]

    def motion_breaks(self, shutter: Shutter) -> list[float]:
        return []

    def light_groups(self) -> dict[str, str]:
        return {light.path: "" for light in self.at(self.reference_shutters()[0]).lights}


def turned(rotation) -> np.ndarray:
    """Rows are the x, y, z axes turned by a rotation vector (Rodrigues)."""
    rotation = np.asarray(rotation, float)
    angle = np.linalg.norm(rotation)
    k = np.cross(rotation / angle, np.eye(3))
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def quad(path: str, low, high, z: float, material: Material = WHITE, motion=None, up: bool = True) -> MeshAtShutter:
    """A horizontal rectangle between two corners (x, y), facing up or down."""
    (x0, y0), (x1, y1) = low, high
    corners = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]], float)
    motions = None if motion is None else np.tile(np.asarray(motion, float), (4, 1))
    return MeshAtShutter(path, corners, QUAD if up else QUAD[:, ::-1].copy(), motions, materials=(material,))


def floor(size: float = 4.0, **options) -> MeshAtShutter:
    return quad("/floor", (-size, -size), (size, size), 0.0, **options)


def looking_down(window=(-1, 1, -1, 1), height: float = 3.0, **options) -> CameraAtShutter:
    """An orthographic camera above the origin; x to the right, y up in the image."""
    return CameraAtShutter("/cam", True, np.array([0.0, 0.0, height]), np.eye(3), window, **options)


def bumpy(path: str, material: Material, height: float, moving: bool, upside_down: bool = False) -> MeshAtShutter:
    """A smooth sheet with vertex normals, whose vertices and normals move unevenly; uneven enough to bend rays."""
    x = np.linspace(-1.5, 1.5, 7)
    points = grid_points(x, x, lambda x, y: height + 0.1 * np.sin(2 * x + y) + 0.05 * y**2)
    normals = np.stack(
        [-0.2 * np.cos(2 * points[:, 0] + points[:, 1]),
         -0.1 * np.cos(2 * points[:, 0] + points[:, 1]) - 0.1 * points[:, 1],
         np.ones(len(points))], axis=1,
    )  # fmt: skip
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = grid_triangles(7, 7).astype(np.int32)
    if upside_down:
        triangles, normals = triangles[:, ::-1].copy(), -normals
    random = np.random.default_rng(12)
    motions, turns = random.normal(0, 0.05, points.shape), random.normal(0, 0.08, points.shape)
    return MeshAtShutter(
        path, points, triangles, motions if moving else None, normals, turns if moving else None, triangles, (material,)
    )  # fmt: skip


def steady(meshes, lights=(SUN,), camera: CameraAtShutter | None = None) -> Source:
    """A source of one scene; motions are per frame and everything keeps moving past the origin at frame ½."""

    def at(shutter: Shutter) -> SceneAtShutter:
        moved = []
        for mesh in meshes:
            if mesh.motions is None:
                moved.append(mesh)
                continue
            change: dict[str, object] = {"points": mesh.points + (shutter.middle - 0.5) * mesh.motions}
            change["motions"] = mesh.motions * shutter.exposure if shutter.exposure else None
            moved.append(replace(mesh, **change))
        return SceneAtShutter(shutter, tuple(moved), tuple(lights), camera or looking_down())

    return Source(at)


def wave_source(
    wave: Wave,
    motion: str = "smooth",
    columns: int = 1025,
    camera: CameraAtShutter | None = None,
    heading: float = 0.0,
) -> Source:
    """The oracle's travelling wave as a strip of long quads over [−2, 2]², seen from just below the water.

    Args:
        wave: Water over a white floor.
        motion: ``smooth``: velocities of the wave at mid shutter; ``linear``: vertices and normals interpolated
            between whole frames.
        columns: Vertices along x, and along y if the wave goes elsewhere.
        camera: What looks at it; by default ±1 along the wave.
        heading: Where the wave goes, degrees from x; its picture turns with it, the square of water does not.
    """
    x = np.linspace(-2, 2, columns)
    y = x if heading else np.array([-2.0, 2.0])
    triangles = grid_triangles(len(x), len(y)).astype(np.int32)
    camera = camera or looking_down((-1, 1, -0.125, 0.125), height=0.9 * wave.height)
    ahead = np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading)), 0.0])
    if heading:
        camera = replace(camera, axes=np.array([ahead, np.cross((0.0, 0.0, 1.0), ahead), (0.0, 0.0, 1.0)]))
    across = np.concatenate([np.stack([x, np.full(len(x), row)], axis=1) for row in y]) @ ahead[:2]
    material = Material(Interaction.DIELECTRIC, ior=wave.ior)

    def sheet(t: float) -> tuple[np.ndarray, np.ndarray]:
        z, nx, nz = wave.smooth(across, t)
        points = grid_points(x, y, lambda _x, _y: z)
        return points, nx[:, None] * ahead + nz[:, None] * (0.0, 0.0, 1.0)

    def surface(shutter: Shutter) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points and normals at mid shutter, and their change over it."""
        if motion == "smooth":
            now, h = sheet(shutter.middle), 1e-4
            early, late = sheet(shutter.middle - h), sheet(shutter.middle + h)
            scale = shutter.exposure / (2 * h)
        else:
            early, late = sheet(shutter.frame), sheet(shutter.frame + 1)
            tau, scale = shutter.middle - shutter.frame, shutter.exposure
            now = tuple((1 - tau) * a + tau * b for a, b in zip(early, late, strict=True))
        return *now, *(scale * (b - a) for a, b in zip(early, late, strict=True))

    def at(shutter: Shutter) -> SceneAtShutter:
        points, normals, motions, turns = surface(shutter)
        moves = {"motions": motions, "normal_motions": turns} if shutter.exposure else {}
        water = MeshAtShutter(
            "/water", points, triangles, normals=normals, normal_indices=triangles, materials=(material,), **moves
        )
        sun = replace(SUN, power=(wave.irradiance,) * 3)
        return SceneAtShutter(shutter, (floor(), water), (sun,), camera)

    return Source(at)


def rod(radius: float, length: float, sides: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A closed cylinder lying along x about the origin: points, triangles, normals (flat on caps) and their indices."""
    angle = 2 * np.pi * np.arange(sides) / sides
    around = np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    half = np.array([0.5 * length, 0, 0])
    points = np.concatenate([radius * around - half, radius * around + half, [-half, half]])
    here = np.arange(sides)
    there = (here + 1) % sides
    side = np.concatenate([np.stack([here, there, here + sides], 1), np.stack([there, there + sides, here + sides], 1)])
    left = np.stack([np.full(sides, 2 * sides), there, here], axis=1)
    right = np.stack([np.full(sides, 2 * sides + 1), here + sides, there + sides], axis=1)
    triangles = np.concatenate([side, left, right]).astype(np.int32)
    normals = np.concatenate([around, [[-1.0, 0, 0], [1.0, 0, 0]]])
    indices = np.concatenate([side % sides, np.full((sides, 3), sides), np.full((sides, 3), sides + 1)])
    return points, triangles, normals, indices.astype(np.int32)


def turning_rod_source(degrees: float, camera: CameraAtShutter, height: float = HEIGHT, sides: int = 256) -> Source:
    """A glass rod (radius 0.15, length 2) above a white floor, turning about the vertical axis through its middle."""
    points, triangles, normals, indices = rod(RADIUS, LENGTH, sides)
    rate = np.radians(degrees)

    def at(shutter: Shutter) -> SceneAtShutter:
        turn = turned((0, 0, rate * shutter.middle + 1e-12))
        moves = {}
        if shutter.exposure:
            spin = np.cross((0, 0, rate * shutter.exposure), turn)
            moves = {"motions": points @ spin, "normal_motions": normals @ spin}
        glass = MeshAtShutter(
            "/glass", points @ turn + (0, 0, height), triangles, normals=normals @ turn, normal_indices=indices,
            materials=(Material(Interaction.DIELECTRIC, ior=1.5),), **moves,
        )  # fmt: skip
        return SceneAtShutter(shutter, (floor(), glass), (SUN,), camera)

    return Source(at)


@cache
def rod_and_truth() -> tuple[Source, np.ndarray]:
    """The rod of :mod:`usd_scenes.oracle.caustic_rod` and its irradiance over [0, 1], whose camera sees no glass."""
    camera = looking_down((-HALF, HALF, -HALF, HALF), height=0.5 * (HEIGHT - RADIUS))
    return turning_rod_source(DEGREES, camera, HEIGHT), irradiance_of_rod(48, 2)
