"""Faces with corners that turn inwards: a fan would cover more than they do, so they are cut ear by ear."""

from __future__ import annotations

import numpy as np

# A corner turns inwards by more than rounding of points in single precision makes it seem, or a fan covers so much of
# the face twice, as a part of the face: of a fine outline no corner turns far.
TURN = -1e-6


def concave_faces(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Numbers of the faces of which a corner turns inwards.

    Args:
        points: Positions, shape [v, 3].
        counts: Corners of each face, shape [f].
        indices: Point of each corner, shape [sum(counts)].
    """
    many = np.flatnonzero(counts > 3)
    if len(many) == 0:
        return many
    starts = np.cumsum(counts) - counts
    sizes = counts[many]
    face = np.repeat(np.arange(len(many)), sizes)
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    begin, size = starts[many][face], sizes[face]
    here, after, before = (points[indices[begin + (within + k) % size]] for k in (0, 1, -1))
    # The centre as origin, for faces far from the world's.
    centre = points[indices[starts[many]]][face]
    newell = np.cross(here - centre, after - centre)
    normals = np.stack([np.bincount(face, weights=newell[:, k], minlength=len(many)) for k in range(3)], axis=1)
    turns = np.einsum("ij,ij->i", np.cross(here - before, after - here), normals[face])
    squares = np.einsum("ij,ij->i", normals, normals)
    # The centre is the corner about which a fan is cut.
    folded = np.minimum(np.einsum("ij,ij->i", newell, normals[face]), 0.0)
    twice = np.bincount(face, weights=folded, minlength=len(many)) < TURN * squares
    twice[face[turns < TURN * squares[face]]] = True
    return many[twice]


def ears(polygon: np.ndarray) -> np.ndarray:
    """Triangles that cover a simple polygon in space, as it goes round, shape [n − 2, 3].

    Args:
        polygon: Its corners in order, shape [n, 3]; seen along its vector area.
    """
    flat = _flattened(polygon)
    order = np.argsort(flat[:, 0], kind="stable")
    outline = _Outline(flat, order, flat[order, 0])
    found: list[tuple[int, int, int]] = []
    here = tried = 0
    for left in range(len(flat), 3, -1):
        while tried < left and not outline.is_ear(here):
            here, tried = outline.after[here], tried + 1
        # Where none is an ear it crosses itself: whatever is cut here, something is covered twice.
        before, after = outline.before[here], outline.after[here]
        found.append((before, here, after))
        outline.cut(here)
        here, tried = before, 0
    found.append(tuple(sorted((outline.before[here], here, outline.after[here]))))
    return np.array(found)


class _Outline:
    """What is left of a polygon: corners [n, 2], which goes before and after each, and which do not turn outwards.

    Args:
        corners: Counter-clockwise.
        order: Their numbers by their first coordinate.
        sorted_first: That coordinate in this order.
    """

    def __init__(self, corners: np.ndarray, order: np.ndarray, sorted_first: np.ndarray) -> None:
        numbers = np.arange(len(corners))
        before, after = np.roll(numbers, 1), np.roll(numbers, -1)
        self.before, self.after = before.tolist(), after.tolist()
        self._corners, self._order, self._sorted = corners, order, sorted_first
        self._inward = _turn(corners[before], corners, corners[after]) <= 0

    def is_ear(self, number: int) -> bool:
        if self._inward[number]:
            return False
        a, b, c = ear = self._corners[[self.before[number], number, self.after[number]]]
        # Of corners within a triangle, if there are any, one turns inwards.
        ends = np.searchsorted(self._sorted, (ear[:, 0].min(), np.nextafter(ear[:, 0].max(), np.inf)))
        near = self._order[slice(*ends)]
        others = self._corners[near[self._inward[near]]]
        inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
        # Corners may share a place with the ear's, where a hole is joined to the outline.
        others = others[inside]
        return not bool((others[:, None] != ear).any(axis=2).all(axis=1).any())

    def cut(self, number: int) -> None:
        """Takes a corner away."""
        before, after = self.before[number], self.after[number]
        self.after[before], self.before[after] = after, before
        self._inward[number] = False
        for other in (before, after):
            corners = self._corners[[self.before[other], other, self.after[other]]]
            self._inward[other] = _turn(*corners) <= 0


def _flattened(polygon: np.ndarray) -> np.ndarray:
    """The corners in the plane across the polygon's vector area, counter-clockwise, shape [n, 2]."""
    centred = polygon - polygon.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    axis = np.eye(3)[np.argmin(abs(normal))]
    u = np.cross(axis, normal)
    v = np.cross(normal, u)
    lengths = np.linalg.norm(u), np.linalg.norm(v)
    return centred @ np.stack([u / max(lengths[0], 1e-300), v / max(lengths[1], 1e-300)], axis=1)


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
