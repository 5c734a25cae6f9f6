"""Footprint kernels against brute-force quadrature of their shapes, and against the laws they must keep."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest
import warp as wp

from tpdwarp.footprints.bspline import SUPPORT, Trajectory, bspline_weight
from tpdwarp.footprints.kernels import RADIAL, moving_weight, static_weight
from tpdwarp.footprints.lanes import Lanes as AnyLanes
from usd_scenes.oracle import shutter_kernel, static_kernel, swept_kernel
from usd_scenes.oracle.quadrature import integrate

KERNELS = (*RADIAL, "bspline")
SIGMAS = (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 3.7, 30.0, 1e3)
ROUNDING = 2.0**-24
EDGE = 1e-3
"""Points nearer than this to the rim of a kernel that jumps there are left out: rounding puts them on either side."""
RESPONSES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "uniform": lambda s: np.ones_like(s),
    "cone": lambda s: 1 - s,
    "epanechnikov": lambda s: 1 - s**2,
    "quartic": lambda s: (1 - s**2) ** 2,
    "gaussian": lambda s: np.exp(-0.5 * s**2),
}
"""Time filters of Eq. 9 by the distance in time from the shutter's close."""

Weights = Callable[[np.ndarray, np.ndarray], np.ndarray]


def evaluator(functions: Sequence[wp.Function], moving: bool) -> Weights:
    """(y [n, 2], v [n, 2]) → weights [f, n] of several kernels, in one module."""
    count = len(functions)

    @wp.kernel(module="unique", enable_backward=False)
    def evaluate(y: wp.array(dtype=wp.vec2), v: wp.array(dtype=wp.vec2), out: wp.array2d(dtype=float)):
        i = wp.tid()
        for f in range(wp.static(count)):
            if wp.static(moving):
                out[f, i] = wp.static(functions[f])(y[i], v[i])
            else:
                out[f, i] = wp.static(functions[f])(y[i])

    def weights(y: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = wp.zeros((count, len(y)), dtype=float, device="cpu")
        pairs = [wp.array(np.broadcast_to(a, y.shape), dtype=wp.vec2, device="cpu") for a in (y, v)]
        wp.launch(evaluate, len(y), inputs=[*pairs, out], device="cpu")
        return out.numpy().astype(np.float64)

    return weights


Lanes = AnyLanes.of(1)
static_bspline, straight_bspline = bspline_weight(1, False, False), bspline_weight(1, True, False)


@wp.func
def bspline_alone(y: wp.vec2) -> float:
    weights = static_bspline(Lanes(y[0]), Lanes(y[1]), Trajectory())
    return weights[0]


@wp.func
def bspline_shutter(y: wp.vec2, v: wp.vec2) -> float:
    way = Trajectory()
    way.velocity = v
    weights = straight_bspline(Lanes(y[0] - 0.5 * v[0]), Lanes(y[1] - 0.5 * v[1]), way)
    return weights[0]


@cache
def still() -> Weights:
    return evaluator([*map(static_weight, RADIAL), bspline_alone], moving=False)


@cache
def shutter() -> Weights:
    radial = [moving_weight(kernel, "shutter") for kernel in RADIAL]
    return evaluator([*radial, bspline_shutter], moving=True)


@cache
def swept() -> Weights:
    plain = [moving_weight(kernel, "swept") for kernel in RADIAL]
    return evaluator(plain + [moving_weight("epanechnikov", "swept", name) for name in RESPONSES], moving=True)


def queries(sigma: float, count: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Points around the path of a footprint that moves by ``sigma``, and its way; float32, as the kernels see them."""
    random = np.random.default_rng(round(1e6 * sigma) + 5)
    angle = random.uniform(0, 2 * math.pi, count)
    v = (sigma * np.stack([np.cos(angle), np.sin(angle)], axis=1)).astype(np.float32)
    y = (random.uniform(-1.7, 1.7, (count, 2)) + random.uniform(0, 1, (count, 1)) * v).astype(np.float32)
    return y, v


def distance_to_path(y: np.ndarray, v: np.ndarray) -> np.ndarray:
    squared = np.maximum((v.astype(np.float64) ** 2).sum(axis=1), 1e-300)
    tau = np.clip((y * v).sum(axis=1) / squared, 0, 1)
    return np.linalg.norm(y - tau[:, None] * v, axis=1)


def spread(function: Callable[[np.ndarray], np.ndarray], y: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """Largest change of ``function`` where its argument is off by ``amount`` [n] along either axis, shape [n]."""
    centre = function(y)
    off = [s * amount[:, None] * np.eye(2)[axis] for axis in (0, 1) for s in (-1, 1)]
    return np.max([np.abs(function(y + d) - centre) for d in off], axis=0)


def path_variation(kernel: str, y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """How much K rises and falls along the path, shape [n]."""
    values = [static_kernel(kernel, y - tau * v) for tau in np.linspace(0, 1, 65)]
    return np.abs(np.diff(values, axis=0)).sum(axis=0)


def gauss_error(sigma: float) -> float:
    """Bound on the B-spline's two Gauss nodes a cell, by Peano's kernel of second derivatives.

    |d²(b b)/ds²| ≤ 5 along any path (|b| ≤ 3/4, |b'| ≤ 1, |b''| ≤ 2, both axes moving), and at most 3 + 2 panels of at
    most one cell see the support.
    """
    node = 0.5 / math.sqrt(3)

    def peano(t: np.ndarray) -> np.ndarray:
        lag = np.clip(np.array([0.5 - node, 0.5 + node])[:, None] - t, 0, None)
        return np.abs((1 - t) ** 2 / 2 - 0.5 * lag.sum(axis=0))

    panel = integrate(peano, np.linspace(0, 1, 9))
    return 5 * panel * (sigma**2 if sigma <= 1 else 5 / sigma)


def test_static_kernels_are_those_of_table_1():
    y, v = queries(0.0, 400)
    y = y[np.abs(np.linalg.norm(y, axis=1) - 1) > EDGE]
    found = still()(y, v[: len(y)])
    for kernel, weights in zip(KERNELS, found, strict=True):
        peak = static_kernel(kernel, np.zeros((1, 2)))[0]
        np.testing.assert_allclose(weights, static_kernel(kernel, y.astype(float)), atol=16 * ROUNDING * peak)


@pytest.mark.parametrize("sigma", SIGMAS)
def test_shutter_footprints_are_the_time_average_of_the_kernel(sigma):
    y, v = queries(sigma)
    rim = np.abs(distance_to_path(y, v) - 1) > EDGE
    y, v = y[rim], v[rim]
    found = shutter()(y, v)
    y, v = y.astype(np.float64), v.astype(np.float64)
    for kernel, weights in zip(KERNELS, found, strict=True):
        expected = shutter_kernel(kernel, y, v)
        peak = static_kernel(kernel, np.zeros((1, 2)))[0]
        # A few roundings of y, of the size of y itself, and of a weight of at most the peak.
        allowed = spread(lambda at, k=kernel: shutter_kernel(k, at, v, 1e-10), y, 4 * ROUNDING * (1 + np.abs(y).max(1)))
        allowed += 32 * ROUNDING * peak
        if kernel in ("cone", "gaussian") and 0 < sigma < 0.02:
            # Two nodes each stand for half of the path: each is off by at most half of what K varies there.
            allowed += 0.5 * 0.5 * path_variation(kernel, y, v)
        elif kernel in ("cone", "gaussian") and sigma > 0:
            # [F]/σ: the difference of two primitives of order one.
            allowed += 8 * ROUNDING / sigma
        elif kernel == "bspline":
            allowed += gauss_error(sigma)
        assert np.all(np.abs(weights - expected) <= allowed), (kernel, sigma, np.abs(weights - expected) / allowed)


@pytest.mark.parametrize("sigma", SIGMAS)
def test_swept_footprints_take_the_closest_point_of_the_path(sigma):
    y, v = queries(sigma, 200)
    rim = np.abs(distance_to_path(y, v) - 1) > EDGE
    y, v = y[rim], v[rim]
    found = swept()(y, v)[: len(RADIAL)]
    y, v = y.astype(np.float64), v.astype(np.float64)
    for kernel, weights in zip(RADIAL, found, strict=True):
        peak = static_kernel(kernel, np.zeros((1, 2)))[0]
        moved = spread(lambda at, k=kernel: swept_kernel(k, at, v), y, 8 * ROUNDING * (1 + np.abs(y).max(1) + sigma))
        assert np.all(np.abs(weights - swept_kernel(kernel, y, v)) <= moved + 16 * ROUNDING * peak), kernel


@pytest.mark.parametrize("sigma", [1e-2, 0.1, 1.0, 30.0])
def test_time_filters_weight_the_closest_time_and_keep_one_photon(sigma):
    y, v = queries(sigma, 200)
    along = (y * v).sum(axis=1) / sigma**2
    clear = (np.abs(distance_to_path(y, v) - 1) > EDGE) & (np.abs(along) > EDGE) & (np.abs(along - 1) > EDGE)
    y, v = y[clear], v[clear]
    found = swept()(y, v)[len(RADIAL) :]
    y, v = y.astype(np.float64), v.astype(np.float64)
    for (name, response), weights in zip(RESPONSES.items(), found, strict=True):
        def expected(at, response=response):
            return swept_kernel("epanechnikov", at, v, lambda tau: response(1 - tau))

        # |ω'| ≤ 3 turns an error of τ, which is an error of y over σ, into one of the weight, at most the peak.
        off = 8 * ROUNDING * (1 + np.abs(y).max(1) + sigma)
        allowed = spread(expected, y, off) + 3 * off / sigma + 16 * ROUNDING
        assert np.all(np.abs(weights - expected(y)) <= allowed), name


def test_a_time_filter_on_a_still_footprint_changes_nothing():
    y, _ = queries(0.0, 100)
    y = y[np.abs(np.linalg.norm(y, axis=1) - 1) > EDGE]
    found = swept()(y, np.zeros_like(y))[len(RADIAL) :]
    for weights in found:
        np.testing.assert_allclose(weights, static_kernel("epanechnikov", y.astype(float)), atol=16 * ROUNDING)


def plane_integrals(weights: Weights, sigma: float, reach: float, cells: tuple[int, int]) -> tuple[np.ndarray, float]:
    """Midpoint rule over the bounds of a footprint swept along a slanted path, in strips along it, and its step."""
    length = sigma + 2 * reach
    step = np.array([length / cells[0], 2 * reach / cells[1]])
    along = -reach + (np.arange(cells[0]) + 0.5) * step[0]
    across = -reach + (np.arange(cells[1]) + 0.5) * step[1]
    p, q = (a.ravel() for a in np.meshgrid(along, across))
    axis = np.array([math.cos(0.6), math.sin(0.6)])
    y = np.outer(p, axis) + np.outer(q, [-axis[1], axis[0]])
    return weights(y, sigma * axis).sum(axis=1) * step.prod(), float(step.max())


@pytest.mark.parametrize("sigma", [0.0, 1e-4, 1e-2, 0.3, 1.0, 7.0, 1e3])
def test_check_17_every_kernel_holds_one_photon_at_any_speed(sigma):
    cells = (max(400, min(4000, math.ceil(60 * sigma))), 400)
    plain, step = plane_integrals(shutter(), sigma, 1.0, cells)
    wide, _ = plane_integrals(shutter(), sigma, 3.0, cells)
    filtered, _ = plane_integrals(swept(), sigma, 1.0, cells)
    for kernel, total in zip(KERNELS, plain, strict=True):
        if kernel in ("uniform", "gaussian"):
            # Cells on the outline count in full or not at all, by the mean over the path of the jump there, either
            # way by turns; where the path is long its two straight sides are all that is left of the outline.
            jump = static_kernel(kernel, np.array([[1 - 1e-9, 0.0]]))[0]
            bound = step * jump * (2 * math.pi + 2 * sigma) / (1 + sigma)
        else:
            bound = 4 * step**2 + 2e-4
        if kernel != "bspline":
            assert total == pytest.approx(1, abs=bound), kernel
    assert wide[KERNELS.index("bspline")] == pytest.approx(1, abs=2 * gauss_error(sigma) + 1e-5)
    outline = step * (2 * math.pi + 2 * sigma) / (1 + sigma)
    np.testing.assert_allclose(filtered, 1, atol=outline)


@pytest.mark.parametrize("sigma", [0.0, 1e-4, 0.3, 1.0, 1.7, 5.0, 40.0])
def test_b_spline_translates_sum_to_one_also_while_they_sweep(sigma):
    random = np.random.default_rng(3)
    v = (sigma * np.array([math.cos(0.7), math.sin(0.7)])).astype(np.float32)
    here = random.uniform(0, 1, (20, 1, 2))
    around = math.ceil(sigma) + 4
    cells = np.stack(np.meshgrid(*[np.arange(-around, around + 1)] * 2), axis=-1).reshape(-1, 2)
    y = (here + cells).reshape(-1, 2).astype(np.float32)
    weights = shutter()(y, v)[KERNELS.index("bspline")].reshape(20, -1)
    # Each weight is rounded where it is computed, from offsets of the size of the path.
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=64 * ROUNDING * (1 + sigma))


def test_check_24_shutter_and_swept_tend_to_the_static_kernel_as_the_exposure_vanishes():
    y, v = queries(1e-5, 200)
    clear = np.abs(np.linalg.norm(y, axis=1) - 1) > EDGE
    y, v = y[clear], v[clear]
    static = still()(y, v)
    # K is off by its slope, at most four, times half of the path.
    np.testing.assert_allclose(shutter()(y, v), static, atol=4 * 0.5e-5 + 16 * ROUNDING)
    np.testing.assert_allclose(swept()(y, v)[: len(RADIAL)], static[: len(RADIAL)], atol=4 * 1e-5 + 16 * ROUNDING)


def test_no_kernel_reaches_beyond_its_support():
    angle = np.linspace(0, 2 * math.pi, 64, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for kernel, weights in zip(KERNELS, still()((1 + EDGE) * circle, 0 * circle), strict=True):
        if kernel != "bspline":
            assert not weights.any(), kernel
    square = SUPPORT * circle / np.abs(circle).max(axis=1, keepdims=True)
    assert not still()(square, square)[KERNELS.index("bspline")].any()
