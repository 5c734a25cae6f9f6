from dataclasses import replace

import numpy as np
import pytest

from tests.studies.made import solution
from tpdwarp.studies.measures import errors_of


def test_a_constant_error_is_bias_and_rmse_alike_but_no_flicker():
    errors = errors_of(solution(2.2, frames=2), solution(2.0, frames=2))
    assert errors.rmse == pytest.approx(0.2, rel=1e-6)
    assert errors.relative_rmse == pytest.approx(0.1, rel=1e-6)
    assert errors.bias == pytest.approx(0.1, rel=1e-6)
    assert errors.flicker == pytest.approx(0.0, abs=1e-6)
    assert errors.flip > 0


def test_darker_is_a_negative_bias():
    assert errors_of(solution(1.5), solution(2.0)).bias == pytest.approx(-0.25, rel=1e-6)


def test_independent_noise_has_no_bias_and_flickers_by_the_root_of_two():
    errors = errors_of(solution(1.0, 0.1, frames=64), solution(1.0, frames=64))
    count = 64 * 16 * 24 * 3
    assert abs(errors.bias) < 5 * 0.1 / np.sqrt(count)
    assert errors.relative_rmse == pytest.approx(0.1, rel=5 / np.sqrt(count))
    assert errors.flicker == pytest.approx(0.1 * np.sqrt(2), rel=10 / np.sqrt(count))


def test_the_truth_has_no_error():
    errors = errors_of(solution(1.0, 0.3), solution(1.0, 0.3))
    assert (errors.rmse, errors.bias, errors.flip, errors.flicker) == (0.0, 0.0, 0.0, None)


def test_flip_looks_at_the_whole_image():
    truth = solution()
    brighter = replace(truth, beauty=truth.beauty * np.float32(1.5))
    errors = errors_of(brighter, truth)
    assert errors.flip > 0.01 and errors.rmse == 0.0


def test_black_images_can_be_compared():
    black = replace(solution(), beauty=np.zeros_like(solution().beauty))
    assert errors_of(black, black).flip == 0.0
