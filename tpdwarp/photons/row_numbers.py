"""Rows of whole numbers that are the same: ``np.unique`` of rows, ten times as fast, as it sorts column by column."""

from __future__ import annotations

import numpy as np

# Numbers of rows and of a column together have to fit into 63 bits.
_LARGEST = np.iinfo(np.int64).max


def row_numbers(*columns: np.ndarray) -> np.ndarray:
    """A number for each row, the same for the same rows: how many others come before it in the order of columns.

    Args:
        columns: Of whole numbers, shape [n] each.

    Returns:
        Numbers from 0 on, shape [n] int64.
    """
    numbers, count = np.zeros(len(columns[0]), np.int64), 1
    for column in columns:
        values, own = np.unique(column, return_inverse=True)
        if count > _LARGEST // max(len(values), 1):
            numbers, count = _from_zero(numbers)
        numbers, count = numbers * len(values) + own, count * len(values)
    return _from_zero(numbers)[0]


def distinct_rows(rows: np.ndarray) -> np.ndarray:
    """The rows of whole numbers [n, k] that differ, in the order of their columns, shape [m, k]."""
    if not len(rows):
        return rows
    numbers = row_numbers(*rows.T)
    out = np.empty((int(numbers.max()) + 1, rows.shape[1]), rows.dtype)
    out[numbers] = rows
    return out


def _from_zero(numbers: np.ndarray) -> tuple[np.ndarray, int]:
    """The same numbers without gaps, and how many differ."""
    values, found = np.unique(numbers, return_inverse=True)
    return found.astype(np.int64, copy=False), len(values)
