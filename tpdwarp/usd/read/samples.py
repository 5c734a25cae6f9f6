"""Time-sampled arrays, read in double precision: USD's linear interpolation, or a cubic through the samples."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np
from pxr import Usd

from tpdwarp.usd.read.jumps import jumps_of
from tpdwarp.usd.read.values import Shape, value_at

SAMPLES_KEPT = 6


class SampledArray:
    """A numeric quantity with time samples, interpolated between them.

    Args:
        times: Sample times in increasing order; empty for a quantity that does not change.
        read: Gives the value at a sample time as float64 (``None`` for the time of an unchanging quantity), or None
            where there is no value.
        cubic: Whether to interpolate by the cubic Hermite through the neighbouring samples instead of linearly.
        tangent: Gives the authored derivative by time code at a sample time, or None to estimate it.
        linked: Whether the samples at two neighbouring times belong to the same elements, beside having one shape.
    """

    def __init__(
        self,
        times: Sequence[float],
        read: Callable[[float | None], np.ndarray | None],
        cubic: bool = False,
        tangent: Callable[[float], np.ndarray | None] | None = None,
        linked: Callable[[float, float], bool] | None = None,
    ) -> None:
        self.times = list(times)
        self._read, self._cubic, self._tangent, self._linked = read, cubic, tangent, linked
        self._kept: dict[float | None, np.ndarray | None] = {}
        self._jumps = frozenset(before for before, _ in jumps_of(self.times)) if cubic else frozenset()

    @property
    def varies(self) -> bool:
        return len(self.times) > 1

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last sample time; None without samples."""
        return (self.times[0], self.times[-1]) if self.times else None

    def sample(self, time: float | None) -> np.ndarray | None:
        """The value at a sample time, as it is stored."""
        if time not in self._kept:
            while len(self._kept) >= SAMPLES_KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[time] = self._read(time)
        else:
            self._kept[time] = self._kept.pop(time)
        return self._kept[time]

    def base(self, time: float) -> float | None:
        """The last sample time at or before ``time`` (the first where there is none before); None without samples."""
        if not self.times:
            return None
        return self.times[max(bisect_right(self.times, time) - 1, 0)]

    def connected(self, first: float, last: float) -> bool:
        """Whether all samples that matter between two times belong to the same elements, so that they interpolate."""
        if not self.varies:
            return True
        begin = max(bisect_right(self.times, first) - 1, 0)
        end = next((i for i in range(begin, len(self.times)) if self.times[i] >= last), len(self.times) - 1)
        return all(self._joined(i) for i in range(begin, end))

    def at(self, time: float) -> np.ndarray | None:
        """The value at any time: held before the first and after the last sample; None where there is no value."""
        if not self.varies:
            return self.sample(self.times[0] if self.times else None)
        i = bisect_right(self.times, time) - 1
        if i < 0:
            return self.sample(self.times[0])
        left = self.sample(self.times[i])
        if i == len(self.times) - 1 or self.times[i] == time or not self._joined(i):
            return left
        right = self.sample(self.times[i + 1])
        step = self.times[i + 1] - self.times[i]
        s = (time - self.times[i]) / step
        if not self._cubic or self.times[i] in self._jumps:
            return left + s * (right - left)
        m0, m1 = step * self._slope(i, i), step * self._slope(i + 1, i)
        return (
            (1 + 2 * s) * (1 - s) ** 2 * left
            + s * (1 - s) ** 2 * m0
            + s * s * (3 - 2 * s) * right
            + s * s * (s - 1) * m1
        )

    def _joined(self, i: int) -> bool:
        left, right = self.sample(self.times[i]), self.sample(self.times[i + 1])
        if left is None or right is None or left.shape != right.shape:
            return False
        return self._linked is None or self._linked(self.times[i], self.times[i + 1])

    def _smooth(self, i: int) -> bool:
        """Whether the interval after sample ``i`` is one that slopes may be computed from."""
        return self.times[i] not in self._jumps and self._joined(i)

    def _secant(self, i: int) -> np.ndarray:
        return (self.sample(self.times[i + 1]) - self.sample(self.times[i])) / (self.times[i + 1] - self.times[i])

    def _slope(self, i: int, interval: int) -> np.ndarray:
        """Derivative at sample ``i``, an end of ``interval``: authored, or that of the parabola through three samples.

        For even spacing this is Catmull-Rom's tangent; at the ends the parabola is one-sided.
        """
        here = self.sample(self.times[i])
        if self._tangent is not None:
            authored = self._tangent(self.times[i])
            if authored is not None and authored.shape == here.shape:
                return authored
        before = i > 0 and self._smooth(i - 1)
        after = i < len(self.times) - 1 and self._smooth(i)
        if before and after:
            h0, h1 = self.times[i] - self.times[i - 1], self.times[i + 1] - self.times[i]
            return (self._secant(i - 1) * h1 + self._secant(i) * h0) / (h0 + h1)
        secant = self._secant(interval)
        beyond = interval + 1 if after else interval - 1
        if not (0 <= beyond < len(self.times) - 1 and self._smooth(beyond)):
            return secant
        h0 = self.times[interval + 1] - self.times[interval]
        h1 = self.times[beyond + 1] - self.times[beyond]
        return secant + (secant - self._secant(beyond)) * h0 / (h0 + h1)


def of_attribute(
    attribute: Usd.Attribute,
    cubic: bool = False,
    check: Callable[[np.ndarray, float | None], None] | None = None,
    shape: Shape | None = None,
    tangent: Callable[[float], np.ndarray | None] | None = None,
    linked: Callable[[float, float], bool] | None = None,
) -> SampledArray:
    """The values of a numeric attribute (array, vector, matrix or scalar) over time.

    Args:
        attribute: The attribute; it must hold no spline.
        cubic, tangent, linked: As in :class:`SampledArray`.
        check: Called with each value read and its time; may raise.
        shape: The shape of a value, as in :func:`tpdwarp.usd.read.values.value_at`.
    """

    def read(time: float | None) -> np.ndarray | None:
        value = value_at(attribute, time, shape)
        if value is not None and check is not None:
            check(value, time)
        return value

    return SampledArray(attribute.GetTimeSamples(), read, cubic, tangent, linked)


def sample_times(attribute: Usd.Attribute) -> list[float]:
    """The times an attribute is authored at: its time samples, or its spline's knots."""
    if attribute.HasSpline():
        return sorted(attribute.GetSpline().GetKnots().keys())
    return list(attribute.GetTimeSamples())
