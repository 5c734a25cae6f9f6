"""Which cells of a grid lie along ways over it."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tpdwarp.trajectories.swept import mark_ways

SIZE = (23, 17)


def marked(cells, ways) -> np.ndarray:
    swept = np.zeros(SIZE, bool)
    mark_ways(swept, np.array(cells), np.array(ways, float))
    return swept


def points_along(cell, way, count: int = 20001) -> np.ndarray:
    """Cells that points close together along a way lie in, as a grid."""
    grid = np.zeros(SIZE, bool)
    at = np.rint(np.array(cell) + np.linspace(-1, 1, count)[:, None] * np.array(way)).astype(int)
    inside = np.all((at >= 0) & (at < SIZE), axis=1)
    grid[tuple(at[inside].T)] = True
    return grid


WAYS = {
    "short": ((11, 8), (4.0, 0.0)),
    "aslant": ((3, 4), (9.3, 5.1)),
    "over the edge": ((0, 16), (-60.0, 31.0)),
    "from beside": ((-40, 3), (55.0, 2.0)),
    "from a corner": ((70, 60), (-80.0, -70.0)),
}


@pytest.mark.parametrize(("cell", "way"), WAYS.values(), ids=WAYS)
def test_a_way_marks_cells_it_passes_and_no_others(cell, way):
    found, wanted = marked([cell], [way]), points_along(cell, way)
    assert wanted.any() and not (found & ~wanted).any()
    # A step of a cell may pass over the corner of one.
    assert (found & wanted).sum() >= max(abs(np.diff(np.argwhere(wanted)[[0, -1]], axis=0)).max(), 1)


def test_ways_that_miss_the_grid_and_short_ones_mark_nothing():
    assert not marked([(-30, 5), (40, 40), (5, 5)], [(0.0, 9.0), (3.0, -3.0), (0.0, 0.0)]).any()


def test_ways_of_any_length_from_anywhere_take_no_longer_than_others():
    """Along a whole way of a million grids, cell by cell, it would take minutes."""
    start = time.process_time()
    found = marked([(11, 8), (10**9, 8)], [(1e12, 0.0), (-2e9, 0.0)])
    assert time.process_time() - start < 1.0
    assert found[:, 8].all() and found.sum() == SIZE[0]
