"""Where and when the camera samples."""

from __future__ import annotations

import numpy as np
import pytest

from tpdwarp.view.sampling import block_order, film_positions, part_count, parts_of, samples_by_time, time_count

WIDTH, HEIGHT = 19, 13
COUNT = WIDTH * HEIGHT


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8, 12])
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("batch", [7, 1000])
def test_every_pixel_takes_each_of_its_samples_exactly_once_over_all_slices(samples, moving, batch):
    times = time_count(samples) if moving else 1
    taken = np.zeros((COUNT, samples), int)
    order = block_order(WIDTH, HEIGHT)
    for first in range(0, COUNT, batch):
        pixels = order[first : first + batch]
        for places, numbers in samples_by_time(times, pixels, samples, 3):
            np.add.at(taken, (pixels[places], numbers), 1)
    np.testing.assert_array_equal(taken, 1)


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8, 12])
def test_the_samples_of_a_pixel_are_spread_evenly_over_the_shutter(samples):
    times = time_count(samples)
    slices = np.full((COUNT, samples), -1)
    for slice_index, (pixels, numbers) in enumerate(samples_by_time(times, np.arange(COUNT), samples, 3)):
        slices[pixels, numbers] = slice_index
    stride = times // samples
    assert times >= 8 and times % samples == 0
    np.testing.assert_array_equal(slices // stride, np.broadcast_to(np.arange(samples), slices.shape))
    # All times are looked at, in about equal parts of the image.
    looked_at = np.bincount((slices % stride)[:, 0], minlength=stride) / COUNT
    np.testing.assert_allclose(looked_at, 1 / stride, atol=4 * np.sqrt(1 / stride / COUNT))


@pytest.mark.parametrize("samples", [1, 4, 64])
@pytest.mark.parametrize("seed", [0, 2**31 - 1])
def test_film_positions_lie_inside_their_pixel(samples, seed):
    pixels = np.repeat(np.arange(COUNT), samples)
    films = film_positions(np.arange(COUNT), WIDTH, samples, seed)
    within = films - np.stack([pixels % WIDTH, pixels // WIDTH], axis=1)
    assert within.min() >= 0 and within.max() < 1


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8, 16, 61])
def test_the_mean_of_a_pixel_s_samples_is_exact_where_light_varies_linearly(samples):
    within = film_positions(np.arange(COUNT), WIDTH, samples, 3) % 1
    np.testing.assert_allclose(within.reshape(COUNT, samples, 2).mean(axis=1), 0.5, atol=1e-12)


@pytest.mark.parametrize("samples", [2, 4, 16])
def test_where_a_sample_lies_says_nothing_of_when_it_looks(samples):
    """Samples of a number look at one part of the shutter; over the image they lie everywhere in their pixels."""
    within = film_positions(np.arange(20 * COUNT), WIDTH, samples, 3) % 1 - 0.5
    of_numbers = within.reshape(-1, samples, 2).mean(axis=0)
    np.testing.assert_allclose(of_numbers, 0.0, atol=4 / np.sqrt(12 * 20 * COUNT))


def test_a_single_sample_takes_the_centre():
    films = film_positions(np.arange(COUNT), WIDTH, 1, 5)
    np.testing.assert_array_equal(films % 1, 0.5)


def test_samples_of_a_pixel_spread_over_it():
    """Sixteen points of the sequence leave no empty quarter, in any pixel."""
    films = film_positions(np.arange(COUNT), WIDTH, 16, 1) % 1
    quarter = (2 * (films[:, 0] >= 0.5) + (films[:, 1] >= 0.5)).astype(int).reshape(COUNT, 16)
    counts = np.stack([(quarter == k).sum(axis=1) for k in range(4)])
    assert counts.min() >= 2


def test_samples_depend_on_the_seed_and_on_nothing_else():
    a, again, other = (film_positions(np.arange(COUNT), WIDTH, 4, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(a, again)
    assert np.abs(a - other).max() > 0.1


@pytest.mark.parametrize("size", [(1, 1), (8, 8), (19, 13), (3, 40)])
def test_block_order_visits_every_pixel_once(size):
    np.testing.assert_array_equal(np.sort(block_order(*size)), np.arange(size[0] * size[1]))


@pytest.mark.parametrize(
    ("samples", "count"), [(1, 1), (4, 1), (15, 1), (16, 2), (18, 1), (35, 1), (36, 3), (44, 2), (64, 4)]
)
def test_each_part_of_a_pixel_has_as_many_samples_with_their_mean_in_its_centre(samples, count):
    assert part_count(samples) == count
    pixels = np.repeat(np.arange(COUNT), samples)
    films = film_positions(np.arange(COUNT), WIDTH, samples, 1)
    parts = parts_of(films, pixels, WIDTH, count)
    np.testing.assert_array_equal(parts % count, np.floor(films[:, 0] % 1 * count))
    np.testing.assert_array_equal(parts // count, np.floor(films[:, 1] % 1 * count))
    part = pixels * count**2 + parts
    np.testing.assert_array_equal(np.bincount(part, minlength=COUNT * count**2), samples // count**2)
    within = films * count % 1
    for axis in range(2):
        np.testing.assert_allclose(np.bincount(part, within[:, axis]) / (samples // count**2), 0.5, atol=1e-9)
