"""What footprints leave at query points: irradiance, relative motion, and no leaking."""

from __future__ import annotations

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, UP, first_channel, grid, irradiance, photon_map, queries, shaped
from tpdwarp.device import Launcher
from tpdwarp.footprints.footprint_map import FootprintMap
from tpdwarp.footprints.gather import gather
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.weights import GatherForm
from usd_scenes.oracle import footprint_weight
from usd_scenes.oracle.closed_forms import lit_edge_profile

CELL = 0.05
FLUX = 0.01
ROUNDING = 2.0**-24
# Offsets of order one divided by a cell: what float32 makes of filter coordinates, times the B-spline's steepest slope.
OFFSET = 8 * ROUNDING / CELL
STEP_U, STEP_V = (CELL, 0, 0), (0, CELL, 0)
FORMS = [GatherForm(), GatherForm("epanechnikov")]


def lattice(low: float, high: float, shear: float = 0.0) -> np.ndarray:
    """Centres of lattice cells with columns (CELL, 0) and (shear CELL, CELL) over about [low, high]²."""
    index = np.arange(round(low / CELL) - 30, round(high / CELL) + 30)
    i, j = (a.ravel() + 0.5 for a in np.meshgrid(index, index))
    x, y = (i + shear * j) * CELL, j * CELL
    keep = (x > low) & (x < high) & (y > low) & (y < high)
    return np.stack([x, y, np.zeros_like(x)], axis=1)[keep]


def points(count: int = 300, reach: float = 0.3, seed: int = 5) -> np.ndarray:
    xy = np.random.default_rng(seed).uniform(-reach, reach, (count, 2))
    return np.append(xy, np.zeros((count, 1)), axis=1)


@pytest.mark.parametrize("shear", [0.0, 0.6])
@pytest.mark.parametrize("dxdt", [(0, 0, 0), (0.13, -0.07, 0)])
def test_a_lattice_of_footprints_is_uniform_irradiance_at_rest_and_in_motion(shear, dxdt):
    photons = photon_map(lattice(-0.6, 0.6, shear), STEP_U, (shear * CELL, CELL, 0), dxdt, flux=FLUX)
    found = first_channel(shaped(photons, moves=any(dxdt)), points())
    np.testing.assert_allclose(found, FLUX / CELL**2, rtol=4 * OFFSET)


@pytest.mark.parametrize("gain", [0.0, 0.6])
def test_a_lattice_that_bends_and_stretches_stays_uniform_and_gets_as_thin_as_its_cells_grow(gain):
    """Every place of a lattice follows x(s) = (1 + s A) x + s v + ½ s² b + ⅙ s³ j, so that light is flux by area."""
    change = np.diag([0.4, 0.4])
    at = lattice(-0.9, 0.9)
    ways = np.append(at[:, :2] @ change.T + (0.05, -0.02), np.zeros((len(at), 1)), axis=1)
    axes = np.append(CELL * change.T, np.zeros((2, 1)), axis=1)
    trajectory = ((0.1, 0.06, 0), (-0.2, 0.1, 0), *axes)
    photons = photon_map(at, STEP_U, STEP_V, ways, flux=FLUX, trajectory=trajectory, gain=gain)
    s = (np.arange(1000) + 0.5) / 1000 - 0.5
    areas = np.linalg.det(np.eye(2) + s[:, None, None] * change)
    found = first_channel(shaped(photons, moves=True), points())
    # Footprints that go farther have more nodes on their ways, which is what is left of the lattice.
    expected = FLUX / CELL**2 * np.mean((1 + s * gain) / areas)
    np.testing.assert_allclose(found, expected, rtol=4e-3)
    straight = photon_map(at, STEP_U, STEP_V, ways, flux=FLUX)
    assert np.std(first_channel(shaped(straight, moves=True), points())) > 5 * np.std(found)


@pytest.mark.parametrize("gain", [0.0, -0.8])
def test_views_that_share_the_shutter_out_average_to_the_whole_of_a_curved_trajectory(gain):
    trajectory = ((0.1, 0.06, 0), (-0.2, 0.1, 0), (0.02, 0.005, 0), (-0.01, -0.02, 0))
    photons = photon_map([(0, 0, 0)], STEP_U, STEP_V, (0.15, 0.1, 0), flux=FLUX, trajectory=trajectory, gain=gain)
    footprints = shaped(photons, moves=True)
    at, whole, total = points(400, 0.15), 0.0, 0.0
    whole = irradiance(footprints, queries(at), query_moves=True).irradiance[:, 0]
    for t in (np.arange(4) + 0.5) / 4 - 0.5:
        total += irradiance(footprints, queries(at), query_moves=True, time=t, window=(t, 0.25)).irradiance[:, 0] / 4
    # Parts have nodes of their own: more of them.
    np.testing.assert_allclose(total, whole, atol=0.01 * whole.max())


def test_zero_motion_weighs_like_no_motion():
    positions = lattice(-0.3, 0.3)
    photons = photon_map(positions, STEP_U, STEP_V, flux=np.random.default_rng(1).uniform(0, 1, (len(positions), 1)))
    at_rest = first_channel(shaped(photons), points())
    np.testing.assert_allclose(first_channel(shaped(photons, moves=True), points()), at_rest, rtol=8 * ROUNDING)
    still = irradiance(shaped(photons), queries(points()), query_moves=True).irradiance[:, 0]
    np.testing.assert_allclose(still, at_rest, rtol=8 * ROUNDING)


def uneven(dxdt=(0, 0, 0), **options):
    positions = lattice(-0.3, 0.3)
    flux = np.random.default_rng(2).uniform(0, FLUX, (len(positions), 1))
    return photon_map(positions, STEP_U, STEP_V, dxdt, flux=flux, **options)


@pytest.mark.parametrize("way", [(0.2, 0.1, 0), (0.05, -0.3, 0), (0.1, 0, 0.2)])
def test_check_6_light_that_rides_on_a_rigidly_moving_receiver_is_still(way):
    at_rest = first_channel(shaped(uneven()), points())
    together = irradiance(
        shaped(uneven(way), moves=True), queries(points(), way), query_moves=True, with_motion=True
    )
    np.testing.assert_allclose(together.irradiance[:, 0], at_rest, atol=4 * OFFSET * at_rest.max())


def test_a_common_motion_of_light_and_viewpoint_cancels():
    way, common = np.array([0.11, -0.04, 0]), np.array([0.1, 0.05, 0.02])
    alone = irradiance(shaped(uneven(way), moves=True), queries(points()), query_moves=True).irradiance
    moving = shaped(uneven(way + common), moves=True)
    both = irradiance(moving, queries(points(), common), query_moves=True).irradiance
    np.testing.assert_allclose(both, alone, atol=8 * OFFSET * alone.max())


@pytest.mark.parametrize("form", FORMS, ids=["bspline", "epanechnikov"])
def test_a_tracking_camera_sees_a_moving_caustic_sharp_and_a_static_one_sees_it_blurred(form):
    way = np.array([0.17, 0.06, 0])
    photon = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V, way), kernel=form.kernel, moves=True)
    at = points(120, 0.12)
    tracked = irradiance(photon, queries(at, way), form, query_moves=True).irradiance[:, 0]
    peak = footprint_weight(form.kernel, "static", np.zeros(3), np.array(STEP_U), np.array(STEP_V), 0 * way)[0]
    sharp = footprint_weight(form.kernel, "static", at, np.array(STEP_U), np.array(STEP_V), 0 * way)
    np.testing.assert_allclose(tracked, sharp, atol=4 * OFFSET * peak)
    blurred = footprint_weight(form.kernel, "shutter", at, np.array(STEP_U), np.array(STEP_V), way)
    # Two Gauss nodes a cell for the B-spline: see test_kernels.
    np.testing.assert_allclose(first_channel(photon, at, form), blurred, atol=0.01 * peak)
    assert np.abs(sharp - blurred).max() > 0.2 * peak


def test_a_camera_over_a_static_caustic_blurs_it_by_its_own_motion():
    way = np.array([0.14, 0.08, 0])
    passing = irradiance(shaped(uneven()), queries(points(), -way), query_moves=True).irradiance
    moved = irradiance(shaped(uneven(way), moves=True), queries(points())).irradiance
    np.testing.assert_allclose(passing, moved, atol=4 * OFFSET * moved.max())


@pytest.mark.parametrize("motion", [(0, 0, 0), (0.02, 0.015, 0)])
def test_segments_of_a_steady_motion_add_up_to_the_whole(motion):
    way = np.array([0.18, -0.07, 0])
    whole = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V, way), kernel="epanechnikov", moves=True)
    parts = [
        photon_map([t * way], STEP_U, STEP_V, way / 4, flux=0.25, time=t, duration=0.25)
        for t in (-0.375, -0.125, 0.125, 0.375)
    ]
    cut = shaped(*parts, kernel="epanechnikov", moves=True)
    at = queries(points(300, 0.12), motion)
    one, four = (irradiance(f, at, FORMS[1], query_moves=True).irradiance for f in (whole, cut))
    assert np.count_nonzero(one) > 50
    np.testing.assert_allclose(four, one, atol=32 * OFFSET * one.max())


@pytest.mark.parametrize(("motion", "windows"), [((0, 0, 0), 3), ((0.02, 0.015, 0), 3), ((0.3, -0.2, 0), 32)])
def test_views_that_share_the_shutter_out_between_them_average_to_the_whole(motion, windows):
    """However fast a view moves: one that races needs more windows, since it stands for no more than a footprint."""
    way, motion = np.array([0.18, -0.07, 0]), np.array(motion)
    photons = [photon_map([t * way], STEP_U, STEP_V, way / 2, flux=0.5, time=t, duration=0.5) for t in (-0.25, 0.25)]
    footprints, at = shaped(*photons, kernel="epanechnikov", moves=True), points(300, 0.12)
    whole = footprint_weight("epanechnikov", "shutter", at, np.array(STEP_U), np.array(STEP_V), way - motion)
    found = []
    for t in (np.arange(windows) + 0.5) / windows - 0.5:
        seen = queries(at + t * motion, motion)
        part = irradiance(footprints, seen, FORMS[1], query_moves=True, time=t, window=(t, 1 / windows))
        found.append(part.irradiance[:, 0])
    assert np.count_nonzero(whole) > 20
    np.testing.assert_allclose(np.mean(found, axis=0), whole, atol=32 * OFFSET * whole.max())


def test_a_view_that_races_stands_for_the_time_about_its_own():
    photon = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V), kernel="epanechnikov")
    motion, t = np.array([2.0, 0, 0]), 0.2
    seen = queries(points(300, 0.05) * (1, 0.4, 1), motion)
    found = irradiance(photon, seen, FORMS[1], query_moves=True, time=t, window=(t, 0.25)).irradiance
    still = irradiance(photon, seen, FORMS[1]).irradiance
    # Blurred over no more than the footprint's own size, it still meets it where it is at that time.
    assert found.max() > 0.25 * still.max()
    assert np.corrcoef(found[:, 0], still[:, 0])[0, 1] > 0.8


def test_a_photon_stays_on_its_own_object():
    photon = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V, receiver=3))
    found = irradiance(photon, queries(np.zeros((3, 3)), receiver=[3, 4, -1])).irradiance[:, 0]
    assert found[0] > 0 and found[1] == 0 and found[2] == 0


def test_a_photon_does_not_reach_through_a_thin_wall_to_its_other_side():
    photon = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V))
    found = irradiance(photon, queries([(0, 0, 0), (0, 0, -1e-4)], normals=[UP, (0, 0, -1)])).irradiance[:, 0]
    assert found[0] > 0 and found[1] == 0


def test_a_photon_does_not_reach_around_a_corner():
    photon = shaped(photon_map([(0.3 * CELL, 0, 0)], STEP_U, STEP_V))
    found = irradiance(photon, queries([(0, 0, 0), (0, 0, 0.01)], normals=[UP, (1, 0, 0)])).irradiance[:, 0]
    assert found[0] > 0 and found[1] == 0


@pytest.mark.parametrize("moves", [False, True])
def test_a_photon_does_not_reach_a_parallel_plane_beyond_its_own_size(moves):
    photon = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V), moves=moves)
    offsets = [0.0, 0.05 * CELL, 2 * CELL, -2 * CELL]
    found = irradiance(photon, queries([(0, 0, z) for z in offsets])).irradiance[:, 0]
    assert found[0] > 0 and found[1] == pytest.approx(found[0]) and found[2] == 0 and found[3] == 0


def test_small_steps_keep_light_apart_once_footprints_are_smaller():
    step = 0.02
    for scale, reaches in ((2.0, True), (0.2, False)):
        photon = shaped(photon_map([(0, 0, 0)], STEP_U, STEP_V), smoothing=scale)
        found = irradiance(photon, queries([(0, 0, step)])).irradiance[0, 0]
        assert (found > 0) == reaches


@pytest.mark.parametrize("cell", [0.04, 0.01])
def test_check_20_a_moving_lit_edge_is_a_linear_ramp_as_the_footprint_vanishes(cell):
    way = 0.2
    x = -(np.arange(round(0.4 / cell)) + 0.5) * cell
    across, along = np.meshgrid(x, (np.arange(8) - 3.5) * cell)
    positions = np.stack([across.ravel(), along.ravel(), 0 * across.ravel()], axis=1)
    lit = photon_map(positions, (cell, 0, 0), (0, cell, 0), (way, 0, 0), flux=cell**2)
    at = np.linspace(-0.16, 0.16, 129)
    found = first_channel(shaped(lit, moves=True), np.stack([at, 0 * at, 0 * at], axis=1))
    # A ramp of slope 1/way, smoothed over a mean distance below one cell.
    np.testing.assert_allclose(found, lit_edge_profile(at, way), atol=cell / way)


@pytest.mark.parametrize("form", FORMS, ids=["bspline", "epanechnikov"])
def test_blurring_moves_light_but_keeps_it(form):
    way = (0.2, 0.1, 0)
    positions, area = grid((-0.6, -0.6), (0.6, 0.6), (240, 240))
    flux = []
    for dxdt in ((0, 0, 0), way):
        found = first_channel(shaped(uneven(dxdt), kernel=form.kernel, moves=any(dxdt)), positions, form)
        flux.append(found.sum() * area)
    sent = uneven().flux[:, 0].sum(dtype=float)
    # Ten nodes a cell; the bend at the Epanechnikov kernel's rim costs its slope 8/π/CELL times half a node squared,
    # with the rims of hundreds of footprints at random phases.
    np.testing.assert_allclose(flux, sent, rtol=(1 / 10) ** 2 / 2)


def test_motion_is_the_flux_weighted_displacement_over_the_whole_shutter():
    photons = [
        photon_map([(0, 0, 0)], STEP_U, STEP_V, (0.03, 0, 0), flux=1.0, receiver_motion=(0.01, 0, 0), duration=0.5),
        photon_map([(0, 0, 0)], STEP_U, STEP_V, (0, 0.03, 0), flux=3.0, duration=0.5),
    ]
    still = shaped(*photons)
    found = irradiance(still, queries([(0, 0, 0), (0.5, 0, 0)]), with_motion=True)
    np.testing.assert_allclose(found.motion[0] / found.weight[0], [0.04 * 0.25, 0.06 * 0.75, 0], atol=1e-6)
    np.testing.assert_array_equal(found.photons, [2, 0])
    assert found.weight[1] == 0


def test_neighbouring_queries_do_not_change_an_answer():
    footprints, at = shaped(uneven((0.1, 0.05, 0)), moves=True), points(400)
    order = np.random.default_rng(3).permutation(len(at))
    together = first_channel(footprints, at)
    np.testing.assert_allclose(first_channel(footprints, at[order]), together[order], rtol=64 * ROUNDING)
    alone = first_channel(footprints, at[:1])
    np.testing.assert_allclose(alone, together[:1], rtol=64 * ROUNDING)


def test_answers_do_not_depend_on_the_number_of_threads():
    footprints, at = shaped(uneven((0.1, 0.05, 0)), moves=True), points(5000)
    one, three = (
        gather(footprints, queries(at), GatherForm(), launcher, Lookup(with_motion=True))
        for launcher in (ONE_THREAD, Launcher("cpu", 3))
    )
    for name in ("irradiance", "motion", "weight", "photons"):
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))


@pytest.mark.parametrize("dxdt", [(0, 0, 0), (0.13, -0.07, 0)])
def test_maps_of_some_footprints_share_their_arrays_and_add_up_to_all_of_them(dxdt):
    at = points(400)
    whole = shaped(photon_map(at, STEP_U, STEP_V, dxdt, flux=FLUX), moves=any(dxdt))
    some = np.random.default_rng(2).permutation(len(at))
    parts = [FootprintMap.of(whole.footprints, np.sort(rows)) for rows in (some[:150], some[150:])]
    assert all(part.footprints.arrays is whole.footprints.arrays for part in parts)
    assert sum(part.count for part in parts) == whole.count
    looked_at = points(300, seed=8)
    expected = first_channel(whole, looked_at)
    found = sum(first_channel(part, looked_at) for part in parts)
    assert expected.max() > 0
    # Runs of queries are as large as footprints are, and of half of them these may be other ones: parabolas differ.
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * expected.max())
