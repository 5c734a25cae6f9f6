"""One step of refinement, and the limit, of Catmull-Clark's and Loop's schemes with creases and corners.

References: E. Catmull, J. Clark (1978); C. Loop (1987); M. Halstead, M. Kass, T. DeRose (1993) for limits and
tangents; T. DeRose, M. Kass, T. Truong (1998) for creases of finite sharpness.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tpdwarp.usd.read.subdivision.connectivity import Connectivity, summed


class Rules:
    """What both schemes share: sharp edges and vertices. Points have shape [v, 3].

    Args:
        mesh: The mesh refined, or brought to its limit.
    """

    def __init__(self, mesh: Connectivity) -> None:
        self.mesh = mesh

    def refined_points(self, points: np.ndarray) -> np.ndarray:
        """The points of the next level: first those of vertices, then of edges (then of faces)."""
        return np.concatenate([self._vertex_points(points), self._edge_points(points), *self._face_points(points)])

    def refined(self) -> tuple[Connectivity, np.ndarray]:
        """The mesh of the next level, and the face each of its faces is part of."""
        counts, indices, parents = self._children()
        mesh, levels = self.mesh, (lambda sharpness: np.maximum(sharpness - 1.0, 0.0))
        vertex_count = mesh.vertex_count + len(mesh.edges) + self._extra()
        child = Connectivity.of(counts, indices, vertex_count)
        # An edge point lies between the halves of its edge, which stay as sharp less one.
        low, high = child.edges.T
        half = (low < mesh.vertex_count) & (high >= mesh.vertex_count) & (high < mesh.vertex_count + len(mesh.edges))
        inherited = np.zeros(len(child.edges))
        inherited[half] = levels(mesh.sharpness)[high[half] - mesh.vertex_count]
        np.maximum(child.sharpness, inherited, out=child.sharpness)
        child.corner_sharpness[: mesh.vertex_count] = levels(mesh.corner_sharpness)
        return child, parents

    def limit_points(self, points: np.ndarray) -> np.ndarray:
        """Where the points end after endless refinement."""
        crease, corner = self._kinds(self.mesh.sharpness, self.mesh.corner_sharpness)
        limit = self._smooth_limit(points)
        limit[crease] = ((4.0 * points + self._sharp_neighbours(points, self.mesh.sharpness)) / 6.0)[crease]
        limit[corner] = points[corner]
        return limit

    def smooth(self) -> np.ndarray:
        """Whether each vertex has one tangent plane, shape [v]."""
        crease, corner = self._kinds(self.mesh.sharpness, self.mesh.corner_sharpness)
        return ~(crease | corner)

    def limit_normals(self, points: np.ndarray) -> np.ndarray:
        """Normals (of any length) at the limits of smooth vertices, shape [v, 3]; elsewhere they mean nothing."""
        first, second = self._tangents(points)
        return np.cross(first, second)

    def corner_values(self, values: np.ndarray) -> np.ndarray:
        """Values at the corners of the next level [c', k] for those at the corners of this one [c, k], linearly."""
        raise NotImplementedError

    def _kinds(self, sharpness: np.ndarray, corner_sharpness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which vertices lie on a crease, and which are corners."""
        sharp = np.bincount(self.mesh.edges[sharpness > 0].ravel(), minlength=self.mesh.vertex_count)
        corner = (corner_sharpness > 0) | (sharp > 2) | (self.mesh.valence == 0)
        return (sharp == 2) & ~corner, corner

    def _sharp_neighbours(self, points: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
        return self.mesh.neighbours(points, np.flatnonzero(sharpness > 0))

    def _vertex_points(self, points: np.ndarray) -> np.ndarray:
        """By the rule of this level's sharpness; where that ends within the level, mixed with the next one's."""
        mesh = self.mesh
        now = self._by_rule(points, mesh.sharpness, mesh.corner_sharpness)
        ending, ending_corner = ((s > 0) & (s < 1) for s in (mesh.sharpness, mesh.corner_sharpness))
        if not (ending.any() or ending_corner.any()):
            return now
        later = self._by_rule(points, np.maximum(mesh.sharpness - 1, 0), np.maximum(mesh.corner_sharpness - 1, 0))
        ends = mesh.edges[ending].ravel()
        count = np.bincount(ends, minlength=mesh.vertex_count) + ending_corner
        share = np.bincount(ends, np.repeat(mesh.sharpness[ending], 2), mesh.vertex_count)
        share += np.where(ending_corner, mesh.corner_sharpness, 0.0)
        share = np.where(count > 0, share / np.maximum(count, 1), 1.0)[:, None]
        return share * now + (1.0 - share) * later

    def _by_rule(self, points: np.ndarray, sharpness: np.ndarray, corner_sharpness: np.ndarray) -> np.ndarray:
        crease, corner = self._kinds(sharpness, corner_sharpness)
        found = self._smooth_vertices(points)
        found[crease] = (0.75 * points + 0.125 * self._sharp_neighbours(points, sharpness))[crease]
        found[corner] = points[corner]
        return found

    def _edge_points(self, points: np.ndarray) -> np.ndarray:
        a, b = self.mesh.edges.T
        middle = 0.5 * (points[a] + points[b])
        sharp = np.clip(self.mesh.sharpness, 0.0, 1.0)[:, None]
        return sharp * middle + (1.0 - sharp) * self._smooth_edges(points, middle)

    def _face_points(self, points: np.ndarray) -> list[np.ndarray]:
        return []

    def _extra(self) -> int:
        return 0

    def _children(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        raise NotImplementedError

    def _smooth_vertices(self, points: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def _smooth_edges(self, points: np.ndarray, middle: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def _smooth_limit(self, points: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def _tangents(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        raise NotImplementedError

    def _angles(self) -> tuple[np.ndarray, np.ndarray]:
        """Angle 2π i / n of each corner in its ring, and 2π / n, shapes [c] and [c]."""
        place, _ = self.mesh.around
        step = 2.0 * np.pi / np.maximum(self.mesh.face_valence, 1)[self.mesh.indices]
        return place * step, step


class CatmullClark(Rules):
    """Faces of any number of corners become quadrilaterals; limits ask for quadrilaterals."""

    def corner_values(self, values: np.ndarray) -> np.ndarray:
        mesh = self.mesh
        middle = 0.5 * (values + values[mesh.after])
        centre = self._means(values)[mesh.face_of]
        return np.stack([values, middle, centre, middle[mesh.before]], axis=1).reshape(-1, values.shape[1])

    def _means(self, values: np.ndarray) -> np.ndarray:
        """Mean over the corners of each face, for values at corners."""
        mesh = self.mesh
        return summed(mesh.face_of, values, len(mesh.counts)) / np.maximum(mesh.counts, 1)[:, None]

    def _face_points(self, points: np.ndarray) -> list[np.ndarray]:
        return [self._means(points[self.mesh.indices])]

    def _extra(self) -> int:
        return len(self.mesh.counts)

    def _children(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mesh = self.mesh
        edge = mesh.vertex_count + mesh.edge_of
        face = mesh.vertex_count + len(mesh.edges) + mesh.face_of
        indices = np.stack([mesh.indices, edge, face, edge[mesh.before]], axis=1).ravel()
        return np.full(len(mesh.indices), 4), indices, mesh.face_of

    def _smooth_vertices(self, points: np.ndarray) -> np.ndarray:
        mesh = self.mesh
        n = np.maximum(mesh.valence, 1)[:, None].astype(float)
        centres = self._means(points[mesh.indices])[mesh.face_of]
        return ((n - 2) * points + (mesh.neighbours(points) + mesh.summed(mesh.indices, centres)) / n) / n

    def _smooth_edges(self, points: np.ndarray, middle: np.ndarray) -> np.ndarray:
        mesh = self.mesh
        centres = self._means(points[mesh.indices])[mesh.face_of]
        return 0.5 * middle + 0.25 * summed(mesh.edge_of, centres, len(mesh.edges))

    def _smooth_limit(self, points: np.ndarray) -> np.ndarray:
        mesh = self.mesh
        n = np.maximum(mesh.valence, 1)[:, None].astype(float)
        across = mesh.summed(mesh.indices, points[self._opposite])
        return (n * n * points + 4.0 * mesh.neighbours(points) + across) / (n * (n + 5.0))

    def _tangents(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mesh = self.mesh
        along, across = points[mesh.indices[mesh.after]], points[self._opposite]
        first, second = (
            mesh.summed(mesh.indices, weight * along + weight_across * across)
            for weight, weight_across in self._tangent_weights
        )
        return first, second

    @cached_property
    def _tangent_weights(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Weights of the next vertex and of the one across at each corner, shapes [c, 1], for either tangent."""
        angle, step = self._angles()
        weight = 1.0 + np.cos(step) + np.cos(0.5 * step) * np.sqrt(2.0 * (9.0 + np.cos(step)))
        return [
            ((weight * wave(angle))[:, None], (wave(angle) + wave(angle + step))[:, None]) for wave in (np.cos, np.sin)
        ]

    @cached_property
    def _opposite(self) -> np.ndarray:
        """The vertex across the quadrilateral from each corner, shape [c]."""
        return self.mesh.indices[self.mesh.after[self.mesh.after]]


class Loop(Rules):
    """Triangles only."""

    def corner_values(self, values: np.ndarray) -> np.ndarray:
        mesh = self.mesh
        middle = 0.5 * (values + values[mesh.after])
        outer = np.stack([values, middle, middle[mesh.before]], axis=1).reshape(-1, 9, values.shape[1])
        return np.concatenate([outer, middle.reshape(-1, 3, values.shape[1])], axis=1).reshape(-1, values.shape[1])

    def _children(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mesh = self.mesh
        edge = mesh.vertex_count + mesh.edge_of
        outer = np.stack([mesh.indices, edge, edge[mesh.before]], axis=1).reshape(-1, 9)
        indices = np.concatenate([outer, edge.reshape(-1, 3)], axis=1).ravel()
        return np.full(4 * len(mesh.counts), 3), indices, np.repeat(np.arange(len(mesh.counts)), 4)

    def _weight(self) -> np.ndarray:
        """β: the weight of each neighbour of a smooth vertex, shape [v, 1]."""
        n = np.maximum(self.mesh.valence, 1)[:, None].astype(float)
        return (0.625 - (0.375 + 0.25 * np.cos(2.0 * np.pi / n)) ** 2) / n

    def _smooth_vertices(self, points: np.ndarray) -> np.ndarray:
        weight = self._weight()
        return (1.0 - self.mesh.valence[:, None] * weight) * points + weight * self.mesh.neighbours(points)

    def _smooth_edges(self, points: np.ndarray, middle: np.ndarray) -> np.ndarray:
        mesh = self.mesh
        across = summed(mesh.edge_of, points[mesh.indices[mesh.before]], len(mesh.edges))
        return 0.75 * middle + 0.125 * across

    def _smooth_limit(self, points: np.ndarray) -> np.ndarray:
        n = self.mesh.valence[:, None]
        weight = 1.0 / (n + 0.375 / self._weight())
        return (1.0 - n * weight) * points + weight * self.mesh.neighbours(points)

    def _tangents(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mesh = self.mesh
        along = points[mesh.indices[mesh.after]]
        first, second = (mesh.summed(mesh.indices, weight * along) for weight in self._tangent_weights)
        return first, second

    @cached_property
    def _tangent_weights(self) -> list[np.ndarray]:
        """Weights of the next vertex at each corner, shape [c, 1], for either tangent."""
        angle, _ = self._angles()
        return [wave(angle)[:, None] for wave in (np.cos, np.sin)]
