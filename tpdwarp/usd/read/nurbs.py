"""NURBS: the weights that control vertices have at places on curves and patches, span by span.

A point is Σ N_i w_i P_i / Σ N_j w_j with the B-splines N of de Boor's recurrence. It is linear in the control vertices
P, so that what moves is evaluated anew by weights that stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# Where control vertices fall together slopes may vanish at the end of a span: they are taken this part further in.
INWARDS = 1e-3


@dataclass(frozen=True, eq=False)
class Span:
    """One span of a B-spline between two of its knots.

    Attributes:
        first: The first of the control vertices that it depends on; the others follow.
        values: Their weights at evenly spread places, both ends included, shape [p, order].
        near: Those where slopes are taken, beside the ends in place of there, shape [p, order].
        slopes: Change of ``near`` by the parameter, shape [p, order].
    """

    first: int
    values: np.ndarray
    near: np.ndarray
    slopes: np.ndarray


def fitting_knots(order: int, count: int, knots: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Knots [count + order] and the first and last parameter [2] of a B-spline, and whether they are the given ones.

    What does not fit is taken for evenly spread knots that hold the first and the last control vertex.
    """
    usable = len(knots) == count + order and np.isfinite(knots).all() and bool((np.diff(knots) >= 0).all())
    inner = knots[[order - 1, count]] if usable else np.zeros(2)
    if not inner[0] < inner[1]:
        middle = np.arange(count - order + 2, dtype=float)
        return np.pad(middle, order - 1, mode="edge"), middle[[0, -1]], False
    if len(limits) != 2 or not np.isfinite(limits).all():
        return knots, inner, True
    low, high = np.clip(limits, *inner)
    return knots, np.array([low, high]) if low < high else inner, True


def spans(order: int, knots: np.ndarray, limits: np.ndarray, pieces: int) -> list[Span]:
    """The spans of a B-spline between two parameters, each looked at in ``pieces`` + 1 places.

    Args:
        order: Degree + 1.
        knots: Knots that do not decrease, shape [n + order].
        limits: First and last parameter, shape [2].
        pieces: Pieces of a span.
    """
    found = []
    for at in range(order - 1, len(knots) - order):
        low, high = max(knots[at], limits[0]), min(knots[at + 1], limits[1])
        if not low < high:
            continue
        places = np.linspace(low, high, pieces + 1)
        inner = np.clip(places, low + INWARDS * (high - low), high - INWARDS * (high - low))
        values, near = _basis(order, knots, at, places), _basis(order, knots, at, inner)
        found.append(Span(at - order + 1, values, near, _basis_slopes(order, knots, at, inner)))
    return found


def _basis(order: int, knots: np.ndarray, at: int, places: np.ndarray) -> np.ndarray:
    """The B-splines that are not zero between knot ``at`` and the next, shape [p, order]."""
    lower = np.ones((len(places), 1))
    for degree in range(1, order):
        higher = np.zeros((len(places), degree + 1))
        for k in range(degree):
            left, right = knots[at - degree + 1 + k], knots[at + 1 + k]
            part = lower[:, k] / (right - left)
            higher[:, k] += (right - places) * part
            higher[:, k + 1] += (places - left) * part
        lower = higher
    return lower


def _basis_slopes(order: int, knots: np.ndarray, at: int, places: np.ndarray) -> np.ndarray:
    """Their derivatives, shape [p, order]."""
    degree = order - 1
    lower = _basis(degree, knots, at, places) if degree else np.zeros((len(places), 0))
    slopes = np.zeros((len(places), order))
    for k in range(degree):
        part = degree * lower[:, k] / (knots[at + 1 + k] - knots[at - degree + 1 + k])
        slopes[:, k] -= part
        slopes[:, k + 1] += part
    return slopes


def rational(values: np.ndarray, slopes: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights and their slopes, shape [..., k] both, of control vertices with weights of their own, shape [..., k]."""
    weighted, changing = values * weights, slopes * weights
    total, change = weighted.sum(axis=-1, keepdims=True), changing.sum(axis=-1, keepdims=True)
    # A total of nothing means nothing; what it gives is no number, and is refused as such.
    with np.errstate(divide="ignore", invalid="ignore"):
        return weighted / total, (changing - weighted * (change / total)) / total


def _rows(found: list[Span], count: int) -> np.ndarray:
    """``values``, ``near`` and ``slopes`` of all spans for all control vertices, shape [3, r, count]."""
    places = len(found[0].values)
    rows = np.zeros((3, len(found) * places, count))
    for number, span in enumerate(found):
        held = slice(span.first, span.first + span.values.shape[1])
        rows[:, number * places : (number + 1) * places, held] = span.values, span.near, span.slopes
    return rows


@dataclass(frozen=True, eq=False)
class Grid:
    """A patch as a grid of points, u fastest.

    Attributes:
        triangles: Counter-clockwise about dP/du × dP/dv, shape [m, 3].
        strongest: The control vertex that weighs most at each point, shape [v].
        place: Gives positions and unit normals [v, 3] for control vertices [n, 3].
    """

    triangles: np.ndarray
    strongest: np.ndarray
    place: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def patch_grid(along_u: list[Span], along_v: list[Span], size: tuple[int, int], weights: np.ndarray) -> Grid:
    """A patch of ``size`` control vertices along u and v, with weights of their own, shape [size[1] · size[0]]."""
    (in_u, near_u, by_u), (in_v, near_v, by_v) = _rows(along_u, size[0]), _rows(along_v, size[1])
    of_vertices = weights.reshape(size[1], size[0], 1)

    def place(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        held = vertices.reshape(size[1], size[0], 3)
        homogeneous = np.concatenate([of_vertices * held, of_vertices], axis=2)
        at, beside, du, dv = (
            np.einsum("bj,jix,ai->bax", v, homogeneous, u, optimize=True).reshape(-1, 4)
            for v, u in ((in_v, in_u), (near_v, near_u), (near_v, by_u), (by_v, near_u))
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            points, close = (found[:, :3] / found[:, 3:] for found in (at, beside))
            # (X' − P S')/S along u and v, but for the scale.
            normals = np.cross(du[:, :3] - close * du[:, 3:], dv[:, :3] - close * dv[:, 3:])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return points, normals / np.maximum(lengths, np.finfo(float).tiny)

    width = len(in_u)
    u, v = (
        (np.arange(len(found))[:, None] * len(found[0].values) + np.arange(len(found[0].values) - 1)).ravel()
        for found in (along_u, along_v)
    )
    corner = (v[:, None] * width + u).ravel()
    triangles = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + width + 1], axis=1),
            np.stack([corner, corner + width + 1, corner + width], axis=1),
        ]
    )
    strongest = (np.argmax(in_v, axis=1)[:, None] * size[0] + np.argmax(in_u, axis=1)).ravel()
    return Grid(triangles, strongest, place)
