"""Numbers of rows against ``np.unique`` of rows."""

from __future__ import annotations

import numpy as np
import pytest

from tpdwarp.photons.row_numbers import distinct_rows, row_numbers

RNG = np.random.default_rng(5)
ROWS = {
    "few": np.stack([RNG.integers(0, 5, 400), RNG.integers(-3, 3, 400), RNG.integers(0, 2, 400)], axis=1),
    "cells": RNG.integers(-50, 50, (3000, 2)).astype(np.int32),
    "too many for 63 bits together": RNG.integers(-(1 << 62), 1 << 62, (2000, 8))[RNG.integers(0, 2000, 5000)],
    "one column": RNG.integers(0, 9, (50, 1)),
    "one row": np.array([[7, -1]]),
    "none": np.zeros((0, 2), np.int64),
}


@pytest.mark.parametrize("name", ROWS)
def test_rows_have_the_numbers_and_the_order_that_numpy_gives_them(name):
    rows = ROWS[name]
    expected, numbers = np.unique(rows, axis=0, return_inverse=True)
    np.testing.assert_array_equal(row_numbers(*rows.T), numbers.reshape(-1))
    found = distinct_rows(rows)
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == rows.dtype
