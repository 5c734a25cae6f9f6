"""The oracle's vector optics against scalar laws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.optics import reflectance, reflected, refracted

UP = np.array([[0.0, 0.0, 1.0]])


def arriving(theta: float) -> np.ndarray:
    return np.array([[math.sin(theta), 0.0, -math.cos(theta)]])


@pytest.mark.parametrize("theta", [0.0, 0.3, 0.8, 1.3])
@pytest.mark.parametrize("n_i, n_t", [(1.0, 1.5), (1.33, 1.0)])
def test_refraction_obeys_snell(theta, n_i, n_t):
    out = refracted(arriving(theta), UP, np.array([n_i / n_t]))[0]
    expected = closed_forms.snell(theta, n_i, n_t)
    if math.isnan(expected):
        assert np.isnan(out).all()
    else:
        np.testing.assert_allclose(out, [math.sin(expected), 0, -math.cos(expected)], atol=1e-15)


def test_reflection_keeps_the_tangential_part_and_turns_the_normal_part():
    np.testing.assert_allclose(reflected(arriving(0.7), UP), arriving(0.7) * [1, 1, -1], atol=1e-15)


@pytest.mark.parametrize("theta", [0.0, 0.2, 0.7, 0.9, 1.5])
@pytest.mark.parametrize("n_i, n_t", [(1.0, 1.5), (1.5, 1.0)])
def test_fresnel_amplitudes_agree_with_the_sine_and_tangent_laws(theta, n_i, n_t):
    found = reflectance(np.array([math.cos(theta)]), np.array([n_i / n_t]))[0]
    assert found == pytest.approx(closed_forms.fresnel_reflectance(theta, n_i, n_t), abs=1e-14)


def test_textbook_numbers_of_glass():
    assert closed_forms.fresnel_reflectance(0, 1, 1.5) == pytest.approx(0.04)
    assert closed_forms.slab_transmittance(0.04) == pytest.approx(0.92308, abs=5e-6)
    assert math.degrees(closed_forms.critical_angle(1.5, 1)) == pytest.approx(41.81, abs=5e-3)


def test_at_brewsters_angle_only_the_perpendicular_component_is_reflected():
    theta = closed_forms.brewster_angle(1, 1.5)
    perpendicular = math.sin(theta - closed_forms.snell(theta, 1, 1.5)) ** 2
    assert reflectance(np.array([math.cos(theta)]), np.array([1 / 1.5]))[0] == pytest.approx(perpendicular / 2)


def test_light_takes_the_same_share_both_ways():
    theta = 0.6
    there = reflectance(np.array([math.cos(theta)]), np.array([1 / 1.5]))[0]
    back = reflectance(np.array([math.cos(closed_forms.snell(theta, 1, 1.5))]), np.array([1.5]))[0]
    assert there == pytest.approx(back, abs=1e-15)
