"""Merging visible points side by side: footprints are averaged over a pixel, so that one query serves them all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Columns = dict[str, np.ndarray]

# How far samples may lie from their middle, in sides of what they stand for together: on a plane half a side is the
# most, and half as much again is allowed for perspective and curvature. On what curves more, or is seen through glass,
# they spread over more, and each is looked up on its own.
LARGEST_DISTANCE = 0.75
# Normals of points that are put together lie within some 18° of their mean. Chosen, not derived.
SMALLEST_COSINE = 0.95


def merged(columns: Columns, in_sides: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]) -> Columns:
    """Points of the same spot on the same object, put together where they lie close together and face one way.

    Args:
        columns: One row a point: ``spot``, ``receiver``, ``position`` and ``normal`` [n, 3], ``weight`` [n, 3] and
            ``first`` [n], which add up, and ``pixel`` [n], the same for all of a spot; ``shading_normal`` [n, 3] where
            receivers are smooth.
        in_sides: Gives displacements [n, 3], at positions [n, 3] with normals [n, 3], in sides of what a spot stands
            for, shape [n, 2].

    Returns:
        The same columns by spot, with fewer rows.
    """
    keys = ((columns["spot"] * 2 + (columns["first"] == 0)) << 32) + columns["receiver"]
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    columns = {name: values[order] for name, values in columns.items()}
    begins = np.diff(keys, prepend=keys[:1] - 1) != 0
    middle, normal, group = _means(columns, begins)
    apart = in_sides(middle[group], normal[group], columns["position"] - middle[group])
    away = np.abs(apart).max(axis=1) > LARGEST_DISTANCE
    away |= np.sum(columns["normal"] * normal[group], axis=1) < SMALLEST_COSINE
    begins |= np.logical_or.reduceat(away, np.flatnonzero(begins))[group]
    middle, normal, _ = _means(columns, begins)
    starts = np.flatnonzero(begins)
    sums = {name: np.add.reduceat(columns[name], starts) for name in ("weight", "first")}
    alike = {name: columns[name][starts] for name in ("spot", "receiver", "pixel")}
    found = {**alike, **sums, "position": middle, "normal": normal}
    if "shading_normal" in columns:
        # Not of unit length: irradiance goes with the mean of cosines.
        total = np.add.reduceat(columns["shading_normal"].astype(np.float64), starts)
        found["shading_normal"] = (total / np.diff(starts, append=len(begins))[:, None]).astype(np.float32)
    return found


def _means(columns: Columns, begins: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean position and normal [g, 3] of the groups of rows that begin where ``begins``, and each row's group."""
    starts = np.flatnonzero(begins)
    counts = np.diff(starts, append=len(begins))
    middle = np.add.reduceat(columns["position"].astype(np.float64), starts) / counts[:, None]
    normal = np.add.reduceat(columns["normal"].astype(np.float64), starts)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    return middle.astype(np.float32), normal.astype(np.float32), np.cumsum(begins) - 1
