"""Brute-force kernels against the constants and integrals of Table 1."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.kernels import (
    KERNELS,
    SHAPES,
    diameter_integral,
    footprint_weight,
    peak,
    quadratic_bspline,
    shutter_kernel,
    static_kernel,
    swept_kernel,
)
from usd_scenes.oracle.quadrature import integrate

AXES = (np.array([0.3, 0.1, 0.0]), np.array([-0.05, 0.2, 0.0]))


def plane_integral(weight, v, cells=600, margin=1.0):
    """Midpoint rule over the bounds of a disc of radius ``margin`` swept along v, and the step of its grid."""
    low, high = np.minimum(0, v) - margin, np.maximum(0, v) + margin
    step = (high - low) / cells
    x, y = (low[i] + (np.arange(cells) + 0.5) * step[i] for i in range(2))
    across, along = np.meshgrid(x, y)
    values = weight(np.stack([across.ravel(), along.ravel()], axis=1))
    return values.sum() * step.prod(), step.max()


@pytest.mark.parametrize("kernel", SHAPES)
def test_check_17_constants_of_table_1(kernel):
    assert peak(kernel) == pytest.approx(closed_forms.KERNEL_PEAKS[kernel], rel=1e-13)
    assert diameter_integral(kernel) == pytest.approx(closed_forms.KERNEL_K1[kernel], rel=1e-13)


@pytest.mark.parametrize("kernel", SHAPES)
@pytest.mark.parametrize("v", [(0.0, 0.0), (0.7, 0.2), (-3.0, 4.0)])
def test_check_17_swept_footprints_hold_one_photon(kernel, v):
    v = np.array(v)
    total, step = plane_integral(lambda y: swept_kernel(kernel, y, v), v)
    # The rule misjudges at most the cells on the outline, by the value there.
    outline = 2 * math.pi + 2 * np.hypot(*v)
    assert total == pytest.approx(1, abs=outline * step * peak(kernel) / (1 + np.hypot(*v) * diameter_integral(kernel)))


@pytest.mark.parametrize("kernel", SHAPES)
def test_eq_9_filtered_footprints_hold_one_photon(kernel):
    v = np.array([1.5, 0.5])
    total, step = plane_integral(lambda y: swept_kernel(kernel, y, v, lambda tau: 1 - 0.8 * tau**2), v)
    assert total == pytest.approx(1, abs=(2 * math.pi + 4) * step * peak(kernel))


@pytest.mark.parametrize("kernel", KERNELS)
def test_check_17_shutter_footprints_hold_one_photon(kernel):
    v = np.array([0.7, 0.3])
    margin = 1.5 if kernel == "bspline" else 1.0
    total, step = plane_integral(lambda y: shutter_kernel(kernel, y, v, 1e-6), v, cells=24, margin=margin)
    # Averaged over time even the uniform kernel leaves its support like a square root: the rule has order 3/2.
    assert total == pytest.approx(1, abs=step**1.5)


def random_places(count=24):
    random = np.random.default_rng(5)
    return random.uniform(-1.2, 1.2, (count, 2)), random.normal(0, 1.5, (count, 2))


def chord(y, v):
    """Closed form of the shutter interval inside the disc: c², z0, z1 and Δ for each place."""
    sigma = np.hypot(v[:, 0], v[:, 1])
    p, q = np.sum(y * v, axis=1) / sigma, np.abs(y[:, 0] * v[:, 1] - y[:, 1] * v[:, 0]) / sigma
    c2 = np.clip((1 - q) * (1 + q), 0, None)
    t0, t1 = (np.clip((p + sign * np.sqrt(c2)) / sigma, 0, 1) for sign in (-1, 1))
    return c2, t0 * sigma - p, t1 * sigma - p, t1 - t0


def test_the_shutter_average_of_the_uniform_kernel_is_the_time_spent_inside():
    y, v = random_places()
    np.testing.assert_allclose(shutter_kernel("uniform", y, v), chord(y, v)[3] / math.pi, atol=1e-10)


def test_the_shutter_average_of_the_epanechnikov_kernel_is_its_polynomial():
    y, v = random_places()
    c2, z0, z1, inside = chord(y, v)
    expected = 2 / math.pi * inside * (c2 - (z1**2 + z1 * z0 + z0**2) / 3)
    np.testing.assert_allclose(shutter_kernel("epanechnikov", y, v), expected, atol=1e-11)


@pytest.mark.parametrize("kernel", KERNELS)
def test_the_shutter_average_is_the_mean_of_static_footprints_on_the_way(kernel):
    y, v = random_places(6)
    tau = (np.arange(4000) + 0.5) / 4000
    expected = [np.mean(static_kernel(kernel, a - tau[:, None] * b)) for a, b in zip(y, v, strict=True)]
    # Two jumps of at most the peak are each off by half a step.
    height = 9 / 16 if kernel == "bspline" else peak(kernel)
    np.testing.assert_allclose(shutter_kernel(kernel, y, v), expected, atol=height / 4000)


@pytest.mark.parametrize("sigma", [1e3, 1e-3])
def test_shutter_averages_hold_at_extreme_speeds(sigma):
    y, v = np.array([[0.3 + 0.4 * sigma, 0.5]]), np.array([[sigma, 0.0]])
    inside = min(1, 2 * math.sqrt(1 - 0.25) / sigma)
    assert shutter_kernel("uniform", y, v)[0] == pytest.approx(inside / math.pi, rel=1e-7)


def test_a_grazing_path_is_not_missed():
    q = 1 - 1e-7
    found = shutter_kernel("uniform", np.array([[400.0, q]]), np.array([[1000.0, 0]]))[0]
    assert found == pytest.approx(2 * math.sqrt(1 - q**2) / 1000 / math.pi, rel=1e-4)


def test_b_spline_translates_sum_to_one_still_or_moving():
    shifts = np.stack(np.meshgrid(np.arange(-4, 5), np.arange(-4, 5)), axis=-1).reshape(-1, 2)
    at = np.array([0.37, -0.21])
    assert static_kernel("bspline", at - shifts).sum() == pytest.approx(1, abs=1e-14)
    assert shutter_kernel("bspline", at - shifts, np.array([0.8, -1.3])).sum() == pytest.approx(1, abs=1e-10)


def test_the_quadratic_b_spline_is_the_box_convolved_with_itself():
    assert quadratic_bspline(np.array([0.0, 0.5, 1.0, 1.5, 2.0])) == pytest.approx([3 / 4, 1 / 2, 1 / 8, 0, 0])
    integral = integrate(quadratic_bspline, np.linspace(-1.5, 1.5, 4))
    second_moment = integrate(lambda x: x**2 * quadratic_bspline(x), np.linspace(-1.5, 1.5, 4))
    assert (integral, second_moment) == pytest.approx((1, 3 / 12))


@pytest.mark.parametrize("kernel", SHAPES)
@pytest.mark.parametrize("sweep", ["static", "swept", "shutter"])
def test_a_still_footprint_peaks_at_its_closed_form(kernel, sweep):
    found = footprint_weight(kernel, sweep, np.zeros(3), *AXES, np.zeros(3))[0]
    area = np.linalg.norm(np.cross(*AXES))
    assert found == pytest.approx(4 / area * closed_forms.KERNEL_PEAKS[kernel], rel=1e-12)


def test_the_b_spline_holds_one_cell():
    area = np.linalg.norm(np.cross(*AXES))
    found = footprint_weight("bspline", "static", np.zeros(3), *AXES, np.zeros(3))[0]
    assert found == pytest.approx(closed_forms.KERNEL_PEAKS["bspline"] / area, rel=1e-12)


def test_the_ellipse_touches_half_the_axes():
    inside = footprint_weight("uniform", "static", 0.499 * np.array(AXES), *AXES, np.zeros(3))
    outside = footprint_weight("uniform", "static", 0.501 * np.array(AXES), *AXES, np.zeros(3))
    assert (inside > 0).all() and (outside == 0).all()


@pytest.mark.parametrize("sweep", ["swept", "shutter"])
def test_footprints_are_swept_evenly_around_mid_shutter(sweep):
    dxdt = np.array([0.4, -0.3, 0.0])
    offsets = np.array([[0.11, 0.05, 0], [0.21, -0.13, 0], [-0.3, 0.1, 0]])
    there = footprint_weight("epanechnikov", sweep, offsets, *AXES, dxdt)
    back = footprint_weight("epanechnikov", sweep, -offsets, *AXES, dxdt)
    np.testing.assert_allclose(there, back, atol=1e-9)
    assert there[1] > 0
    assert footprint_weight("epanechnikov", sweep, 0.49 * dxdt, *AXES, dxdt)[0] > 0
    assert footprint_weight("epanechnikov", sweep, dxdt, *AXES, dxdt)[0] == 0


def test_check_20_a_lit_half_plane_that_moves_leaves_a_linear_ramp():
    # One lattice row stands for the half plane: rows sum to one, and the edge lies half a cell past the last photon.
    cell, displacement = 0.05, 1.0
    photons = -cell * (np.arange(40) + 0.5)
    at = np.array([-0.3, -0.1, 0.0, 0.2, 0.4])
    rows = (np.arange(-2, 3) + 0.3) * cell
    offsets = np.array([(x - photon, row, 0) for x in at for photon in photons for row in rows])
    weights = footprint_weight("bspline", "shutter", offsets, [cell, 0, 0], [0, cell, 0], [displacement, 0, 0])
    found = cell**2 * weights.reshape(len(at), -1).sum(axis=1)
    np.testing.assert_allclose(found, closed_forms.lit_edge_profile(at, displacement), atol=1e-9)


def test_a_b_spline_has_no_closest_point():
    with pytest.raises(ValueError, match="radial"):
        swept_kernel("bspline", np.zeros((1, 2)), np.ones(2))
