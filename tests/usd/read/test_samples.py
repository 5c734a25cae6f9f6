"""Interpolation between samples: exact on the polynomials it is built for, held where elements change."""

import numpy as np
import pytest

from tpdwarp.usd.read.samples import SampledArray

# Double precision, values of order 10² and a handful of operations.
ROUNDING = 1e-12


def curve(values, times, cubic=True, **options):
    stored = {
        time: np.atleast_1d(np.asarray(value, dtype=np.float64)) for time, value in zip(times, values, strict=True)
    }
    return SampledArray(times, stored.get, cubic, **options)


@pytest.mark.parametrize("cubic", [False, True])
def test_samples_are_met_exactly_and_held_outside(cubic):
    values = curve([1.0, 5.0, 2.0, 7.0], [1.0, 2.0, 4.0, 5.0], cubic)
    for time, value in [(1, 1), (2, 5), (4, 2), (5, 7), (-3, 1), (9, 7)]:
        assert values.at(float(time))[0] == value


def test_linear_interpolation_divides_a_segment_by_time():
    assert curve([0.0, 3.0], [1.0, 2.0], cubic=False).at(1.25)[0] == 0.75


@pytest.mark.parametrize("times", [[1.0, 2.0, 3.0, 4.0, 5.0], [0.0, 0.5, 2.0, 2.25, 6.0]])
def test_cubic_reproduces_a_parabola_on_any_spacing_up_to_its_ends(times):
    def parabola(t):
        return 3 - 2 * t + 1.5 * t * t

    values = curve([parabola(t) for t in times], times)
    for time in np.linspace(times[0], times[-1], 41):
        assert values.at(time)[0] == pytest.approx(parabola(time), abs=50 * ROUNDING)


def test_cubic_with_authored_tangents_reproduces_a_cubic():
    times = [0.0, 1.0, 3.0]
    values = curve([t**3 for t in times], times, tangent=lambda t: np.array([3 * t * t]))
    for time in np.linspace(0, 3, 13):
        assert values.at(time)[0] == pytest.approx(time**3, abs=50 * ROUNDING)


def test_cubic_through_two_samples_is_linear():
    values = curve([0.0, 4.0], [0.0, 2.0])
    assert values.at(0.5)[0] == pytest.approx(1.0, abs=ROUNDING)


def test_cubic_does_not_look_across_a_change_of_elements():
    """Tangents come from one side only where the neighbour has other elements."""
    times = [0.0, 1.0, 2.0, 3.0]
    joined = curve([100.0, 1.0, 4.0, 9.0], times, linked=lambda a, b: a >= 1.0)
    assert joined.at(1.5)[0] == pytest.approx(2.25, abs=ROUNDING)
    assert joined.at(0.5)[0] == 100.0


def test_values_of_another_size_are_held_not_mixed():
    values = curve([[1.0, 2.0], [3.0]], [0.0, 1.0])
    np.testing.assert_array_equal(values.at(0.9), [1.0, 2.0])
    np.testing.assert_array_equal(values.at(1.0), [3.0])


def test_connected_asks_only_for_the_samples_touched():
    values = curve([[1.0], [1.0], [1.0, 2.0], [1.0, 2.0]], [0.0, 1.0, 2.0, 3.0])
    assert values.connected(0.0, 1.0)
    assert not values.connected(0.5, 1.5)
    assert not values.connected(1.0, 2.0)
    assert values.connected(2.0, 3.0)
    assert values.connected(2.0, 9.0)
    assert values.connected(-4.0, 0.0)


def test_base_is_the_sample_at_or_before():
    values = curve([0.0, 1.0], [1.0, 2.0])
    assert [values.base(t) for t in (0.0, 1.0, 1.9, 2.0, 5.0)] == [1.0, 1.0, 1.0, 2.0, 2.0]
    assert SampledArray([], lambda time: None).base(1.0) is None
