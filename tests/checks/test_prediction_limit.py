"""Prediction limits have their closed forms for two and three values, and are passed as rarely as they promise."""

import math
import sys

import numpy as np
import pytest

from tpdwarp.checks.calibrate import calibrate
from tpdwarp.checks.prediction_limit import prediction_limit
from tpdwarp.errors import InputError

TAILS = (0.4, 0.05, 1e-3, 1e-6)


@pytest.mark.parametrize("tail", TAILS)
def test_two_values_have_the_limit_of_the_cauchy_distribution(tail):
    # One degree of freedom: P(T > t) = ½ − arctan(t)/π. The values have mean 4 and deviation √2.
    t = 1 / math.tan(math.pi * tail)
    assert prediction_limit([3.0, 5.0], tail) == pytest.approx(4 + t * math.sqrt(2) * math.sqrt(3 / 2), rel=1e-9)


@pytest.mark.parametrize("tail", TAILS)
def test_three_values_have_the_limit_of_two_degrees_of_freedom(tail):
    # P(T > t) = ½ − t / (2 √(2 + t²)). The values have mean 4 and deviation 2.
    t = (1 - 2 * tail) / math.sqrt(2 * tail * (1 - tail))
    assert prediction_limit([2.0, 4.0, 6.0], tail) == pytest.approx(4 + t * 2 * math.sqrt(4 / 3), rel=1e-9)


def test_the_next_value_is_beyond_the_limit_as_often_as_asked():
    draws = np.random.default_rng(4).normal(3, 2, (4000, 7))
    beyond = np.mean([row[6] > prediction_limit(row[:6].tolist(), 0.02) for row in draws])
    # Four standard deviations of a binomial share.
    assert abs(beyond - 0.02) < 4 * math.sqrt(0.02 * 0.98 / len(draws))


@pytest.mark.parametrize(("values", "tail"), [([1.0], 0.1), ([1.0, 2.0], 0.0), ([1.0, 2.0], 0.5)])
def test_what_has_no_limit_is_refused(values, tail):
    with pytest.raises(ValueError, match="needs 2 values"):
        prediction_limit(values, tail)


def test_without_scipy_calibration_says_what_to_install_before_it_renders(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "scipy.special", None)
    monkeypatch.setattr("tpdwarp.checks.calibrate.render_like", lambda *_, **__: pytest.fail("rendered"))
    with pytest.raises(InputError, match=r"^calibrate needs SciPy \(pip install 'tpdwarp\[study\]'\)"):
        calibrate(tmp_path / "scene.usda", tmp_path / "baseline")
