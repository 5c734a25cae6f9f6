"""Triangulated shapes: points [v, 3], triangles [m, 3] counter-clockwise seen from outside, unit normals [v, 3]."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Shape = tuple[np.ndarray, np.ndarray, np.ndarray]


def rotation(axis: tuple[float, float, float], degrees: float) -> np.ndarray:
    """Matrix [3, 3] that turns column vectors about ``axis`` (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def moved(points: np.ndarray, offset: tuple[float, float, float]) -> np.ndarray:
    """Points [v, 3], all displaced by ``offset``."""
    return points + np.asarray(offset)


def sphere(around: int = 96, along: int = 48) -> Shape:
    """The unit sphere by longitude and latitude, poles on z."""
    polar = np.pi * np.arange(1, along) / along
    azimuth = 2.0 * np.pi * np.arange(around) / around
    rings = np.stack(
        [
            np.outer(np.sin(polar), np.cos(azimuth)),
            np.outer(np.sin(polar), np.sin(azimuth)),
            np.outer(np.cos(polar), np.ones(around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    points = np.concatenate([[[0.0, 0.0, 1.0]], rings, [[0.0, 0.0, -1.0]]])
    here, there = np.arange(around), (np.arange(around) + 1) % around
    last = len(points) - 1
    low = 1 + np.arange(along - 2)[:, None] * around
    a, b = (low + here).ravel(), (low + there).ravel()
    caps = [
        np.stack([np.zeros(around, int), 1 + here, 1 + there], axis=1),
        np.stack([np.full(around, last), last - around + there, last - around + here], axis=1),
    ]
    sides = [np.stack([a, a + around, b + around], axis=1), np.stack([a, b + around, b], axis=1)]
    return points, np.concatenate([*caps, *sides]), points.copy()


def blob(bump: float = 0.06, seed: int = 4) -> Shape:
    """A sphere whose radius is 1 + ``bump`` · Σ cos(k_i · x) over six wave vectors of length 5 and random heading."""
    points, triangles, _ = sphere()
    random = np.random.default_rng(seed)
    waves = random.normal(size=(6, 3))
    waves *= 5.0 / np.linalg.norm(waves, axis=1, keepdims=True)
    phases = random.uniform(0.0, 2.0 * np.pi, 6)
    angles = points @ waves.T + phases
    radii = 1.0 + bump * np.cos(angles).sum(axis=1)
    # Of r(x/|x|): the part of the gradient across the ray from the centre, over r.
    slopes = -bump * np.sin(angles) @ waves
    slopes -= np.sum(slopes * points, axis=1, keepdims=True) * points
    normals = points - slopes / radii[:, None]
    return points * radii[:, None], triangles, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def torus(thickness: float, around: int = 96, across: int = 40) -> Shape:
    """A torus about z, its centre line of radius 1, its tube of radius ``thickness``."""
    u, v = np.meshgrid(
        2.0 * np.pi * np.arange(around) / around, 2.0 * np.pi * np.arange(across) / across, indexing="ij"
    )
    normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=-1)
    points = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=-1) + thickness * normals
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    corner = [((i + di) % around) * across + (j + dj) % across for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    triangles = [np.stack([corner[0], corner[k], corner[k + 1]], axis=1) for k in (1, 2)]
    return points.reshape(-1, 3), np.concatenate(triangles), normals.reshape(-1, 3)


def box(size: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A box about the origin; no normals: its faces are flat."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.5
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners * size, _halved(np.array(quads))


def prism(width: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """A right-angled isosceles prism along y; its hypotenuse, ``width`` wide, is on top, the right angle below."""
    ends = np.array([[-0.5, 0.0, 0.25], [0.5, 0.0, 0.25], [0.0, 0.0, -0.25]]) * width
    points = np.concatenate([ends - [0, length / 2, 0], moved(ends, (0, length / 2, 0))])
    sides = _halved(np.array([[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]]))
    return points, np.concatenate([sides, [[0, 2, 1], [3, 4, 5]]])


def lens(aperture: float, radius: float, around: int = 96, rings: int = 24) -> Shape:
    """A biconvex lens about z: two spherical caps of ``radius`` that meet at the rim of radius ``aperture``.

    Each cap has its own vertices at the rim, because normals differ there.
    """
    depth = radius - np.sqrt(radius**2 - aperture**2)
    tilt = np.arcsin(aperture / radius) * np.arange(1, rings + 1) / rings
    azimuth = 2.0 * np.pi * np.arange(around) / around
    normals = np.stack(
        [
            np.outer(np.sin(tilt), np.cos(azimuth)),
            np.outer(np.sin(tilt), np.sin(azimuth)),
            np.outer(np.cos(tilt), np.ones(around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    normals = np.concatenate([[[0.0, 0.0, 1.0]], normals])
    points = radius * normals - [0, 0, radius - depth]
    here, there = np.arange(around), (np.arange(around) + 1) % around
    low = 1 + np.arange(rings - 1)[:, None] * around
    a, b = (low + here).ravel(), (low + there).ravel()
    top = np.concatenate(
        [
            np.stack([np.zeros(around, int), 1 + here, 1 + there], axis=1),
            np.stack([a, a + around, b + around], axis=1),
            np.stack([a, b + around, b], axis=1),
        ]
    )
    # The rims must agree to the last bit, or light leaks between the caps.
    points[-around:, 2] = 0.0
    down = [1, 1, -1]
    return (
        np.concatenate([points, points * down]),
        np.concatenate([top, top[:, ::-1] + len(points)]),
        np.concatenate([normals, normals * down]),
    )


def ring(radius: float, height: float, sides: int = 256) -> Shape:
    """A tube without ends, standing on z = 0 about the z axis, its front inside."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    inward = np.tile(-np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1), (2, 1))
    points = -radius * inward
    points[sides:, 2] = height
    here, there = np.arange(sides), (np.arange(sides) + 1) % sides
    return points, _halved(np.stack([there, here, here + sides, there + sides], axis=1)), inward


def sheet(
    size: float, cells: int, height: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
) -> Shape:
    """A square height field about the z axis, its front up; ``height`` gives z, ∂z/∂x and ∂z/∂y for x and y."""
    steps = size * (np.arange(cells + 1) / cells - 0.5)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    z, zx, zy = height(x, y)
    normals = np.stack([-zx, -zy, np.ones_like(x)], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    return (
        np.stack([x, y, z], axis=1),
        _halved(corner + np.array([0, 1, cells + 2, cells + 1])),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
    )


def rectangle(width: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """A flat rectangle about the origin in z = 0, its front up; no normals."""
    corners = 0.5 * np.array([[-width, -depth, 0], [width, -depth, 0], [width, depth, 0], [-width, depth, 0]])
    return corners, _halved(np.array([[0, 1, 2, 3]]))


def _halved(quads: np.ndarray) -> np.ndarray:
    """Two triangles of each quadrilateral [n, 4]."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
