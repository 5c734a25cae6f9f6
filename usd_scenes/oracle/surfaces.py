"""Moving surfaces that rays can meet: triangle meshes and a few analytic shapes, all evaluated at any time.

Every surface answers four questions, at one time ``t``:

- ``intersect``: which primitive does a ray meet first, and how far away (infinite where it misses);
- ``distances``: how far is a *given* primitive, extended beyond its edges: what finite differences need;
- ``frame``: geometric normal, shading normal and surface coordinates at a hit;
- ``follow``: where is the material point of a hit at another time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tpdwarp.scene.description import Interaction

from .optics import dot, unit

Vector = tuple[float, float, float] | np.ndarray
Moving = Vector | Callable[[float], Vector]


def at_time(value: Moving, t: float) -> np.ndarray:
    """A fixed or time-dependent vector at time ``t``, shape [3] or [k, 3]."""
    return np.asarray(value(t) if callable(value) else value, dtype=np.float64)


class Surface(Protocol):
    """What the tracer asks of a surface; rays are [n, 3], primitives [n], times scalar."""

    name: str
    interaction: Interaction
    ior: float

    def intersect(
        self, origins: np.ndarray, directions: np.ndarray, t: float, leaving: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances (infinite where missed) and primitives, [n] each; ``leaving`` [n] is the primitive left, or −1."""
        ...

    def distances(
        self, primitives: np.ndarray, origins: np.ndarray, directions: np.ndarray, t: float, guess: np.ndarray
    ) -> np.ndarray:
        """Distances [n] to the given primitives continued beyond their edges, near ``guess`` [n]."""
        ...

    def frame(
        self, positions: np.ndarray, primitives: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Geometric normals, shading normals, barycentrics (NaN where there are none), [n, 3] each."""
        ...

    def follow(self, positions: np.ndarray, primitives: np.ndarray, start: float, end: float) -> np.ndarray:
        """Where the material points at ``positions`` [n, 3] at time ``start`` are at time ``end``, shape [n, 3]."""
        ...


def nearest_distance(origins: np.ndarray) -> float:
    """Shortest distance that counts as a hit: rounding of a float64 position on the surface just left."""
    return 1e-10 * max(1.0, float(np.abs(origins).max(initial=0.0)))


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles whose vertices move; flat shaded, or with interpolated vertex normals.

    Attributes:
        name: How messages and tests call it.
        points: Vertex positions at a time, [v, 3], or a fixed array.
        triangles: Vertex indices, counter-clockwise seen from the front, shape [m, 3].
        normals: Vertex normals at a time, [k, 3], or a fixed array, or None for flat shading.
        normal_indices: Normal of each corner, shape [m, 3]; None where normals go with the vertices.
        interaction: What happens to light.
        ior: Index inside (behind the front side) relative to outside.
    """

    name: str
    points: Moving
    triangles: np.ndarray
    normals: Moving | None = None
    normal_indices: np.ndarray | None = None
    interaction: Interaction = Interaction.DIFFUSE
    ior: float = 1.5

    def _corners(self, primitives: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        corners = at_time(self.points, t)[np.asarray(self.triangles)[primitives]]
        return corners[:, 0], corners[:, 1], corners[:, 2]

    def intersect(
        self, origins: np.ndarray, directions: np.ndarray, t: float, leaving: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Möller–Trumbore over all triangles; edges belong to both neighbours, so that rays do not leak."""
        count = len(self.triangles)
        a, b, c = self._corners(np.arange(count), t)
        e1, e2 = b - a, c - a
        nearest, primitives = np.full(len(origins), np.inf), np.full(len(origins), -1)
        slack = 1e-12
        for rays in np.array_split(np.arange(len(origins)), max(1, len(origins) * count // 500_000)):
            o, d = origins[rays, None], directions[rays, None]
            p = np.cross(d, e2)
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = 1 / dot(e1, p)
                s = o - a
                q = np.cross(s, e1)
                beta1, beta2 = dot(s, p) * inverse, dot(d, q) * inverse
                distance = dot(e2, q) * inverse
                hit = (beta1 >= -slack) & (beta2 >= -slack) & (beta1 + beta2 <= 1 + slack)
                hit &= (distance > nearest_distance(origins)) & np.isfinite(distance)
            hit &= leaving[rays, None] != np.arange(count)
            distance = np.where(hit, distance, np.inf)
            best = np.argmin(distance, axis=1)
            nearest[rays] = distance[np.arange(len(rays)), best]
            primitives[rays] = best
        return nearest, primitives

    def distances(
        self, primitives: np.ndarray, origins: np.ndarray, directions: np.ndarray, t: float, guess: np.ndarray
    ) -> np.ndarray:
        """Distances to the planes of the triangles."""
        a, b, c = self._corners(primitives, t)
        plane = np.cross(b - a, c - a)
        return dot(plane, a - origins) / dot(plane, directions)

    def barycentrics(self, positions: np.ndarray, primitives: np.ndarray, t: float) -> np.ndarray:
        """Barycentric coordinates of points in the planes of their triangles, shape [n, 3], summing to one."""
        a, b, c = self._corners(primitives, t)
        plane = np.cross(b - a, c - a)
        scale = dot(plane, plane)
        beta1 = dot(np.cross(c - a, positions - a), -plane) / scale
        beta2 = dot(np.cross(b - a, positions - a), plane) / scale
        return np.stack([1 - beta1 - beta2, beta1, beta2], axis=1)

    def frame(
        self, positions: np.ndarray, primitives: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Triangle normals and interpolated, normalised vertex normals."""
        a, b, c = self._corners(primitives, t)
        geometric = unit(np.cross(b - a, c - a))
        weights = self.barycentrics(positions, primitives, t)
        if self.normals is None:
            return geometric, geometric, weights
        indices = np.asarray(self.triangles if self.normal_indices is None else self.normal_indices)
        corner_normals = at_time(self.normals, t)[indices[primitives]]
        return geometric, unit(np.einsum("nk,nki->ni", weights, corner_normals)), weights

    def follow(self, positions: np.ndarray, primitives: np.ndarray, start: float, end: float) -> np.ndarray:
        """Same triangle, same barycentrics."""
        weights = self.barycentrics(positions, primitives, start)
        return np.einsum("nk,nki->ni", weights, np.stack(self._corners(primitives, end), axis=1))


@dataclass(frozen=True, eq=False)
class Plane:
    """An infinite plane that translates (its normal may turn; its material then follows ``point`` only).

    Attributes:
        name: How messages and tests call it.
        point: A material point of it, fixed or at a time.
        normal: Front side, fixed or at a time.
        interaction, ior: As for meshes.
    """

    name: str
    point: Moving
    normal: Moving
    interaction: Interaction = Interaction.DIFFUSE
    ior: float = 1.5

    def intersect(
        self, origins: np.ndarray, directions: np.ndarray, t: float, leaving: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        primitives = np.zeros(len(origins), dtype=int)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = self.distances(primitives, origins, directions, t, primitives)
            hit = (distance > nearest_distance(origins)) & (leaving != 0) & np.isfinite(distance)
        return np.where(hit, distance, np.inf), primitives

    def distances(
        self, primitives: np.ndarray, origins: np.ndarray, directions: np.ndarray, t: float, guess: np.ndarray
    ) -> np.ndarray:
        normal = at_time(self.normal, t)
        return (at_time(self.point, t) - origins) @ normal / (directions @ normal)

    def frame(
        self, positions: np.ndarray, primitives: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        normal = np.broadcast_to(unit(at_time(self.normal, t)), positions.shape)
        return normal, normal, np.full(positions.shape, np.nan)

    def follow(self, positions: np.ndarray, primitives: np.ndarray, start: float, end: float) -> np.ndarray:
        return positions + at_time(self.point, end) - at_time(self.point, start)


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An axis-aligned ellipsoid (a sphere for equal semi-axes) that translates; outside is in front.

    Its primitives are the nearer (0) and the farther (1) of a line's two crossings.

    Attributes:
        name: How messages and tests call it.
        center: Centre, fixed or at a time.
        semi_axes: Along x, y, z; negative semi-axes turn the front side inwards.
        interaction, ior: As for meshes.
    """

    name: str
    center: Moving
    semi_axes: Vector
    interaction: Interaction = Interaction.DIELECTRIC
    ior: float = 1.5

    def _crossings(self, origins: np.ndarray, directions: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        axes = np.abs(np.asarray(self.semi_axes, dtype=np.float64))
        o, d = (origins - at_time(self.center, t)) / axes, directions / axes
        a, b = dot(d, d), dot(o, d)
        # |o + λd|² = 1 through the closest point: exact where the ray starts far away.
        closest = o - (b / a)[:, None] * d
        with np.errstate(invalid="ignore"):
            half = np.sqrt((1 - dot(closest, closest)) / a)
        return -b / a - half, -b / a + half

    def intersect(
        self, origins: np.ndarray, directions: np.ndarray, t: float, leaving: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        near, far = self._crossings(origins, directions, t)
        minimum = nearest_distance(origins)
        with np.errstate(invalid="ignore"):
            primitives = np.where(near > minimum, 0, 1)
            distance = np.where(near > minimum, near, np.where(far > minimum, far, np.inf))
        return distance, primitives

    def distances(
        self, primitives: np.ndarray, origins: np.ndarray, directions: np.ndarray, t: float, guess: np.ndarray
    ) -> np.ndarray:
        near, far = self._crossings(origins, directions, t)
        return np.where(primitives == 0, near, far)

    def frame(
        self, positions: np.ndarray, primitives: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        axes = np.asarray(self.semi_axes, dtype=np.float64)
        normal = unit((positions - at_time(self.center, t)) / (axes * np.abs(axes)))
        return normal, normal, np.full(positions.shape, np.nan)

    def follow(self, positions: np.ndarray, primitives: np.ndarray, start: float, end: float) -> np.ndarray:
        return positions + at_time(self.center, end) - at_time(self.center, start)


@dataclass(frozen=True, eq=False)
class HeightField:
    """A surface z = height(x, y, t) with analytic slopes, whose material moves vertically; its front side is up.

    Attributes:
        name: How messages and tests call it.
        height: Heights [n] for x [n], y [n] and a time.
        slopes: (∂z/∂x, ∂z/∂y), [n] each, for x, y and a time.
        bounds: Lowest and highest z the surface ever reaches.
        interaction, ior: As for meshes.
        reach: How far horizontal rays are followed.
        samples: Steps in which a first crossing is looked for.
    """

    name: str
    height: Callable[[np.ndarray, np.ndarray, float], np.ndarray]
    slopes: Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]
    bounds: tuple[float, float]
    interaction: Interaction = Interaction.DIELECTRIC
    ior: float = 1.33
    reach: float = 100.0
    samples: int = 256

    def _above(self, positions: np.ndarray, t: float) -> np.ndarray:
        return positions[..., 2] - self.height(positions[..., 0], positions[..., 1], t)

    def intersect(
        self, origins: np.ndarray, directions: np.ndarray, t: float, leaving: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        minimum = nearest_distance(origins)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.array(self.bounds) + np.array([-1e-6, 1e-6]) - origins[:, 2:]) / directions[:, 2:]
        ends = np.clip(np.nan_to_num(np.sort(ends, axis=1), nan=self.reach), minimum, self.reach)
        steps = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * np.linspace(0, 1, self.samples + 1)
        above = self._above(origins[:, None] + steps[..., None] * directions[:, None], t) > 0
        crossed = above[:, 1:] != above[:, :-1]
        first, rows = np.argmax(crossed, axis=1), np.arange(len(origins))
        low, high, start = steps[rows, first], steps[rows, first + 1], above[rows, first]
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = (self._above(origins + middle[:, None] * directions, t) > 0) == start
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return np.where(crossed.any(axis=1), 0.5 * (low + high), np.inf), np.zeros(len(origins), dtype=int)

    def distances(
        self, primitives: np.ndarray, origins: np.ndarray, directions: np.ndarray, t: float, guess: np.ndarray
    ) -> np.ndarray:
        """The crossing that Newton's method finds from ``guess``; NaN where it finds none."""
        distance = np.array(guess, dtype=np.float64)
        for _ in range(30):
            positions = origins + distance[:, None] * directions
            zx, zy = self.slopes(positions[:, 0], positions[:, 1], t)
            rate = directions[:, 2] - zx * directions[:, 0] - zy * directions[:, 1]
            step = self._above(positions, t) / rate
            distance = distance - step
        return np.where(np.abs(step) < 1e-11 * np.maximum(1, np.abs(distance)), distance, np.nan)

    def frame(
        self, positions: np.ndarray, primitives: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        zx, zy = self.slopes(positions[:, 0], positions[:, 1], t)
        normal = unit(np.stack(np.broadcast_arrays(-zx, -zy, np.ones(len(positions))), axis=1))
        return normal, normal, np.full(positions.shape, np.nan)

    def follow(self, positions: np.ndarray, primitives: np.ndarray, start: float, end: float) -> np.ndarray:
        moved = positions.copy()
        moved[:, 2] = self.height(positions[:, 0], positions[:, 1], end)
        return moved
