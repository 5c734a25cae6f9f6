"""Laws of sharing photons out between instants of the shutter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpdwarp.estimators.time_strata import cells_at_time, stratified_times
from tpdwarp.photons.emission import Patch


def patch_of(first=(0, 0), counts=(16, 16)) -> Patch:
    patch = Patch()
    patch.first_u, patch.first_v = first
    patch.count_u, patch.count_v = counts
    return patch


def dealt(patch: Patch, count: int, seed: int = 0) -> np.ndarray:
    """The instant of each cell, shape [count_v, count_u]; −1 where none has it."""
    numbers = np.full(patch.count_u * patch.count_v, -1)
    for number in range(count):
        chosen = cells_at_time(number, count, seed)(None, patch).cell
        cells = chosen[:, 0] - patch.first_u + patch.count_u * (chosen[:, 1] - patch.first_v)
        assert np.all(numbers[cells] == -1)
        numbers[cells] = number
    return numbers.reshape(patch.count_v, patch.count_u)


@pytest.mark.parametrize("first", [(0, 0), (-5, 3), (7, -11)])
@pytest.mark.parametrize("count", [1, 5, 16, 64])
def test_every_cell_has_exactly_one_instant(first, count):
    assert dealt(patch_of(first, (19, 13)), count).min() >= 0


@pytest.mark.parametrize("count", [4, 10, 64])
def test_every_neighbourhood_is_spread_evenly_over_the_shutter(count):
    side = math.ceil(math.sqrt(count))
    numbers = dealt(patch_of((-side, 2 * side), (3 * side, 2 * side)), count)
    for block in numbers.reshape(2, side, 3, side).swapaxes(1, 2).reshape(6, side * side):
        times = np.bincount(block, minlength=count)
        assert times.min() >= side**2 // count and times.max() <= -(-(side**2) // count)


def test_a_cell_keeps_its_instant_wherever_the_patch_begins():
    whole = dealt(patch_of((-8, -8), (24, 24)), 16)
    np.testing.assert_array_equal(dealt(patch_of((-3, 2), (9, 7)), 16), whole[10:17, 5:14])


def test_blocks_and_seeds_are_shuffled_differently():
    numbers = dealt(patch_of((0, 0), (16, 8)), 64)
    assert np.any(numbers[:, :8] != numbers[:, 8:])
    assert np.any(numbers != dealt(patch_of((0, 0), (16, 8)), 64, seed=1))


def test_each_part_of_the_shutter_has_one_random_instant():
    times = stratified_times(8, 3)
    np.testing.assert_array_equal(np.floor(8 * times), np.arange(8))
    assert np.any(times != stratified_times(8, 4))
    assert np.ptp(8 * times % 1) > 0.1
