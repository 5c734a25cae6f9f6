"""Triangulated shapes to trace."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def grid_triangles(columns: int, rows: int) -> np.ndarray:
    """Two triangles a cell of a grid of ``columns`` × ``rows`` vertices, front side up, shape [m, 3]."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return np.concatenate([lower, upper])


def grid_points(x: np.ndarray, y: np.ndarray, height: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Vertices (x, y, height(x, y)) of a grid, x fastest, shape [len(x) len(y), 3]."""
    across, along = np.meshgrid(x, y)
    across, along = across.ravel(), along.ravel()
    return np.stack([across, along, np.broadcast_to(height(across, along), across.shape)], axis=1)
