"""Pictures in eight bits keep what an exposure slider needs."""

import numpy as np
import pytest

from tpdwarp.reports.pictures import KNEE, log_codes, shrunk


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
