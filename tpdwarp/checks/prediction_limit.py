"""Prediction limits: how far the next of a few measurements may fall from their mean."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence

from tpdwarp.errors import InputError


def student_inverse() -> Callable[[float, float], float]:
    """SciPy's inverse of Student's t distribution: ``(degrees of freedom, P(T <= t))`` to t.

    Raises:
        InputError: SciPy is not installed.
    """
    try:
        from scipy.special import stdtrit
    except ImportError as error:
        raise InputError("--calibrate needs SciPy (pip install 'tpdwarp[study]')") from error
    return stdtrit


def prediction_limit(values: Sequence[float], false_alarms: float) -> float:
    """What a further value drawn from the same normal distribution exceeds with probability ``false_alarms``.

    It is m + t s √(1 + 1/n), with m the mean of the n values, s their standard deviation, and t the quantile of
    Student's distribution of n − 1 degrees of freedom. It is exact for every n, because it allows for m and s being
    known only as well as n values tell them.

    Args:
        values: n ≥ 2 values.
        false_alarms: Probability, below ½.

    Raises:
        ValueError: There are too few values, or the probability is not in 0 … ½.
        InputError: SciPy is not installed.
    """
    count = len(values)
    if count < 2 or not 0 < false_alarms < 0.5:
        raise ValueError(f"needs 2 values or more and a probability in 0 … ½, not {count} and {false_alarms}")
    # The distribution is symmetric, and the lower tail keeps the digits that 1 − false_alarms would round away.
    quantile = -float(student_inverse()(count - 1, false_alarms))
    return statistics.fmean(values) + quantile * statistics.stdev(values) * math.sqrt(1 + 1 / count)
