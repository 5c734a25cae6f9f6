"""Wide footprints: on rasters their light is what it is at each query, wherever and whenever that looks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, photon_map, pixel, queries, shaped
from tpdwarp.footprints import rasters
from tpdwarp.footprints.footprint_map import shape_footprints
from tpdwarp.footprints.gather import gather, gathered
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.light import FootprintLight
from tpdwarp.footprints.plain_gather import plain_gather
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.footprints.wide import wide_footprints

CELL, HALF_PIXEL = 0.05, 0.001
# What cubic convolution errs by between corners of squares of a third of a cell, where light changes from cell to cell
# by half of its mean at random, in the mean of squares and at worst: by experiment in one, two and many cells, on
# squares turned against the cells (docs/method.md, section 11).
RANDOM_ERROR, WORST_ERROR = 0.002, 0.0113


def uneven(turn: float = 0.4, spread: float = 0.5, **columns):
    """Photons on a lattice turned on the plane z = 0, with an irradiance of one that changes by ``spread``."""
    x = np.arange(-1.0, 1.0, CELL)
    flux = 1.0 + spread * np.random.default_rng(7).uniform(-1.0, 1.0, len(x) ** 2)
    c, s = math.cos(turn), math.sin(turn)
    u, v = (a.ravel() for a in np.meshgrid(x, x))
    at = np.stack([c * u - s * v, s * u + c * v, 0 * u], axis=1)
    steps = (CELL * c, CELL * s, 0), (-CELL * s, CELL * c, 0)
    return photon_map(at, *steps, flux=CELL**2 * flux[:, None], **columns)


def chosen(photons, size=HALF_PIXEL, smoothing=1.0):
    footprints = shape_footprints([photons], "bspline", smoothing, pixel(size), True, ONE_THREAD)
    return wide_footprints(footprints, pixel(size), ONE_THREAD)


def found(photons, points, lookup=Lookup(), moves=True) -> np.ndarray:  # noqa: B008
    light = FootprintLight([photons], GatherForm(), 1.0, pixel(HALF_PIXEL), moves, ONE_THREAD)
    return light.irradiance(points, lookup).irradiance[:, 0].astype(np.float64)


def plainly(photons, points, lookup=Lookup(), moves=True) -> np.ndarray:  # noqa: B008
    footprints = shaped(photons, half_pixel=HALF_PIXEL, moves=moves)
    return plain_gather(footprints, points, GatherForm(), ONE_THREAD, lookup).irradiance[:, 0].astype(np.float64)


def scattered(count: int = 2000, reach: float = 0.5) -> np.ndarray:
    return np.append(np.random.default_rng(4).uniform(-reach, reach, (count, 2)), np.zeros((count, 1)), axis=1)


@pytest.mark.parametrize("way", [(0, 0, 0), (0.03, 0.02, 0)])
def test_wide_light_is_what_it_is_at_each_query(way):
    photons, points = uneven(dxdt=way), queries(scattered())
    assert len(chosen(photons).others) == 0
    errors = found(photons, points) - plainly(photons, points)
    assert 0 < np.sqrt(np.mean(errors**2)) < RANDOM_ERROR
    assert np.abs(errors).max() < WORST_ERROR


@pytest.mark.parametrize("way", [(0, 0, 0), (0.06, 0.03, 0)])
def test_nothing_is_gathered_where_no_footprint_reaches(monkeypatch, way):
    photons = uneven(dxdt=way)
    some = photons.rows(np.hypot(*(photons.position[:, :2] - 0.1).T) < 0.35)
    assert len(chosen(some).others) == 0
    corners = []

    def counted(maps, at, *rest):
        corners.append(at.position.shape[0])
        return gathered(maps, at, *rest)

    points = queries(scattered(8000, 1.6))
    plain = plainly(some, points)
    monkeypatch.setattr(rasters, "gathered", counted)
    errors = found(some, points) - plain
    assert np.abs(errors[plain == 0.0]).max() < WORST_ERROR and np.sqrt(np.mean(errors**2)) < RANDOM_ERROR
    assert (plain == 0.0).mean() > 0.8
    every = sum(corners)
    monkeypatch.setattr(rasters, "DARK", rasters.UNKNOWN)
    corners.clear()
    np.testing.assert_array_equal(found(some, points), errors + plain)
    assert every < 0.25 * sum(corners)


def test_squares_are_no_more_than_a_third_of_a_cell_on_its_narrow_side():
    photons = uneven()
    photons.dxdu[:] *= 4.0
    wide = chosen(photons)
    (side,) = wide.still
    assert CELL / 6 < side <= CELL / 3
    # Widened cells have wider squares.
    (wider,) = chosen(photons, smoothing=2.0).still
    assert wider == 2 * side


@pytest.mark.parametrize("what", ["a receiver that moves", "few photons", "pixels as large as squares", "thin ones"])
def test_no_footprints_are_wide_where_rasters_gain_nothing_or_are_wrong(what):
    photons = uneven(receiver_motion=(0.1, 0, 0) if what == "a receiver that moves" else (0, 0, 0))
    if what == "few photons":
        photons = photons.rows(np.arange(100))
    if what == "thin ones":
        photons.dxdu[:] *= 1e-2
    wide = chosen(photons, 0.01 if what == "pixels as large as squares" else HALF_PIXEL)
    assert not wide.still and not wide.moving
    assert len(wide.others) == len(photons) or what == "thin ones"


def test_parts_of_the_shutter_see_what_moves_where_it_is_then():
    photons, points = uneven(dxdt=(0.2, 0.1, 0)), queries(scattered())
    lookup = Lookup(time=0.3, window=(0.3, 0.2))
    plain = plainly(photons, points, lookup)
    whole = plainly(photons, points)
    errors = found(photons, points, lookup) - plain
    # As they are gathered one by one, parabolas err by parts of a thousand.
    assert np.abs(errors).max() < 2e-3 < np.abs(whole - plain).max()


def test_queries_that_move_see_the_mean_of_light_at_rest_along_their_way():
    photons, motion, at = uneven(), np.array([0.15, 0.1, 0.0]), scattered(300)
    seen = found(photons, queries(at, motions=motion), Lookup(query_moves=True))
    steps = (np.arange(32) + 0.5) / 32 - 0.5
    plain = np.mean([plainly(photons, queries(at + late * motion)) for late in steps], axis=0)
    assert np.sqrt(np.mean((seen - plain) ** 2)) < RANDOM_ERROR
    # Where they stand alone it is other light.
    assert np.abs(plainly(photons, queries(at)) - plain).max() > 0.05


def test_motion_and_number_are_those_of_all_footprints():
    way, lookup = (0.03, 0.02, 0), Lookup(with_motion=True)
    photons, points = uneven(dxdt=way), queries(scattered(500))
    light = FootprintLight([photons], GatherForm(), 1.0, pixel(HALF_PIXEL), True, ONE_THREAD)
    seen = light.irradiance(points, lookup)
    direct = gather(shaped(photons, half_pixel=HALF_PIXEL, moves=True), points, GatherForm(), ONE_THREAD, lookup)
    np.testing.assert_array_equal(seen.photons, direct.photons)
    np.testing.assert_allclose(seen.motion, direct.motion, rtol=1e-5)
    np.testing.assert_allclose(seen.weight, direct.weight, rtol=1e-5)
