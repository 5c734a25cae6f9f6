"""Pictures in eight bits keep what an exposure slider needs."""

import numpy as np
import pytest

from tpdwarp.html.pictures import KNEE, log_codes, shrunk


def test_codes_stand_for_values_within_half_a_step():
    largest = 12.0
    values = np.geomspace(1e-3, largest, 500)
    codes = log_codes(values, largest).astype(float)
    step = np.log1p(KNEE * largest) / 255
    decoded = np.log1p(KNEE * np.expm1(codes * step) / KNEE)
    assert np.abs(decoded - np.log1p(KNEE * values)).max() <= step / 2 + 1e-9


def test_values_beyond_the_range_are_its_ends():
    assert log_codes(np.array([-1.0, 0.0, 5.0, 50.0]), 5.0).tolist() == [0, 0, 255, 255]


@pytest.mark.parametrize("shape", [(7, 10), (8, 12, 3)])
def test_shrinking_keeps_the_mean_of_even_images_and_never_enlarges(shape):
    assert shrunk(np.full(shape, 0.25), 4).shape[1] <= 4
    np.testing.assert_allclose(shrunk(np.full(shape, 0.25), 4), 0.25)
    image = np.arange(np.prod(shape), dtype=float).reshape(shape)
    assert shrunk(image, 100) is image


@pytest.mark.parametrize("shape", [(12, 20), (13, 21, 3), (1, 9, 2)])
@pytest.mark.parametrize("keep_peaks", [False, True])
def test_each_shrunk_pixel_is_the_mean_or_the_largest_of_its_block(shape, keep_peaks):
    image = np.random.default_rng(7).normal(size=shape)
    width = 5
    factor = -(-shape[1] // width)
    found = shrunk(image, width, keep_peaks)
    for row, column in np.ndindex(found.shape[:2]):
        rows = np.minimum(np.arange(row * factor, (row + 1) * factor), shape[0] - 1)
        columns = np.minimum(np.arange(column * factor, (column + 1) * factor), shape[1] - 1)
        block = image[np.ix_(rows, columns)]
        np.testing.assert_allclose(found[row, column], block.max((0, 1)) if keep_peaks else block.mean((0, 1)))
