"""The B-spline along curved ways and over boxes, against brute force, and the laws it must keep there."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

from tests.footprints.test_kernels import gauss_error
from tpdwarp.footprints.bspline import Trajectory, bspline_weight
from tpdwarp.footprints.lanes import CPU_LANES
from tpdwarp.footprints.lanes import Lanes as AnyLanes
from usd_scenes.oracle import static_kernel

LANES, Lanes = wp.constant(CPU_LANES), AnyLanes.of(CPU_LANES)
curved_bspline = bspline_weight(CPU_LANES, True, True)


@wp.kernel(module="unique", enable_backward=False)
def evaluate_ways(
    y: wp.array(dtype=wp.vec2),
    velocity: wp.array(dtype=wp.vec2),
    acceleration: wp.array(dtype=wp.vec2),
    jerk: wp.array(dtype=wp.vec2),
    rate: wp.array(dtype=wp.mat22),
    box: wp.array(dtype=wp.vec3),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    trajectory = Trajectory()
    trajectory.velocity = velocity[i]
    trajectory.acceleration = acceleration[i]
    trajectory.jerk = jerk[i]
    trajectory.jacobian_rate = rate[i]
    trajectory.filter_width = box[i]
    # In one lane, with another query in all others.
    lane = i % LANES
    u = Lanes(y[0][0])
    v = Lanes(y[0][1])
    u[lane] = y[i][0]
    v[lane] = y[i][1]
    weights = curved_bspline(u, v, trajectory)
    out[i] = weights[lane]


def weights_of(y: np.ndarray, *trajectory: np.ndarray) -> np.ndarray:
    """Weights at ``y`` [n, 2] of one B-spline each, whose trajectory has these columns, in the order of the kernel."""
    given = [np.ascontiguousarray(values, np.float32) for values in (y, *trajectory)]
    if len(given) < 6:
        given.append(np.zeros((len(y), 3), np.float32))
    # One box along u, and up to two along v.
    given[5] = np.pad(given[5], ((0, 0), (0, 3 - given[5].shape[1])))
    types = (wp.vec2, wp.vec2, wp.vec2, wp.vec2, wp.mat22, wp.vec3)
    out = wp.zeros(len(y), dtype=float, device="cpu")
    arrays = [wp.array(values, dtype=dtype, device="cpu") for values, dtype in zip(given, types, strict=True)]
    wp.launch(evaluate_ways, len(y), inputs=[*arrays, out], device="cpu")
    return out.numpy().astype(np.float64)


def exact_weights(y, velocity, acceleration, jerk, rate, times=4096) -> np.ndarray:
    """The same by the midpoint rule in double precision, from the axes at each time."""
    total = np.zeros(len(y))
    for s in (np.arange(times) + 0.5) / times - 0.5:
        axes = np.eye(2) + s * rate
        place = s * velocity + s**2 / 2 * acceleration + s**3 / 6 * jerk
        at = np.linalg.solve(axes, (y - place)[..., None])[..., 0]
        total += static_kernel("bspline", at) / np.abs(np.linalg.det(axes))
    return total / times


@pytest.mark.parametrize("size", [0.0, 0.3, 3.0, 20.0])
@pytest.mark.parametrize("growing", [False, True])
def test_curved_and_growing_trajectories_match_brute_force(size, growing):
    random, count = np.random.default_rng(11), 400
    velocity, acceleration, jerk = (
        (scale * size * random.uniform(-1, 1, (count, 2))).astype(np.float32) for scale in (1.0, 0.5, 0.5)
    )
    rate = np.float32(growing) * random.uniform(-1, 1, (count, 2, 2)).astype(np.float32) * [[1, 0.5], [0.5, 1]]
    s = random.uniform(-0.5, 0.5, (count, 1))
    place = s * velocity + s**2 / 2 * acceleration + s**3 / 6 * jerk
    y = (random.uniform(-1.8, 1.8, (count, 2)) + place).astype(np.float32)
    expected = exact_weights(y, velocity, acceleration, jerk, rate)
    assert expected.max() > 0.02
    # Axes shrink to a half, so that cells are as much as twice as long for the nodes.
    limit = gauss_error(size) if size else 5e-3
    found = weights_of(y, velocity, acceleration, jerk, rate)
    np.testing.assert_allclose(found, expected, atol=(1 + 7 * growing) * limit)


@pytest.mark.parametrize("size", [0.0, 0.5, 4.0])
def test_a_curved_and_growing_footprint_keeps_its_flux(size):
    velocity, acceleration, jerk = size * np.array([[1.0, 0.4], [-0.3, 0.6], [0.4, 0.2]])
    rate = np.array([[0.9, -0.4], [0.3, -0.8]])
    side = np.linspace(-6, 6, 601)[:-1] + 0.01
    y = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    rows = (np.broadcast_to(values, (len(y), *values.shape)) for values in (velocity, acceleration, jerk, rate))
    assert weights_of(y, *rows).sum() * 0.02**2 == pytest.approx(1, abs=2e-3)


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
    np.testing.assert_allclose(weights_of(y, *still, box), averaged(y, box), atol=(4 / 40) ** 3 / 4 + 1e-5)


@pytest.mark.parametrize("widths", [(0.0, 1.0, 0.3), (0.4, 6.0, 6.0), (2.0, 20.0, 3.0), (0.0, 64.0, 45.0)])
def test_a_thin_footprint_is_averaged_over_two_boxes_as_a_square_is_across_it(widths):
    """By a sum over the second box of means over the first one; midpoints err with the square of their step."""
    random = np.random.default_rng(22)
    reach = 1.6 + 0.5 * (widths[1] + widths[2])
    y = np.stack([random.uniform(-1.7, 1.7, 300), random.uniform(-reach, reach, 300)], axis=1).astype(np.float32)
    still = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros((300, 2, 2))
    steps = 400
    found = weights_of(y, *still, np.broadcast_to(widths, (300, 3)))
    offsets = widths[2] * ((np.arange(steps) + 0.5) / steps - 0.5)
    single = np.broadcast_to(widths[:2], (300, 2))
    expected = np.mean([weights_of(np.float32(y + np.array([0, o])), *still, single) for o in offsets], axis=0)
    np.testing.assert_allclose(found, expected, atol=2e-3 * expected.max())
    # And by itself: an average keeps the sum.
    side = np.arange(-reach, reach, 0.05)
    line = np.stack([np.zeros_like(side), side], axis=1)
    rows = [np.zeros_like(line)] * 3 + [np.zeros((len(line), 2, 2))]
    across = weights_of(line, *rows, np.broadcast_to(widths, (len(line), 3)))
    alone = weights_of(np.zeros((1, 2)), *[np.zeros((1, 2))] * 3, np.zeros((1, 2, 2)), [[widths[0], 0, 0]])[0] / 0.75
    assert across.sum() * 0.05 == pytest.approx(alone, rel=1e-3)


@pytest.mark.parametrize("box", [(0.3, 0), (0, 1.43), (1.0, 1.0), (1.43, 0.7), (3.3, 2.6)])
@pytest.mark.parametrize("size", [0.0, 1.7, 5.0])
@pytest.mark.parametrize("curved", [False, True])
def test_translates_sum_to_one_over_whatever_box_they_are_averaged(box, size, curved):
    """As those of a B-spline that is one and a half cells wide do not: they leave two per cent of ripple."""
    velocity, acceleration, jerk = size * np.array([[0.8, -0.6], [0.3, 0.4], [-0.2, 0.5]])
    here = np.random.default_rng(3).uniform(0, 1, (20, 1, 2))
    around = np.arange(-9, 10)
    y = (here + np.stack(np.meshgrid(around, around), axis=-1).reshape(-1, 2)).reshape(-1, 2)
    rows = [np.broadcast_to(values, (len(y), 2)) for values in (velocity, curved * acceleration, curved * jerk)]
    weights = weights_of(y, *rows, np.zeros((len(y), 2, 2)), np.broadcast_to(box, y.shape))
    np.testing.assert_allclose(weights.reshape(20, -1).sum(axis=1), 1, atol=2e-5)
    wide = static_kernel("bspline", y / 1.43) / 1.43**2
    assert np.ptp(wide.reshape(20, -1).sum(axis=1)) > 0.02


def test_a_box_stays_as_large_while_axes_grow():
    """An axis that grows from mid shutter on, seen at the end of it by many nodes of a fast way along the other."""
    box, rate = np.array([1.5, 0.4]), np.array([[0.8, 0.0], [0.0, -0.6]])
    side = np.linspace(-4, 4, 401)[:-1] + 0.01
    y = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    rows = [np.broadcast_to(values, (len(y), *np.shape(values))) for values in ((0, 0), (0, 0), (0, 0), rate, box)]
    weights = weights_of(y, *rows)
    # Variances: a quarter of an axis' square, on average over the shutter, and a twelfth of the box'.
    expected = (1 + np.diag(rate) ** 2 / 12) / 4 + box**2 / 12
    np.testing.assert_allclose((weights[:, None] * y**2).sum(axis=0) / weights.sum(), expected, rtol=0.02)
