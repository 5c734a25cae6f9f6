"""Cells of a lattice as footprints: areas against polygons that are clipped, and the laws that cells keep."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import first_channel, photon_map, shaped
from tpdwarp.footprints.bspline import Trajectory, bspline_weight
from tpdwarp.footprints.lanes import Lanes as AnyLanes

Lanes = AnyLanes.of(1)
still_weight, moving_weight = bspline_weight(1, False, False), bspline_weight(1, True, True)


@wp.kernel(module="unique", enable_backward=False)
def evaluate_cells(
    y: wp.array(dtype=wp.vec2),
    pixel: wp.array(dtype=wp.mat22),
    velocity: wp.array(dtype=wp.vec2),
    acceleration: wp.array(dtype=wp.vec2),
    rate: wp.array(dtype=wp.mat22),
    moves: bool,
    out: wp.array(dtype=float),
):
    i = wp.tid()
    trajectory = Trajectory()
    trajectory.is_cell = 1
    trajectory.pixel = pixel[i]
    trajectory.velocity = velocity[i]
    trajectory.acceleration = acceleration[i]
    trajectory.jacobian_rate = rate[i]
    if moves:
        out[i] = moving_weight(Lanes(y[i][0]), Lanes(y[i][1]), trajectory)[0]
    else:
        out[i] = still_weight(Lanes(y[i][0]), Lanes(y[i][1]), trajectory)[0]


def weights_of(y, pixel, velocity=(0, 0), acceleration=(0, 0), rate=((0, 0), (0, 0)), moves=False) -> np.ndarray:
    """Weights at ``y`` [n, 2] of a cell each; other arguments are one value for all or one a cell."""
    count = len(y)
    given = [(y, wp.vec2), (pixel, wp.mat22), (velocity, wp.vec2), (acceleration, wp.vec2), (rate, wp.mat22)]
    arrays = []
    for values, dtype in given:
        shape = (count, 2, 2) if dtype is wp.mat22 else (count, 2)
        arrays.append(wp.array(np.broadcast_to(np.float32(values), shape).copy(), dtype=dtype, device="cpu"))
    out = wp.zeros(count, dtype=float, device="cpu")
    wp.launch(evaluate_cells, count, inputs=[*arrays, moves, out], device="cpu")
    return out.numpy().astype(np.float64)


def clipped_share(y: np.ndarray, pixel: np.ndarray) -> float:
    """The mean of the unit square over a parallelogram around ``y``: Sutherland and Hodgman's clipping, in float64."""
    p, q = pixel.T
    corners = [y + a * p + b * q for a, b in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        kept = []
        for k, here in enumerate(corners):
            there = corners[(k + 1) % len(corners)]
            inside, beyond = 0.5 - sign * here[axis], 0.5 - sign * there[axis]
            if inside >= 0:
                kept.append(here)
            if inside * beyond < 0:
                kept.append(here + inside / (inside - beyond) * (there - here))
        corners = kept
        if not corners:
            return 0.0
    x, z = np.array(corners).T
    area = 0.5 * abs(np.sum(x * np.roll(z, -1) - z * np.roll(x, -1)))
    return area / abs(np.linalg.det(pixel))


def random_pixels(count: int, seed: int = 5) -> np.ndarray:
    """Parallelograms from an eighth of a cell to 64 cells wide, oblique by up to a thousandth; shape [n, 2, 2]."""
    random = np.random.default_rng(seed)
    sizes = np.exp(random.uniform(math.log(0.125), math.log(64.0), (count, 2)))
    angle = random.uniform(0, 2 * math.pi, count)
    between = np.exp(random.uniform(math.log(1e-3), math.log(math.pi / 2), count))
    return np.stack(
        [
            sizes[:, :1] * np.stack([np.cos(angle), np.sin(angle)], axis=1),
            sizes[:, 1:] * np.stack([np.cos(angle + between), np.sin(angle + between)], axis=1),
        ],
        axis=2,
    )


def test_a_pixel_takes_the_part_of_a_cell_that_lies_within_it():
    random, count = np.random.default_rng(6), 2000
    pixel = np.float32(random_pixels(count)).astype(np.float64)
    # Around the square, as far out as pixels reach it, and with sides that are parallel to those of the square.
    pixel[::10, 1, 0] = pixel[::15, 0, 1] = 0.0
    reach = 0.5 + 0.5 * np.abs(pixel).sum(axis=2)
    y = np.float32(random.uniform(-1.05, 1.05, (count, 2)) * reach)
    expected = np.array([clipped_share(*row) for row in zip(y.astype(np.float64), pixel, strict=True)])
    assert np.count_nonzero(expected) > count / 4
    found = weights_of(y, pixel)
    # Areas, made of coordinates that are rounded by 2⁻²⁴ of them, over that of the pixel; edges that lean by a
    # thousandth lose three digits, and are few.
    unit = np.maximum(np.abs(pixel).max(axis=(1, 2)), 1.0) / np.abs(np.linalg.det(pixel)) * 2.0**-24
    assert np.all(np.abs(found - expected) <= 1000 * unit)
    assert np.count_nonzero(np.abs(found - expected) > 10 * unit) < count / 200


def test_cells_side_by_side_are_one_whatever_pixels_are():
    random = np.random.default_rng(7)
    around = np.stack(np.meshgrid(*[np.arange(-6, 7)] * 2), axis=-1).reshape(-1, 2)
    for pixel in random_pixels(40, 8):
        pixel *= min(1.0, 10.0 / np.abs(pixel).sum(axis=1).max())
        y = around + random.uniform(-0.5, 0.5, 2)
        if abs(np.linalg.det(pixel)) > 1e-3:
            assert weights_of(y, pixel).sum() == pytest.approx(1.0, abs=2e-3 * 2.0**-6 / abs(np.linalg.det(pixel)))


@pytest.mark.parametrize("growing", [False, True])
def test_a_moving_cell_is_the_mean_of_its_places(growing):
    """By the midpoint rule with many times; two nodes a panel leave a few hundredths of a hard edge, not of a sum."""
    random, count = np.random.default_rng(9), 60
    pixel = random_pixels(count, 10)
    pixel *= 2.0 / np.abs(pixel).max(axis=(1, 2))[:, None, None]
    pixel += np.eye(2) * np.sign(np.linalg.det(pixel))[:, None, None]
    velocity, acceleration = random.uniform(-1.5, 1.5, (2, count, 2))
    rate = growing * random.uniform(-0.5, 0.5, (count, 2, 2))
    y = random.uniform(-1.2, 1.2, (count, 2))
    found = weights_of(y, pixel, velocity, acceleration, rate, moves=True)
    expected = np.zeros(count)
    times = 400
    for s in (np.arange(times) + 0.5) / times - 0.5:
        axes = np.eye(2) + s * rate
        at = np.linalg.solve(axes, (y - s * velocity - 0.5 * s**2 * acceleration)[..., None])[..., 0]
        expected += weights_of(at, np.linalg.solve(axes, pixel)) / np.abs(np.linalg.det(axes)) / times
    assert expected.max() > 0.2
    np.testing.assert_allclose(found, expected, atol=0.06)
    assert np.abs(found - expected).mean() < 0.012


@pytest.mark.parametrize(("pixels", "ripple"), [(0.3, 1e-2), (0.7, 1e-2), (1.4, 1e-2), (5.0, 2e-4)])
def test_an_oblique_lattice_is_even_in_pixels_of_any_size(pixels, ripple):
    """B-splines, which keep some ripple where they are oblique, what is both in parts, and cells, which have none."""
    cell, index = 0.05, np.arange(-40, 41)
    i, j = (a.ravel() for a in np.meshgrid(index, index))
    at = np.stack([(i + 0.6 * j) * cell, 0.8 * j * cell, 0.0 * i], axis=1)
    photons = photon_map(at, (cell, 0, 0), (0.6 * cell, 0.8 * cell, 0), flux=0.8 * cell**2)
    points = np.append(np.random.default_rng(4).uniform(-0.1, 0.1, (300, 2)), np.zeros((300, 1)), axis=1)
    found = first_channel(shaped(photons, half_pixel=pixels * cell / math.sqrt(12)), points)
    np.testing.assert_allclose(found, 1.0, atol=ripple)


@pytest.mark.parametrize(
    ("length", "width", "part"),
    [(0.9, 0.4, 1.0), (1.0, 0.02, 1.0), (1.5, 0.5, 0.5), (0.8, 0.8, 0.4), (2.0, 0.1, 0.0), (1.0, 1.0, 0.0)],
)  # fmt: skip
def test_what_is_as_small_as_a_pixel_is_a_cell_and_what_is_larger_a_b_spline(length, width, part):
    side = 0.1
    photon = photon_map([(0, 0, 0)], (length * side, 0, 0), (0, width * side, 0), flux=2.0)
    found = shaped(photon, half_pixel=side / math.sqrt(12))
    cells = found.footprints.arrays.is_cell.numpy() == 1
    np.testing.assert_array_equal(cells, {0.0: [False], 1.0: [True]}.get(part, [False, True]))
    # Densities are flux over area; a cell's is that of its own area, and B-splines are no narrower.
    if part > 0:
        density = found.footprints.arrays.density.numpy()[cells, 0]
        assert density == pytest.approx(2.0 * part / (length * width * side**2), rel=1e-4)
        sides = np.linalg.svd(found.footprints.arrays.pixel.numpy()[cells][0], compute_uv=False)
        np.testing.assert_allclose(sides, [1 / width, 1 / length], rtol=1e-4)
