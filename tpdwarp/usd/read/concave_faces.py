"""Faces with corners that turn inwards: a fan would cover more than they do, so they are cut ear by ear."""

from __future__ import annotations

import numpy as np

# A corner turns inwards by more than rounding of points in single precision makes it seem.
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
    inwards = turns < TURN * np.einsum("ij,ij->i", normals, normals)[face]
    return many[np.unique(face[inwards])]


def ears(polygon: np.ndarray) -> np.ndarray:
    """Triangles that cover a simple polygon in space, as it goes round, shape [n − 2, 3].

    Args:
        polygon: Its corners in order, shape [n, 3]; seen along its vector area.
    """
    flat = _flattened(polygon)
    left = list(range(len(flat)))
    found: list[tuple[int, int, int]] = []
    first = 0
    while len(left) > 3:
        for step in range(len(left)):
            k = (first + step) % len(left)
            before, ear, after = left[k - 1], left[k], left[(k + 1) % len(left)]
            if _is_ear(flat, left, before, ear, after):
                break
        else:
            # It crosses itself: whatever is cut here, something is covered twice.
            k = 0
            before, ear, after = left[-1], left[0], left[1]
        found.append((before, ear, after))
        del left[k]
        first = max(k - 1, 0)
    found.append(tuple(left))
    return np.array(found)


def _flattened(polygon: np.ndarray) -> np.ndarray:
    """The corners in the plane across the polygon's vector area, counter-clockwise, shape [n, 2]."""
    centred = polygon - polygon.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    axis = np.eye(3)[np.argmin(abs(normal))]
    u = np.cross(axis, normal)
    v = np.cross(normal, u)
    lengths = np.linalg.norm(u), np.linalg.norm(v)
    return centred @ np.stack([u / max(lengths[0], 1e-300), v / max(lengths[1], 1e-300)], axis=1)


def _is_ear(flat: np.ndarray, left: list[int], before: int, ear: int, after: int) -> bool:
    a, b, c = flat[before], flat[ear], flat[after]
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[k for k in left if k not in (before, ear, after)]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    # Corners may share a place with the ear's, where a hole is joined to the outline.
    apart = ~np.any([(others == corner).all(axis=1) for corner in (a, b, c)], axis=0)
    return not bool((inside & apart).any())


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
