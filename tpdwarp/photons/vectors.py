"""Lengths, products and areas of many vectors, column by column: several times as fast as row by row."""

from __future__ import annotations

import numpy as np


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors [..., 3], shape [...]."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products of vectors [..., 3], shape [..., 3]."""
    (ax, ay, az), (bx, by, bz) = (np.moveaxis(vectors, -1, 0) for vectors in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def areas(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Areas |a × b| of parallelograms with sides [n, 3], shape [n], in double precision."""
    (ax, ay, az), (bx, by, bz) = (vectors.astype(np.float64).T for vectors in (a, b))
    return np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
