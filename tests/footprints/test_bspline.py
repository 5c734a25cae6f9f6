"""The B-spline along bent ways and over boxes, against brute force, and the laws it must keep there."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

from tests.footprints.test_kernels import gauss_error
from tpdwarp.footprints.bspline import Way, bspline_weight
from usd_scenes.oracle import static_kernel

bent_bspline = bspline_weight(True, True)


@wp.kernel(module="unique", enable_backward=False)
def evaluate_ways(
    y: wp.array(dtype=wp.vec2),
    velocity: wp.array(dtype=wp.vec2),
    bend: wp.array(dtype=wp.vec2),
    jerk: wp.array(dtype=wp.vec2),
    stretch: wp.array(dtype=wp.mat22),
    box: wp.array(dtype=wp.vec2),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    way = Way()
    way.velocity = velocity[i]
    way.bend = bend[i]
    way.jerk = jerk[i]
    way.stretch = stretch[i]
    way.box = box[i]
    out[i] = bent_bspline(y[i], way)


def way_weights(y: np.ndarray, *way: np.ndarray) -> np.ndarray:
    """Weights at ``y`` [n, 2] of one B-spline each: velocity, bend and jerk of its way, its stretch, and its box."""
    given = [np.ascontiguousarray(values, np.float32) for values in (y, *way)]
    if len(given) < 6:
        given.append(np.zeros_like(given[0]))
    types = (wp.vec2, wp.vec2, wp.vec2, wp.vec2, wp.mat22, wp.vec2)
    out = wp.zeros(len(y), dtype=float, device="cpu")
    arrays = [wp.array(values, dtype=dtype, device="cpu") for values, dtype in zip(given, types, strict=True)]
    wp.launch(evaluate_ways, len(y), inputs=[*arrays, out], device="cpu")
    return out.numpy().astype(np.float64)


def exact_way(y: np.ndarray, velocity: np.ndarray, bend: np.ndarray, jerk: np.ndarray, stretch: np.ndarray, times=4096):
    """The same by the midpoint rule in double precision, from the axes at each time."""
    total = np.zeros(len(y))
    for s in (np.arange(times) + 0.5) / times - 0.5:
        axes = np.eye(2) + s * stretch
        place = s * velocity + s**2 / 2 * bend + s**3 / 6 * jerk
        at = np.linalg.solve(axes, (y - place)[..., None])[..., 0]
        total += static_kernel("bspline", at) / np.abs(np.linalg.det(axes))
    return total / times


@pytest.mark.parametrize("size", [0.0, 0.3, 3.0, 20.0])
@pytest.mark.parametrize("stretched", [False, True])
def test_bent_and_stretched_ways_match_brute_force(size, stretched):
    random, count = np.random.default_rng(11), 400
    velocity, bend, jerk = (
        (scale * size * random.uniform(-1, 1, (count, 2))).astype(np.float32) for scale in (1.0, 0.5, 0.5)
    )
    stretch = np.float32(stretched) * random.uniform(-1, 1, (count, 2, 2)).astype(np.float32) * [[1, 0.5], [0.5, 1]]
    s = random.uniform(-0.5, 0.5, (count, 1))
    y = (random.uniform(-1.8, 1.8, (count, 2)) + s * velocity + s**2 / 2 * bend + s**3 / 6 * jerk).astype(np.float32)
    expected = exact_way(y, velocity, bend, jerk, stretch)
    assert expected.max() > 0.02
    # Axes shrink to a half, so that cells are as much as twice as long for the nodes.
    limit = gauss_error(size) if size else 5e-3
    found = way_weights(y, velocity, bend, jerk, stretch)
    np.testing.assert_allclose(found, expected, atol=(1 + 7 * stretched) * limit)


@pytest.mark.parametrize("size", [0.0, 0.5, 4.0])
def test_a_bent_and_stretched_footprint_keeps_its_flux(size):
    velocity, bend, jerk = size * np.array([1.0, 0.4]), size * np.array([-0.3, 0.6]), size * np.array([0.4, 0.2])
    stretch = np.array([[0.9, -0.4], [0.3, -0.8]])
    side = np.linspace(-6, 6, 601)[:-1] + 0.01
    y = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    rows = (np.broadcast_to(values, (len(y), *values.shape)) for values in (velocity, bend, jerk, stretch))
    assert way_weights(y, *rows).sum() * 0.02**2 == pytest.approx(1, abs=2e-3)


def averaged(y: np.ndarray, box: np.ndarray, parts: int = 40) -> np.ndarray:
    """The B-spline's mean over boxes [n, 2] around y [n, 2] by two Gauss nodes in each of ``parts``² parts."""
    node = 0.5 / math.sqrt(3)
    offsets = ((np.arange(parts)[:, None] + 0.5 + [-node, node]) / parts - 0.5).ravel()
    total = np.zeros(len(y))
    for u in offsets:
        for v in offsets:
            total += static_kernel("bspline", y + box * (u, v))
    return total / len(offsets) ** 2


def test_a_b_spline_is_averaged_over_its_box():
    random = np.random.default_rng(21)
    box = np.exp(random.uniform(math.log(0.1), math.log(4), (300, 2))).astype(np.float32)
    box[:100, 0] = box[50:150, 1] = 0
    y = (random.uniform(-1, 1, (300, 2)) * (1.6 + 0.5 * box)).astype(np.float32)
    still = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros((300, 2, 2))
    # Two nodes are exact to third order: b'' jumps by three at knots, which one part or two of each axis hold.
    np.testing.assert_allclose(way_weights(y, *still, box), averaged(y, box), atol=(4 / 40) ** 3 / 4 + 1e-5)


@pytest.mark.parametrize("box", [(0.3, 0), (0, 1.43), (1.0, 1.0), (1.43, 0.7), (3.3, 2.6)])
@pytest.mark.parametrize("size", [0.0, 1.7, 5.0])
@pytest.mark.parametrize("bent", [False, True])
def test_translates_sum_to_one_over_whatever_box_they_are_averaged(box, size, bent):
    """As those of a B-spline that is one and a half cells wide do not: they leave two per cent of ripple."""
    velocity, bend, jerk = size * np.array([0.8, -0.6]), size * np.array([0.3, 0.4]), size * np.array([-0.2, 0.5])
    here = np.random.default_rng(3).uniform(0, 1, (20, 1, 2))
    around = np.arange(-9, 10)
    y = (here + np.stack(np.meshgrid(around, around), axis=-1).reshape(-1, 2)).reshape(-1, 2)
    rows = [np.broadcast_to(values, (len(y), 2)) for values in (velocity, bent * bend, bent * jerk)]
    weights = way_weights(y, *rows, np.zeros((len(y), 2, 2)), np.broadcast_to(box, y.shape))
    np.testing.assert_allclose(weights.reshape(20, -1).sum(axis=1), 1, atol=2e-5)
    wide = static_kernel("bspline", y / 1.43) / 1.43**2
    assert np.ptp(wide.reshape(20, -1).sum(axis=1)) > 0.02


def test_a_box_stays_as_large_while_axes_grow():
    """An axis that grows from mid shutter on, seen at the end of it by many nodes of a fast way along the other."""
    box, stretch = np.array([1.5, 0.4]), np.array([[0.8, 0.0], [0.0, -0.6]])
    side = np.linspace(-4, 4, 401)[:-1] + 0.01
    y = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    rows = [np.broadcast_to(values, (len(y), *np.shape(values))) for values in ((0, 0), (0, 0), (0, 0), stretch, box)]
    weights = way_weights(y, *rows)
    # Variances: a quarter of an axis' square, on average over the shutter, and a twelfth of the box'.
    expected = (1 + np.diag(stretch) ** 2 / 12) / 4 + box**2 / 12
    np.testing.assert_allclose((weights[:, None] * y**2).sum(axis=0) / weights.sum(), expected, rtol=0.02)
