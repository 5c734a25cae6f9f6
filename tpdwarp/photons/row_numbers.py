"""Rows of whole numbers that are the same: ``np.unique`` of rows, ten times as fast, as it sorts column by column."""

from __future__ import annotations

import numpy as np

# Numbers of rows and of a column together have to fit into 63 bits.
_LARGEST = np.iinfo(np.int64).max
# Values that span less than so many times their count are numbered by a table of all that they might be, in a tenth of
# the time that it takes to sort them.
_WIDEST_TABLE = 8


def row_numbers(*columns: np.ndarray) -> np.ndarray:
    """A number for each row, the same for the same rows: how many others come before it in the order of columns.

    Args:
        columns: Of whole numbers, shape [n] each.

    Returns:
        Numbers from 0 on, shape [n] int64.
    """
    numbers, count = np.zeros(len(columns[0]), np.int64), 1
    for column in columns:
        own, different = _in_order(column)
        if count > _LARGEST // max(different, 1):
            numbers, count = _in_order(numbers)
        numbers, count = numbers * different + own, count * different
    return _in_order(numbers)[0]


def distinct_rows(rows: np.ndarray) -> np.ndarray:
    """The rows of whole numbers [n, k] that differ, in the order of their columns, shape [m, k]."""
    if not len(rows):
        return rows
    numbers = row_numbers(*rows.T)
    out = np.empty((int(numbers.max()) + 1, rows.shape[1]), rows.dtype)
    out[numbers] = rows
    return out


def _in_order(values: np.ndarray) -> tuple[np.ndarray, int]:
    """How many others come before each of whole numbers [n], shape [n] int64, and how many differ."""
    if len(values):
        least = values.min()
        span = int(values.max()) - int(least) + 1
        if span <= _WIDEST_TABLE * len(values):
            places = values - least
            there = np.zeros(span, bool)
            there[places] = True
            before = np.cumsum(there) - 1
            return before[places], int(before[-1]) + 1
    different, found = np.unique(values, return_inverse=True)
    return found.astype(np.int64, copy=False), len(different)
