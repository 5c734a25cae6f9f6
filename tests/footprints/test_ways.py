"""What races over a receiver stands for all that it passes within its window, however fine the footprints are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, photon_map, pixel, queries
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.light import FootprintLight
from tpdwarp.footprints.ways import MOST_PIECES, WayPieces, piece_counts
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


def test_pieces_share_the_window_out_and_their_mean_is_that_of_the_way():
    at = queries(np.array([[0.0, 0, 0], [5, 0, 0]]), np.array([[0.8, 0, 0], [0, 0, 0]]))
    lookup = Lookup(0.0, WINDOW, query_moves=True, own_times=np.array([[0.1, 0.125], [0.0, -0.125]]))
    pieces = WayPieces.of(at, lookup, np.array([4, 1]), 0.01)
    first = pieces.windows[pieces.place[:4]]
    np.testing.assert_allclose(first[:, 1] - 0.5 * first[:, 2], [0.0, 0.0625, 0.125, 0.1875])
    np.testing.assert_allclose(first[:, 2], WINDOW[1] / 4)
    np.testing.assert_array_equal(pieces.rows[pieces.place], [0, 0, 0, 0, 1])
    np.testing.assert_allclose(pieces.windows[pieces.place[4]], [-0.125, -0.125, 0.25])
    np.testing.assert_array_equal(pieces.starts, [0, 4])


def test_queries_of_different_times_together_see_what_each_sees_alone():
    light = stripes(0.01)
    rng = np.random.default_rng(1)
    places, motion = rng.uniform(-0.04, 0.04, (64, 3)) * (1, 1, 0), np.array([0.3, 0, 0])
    number = rng.integers(0, 4, 64)
    times = np.array([[0.25 * k - 0.4, 0.25 * k - 0.375] for k in range(4)])
    for moves in (True, False):
        at = queries(places, motion if moves else 0 * motion)
        own = Lookup(0.0, (0.0, 0.25), moves, with_motion=True, own_times=times[number])
        together = light.irradiance(at, own)
        for k, (time, middle) in enumerate(times):
            alone = light.irradiance(at, Lookup(time, (middle, 0.25), moves, with_motion=True))
            for name in ("irradiance", "motion", "weight", "photons"):
                found, expected = getattr(together, name)[number == k], getattr(alone, name)[number == k]
                # Others in a run change the parabolas that it sees: less than 1/500 of a footprint.
                np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-5)


def test_only_what_goes_far_is_looked_up_in_pieces():
    ways = np.array([0.0, 0.9, 1.0, 1.9, 4.1, 1e6])
    at = queries(np.zeros((6, 3)), np.stack([ways / WINDOW[1], 0 * ways, 0 * ways], axis=1))
    counts = piece_counts(at, Lookup(0.125, WINDOW, query_moves=True), 1.0)
    np.testing.assert_array_equal(counts, [1, 1, 1, 2, 8, MOST_PIECES])
    assert (piece_counts(at, Lookup(), 1.0) == 1).all()
