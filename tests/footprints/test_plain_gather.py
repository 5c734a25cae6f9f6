"""The fast gather against the plain one: groups, trees and parabolas change nothing but the time it takes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, UP, grid, photon_map, queries, shaped
from tpdwarp.footprints.footprint_map import FootprintMap
from tpdwarp.footprints.gather import gather
from tpdwarp.footprints.irradiance import Lookup, QueryArrays
from tpdwarp.footprints.plain_gather import plain_gather
from tpdwarp.footprints.weights import GatherForm

CELL = 0.02
# A parabola stands for a B-spline over an eighth of a cell to either side of its middle; its third derivative jumps by
# three at knots, so that it errs by 3 · (1/8)³/6 of a unit, beside a peak of 9/16, where it holds one.
PARABOLA = 3 * 0.125**3 / 6 / (9 / 16)
# Irradiances of some hundred footprints, summed in single precision in another order.
ROUNDING = 2e-5
FORMS = [GatherForm(), GatherForm("epanechnikov"), GatherForm("quartic", "swept", "cone")]


def lattice(height=lambda x, y: 0.0 * x, half: int = 14, seed: int = 3, spread: float = 1.0, **columns):
    """Photons on a jittered lattice over a height field, with footprints of all sizes, some folded and some long."""
    random = np.random.default_rng(seed)
    index = np.arange(-half, half + 1)
    x, y = (a.ravel() * CELL for a in np.meshgrid(index, index))
    x, y = x + random.uniform(-0.2, 0.2, x.shape) * CELL, y + random.uniform(-0.2, 0.2, y.shape) * CELL
    step = 1e-5
    slope = [(height(x + dx, y + dy) - height(x - dx, y - dy)) / (2 * step) for dx, dy in ((step, 0), (0, step))]
    normals = np.stack([-slope[0], -slope[1], np.ones_like(x)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sizes = spread * CELL * np.exp(random.uniform(math.log(0.2), math.log(12), (len(x), 2)))
    turn = random.uniform(0, 2 * math.pi, len(x))
    across = np.stack([np.cos(turn), np.sin(turn), slope[0] * np.cos(turn) + slope[1] * np.sin(turn)], axis=1)
    along = np.cross(normals, across)
    skew = random.uniform(-0.99, 0.99, (len(x), 1))
    at = np.stack([x, y, height(x, y)], axis=1)
    flux = random.uniform(0.5, 1.5, (len(x), 3)) * CELL**2
    given = {"dxdu": sizes[:, :1] * across, "dxdv": sizes[:, 1:] * (along + skew * across), "flux": flux}
    return photon_map(at, normals=normals, **{**given, **columns})


def agree(footprints: FootprintMap, points: QueryArrays, form: GatherForm, allowed: float, **options) -> None:
    fast = gather(footprints, points, form, ONE_THREAD, Lookup(**options)).irradiance
    plain = plain_gather(footprints, points, form, ONE_THREAD, Lookup(**options)).irradiance
    assert np.count_nonzero(plain.any(axis=1)) > 0.3 * len(plain)
    np.testing.assert_allclose(fast, plain, atol=allowed * np.percentile(plain, 99))


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.kernel)
def test_dense_rasters_see_what_each_point_sees(form):
    footprints = shaped(lattice(), kernel=form.kernel, half_pixel=0.001)
    points, _ = grid((-0.2, -0.2), (0.2, 0.2), (120, 120))
    agree(footprints, queries(points), form, PARABOLA if form.smooth else ROUNDING)


@pytest.mark.parametrize("amplitude", [0.05, 0.3])
def test_curved_receivers_see_what_each_point_sees(amplitude):
    def height(x, y):
        return amplitude * np.cos(12 * x) * np.cos(9 * y)

    footprints = shaped(lattice(height, spread=0.4), half_pixel=0.001)
    points, _ = grid((-0.25, -0.25), (0.25, 0.25), (90, 90))
    x, y = points[:, 0], points[:, 1]
    normals = np.stack(
        [12 * amplitude * np.sin(12 * x) * np.cos(9 * y), 9 * amplitude * np.cos(12 * x) * np.sin(9 * y), 0 * x + 1],
        axis=1,
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points[:, 2] = height(x, y)
    agree(footprints, queries(points, normals=normals), GatherForm(), PARABOLA)


def test_folded_receivers_keep_their_sides_and_objects_apart():
    """Two sheets a little apart, one of them facing down, and points of either in turns, so that runs are short."""
    up, down = lattice(seed=5), lattice(lambda x, y: 0.003 + 0.0 * x, seed=6, receiver=1)
    down.normal[:] = (0, 0, -1)
    footprints = shaped(up, down, half_pixel=0.001)
    points, _ = grid((-0.2, -0.2), (0.2, 0.2), (80, 80))
    side = np.arange(len(points)) // 5 % 2
    points[:, 2] = 0.003 * side
    normals = np.where(side[:, None] == 1, (0, 0, -1.0), UP)
    agree(footprints, queries(points, normals=normals, receiver=side), GatherForm(), PARABOLA)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.kernel)
def test_moving_footprints_see_still_points(form):
    random = np.random.default_rng(8)
    count = 29 * 29
    dxdt = np.append(random.normal(0, 2 * CELL, (count, 2)), np.zeros((count, 1)), axis=1)
    curve = np.append(random.normal(0, CELL, (4, count, 2)), np.zeros((4, count, 1)), axis=2)
    moving = lattice(dxdt=dxdt, trajectory=curve if form.smooth else None, gain=0.5)
    points, _ = grid((-0.2, -0.2), (0.2, 0.2), (60, 60))
    # Speeds, too, are differences of nodes within a run: twice as many knots are crossed.
    agree(shaped(moving, kernel=form.kernel, half_pixel=0.001, moves=True), queries(points), form, 2 * PARABOLA)


def test_queries_that_move_together_see_what_each_sees():
    """Of one motion, so that a run's motion is that of each of its queries."""
    motion = (0.03, -0.02, 0.0)
    points, _ = grid((-0.2, -0.2), (0.2, 0.2), (60, 60))
    for window in ((0.0, 1.0), (0.25, 0.5)):
        options = {"time": window[0], "window": window, "query_moves": True}
        moving = shaped(lattice(dxdt=(0.02, 0.01, 0)), half_pixel=0.001, moves=True)
        agree(moving, queries(points, motion), GatherForm(), 2 * PARABOLA, **options)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.kernel)
def test_queries_meet_all_of_the_footprints_that_pass_them_and_bend(form):
    random = np.random.default_rng(9)
    count = 29 * 29
    dxdt = np.append(random.normal(0, 4 * CELL, (count, 2)), np.zeros((count, 1)), axis=1)
    curve = np.append(random.normal(0, CELL, (4, count, 2)), np.zeros((4, count, 1)), axis=2)
    moving = lattice(dxdt=dxdt, trajectory=curve if form.smooth else None)
    footprints = shaped(moving, kernel=form.kernel, half_pixel=0.001, moves=True)
    points, _ = grid((-0.2, -0.2), (0.2, 0.2), (50, 50))
    options = {"time": 0.3, "window": (0.25, 0.25), "query_moves": True}
    agree(footprints, queries(points, (0.1, -0.06, 0.0)), form, 2 * PARABOLA, **options)


def test_results_do_not_depend_on_how_queries_are_cut_into_batches():
    footprints = shaped(lattice(), half_pixel=0.001)
    points, _ = grid((-0.2, -0.2), (0.2, 0.2), (64, 64))
    whole = gather(footprints, queries(points), GatherForm(), ONE_THREAD).irradiance
    # Runs begin anew in each batch, and parabolas have other middles there.
    for size in (97, 128, 1000):
        parts = [
            gather(footprints, queries(points[i : i + size]), GatherForm(), ONE_THREAD).irradiance
            for i in range(0, len(points), size)
        ]
        np.testing.assert_allclose(np.concatenate(parts), whole, atol=PARABOLA * np.percentile(whole, 99))
    # Whole groups stay as they are.
    halves = [gather(footprints, queries(half), GatherForm(), ONE_THREAD).irradiance for half in np.split(points, 2)]
    np.testing.assert_array_equal(np.concatenate(halves), whole)

