"""Photons that are left of many lie evenly over the light, whatever their number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.usd.write.test_debug_layer import photons
from tpdwarp.photons.thinning import thinning_ranks


def test_thinning_to_a_power_of_four_leaves_a_coarser_lattice():
    record = photons(16)
    chosen = np.argsort(thinning_ranks(record))[: len(record) // 16]
    cells = np.floor(record.emission[chosen]).astype(int)
    assert len(np.unique(cells % 4, axis=0)) == 1 and len(np.unique(cells // 4, axis=0)) == 16


@pytest.mark.parametrize("count", [7, 20, 50, 100, 200])
def test_any_share_of_the_lattice_is_spread_evenly(count):
    """Each quadrant holds its quarter of the chosen photons to within one a level of the lattice's four."""
    record = photons(16)
    cells = np.floor(record.emission[np.argsort(thinning_ranks(record))[:count]]).astype(int)
    quadrants = np.bincount((cells // 8) @ [1, 2], minlength=4)
    assert np.abs(quadrants - count / 4).max() <= 4


@pytest.mark.parametrize("place", [0.0, 0.5])
def test_thinning_does_not_depend_on_the_last_digit_of_a_coordinate(place):
    record = replace(photons(16), emission=photons(16).emission + place)
    nudged = replace(record, emission=np.nextafter(record.emission.astype(np.float32), np.float32(-1)))
    np.testing.assert_array_equal(thinning_ranks(record), thinning_ranks(nudged))


def test_photons_of_one_lattice_point_have_ranks_of_their_own():
    record = replace(photons(32), emission=np.full((1024, 2), 0.5))
    assert len(np.unique(thinning_ranks(record))) > 1000
