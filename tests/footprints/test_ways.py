"""What races over a receiver stands for all that it passes within its window, however fine the footprints are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, photon_map, pixel, queries
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.light import FootprintLight
from tpdwarp.footprints.ways import MOST_PIECES, piece_counts, pieces_of
from tpdwarp.footprints.weights import GatherForm

WINDOW = (0.125, 0.25)


def stripes(cell: float) -> FootprintLight:
    """Photons on a lattice whose flux is a wave along x of length 0.1."""
    steps = (np.arange(round(0.6 / cell)) + 0.5) * cell - 0.3
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps[np.abs(steps) < 4 * cell]))
    flux = cell**2 * (1.0 + np.cos(2 * np.pi * x / 0.1))
    photons = photon_map(
        np.stack([x, y, 0 * x], axis=1), (cell, 0, 0), (0, cell, 0), flux=np.repeat(flux[:, None], 3, axis=1)
    )
    return FootprintLight([photons], GatherForm(), 1.0, pixel(), False, ONE_THREAD)


@pytest.mark.parametrize("cell", [0.01, 0.005])
@pytest.mark.parametrize("way", [0.01, 0.04, 0.1])
def test_a_view_sees_the_mean_of_all_that_it_passes(cell, way):
    light = stripes(cell)
    motion = np.array([way / WINDOW[1], 0, 0])
    x = np.linspace(-0.05, 0.05, 41)
    # They stand there early in their window.
    time = 0.05
    at = queries(np.stack([x, 0 * x, 0 * x], axis=1), motion)
    lookup = Lookup(time, WINDOW, query_moves=True, with_motion=True)
    found = light.irradiance(at, lookup)
    middle = x + (WINDOW[0] - time) * motion[0]
    # The mean of 1 + cos over the way; B-splines of cells blur the wave by 1/4 cell² of variance.
    number = 2 * np.pi / 0.1
    half = 0.5 * number * way
    expected = 1.0 + np.exp(-(number**2) * cell**2 / 8) * np.sin(half) / half * np.cos(number * middle)
    # The next term of what a B-spline does to a wave of this length, and two Gauss nodes a cell, err by less than 1 %;
    # pieces longer than a run (here of the longest way, over the coarsest tree) are 16 equal parts seen in part each.
    np.testing.assert_allclose(found.irradiance[:, 0], expected, atol=0.02)
    assert found.weight.shape == (41,) and found.photons.min() > 0


def test_pieces_share_the_window_out():
    middles, lengths = np.array(pieces_of(WINDOW, 4)).T
    np.testing.assert_allclose(middles - 0.5 * lengths, [0.0, 0.0625, 0.125, 0.1875])
    np.testing.assert_allclose(lengths, WINDOW[1] / 4)


def test_only_what_goes_far_is_looked_up_in_pieces():
    ways = np.array([0.0, 0.9, 1.0, 1.9, 4.1, 1e6])
    at = queries(np.zeros((6, 3)), np.stack([ways / WINDOW[1], 0 * ways, 0 * ways], axis=1))
    counts = piece_counts(at, Lookup(0.125, WINDOW, query_moves=True), 1.0)
    np.testing.assert_array_equal(counts, [1, 1, 1, 2, 8, MOST_PIECES])
    assert (piece_counts(at, Lookup(), 1.0) == 1).all()
