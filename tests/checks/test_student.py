"""Student's t agrees with tables, and prediction limits are passed as rarely as they promise."""

import math

import numpy as np
import pytest

from tpdwarp.checks.student import prediction_limit, student_quantile, student_tail


@pytest.mark.parametrize(
    ("tail", "freedom", "quantile"),
    [(0.05, 1, 6.314), (0.025, 2, 4.303), (0.01, 5, 3.365), (0.001, 10, 4.144), (0.0005, 7, 5.408), (0.05, 30, 1.697)],
)
def test_quantiles_are_those_of_the_tables(tail, freedom, quantile):
    assert student_quantile(tail, freedom) == pytest.approx(quantile, abs=5e-4)


def test_tails_of_one_and_two_degrees_have_their_closed_forms():
    for t in (0.0, 0.3, 2.0, 50.0):
        assert student_tail(t, 1) == pytest.approx(0.5 - math.atan(t) / math.pi, abs=1e-14)
        assert student_tail(t, 2) == pytest.approx(0.5 - t / (2 * math.sqrt(2 + t * t)), abs=1e-14)


def test_the_next_value_is_beyond_the_limit_as_often_as_asked():
    draws = np.random.default_rng(4).normal(3, 2, (20000, 7))
    beyond = np.mean([row[6] > prediction_limit(row[:6].tolist(), 0.02) for row in draws[:4000]])
    # Four standard deviations of a binomial share.
    assert abs(beyond - 0.02) < 4 * math.sqrt(0.02 * 0.98 / 4000)


@pytest.mark.parametrize(("values", "tail"), [([1.0], 0.1), ([1.0, 2.0], 0.0), ([1.0, 2.0], 0.5)])
def test_what_has_no_limit_is_refused(values, tail):
    with pytest.raises(ValueError, match="needs 2 values"):
        prediction_limit(values, tail)
