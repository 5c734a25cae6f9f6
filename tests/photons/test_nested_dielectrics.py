"""Light through solids that lie in each other or touch, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import ball, box, floor, glass, moving
from tests.photons.traced import Traced, lamp, scene_of, sun, traced
from usd_scenes.oracle.closed_forms import ball_lens_focal_length, fresnel_reflectance, snell

WATER, GLASS, ICE = 1.33, 1.5, 1.31
SLOPE = 0.4
THETA = np.arctan(SLOPE)
# Positions of a scene of radius six in single precision, through some surfaces each.
ROUNDING = 2e-5


def water(bottom: float = 1.0, top: float = 1.5):
    return box("/water", (-2, -2, bottom), (2, 2, top), glass(WATER))


def slab(low: float = 0.6, high: float = 1.0, ior: float = GLASS):
    return box("/slab", (-2, -2, low), (2, 2, high), glass(ior))


def straight_through(result: Traced, interfaces: int) -> np.ndarray:
    """Rows of the photons that nothing reflected: at the first, through each of so many interfaces once."""
    brightest = result.photons.flux[:, 0] > 0.9 * result.photons.flux[:, 0].max()
    return np.flatnonzero((result.photons.bounces == interfaces) & brightest)


def through_layers(*layers: tuple[float, float]) -> tuple[float, float]:
    """Shift and transmittance of light at THETA through layers of (index, thickness), to air."""
    shift, passed, index, theta = 0.0, 1.0, 1.0, THETA
    for next_index, thickness in (*layers, (1.0, 0.0)):
        beyond = snell(theta, index, next_index)
        passed *= 1 - fresnel_reflectance(theta, index, next_index)
        shift += thickness * np.tan(beyond)
        index, theta = next_index, beyond
    return shift, passed


@pytest.mark.parametrize("above", [False, True], ids=["water on glass", "glass on water"])
@pytest.mark.parametrize("grown", [0.0, 0.05], ids=["touching", "grown into it"])
def test_layers_in_contact_refract_and_reflect_at_each_interface_once(above, grown):
    layers = [(WATER, 0.5), (GLASS, 0.4)]
    meshes = [water(1.0 - grown), slab()]
    if above:
        layers = [(GLASS, 0.4), (WATER, 0.4)]
        meshes = [water(0.6, 1.0 + grown), slab(1.0, 1.4)]
    result = traced(scene_of([floor(half=9.0), *meshes], sun((SLOPE, 0, -1))), 1024)
    rows = straight_through(result, 3)
    shift, passed = through_layers(*layers)
    level = meshes[0 if not above else 1].points[:, 2].max()
    start = result.origins()[rows]
    entry = start[:, 0] - (level - start[:, 2]) * SLOPE
    shift += 0.6 * SLOPE
    middle = np.abs(entry) < 1.2
    assert middle.sum() > 100
    np.testing.assert_allclose(result.photons.positions[rows][middle, 0], (entry + shift)[middle], atol=ROUNDING)
    # Cells across the sun hold the light of their area.
    area = np.linalg.norm(np.cross(*result.steps.T))
    np.testing.assert_allclose(result.photons.flux[rows][middle, 0], passed * area, rtol=1e-4)


def test_water_grown_into_glass_changes_no_photon():
    found = [
        traced(scene_of([floor(half=9.0), water(1.0 - grown), slab()], sun((SLOPE, 0, -1))), 1024)
        for grown in (0.0, 1e-3, 0.05)
    ]
    for other in found[1:]:
        assert other.energy.deposited == pytest.approx(found[0].energy.deposited, rel=1e-5)
        np.testing.assert_array_equal(other.photons.ids, found[0].photons.ids)
        np.testing.assert_allclose(other.photons.positions, found[0].photons.positions, atol=ROUNDING)


def in_water(body, depth_below: float = 1.2, photons: int = 4096) -> Traced:
    """Vertical light through a body whose middle is at the origin, in deep water on a floor."""
    around = box("/water", (-3, -3, -depth_below - 1), (3, 3, 1.0), glass(WATER))
    return traced(scene_of([floor(-depth_below, 2.9), around, body], sun()), photons)


def near_axis(result: Traced, radius: float) -> np.ndarray:
    start = result.origins()
    return np.flatnonzero((np.hypot(start[:, 0], start[:, 1]) < radius) & (result.photons.bounces == 3))


def test_a_ball_of_ice_in_water_is_a_weak_diverging_lens():
    radius, depth = 0.5, 1.2
    result = in_water(ball("/ice", (0, 0, 0), radius, 48, glass(ICE)), depth, 1 << 16)
    rows = near_axis(result, 0.1 * radius)
    assert len(rows) > 8
    focal_length = ball_lens_focal_length(radius, ICE / WATER)
    assert focal_length < 0
    # Spherical aberration at a tenth of the radius goes with its square, and normals that are interpolated over 48
    # cells of a face turn unevenly by as little.
    stretch = result.stretch()[rows]
    widened = 1 - depth / focal_length
    np.testing.assert_allclose(stretch, np.broadcast_to(widened * np.eye(2), stretch.shape), atol=0.02 * (widened - 1))
    # As paraxial light through the same ball in air whose index is relative.
    passed = (1 - fresnel_reflectance(0, 1, WATER)) * (1 - fresnel_reflectance(0, WATER, ICE)) ** 2
    area = np.linalg.norm(np.cross(*result.steps.T))
    np.testing.assert_allclose(result.photons.flux[rows, 0], passed * area, rtol=1e-4)


def test_nothing_is_lost_at_a_ball_of_ice():
    energy = in_water(ball("/ice", (0, 0, 0), 0.5, 24, glass(ICE))).energy
    assert energy.sent == pytest.approx(3 * 36.0, rel=1e-5)
    assert energy.deposited + energy.escaped + energy.lost_total == pytest.approx(energy.sent, rel=1e-6)


@pytest.mark.parametrize(("solid", "relative"), [(1.0, 1.0 / WATER)])
def test_a_bubble_of_air_is_a_ball_of_the_relative_index(solid, relative):
    """An index below one is relative to what is around, so that such a ball is none of the nested solids."""
    nested = in_water(ball("/ball", (0, 0, 0), 0.3, 24, glass(solid)))
    alone = in_water(ball("/ball", (0, 0, 0), 0.3, 24, glass(relative)))
    assert nested.energy.deposited == pytest.approx(alone.energy.deposited, rel=1e-4)
    np.testing.assert_array_equal(nested.photons.ids, alone.photons.ids)
    apart = np.linalg.norm(nested.photons.positions - alone.photons.positions, axis=1)
    # Where light is all but totally reflected, rounding of the index counts.
    assert np.quantile(apart, 0.99) < 1e-3


def test_ice_of_the_water_s_own_index_is_not_there():
    with_ice, without = (
        in_water(body) for body in (ball("/ice", (0, 0, 0), 0.5, 24, glass(WATER)), floor(-3.0, 0.1))
    )
    np.testing.assert_allclose(with_ice.photons.positions, without.photons.positions, atol=ROUNDING)
    np.testing.assert_allclose(with_ice.photons.flux, without.photons.flux, rtol=1e-6)
    assert set(with_ice.photons.bounces) == {1}


def test_a_lamp_in_the_water_begins_there():
    """Its light meets the ice from water, though it has gone in nowhere."""
    around = box("/water", (-3, -3, -2.2), (3, 3, 2.0), glass(WATER))
    ice = box("/ice", (-1, -1, -0.2), (1, 1, 0.2), glass(ICE))
    result = traced(scene_of([floor(-1.2, 2.9), around, ice], lamp((0, 0, 1.0))), 4096)
    rows = straight_through(result, 2)
    assert len(rows) > 50
    # Snell's law through a layer 0.4 thick in 1.8 of water.
    tangent = np.hypot(*np.tan(angles_of(result)[rows]).T)
    within = np.tan(np.arcsin(np.sin(np.arctan(tangent)) * WATER / ICE))
    radius = np.hypot(*result.photons.positions[rows, :2].T)
    np.testing.assert_allclose(radius, 1.8 * tangent + 0.4 * within, atol=ROUNDING)


def angles_of(result: Traced) -> np.ndarray:
    """Angles u and v at which photons of a lamp start, shape [n, 2]."""
    (lattice,) = [lattice for lattice in result.plan.lattices if lattice.first_id == 0]
    return np.asarray(lattice.origin) + result.photons.emission * lattice.step


def test_nested_solids_move():
    """Water on glass that rises with it: all layers together are a slab, whose light stays (check 3)."""
    rising = (0, 0, 0.1)
    meshes = [moving(water(), rising), moving(slab(), rising)]
    result = traced(scene_of([floor(half=9.0), *meshes], sun((SLOPE, 0, -1))), 1024, anchor="light")
    rows = straight_through(result, 3)
    np.testing.assert_allclose(result.photons.dxdt[rows], 0, atol=1e-6)
    alone = traced(scene_of([floor(half=9.0), *[replace(m, motions=None) for m in meshes]], sun((SLOPE, 0, -1))), 1024)
    np.testing.assert_allclose(result.photons.positions, alone.photons.positions, atol=ROUNDING)
