"""Laws of the estimate from the nearest photons."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.footprints.photons import UP, grid, photon_map, queries
from tpdwarp.errors import InputError
from tpdwarp.estimators.nearest import NearestField
from tpdwarp.footprints.irradiance import Lookup

DOWN = (0.0, 0.0, -1.0)
ZERO = (0, 0, 0)


def scattered(count: int, seed: int = 0, **options):
    """Photons at random places of the unit square with random flux."""
    random = np.random.default_rng(seed)
    positions = np.concatenate([random.uniform(0, 1, (count, 2)), np.zeros((count, 1))], axis=1)
    return photon_map(positions, ZERO, ZERO, flux=random.uniform(0, 1, (count, 3)), **options)


def light(maps, neighbours, points, *, window=(0.0, 1.0), query_moves=False, with_motion=False):
    field = NearestField(maps, neighbours, 1)
    return field.irradiance(points, Lookup(0.0, window, query_moves, with_motion))


def brute_force(photons, neighbours: int, point: np.ndarray) -> np.ndarray:
    """The definition, photon by photon."""
    distances = np.linalg.norm(photons.position.astype(float) - point.astype(np.float32).astype(float), axis=1)
    nearest = np.argsort(distances)[:neighbours]
    r = distances[nearest[-1]]
    total = np.zeros(3)
    for i in nearest:
        total += photons.flux[i].astype(float) * 2 / np.pi * (1 - (distances[i] / r) ** 2) / r**2
    return total


@pytest.mark.parametrize("neighbours", [2, 17, 200, 1000])
def test_the_estimate_is_that_of_brute_force(neighbours):
    photons, points = scattered(300), np.random.default_rng(1).uniform(0, 1, (20, 3)) * (1, 1, 0)
    expected = [brute_force(photons, neighbours, point) for point in points]
    np.testing.assert_allclose(light([photons], neighbours, queries(points)).irradiance, expected, rtol=1e-9)


def test_maps_of_several_instants_are_searched_as_one():
    early, late = (scattered(100, seed, time=time, duration=0.5) for seed, time in ((2, -0.25), (3, 0.25)))
    points = queries([[0.4, 0.5, 0]])
    split = light([early, late], 30, points).irradiance
    one = photon_map(
        np.concatenate([early.position, late.position]), ZERO, ZERO, flux=np.concatenate([early.flux, late.flux])
    )
    np.testing.assert_array_equal(split, light([one], 30, points).irradiance)


def test_a_uniform_lattice_gives_its_flux_density():
    positions, cell = grid((-1, -1), (1, 1), (80, 80))
    photons, k = photon_map(positions, ZERO, ZERO, flux=3.0 * cell), 400
    found = light([photons], k, queries(np.random.default_rng(4).uniform(-0.3, 0.3, (50, 3)) * (1, 1, 0)))
    # k cells, each within half a diagonal of its photon, cover a disk whose radius errs by no more than that diagonal.
    tolerance = 2 * np.sqrt(0.5) / np.sqrt(k / np.pi)
    np.testing.assert_allclose(found.irradiance, 3.0, rtol=tolerance)
    assert abs(found.irradiance.mean() / 3.0 - 1) < tolerance / 5


def test_photons_of_other_objects_and_of_the_other_side_do_not_count():
    mine, points = scattered(60), queries([[0.5, 0.5, 0], [0.2, 0.7, 0]])
    alone = light([mine], 20, points).irradiance
    others = [scattered(150, 5, receiver=1), scattered(200, 6, normals=DOWN)]
    np.testing.assert_array_equal(light([mine, *others], 20, points).irradiance, alone)
    elsewhere = queries([[0.5, 0.5, 0]], receiver=1)
    assert np.any(light([mine, *others], 20, elsewhere).irradiance != alone[0])
    assert not light([mine], 20, queries([[0.5, 0.5, 0]], normals=DOWN)).irradiance.any()
    assert not light([mine], 20, queries([[0.5, 0.5, 0]], receiver=-1)).irradiance.any()


@pytest.mark.parametrize("motion", [(0, 0, 0.1), None])
def test_queries_take_the_photons_of_their_window_alone(motion):
    early, late = (scattered(80, seed, time=time, duration=0.5) for seed, time in ((7, -0.25), (8, 0.25)))
    looking = queries([[0.5, 0.5, 0]], motions=motion) if motion else queries([[0.5, 0.5, 0]])
    for window, part in (((-0.25, 0.5), early), ((0.25, 0.5), late)):
        found = light([early, late], 20, looking, window=window, query_moves=motion is not None).irradiance
        # Each stands for half of the shutter, which its window sees twice as brightly as the whole does.
        np.testing.assert_allclose(found, 2 * light([part], 20, looking).irradiance, rtol=1e-12)


def test_all_photons_in_one_place_leave_no_number_that_is_not_finite():
    photons = photon_map(np.zeros((10, 3)), ZERO, ZERO)
    assert np.isfinite(light([photons], 5, queries([[0, 0, 0], [1, 0, 0]])).irradiance).all()


def test_the_photons_found_are_counted_and_have_no_motion():
    found = light([scattered(50)], 20, queries([[0.5, 0.5, 0], [0.5, 0.5, 0]], normals=[UP, DOWN]), with_motion=True)
    assert found.photons.tolist() == [20, 0]
    assert not found.motion.any() and found.weight[0] == pytest.approx(found.irradiance[0].sum())


def test_without_scipy_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    with pytest.raises(InputError, match=r"needs SciPy \(pip install 'tpdwarp\[study\]'\)"):
        NearestField([scattered(3)], 2, 1)
