"""Student's t distribution: how far the next of a few measurements may fall from their mean."""

from __future__ import annotations

import math
from collections.abc import Sequence


def prediction_limit(values: Sequence[float], false_alarms: float) -> float:
    """What a further value drawn from the same normal distribution exceeds with probability ``false_alarms``.

    It is m + t s √(1 + 1/n), with t of n − 1 degrees of freedom: exact for every n, for the mean and the deviation are
    themselves only known as well as n values tell.

    Args:
        values: n ≥ 2 values.
        false_alarms: Probability, below ½.

    Raises:
        ValueError: There are too few values, or the probability is not in 0 … ½.
    """
    count = len(values)
    if count < 2 or not 0 < false_alarms < 0.5:
        raise ValueError(f"needs 2 values or more and a probability in 0 … ½, not {count} and {false_alarms}")
    mean = math.fsum(values) / count
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (count - 1))
    return mean + student_quantile(false_alarms, count - 1) * deviation * math.sqrt(1 + 1 / count)


def student_quantile(tail: float, freedom: int) -> float:
    """t with P(T > t) = ``tail`` (below ½) for ``freedom`` degrees of freedom."""
    low, high = 0.0, 1.0
    while student_tail(high, freedom) > tail:
        high *= 2
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if student_tail(middle, freedom) > tail else (low, middle)
    return high


def student_tail(t: float, freedom: int) -> float:
    """P(T > t) for t ≥ 0, by the finite sums for whole degrees of freedom (Abramowitz & Stegun 26.7.3, 26.7.4)."""
    angle = math.atan2(t, math.sqrt(freedom))
    cosine = math.cos(angle)
    odd = freedom % 2 == 1
    term, total = (cosine, 0.0) if odd else (1.0, 0.0)
    first = 2 if odd else 1
    for step in range(freedom // 2):
        total += term
        term *= cosine**2 * (first + 2 * step) / (first + 1 + 2 * step)
    inside = 2 / math.pi * (angle + math.sin(angle) * total) if odd else math.sin(angle) * total
    return 0.5 * (1 - inside)
