"""What a polygonal mesh is connected by: edges with their sharpness, and the faces around each vertex in order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

# From this sharpness on an edge or a corner stays sharp at every level (UsdGeomMesh, SHARPNESS_INFINITE).
INFINITE = 10.0


@dataclass(frozen=True, eq=False)
class Connectivity:
    """A polygonal mesh. Corners are the places of vertices in faces, in the order in which faces list them.

    Attributes:
        counts: Corners of each face, shape [f].
        indices: Vertex of each corner, shape [c].
        vertex_count: Number of vertices.
        edges: Vertices of each edge, the lower first, shape [e, 2].
        edge_of: Edge from each corner to the next one of its face, shape [c].
        sharpness: Sharpness of each edge, infinite where it has not two faces on two sides, shape [e].
        corner_sharpness: Sharpness of each vertex, shape [vertex_count].
    """

    counts: np.ndarray
    indices: np.ndarray
    vertex_count: int
    edges: np.ndarray
    edge_of: np.ndarray
    sharpness: np.ndarray
    corner_sharpness: np.ndarray

    @classmethod
    def of(
        cls,
        counts: np.ndarray,
        indices: np.ndarray,
        vertex_count: int,
        creases: dict[tuple[int, int], float] | None = None,
        corner_sharpness: np.ndarray | None = None,
    ) -> Connectivity:
        """Finds the edges of a mesh; ``creases`` holds sharpness by vertices, the lower first."""
        after = indices[_next(counts)]
        keys = np.minimum(indices, after) * vertex_count + np.maximum(indices, after)
        known, edge_of, faces = np.unique(keys, return_inverse=True, return_counts=True)
        edges = np.stack(np.divmod(known, vertex_count), axis=1)
        sharpness = np.zeros(len(edges))
        if creases:
            wanted = np.array([a * vertex_count + b for a, b in creases], dtype=np.int64)
            place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
            there = known[place] == wanted
            sharpness[place[there]] = np.array(list(creases.values()))[there]
        # Two faces that run along an edge the same way are not two sides of one surface.
        direction = np.bincount(edge_of, weights=np.where(indices < after, 1.0, -1.0))
        sharpness[(faces != 2) | (direction != 0)] = np.inf
        corners = np.zeros(vertex_count) if corner_sharpness is None else corner_sharpness
        sharpness[sharpness >= INFINITE] = np.inf
        corners = np.where(corners >= INFINITE, np.inf, corners)
        return cls(counts, indices, vertex_count, edges, edge_of, sharpness, corners)

    @cached_property
    def starts(self) -> np.ndarray:
        """First corner of each face, shape [f]."""
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def face_of(self) -> np.ndarray:
        """Face of each corner, shape [c]."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def after(self) -> np.ndarray:
        """Next corner of the same face, shape [c]."""
        return _next(self.counts)

    @cached_property
    def before(self) -> np.ndarray:
        """Previous corner of the same face, shape [c]."""
        found = np.empty_like(self.after)
        found[self.after] = np.arange(len(self.after))
        return found

    @cached_property
    def valence(self) -> np.ndarray:
        """Number of edges at each vertex, shape [vertex_count]."""
        return np.bincount(self.edges.ravel(), minlength=self.vertex_count)

    @cached_property
    def face_valence(self) -> np.ndarray:
        """Number of faces at each vertex, shape [vertex_count]."""
        return np.bincount(self.indices, minlength=self.vertex_count)

    @cached_property
    def twins(self) -> np.ndarray:
        """The corner whose edge is that of each corner, run along the other way; −1 where it has none, shape [c]."""
        order = np.argsort(self.edge_of, kind="stable")
        manifold = np.bincount(self.edge_of) == 2
        manifold &= np.bincount(self.edge_of, np.where(self.indices < self.indices[self.after], 1.0, -1.0)) == 0
        pairs = order[manifold[self.edge_of[order]]].reshape(-1, 2)
        found = np.full(len(self.indices), -1)
        found[pairs[:, 0]], found[pairs[:, 1]] = pairs[:, 1], pairs[:, 0]
        return found

    @cached_property
    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """Place of each corner in the ring about its vertex, and its sector between sharp edges; shapes [c] and [c].

        Rings run counter-clockwise seen from the front. Corners that no ring reaches have sectors of their own.
        """
        count = len(self.indices)
        sharp = self.sharpness > 0
        priority = np.where(self.twins < 0, 0, np.where(sharp[self.edge_of], 1, 2))
        order = np.lexsort((np.arange(count), priority, self.indices))
        vertices, first = np.unique(self.indices[order], return_index=True)
        begin = order[first]
        place, sector = np.full(count, -1), np.arange(count) + count
        here, crossed = begin.copy(), np.zeros(len(vertices), dtype=np.int64)
        step = 0
        while len(here):
            place[here], sector[here] = step, crossed
            crossed = crossed + sharp[self.edge_of[self.before[here]]]
            following = self.twins[self.before[here]]
            goes_on = (following >= 0) & (following != begin) & (place[following] < 0)
            here, begin, crossed = following[goes_on], begin[goes_on], crossed[goes_on]
            step += 1
        return place, sector

    def summed(self, at: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Sums of rows [k, 3] over the vertices ``at`` [k], shape [vertex_count, 3]."""
        return summed(at, values, self.vertex_count)

    def neighbours(self, points: np.ndarray, edges: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Sum of the other ends of the edges (or of some) at each vertex, shape [vertex_count, 3]."""
        a, b = self.edges[edges].T
        return self.summed(a, points[b]) + self.summed(b, points[a])


def summed(at: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums of rows [k, 3] by their numbers ``at`` [k], shape [count, 3]."""
    return np.stack([np.bincount(at, weights=values[:, k], minlength=count) for k in range(values.shape[1])], axis=1)


def _next(counts: np.ndarray) -> np.ndarray:
    following = np.arange(1, counts.sum() + 1)
    ends = np.cumsum(counts)
    whole = counts > 0
    following[ends[whole] - 1] = (ends - counts)[whole]
    return following
