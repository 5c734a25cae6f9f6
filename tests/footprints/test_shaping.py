"""The metric of a footprint, its regularisation and its bounds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, first_channel, grid, irradiance, photon_map, queries, shaped
from tpdwarp.footprints import bspline, kernels
from tpdwarp.footprints.footprint_map import FootprintMap, shape_footprints
from tpdwarp.footprints.shaping import LARGEST_ASPECT, LONGEST_AXIS, SHORTEST_AXIS, SHORTEST_AXIS_AT_ORIGIN, PixelSize
from tpdwarp.footprints.weights import GatherForm
from usd_scenes.oracle import footprint_weight, static_kernel

ROUNDING = 2.0**-23
EPANECHNIKOV = GatherForm("epanechnikov")


def rotations(count: int, seed: int = 1) -> np.ndarray:
    """Random rotations, shape [n, 3, 3]."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))
    q = q * np.sign(np.einsum("nii->ni", r))[:, None]
    return q * np.sign(np.linalg.det(q))[:, None, None]


def tangent_photons(count: int = 200, size: float = 0.05, seed: int = 2) -> dict[str, np.ndarray]:
    """Random footprints with their columns in random tangent planes."""
    random = np.random.default_rng(seed)
    frame = rotations(count, seed)
    columns = size * random.normal(size=(count, 2, 2))
    # Kept clear of folds, where the limits are at work.
    area = np.abs(np.linalg.det(columns))
    columns[area < 0.1 * size**2] = size * np.diag([1.0, 0.7])
    dxdu, dxdv = (np.einsum("ni,nij->nj", columns[:, k], frame[:, :2]) for k in (0, 1))
    return {
        "positions": random.uniform(-0.5, 0.5, (count, 3)), "dxdu": dxdu, "dxdv": dxdv, "normals": frame[:, 2]
    }  # fmt: skip


def metric(footprints) -> np.ndarray:
    """MᵀM: what a radial footprint measures distances with, shape [n, 3, 3]."""
    arrays = footprints.footprints.arrays
    u, v = arrays.row_u.numpy().astype(float), arrays.row_v.numpy().astype(float)
    return np.einsum("ni,nj->nij", u, u) + np.einsum("ni,nj->nij", v, v)


def density(footprints) -> np.ndarray:
    return footprints.footprints.arrays.density.numpy()[:, 0].astype(float)


def bounds(footprints) -> np.ndarray:
    """Lower and upper corners of all pieces of each footprint together, shape [2, n, 3]."""
    owner = footprints.pieces.rows.numpy()["footprint"]
    low, high = np.full((footprints.count, 3), np.inf), np.full((footprints.count, 3), -np.inf)
    np.minimum.at(low, owner, footprints.pieces.lower.numpy())
    np.maximum.at(high, owner, footprints.pieces.upper.numpy())
    return np.stack([low, high])


def covariance(photons: dict[str, np.ndarray]) -> np.ndarray:
    return 0.25 * sum(np.einsum("ni,nj->nij", photons[k], photons[k]) for k in ("dxdu", "dxdv"))


@pytest.mark.parametrize(("kernel", "scale"), [("epanechnikov", 2.0), ("bspline", 1.0)])
def test_rows_are_those_of_the_inverse_jacobian(kernel, scale):
    photons = tangent_photons()
    found = shaped(photon_map(**photons, flux=3.0), kernel=kernel)
    u, v, n = photons["dxdu"], photons["dxdv"], photons["normals"]
    area = np.einsum("ni,ni->n", u, np.cross(v, n))[:, None]
    # Angles and singular values are rounded by a few units, and the smallest axis amplifies them by the aspect.
    aspect = np.linalg.cond(np.stack([u, v], axis=2)).max()
    size = scale / np.linalg.svd(np.stack([u, v], axis=2), compute_uv=False).min()
    allowed = 16 * ROUNDING * aspect * size
    np.testing.assert_allclose(found.footprints.arrays.row_u.numpy(), scale * np.cross(v, n) / area, atol=allowed)
    np.testing.assert_allclose(found.footprints.arrays.row_v.numpy(), scale * np.cross(n, u) / area, atol=allowed)
    np.testing.assert_allclose(density(found), 3 * scale**2 / np.abs(area[:, 0]), rtol=16 * ROUNDING * aspect)
    assert found.footprints.clamped == 0


def kernel_variance(kernel: str) -> float:
    """Variance along an axis of a radial kernel of unit radius, by the midpoint rule."""
    positions, area = grid((-1, -1), (1, 1), (1000, 1000))
    return float((static_kernel(kernel, positions[:, :2]) * positions[:, 0] ** 2).sum() * area)


@pytest.mark.parametrize("kernel", kernels.RADIAL)
def test_variances_of_a_pixel_and_of_a_radial_footprint_add_up(kernel):
    photons, half = tangent_photons(), 0.03
    found = shaped(photon_map(**photons), kernel=kernel, half_pixel=half)
    n = photons["normals"]
    tangent = np.eye(3) - np.einsum("ni,nj->nij", n, n)
    # MᵀM is the inverse of C + ε²I in the tangent plane, where the kernel has its own part of C for a variance.
    wide = covariance(photons) + half**2 / kernel_variance(kernel) * tangent
    np.testing.assert_allclose(np.einsum("nij,njk->nik", metric(found), wide), tangent, atol=2e-3)
    axes = np.sort(np.linalg.eigvalsh(wide), axis=1)[:, 1:]
    np.testing.assert_allclose(density(found), 1 / np.sqrt(axes.prod(axis=1)), rtol=1e-3)


@pytest.mark.parametrize("side", [0.02, 0.05, 0.5])
@pytest.mark.parametrize("angle", [90, 60, 20, 3])
def test_a_widened_b_spline_is_as_wide_as_it_is_on_average_over_a_pixel(side, angle):
    """Variances add up; those of a parallelogram's axes, whose orthogonal part the box takes, to within a half."""
    u, v = np.array([0.05, 0, 0]), 0.04 * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0])
    found = shaped(photon_map([(0, 0, 0)], u / 2, v / 2), half_pixel=side / math.sqrt(12), smoothing=2.0)
    half = 0.15 + 2 * side
    positions, area = grid((-half, -half), (half, half), (1200, 1200))
    weights = first_channel(found, positions) * area
    assert weights.sum() == pytest.approx(1, rel=1e-3)
    spread = np.einsum("n,ni,nj->ij", weights, positions[:, :2], positions[:, :2])
    cell = covariance({"dxdu": u[None], "dxdv": v[None]})[0, :2, :2]
    added = np.linalg.eigvalsh(spread - cell) / (side**2 / 12)
    # Axes are no shorter than the box's deviation, so that small cells under large boxes count as a quarter more.
    assert np.all(added > 0.7) and np.all(added < 1.6)
    if angle == 90 and side < 0.1:
        np.testing.assert_allclose(added, 1, rtol=1e-2)


@pytest.mark.parametrize("angle", [90, 60, 20])
def test_a_footprint_smaller_than_a_pixel_is_as_wide_as_cell_and_pixel(angle):
    side = 0.1
    u, v = np.array([0.05, 0, 0]), 0.04 * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0])
    found = shaped(photon_map([(0, 0, 0)], u, v), half_pixel=side / math.sqrt(12))
    half = 0.15
    positions, area = grid((-half, -half), (half, half), (1200, 1200))
    weights = first_channel(found, positions) * area
    assert weights.sum() == pytest.approx(1, rel=2e-3)
    spread = np.einsum("n,ni,nj->ij", weights, positions[:, :2], positions[:, :2])
    # A B-spline has a quarter of the square of its axes, a cell a twelfth.
    expected = covariance({"dxdu": u[None], "dxdv": v[None]})[0, :2, :2] / 3 + side**2 / 12 * np.eye(2)
    np.testing.assert_allclose(spread, expected, atol=0.01 * np.trace(expected))


def test_pixels_much_smaller_than_cells_widen_nothing():
    photon = photon_map([(0, 0, 0)], (0.05, 0, 0), (0, 0.005, 0))
    found = shaped(photon, half_pixel=0.02 / math.sqrt(12), smoothing=2.0)
    np.testing.assert_allclose(found.footprints.arrays.filter_width.numpy(), [[0, 2, 0]], rtol=1e-5)


def test_pixels_grow_with_the_distance_from_the_eye():
    size = PixelSize()
    size.eye, size.slope = (0.0, 0.0, 1.0), math.sqrt(12) * 0.02
    photons = photon_map([(0, 0, 0), (0, 0, -1.0)], (0, 0, 0), (0, 0, 0))
    found = FootprintMap.of(shape_footprints([photons], "uniform", 1.0, size, False, ONE_THREAD))
    expected = kernel_variance("uniform") / np.array([0.02, 0.04]) ** 2
    np.testing.assert_allclose(density(found), expected, rtol=1e-3)


def test_smoothing_scales_the_footprint():
    photons = tangent_photons()
    wide = {**photons, "dxdu": 2.5 * photons["dxdu"], "dxdv": 2.5 * photons["dxdv"]}
    a, b = shaped(photon_map(**photons), smoothing=2.5), shaped(photon_map(**wide))
    rows = [one.footprints.arrays.row_u.numpy() for one in (a, b)]
    np.testing.assert_allclose(*rows, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(density(a), density(b), rtol=1e-5)


@pytest.mark.parametrize("kernel", ["epanechnikov", "bspline"])
def test_swapping_or_flipping_columns_changes_nothing(kernel):
    photons = tangent_photons()
    given = shaped(photon_map(**photons), kernel=kernel)
    u, v = photons["dxdu"], photons["dxdv"]
    for du, dv in ((v, u), (-u, v), (u, -v), (-v, -u)):
        other = shaped(photon_map(**{**photons, "dxdu": du, "dxdv": dv}), kernel=kernel)
        peak = np.abs(metric(given)).max(axis=(1, 2))
        assert np.all(np.abs(metric(other) - metric(given)).max(axis=(1, 2)) <= 1e-4 * peak)
        np.testing.assert_allclose(density(other), density(given), rtol=1e-5)
        np.testing.assert_allclose(bounds(other), bounds(given), atol=1e-5)


@pytest.mark.parametrize("kernel", ["epanechnikov", "bspline"])
def test_turning_a_footprint_turns_its_metric(kernel):
    photons = tangent_photons()
    turn = rotations(len(photons["dxdu"]), 9)
    turned = {name: np.einsum("nij,nj->ni", turn, value) for name, value in photons.items()}
    a, b = shaped(photon_map(**photons), kernel=kernel), shaped(photon_map(**turned), kernel=kernel)
    expected = np.einsum("nij,njk,nlk->nil", turn, metric(a), turn)
    peak = np.abs(expected).max(axis=(1, 2))
    assert np.all(np.abs(metric(b) - expected).max(axis=(1, 2)) <= 1e-4 * peak)
    np.testing.assert_allclose(density(b), density(a), rtol=1e-5)
    for k in ("row_u", "row_v"):
        rows = np.einsum("nij,nj->ni", turn, getattr(a.footprints.arrays, k).numpy())
        turned = getattr(b.footprints.arrays, k).numpy()
        np.testing.assert_allclose(turned, rows, rtol=1e-3, atol=1e-4 * np.abs(rows).max())


FOOTPRINTS = {
    "round": ((0.1, 0, 0), (0, 0.1, 0)),
    "sheared": ((0.1, 0.02, 0), (0.08, 0.07, 0)),
    "mirrored": ((0.02, 0.1, 0), (0.1, -0.03, 0)),
    "fold": ((0.1, 0.05, 0), (0.06, 0.03, 0)),
    "nearly folded": ((0.1, 0.05, 0), (0.06, 0.0301, 0)),
    "no Du": ((0, 0, 0), (0.03, 0.1, 0)),
    "cusp": ((0, 0, 0), (0, 0, 0)),
    "long": ((0.3, 0.1, 0), (0, 1e-6, 0)),
    "grazing": ((0, 50.0, 0), (0.05, 0, 0)),
    "off the plane": ((0.1, 0, 0.4), (0, 0.1, -0.2)),
}


@pytest.mark.parametrize("name", FOOTPRINTS)
@pytest.mark.parametrize("dxdt", [(0, 0, 0), (0.35, -0.1, 0)])
def test_check_17_footprints_keep_their_flux_however_they_are_widened(name, dxdt):
    dxdu, dxdv = FOOTPRINTS[name]
    half = 0.012
    for form in (GatherForm(), EPANECHNIKOV):
        photon = photon_map([(0, 0, 0)], dxdu, dxdv, dxdt, flux=2.0)
        found = shaped(photon, kernel=form.kernel, half_pixel=half, moves=True)
        low, high = bounds(found)[:, 0, :2]
        counts = np.maximum(np.ceil((high - low) / (0.1 * half)).astype(int), 40)
        counts = np.minimum(counts, 1500)
        positions, area = grid(low, high, counts)
        total = first_channel(found, positions, form).sum() * area
        # The narrowest axis is two half pixels wide, twenty cells; the midpoint rule's error is second order in a
        # cell, for the Epanechnikov kernel by the bend at its rim. What is smaller than a pixel is a box as large as
        # one, thirty-five cells wide, of whose hard edges the rule may miss half a cell along each axis.
        averaged = form == GatherForm() and name == "cusp"
        assert total == pytest.approx(2.0, rel=1 / 35 if averaged else (1 / 20) ** 2), (name, form.kernel)


@pytest.mark.parametrize("away", [0.0, 1e-5, 0.5])
def test_limited_footprints_are_counted(away):
    dxdu = [(0.1, 0, 0), (5.0, 0, 0), (0.3, 0, 0), (0, 0, 0), (0.5, 0, 0)]
    dxdv = [(0, 0.1, 0), (0, 5.0, 0), (0, 1e-5, 0), (0, 0, 0), (0, 0.001, 0)]
    photons = photon_map(np.tile([away, 0, 0], (5, 1)), dxdu, dxdv)
    found = shaped(photons)
    np.testing.assert_array_equal(found.footprints.arrays.clamped.numpy(), [0, 1, 1, 1, 0])
    assert found.footprints.clamped == 3
    arrays = found.footprints.arrays
    axes = np.sort(1 / np.linalg.norm([arrays.row_u.numpy(), arrays.row_v.numpy()], axis=2), axis=0)
    longest, thinnest = axes[1], axes[0]
    assert np.all(longest <= float(LONGEST_AXIS) * (1 + 1e-5))
    smallest = max(float(SHORTEST_AXIS) * away, float(SHORTEST_AXIS_AT_ORIGIN))
    assert np.all(thinnest >= np.maximum(longest / float(LARGEST_ASPECT), smallest) * (1 - 1e-5))
    # The one that has collapsed is as small as single precision tells points apart where it lies.
    assert thinnest[3] == pytest.approx(smallest, rel=1e-5)
    assert shaped(photons, half_pixel=0.01).footprints.clamped == 1


@pytest.mark.parametrize(("kernel", "curved"), [("epanechnikov", False), ("bspline", False), ("bspline", True)])
def test_bounds_enclose_every_point_that_is_reached_at_any_time(kernel, curved):
    photons, random = tangent_photons(), np.random.default_rng(4)
    photons["dxdu"][::5] = photons["dxdv"][::5]
    dxdt = 0.1 * random.normal(size=photons["dxdu"].shape)
    # In the plane, as all that a receiver at rest sees of them; axes change by more than they may.
    normals = photons["normals"][:, None]
    trajectory = np.swapaxes(0.1 * random.normal(size=(len(dxdt), 4, 3)), 0, 1)
    trajectory -= np.swapaxes((np.swapaxes(trajectory, 0, 1) * normals).sum(axis=2, keepdims=True) * normals, 0, 1)
    given = photon_map(**photons, dxdt=dxdt, trajectory=trajectory if curved else None)
    # With a smoothing, none is a cell.
    found = shaped(given, kernel=kernel, half_pixel=0.004, moves=True, smoothing=1.0 + 1e-6)
    arrays = found.footprints.arrays
    rate = arrays.jacobian_rate.numpy() if curved else np.zeros((found.count, 2, 2))
    rows = np.stack([arrays.row_u.numpy(), arrays.row_v.numpy()], axis=1).astype(float)
    # Points of the support in filter space, as far out as it goes, carried into the world and along the path.
    support = bspline.SUPPORT if kernel == "bspline" else kernels.SUPPORT
    corners = support * random.uniform(-1, 1, (64, 2))
    widths = arrays.filter_width.numpy().astype(float) if kernel == "bspline" else np.zeros((found.count, 3))
    box = 0.5 * np.stack([widths[:, 0], widths[:, 1] + widths[:, 2]], axis=1)
    boxes = box[:, None] * random.uniform(-1, 1, (found.count, 64, 2))
    if kernel == "epanechnikov":
        corners /= np.maximum(np.linalg.norm(corners, axis=1, keepdims=True), 1e-9)
        corners *= 0.999
    assert np.all(static_kernel(kernel, corners) > 0)
    # Those of a footprint one after the other, as they lie along it.
    parts = found.pieces.rows.numpy()
    order = np.lexsort((parts["number"], parts["footprint"]))
    parts, pieces, number = parts[order], parts["footprint"][order], parts["number"][order]
    low, high = (corner.numpy()[order][:, None] for corner in (found.pieces.lower, found.pieces.upper))
    later = np.flatnonzero(number > 0)
    np.testing.assert_array_equal(parts["low_before"][later], low[later - 1, 0])
    np.testing.assert_array_equal(parts["high_before"][later], high[later - 1, 0])
    assert len(pieces) > 1.2 * found.count
    for tau in (-0.5, 0.0, 0.2, 0.5):
        stretched = np.einsum("nij,kj->nki", np.eye(2) + tau * rate, corners)
        inside = np.einsum("nij,nkj->nki", np.linalg.pinv(rows), stretched + boxes)
        place = tau * dxdt + (0.5 * tau**2 * trajectory[0] + tau**3 / 6 * trajectory[1] if curved else 0.0)
        reached = arrays.center.numpy()[:, None].astype(float) + inside + place[:, None]
        at = reached[pieces]
        held = np.all((at >= low - 1e-6) & (at <= high + 1e-6), axis=2)
        times_held = np.zeros((found.count, len(corners)), int)
        np.add.at(times_held, pieces, held)
        assert times_held.min() >= 1
        # Those that hold a point follow each other, so that the first of them can stand for all.
        starts = held & np.vstack([np.ones_like(held[:1]), ~held[:-1] | (number[1:, None] == 0)])
        times_started = np.zeros_like(times_held)
        np.add.at(times_started, pieces, starts)
        np.testing.assert_array_equal(times_started, 1)


@pytest.mark.parametrize("kernel", ["epanechnikov", "bspline"])
def test_what_lies_off_the_plane_is_met_where_its_light_meets_the_plane(kernel):
    photons, random = tangent_photons(), np.random.default_rng(5)
    normals = photons["normals"]
    # Down to 35° above the plane; steeper light is limited.
    aside = np.cross(normals, random.normal(size=normals.shape))
    rays = 1.4 * random.uniform(size=(len(aside), 1)) * aside / np.linalg.norm(aside, axis=1, keepdims=True) - normals
    given = replace(photon_map(**photons), incidence=-rays.astype(np.float32))
    flat, found = (shaped(p, kernel=kernel, half_pixel=0.004) for p in (photon_map(**photons), given))
    height = found.footprints.arrays.plane_tolerance.numpy().astype(float)
    low, high = bounds(found)
    for name in ("row_u", "row_v"):
        before, after = (getattr(f.footprints.arrays, name).numpy().astype(float) for f in (flat, found))
        np.testing.assert_allclose((after * rays).sum(axis=1), 0.0, atol=1e-4 * np.linalg.norm(after, axis=1).max())
        along = photons["dxdu"] + 0.3 * photons["dxdv"]
        np.testing.assert_allclose((after * along).sum(axis=1), (before * along).sum(axis=1), rtol=1e-3, atol=1e-4)
    # Bounds hold what is so far off the plane, above it and below it.
    for part in (-1.0, 1.0):
        place = photons["positions"] + part * height[:, None] * rays
        assert np.all((place >= low - 1e-6) & (place <= high + 1e-6))


@pytest.mark.parametrize("form", [GatherForm(), EPANECHNIKOV], ids=["bspline", "epanechnikov"])
def test_a_swept_footprint_weighs_as_the_oracle_says(form):
    photons = tangent_photons(12, 0.06)
    random = np.random.default_rng(8)
    u, v, n = (photons[k] for k in ("dxdu", "dxdv", "normals"))
    dxdt = 0.7 * u - 1.3 * v
    offsets = np.einsum("ka,akj->kj", random.uniform(-0.8, 0.8, (12, 2)), np.stack([u, v]))
    found = shaped(photon_map(**photons, dxdt=dxdt, receiver=np.arange(12)), kernel=form.kernel, moves=True)
    points = queries(photons["positions"] + offsets, normals=n, receiver=np.arange(12))
    weights = irradiance(found, points, form).irradiance[:, 0]
    expected = footprint_weight(form.kernel, "shutter", offsets, u, v, dxdt)
    assert np.count_nonzero(expected) >= 8
    peak = 1 / np.linalg.norm(np.cross(u, v), axis=1)
    # Float32 positions of order one against cells of 0.06; the B-spline's two nodes a cell (see test_kernels).
    assert np.all(np.abs(weights - expected) <= peak * (4e-4 + (0.01 if form.kernel == "bspline" else 0)))


def test_no_photons_make_an_empty_map():
    found = shaped(photon_map(np.zeros((0, 3)), (1, 0, 0), (0, 1, 0)))
    assert found.count == 0 and found.bvh is None
    np.testing.assert_array_equal(first_channel(found, np.zeros((3, 3))), 0)


def test_a_footprint_holds_its_flux_in_every_channel():
    found = shaped(photon_map([(0, 0, 0)], (0.1, 0, 0), (0, 0.1, 0), flux=(1.0, 2.0, 3.0)))
    positions, area = grid((-0.25, -0.25), (0.25, 0.25), (50, 50))
    total = irradiance(found, queries(positions)).irradiance.astype(float).sum(axis=0) * area
    # Five nodes a cell of a B-spline: a sum over translates, exact up to rounding.
    np.testing.assert_allclose(total, [1, 2, 3], rtol=1e-5)
    assert math.isclose(total[2] / total[0], 3, rel_tol=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 0.5])
@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi / 4])
def test_what_is_smaller_than_a_pixel_is_shared_between_pixels_without_rest(turn, tilt):
    """A focus of a twentieth of a pixel: all of its flux in the pixels that it touches, whichever way these lie."""
    side = 0.1
    frame = PixelSize()
    frame.orthographic, frame.back = 1, (math.sin(tilt), 0.0, math.cos(tilt))
    across, along = np.array([math.cos(turn), math.sin(turn), 0.0]), np.array([-math.sin(turn), math.cos(turn), 0.0])
    # The image's axes, turned about the view; on the plane z = 0 pixels are parallelograms.
    view = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    right = across @ np.array([[math.cos(tilt), 0, -math.sin(tilt)], [0, 1, 0], [math.sin(tilt), 0, math.cos(tilt)]])
    up = np.cross(view, right)
    frame.right, frame.up = side * right, side * up
    on_plane = [v - view * (v[2] / view[2]) for v in (side * right, side * up)]
    area = abs(np.cross(*on_plane)[2])
    middle = 0.31 * on_plane[0] - 0.17 * on_plane[1]
    photon = photon_map([middle], 0.004 * along, 0.005 * across)
    found = FootprintMap.of(shape_footprints([photon], "bspline", 1.0, frame, False, ONE_THREAD))
    index = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), axis=-1).reshape(-1, 2)
    light = first_channel(found, index @ np.array(on_plane)) * area
    assert light.sum() == pytest.approx(1, abs=1e-4)
    # It lies in the middle pixel with all of its support.
    assert light[12] == pytest.approx(1, abs=1e-4)


def test_what_is_thin_and_smaller_than_a_pixel_counts_no_farther_off_its_plane_than_the_pixel_is_large():
    """Beside a fold columns are nearly along each other: its light is not on the step below."""
    frame = PixelSize()
    frame.orthographic, frame.back, frame.right, frame.up = 1, (0, 0, 1), (0.01, 0, 0), (0, 0.01, 0)
    photon = photon_map([[0, 0, 0]], [1e-3, 0, 0], [1e-3, 1e-5, 0])
    found = shape_footprints([photon], "bspline", 1.0, frame, False, ONE_THREAD)
    assert found.arrays.is_cell.numpy().all()
    # A quarter of its two sides.
    assert found.arrays.plane_tolerance.numpy().max() < 0.25 * 2 * (0.01 + 1e-3)


def test_a_line_finer_than_a_pixel_is_shared_as_it_crosses_pixels():
    """Pixels at 45° to a long thin footprint: each has the length of the line inside it."""
    side, thin, long = 0.1, 0.0001, 3.0
    frame = PixelSize()
    frame.orthographic, frame.back, frame.right, frame.up = 1, (0.0, 0.0, 1.0), (side, 0.0, 0.0), (0.0, side, 0.0)
    half = math.sqrt(0.5)
    photon = photon_map([(0, 0, 0)], (0.1 * long * half, 0.1 * long * half, 0), (-thin * half, thin * half, 0))
    found = FootprintMap.of(shape_footprints([photon], "bspline", 1.0, frame, False, ONE_THREAD))
    offsets = np.linspace(-0.1, 0.1, 41)
    light = first_channel(found, np.stack([offsets, -offsets, 0 * offsets], axis=1)) * side**2
    # The pixel's middle lies √2 |offset| off the line; a square's chord there is 2 (side/√2 − √2 |offset|) long. Flux a
    # length is b(0) = 3/4 over a cell's length at the footprint's middle.
    chords = np.maximum(math.sqrt(2) * side - 2 * math.sqrt(2) * np.abs(offsets), 0)
    np.testing.assert_allclose(light, 0.75 / (0.1 * long) * chords, atol=0.025 * light.max())
