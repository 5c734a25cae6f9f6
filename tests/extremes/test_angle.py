"""Grazing and totally reflected light, light in the plane of a face, unusual indices, normals past the horizon."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.photons.moving_scenes import walls
from tests.photons.shapes import box, floor, glass, moving, quad, ripples, upside_down
from tests.photons.traced import EPS, lamp, sun
from tests.view.scenes import looking_down
from tpdwarp.scene.description import MeshAtShutter
from tpdwarp.trajectories.parts import INSTANTS
from usd_scenes.oracle.closed_forms import fresnel_reflectance, snell
from usd_scenes.oracle.shapes import grid_points, grid_triangles

from .cases import GRID, render, scene, slab

MOTIONS = {
    "rigid": (0.05, 0.02, 0.03),
    "deforming": np.array([[0.05, 0, 0], [0.02, 0, 0.03], [0, 0, 0.05], [0, 0.1, 0]]),
}


def towards(angle: float) -> tuple[float, float, float]:
    """Direction of light that falls at ``angle`` from the vertical."""
    return (math.sin(angle), 0.0, -math.cos(angle))


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("left", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
def test_grazing_light_is_refracted_as_fresnel_has_it(left, motion):
    angle = 0.5 * math.pi - left
    frame = render(slab(towards(angle), 1.33, MOTIONS[motion]))
    # Those asked for, and where neighbours drift apart, as on waves that they graze, cells traced again in time.
    again = frame.energy.counts.get("cells traced again in time", 0)
    assert frame.energy.counts["emitted"] == pytest.approx(1024 + (INSTANTS - 1) * again, rel=0.05)
    energy, sent = frame.energy, 3 * 4 * math.cos(angle)
    # The cosine is known to a rounding of one.
    expected, rounding = 1 - fresnel_reflectance(angle, 1.0, 1.33), 1e-5 + 4 * EPS / left
    tolerance = {0.1: 1e-3, 0.01: 0.25, 0.001: 0.45}.get(left)
    if motion == "deforming" and tolerance:
        # What deforms turns, and has another mean over the shutter: that of many instants. Where it turns by more than
        # light grazes it, cells are lit for a part of the shutter, which is told to an eighth: at mid shutter a fifth
        # of the last one's light is sent.
        instants = render(slab(towards(angle), 1.33, MOTIONS[motion]), estimator="accumulation").energy
        assert instants.sent > 1.0005 * sent
        assert energy.sent == pytest.approx(instants.sent, rel=tolerance)
        assert energy.deposited == pytest.approx(instants.deposited, rel=tolerance)
    else:
        # Of what grazes still less the light is that of mid shutter, where no cell tells of the rest.
        assert energy.sent == pytest.approx(sent, rel=rounding)
        assert energy.deposited == pytest.approx(expected * energy.sent, rel=rounding)


@pytest.mark.parametrize("motion", MOTIONS)
def test_light_exactly_in_the_plane_of_the_water_sends_nothing(motion):
    flat = slab((1, 0, 0), 1.33, (0.05, 0.02, 0))
    assert render(flat).energy.sent == 0
    assert render(slab((1, 0, 0), 1.33, MOTIONS[motion])).energy.sent < 1e-12


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("ior", [0.25, 0.75, 1.0, 1 + 1e-6, 1.0001, 4.0, 1e3, 1e6])
def test_a_flat_interface_of_any_index_follows_snell_and_fresnel(ior, motion):
    frame = render(slab(towards(0.4), ior, MOTIONS[motion]))
    bent, passing = snell(0.4, 1.0, ior), 1 - fresnel_reflectance(0.4, 1.0, ior)
    # What passes is the difference of all and what does not, which is rounded a few times.
    sent = frame.energy.sent
    assert frame.energy.deposited == pytest.approx(passing * sent, rel=1e-5, abs=8 * EPS * sent)
    if math.isnan(bent):
        assert len(frame.photons) == 0
        return
    photons = frame.photons
    if motion == "rigid":
        # Where light enters, and it is a lattice that fills the square, tells where it leaves.
        centre = photons.positions[:, 0].mean()
        assert centre == pytest.approx(math.tan(bent), abs=0.01)
        assert photons.dxdt[:, 0].mean() == pytest.approx(0.05 + 0.03 * math.tan(bent), abs=1e-4)


@pytest.mark.parametrize("angle", [0.4, 1.2, 0.5 * math.pi - 1e-2, 0.5 * math.pi - 1e-3])
def test_an_interface_without_a_step_in_index_reflects_nothing_at_any_angle(angle):
    water = moving(quad("/water", (0, 0, 1), (1, 0, 0), (0, 1, 0), glass(1.0)), (0.05, 0.02, 0.03))
    # Along straight trajectories each cell has one photon, those at the border too.
    frame = render(scene([water, *walls()], sun(towards(angle))), photons=512, path="straight")
    # Every photon goes straight on to the floor or to the wall behind.
    assert len(frame.photons) == pytest.approx(512, rel=0.1)
    assert frame.energy.deposited == pytest.approx(frame.energy.sent, rel=1e-6)
    assert (frame.photons.positions[:, 2] < 1).all()


def transmittance(cos_i: float, cos_t_squared: float, n: float) -> float:
    """1 − R from n to 1 by Fresnel's equations, for a cosine squared that may be negative."""
    cos_t = math.sqrt(max(cos_t_squared, 0.0))
    parallel = (cos_i - n * cos_t) / (cos_i + n * cos_t)
    perpendicular = (n * cos_i - cos_t) / (n * cos_i + cos_t)
    return 1 - 0.5 * (parallel**2 + perpendicular**2)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("beyond", [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 0.0, -1e-7, -1e-6, -1e-5, -1e-3, -1e-1])
def test_about_the_critical_angle_light_passes_as_fresnel_has_it(beyond, motion):
    n = 1.5
    angle = math.asin(1 / n) + beyond
    inside = moving(upside_down(quad("/glass", (0, 0, 1), (1, 0, 0), (0, 1, 0), glass(n))), MOTIONS[motion])
    # One trace along straight trajectories: mid shutter alone, where the angle is what it is.
    frame = render(scene([inside, *walls()], sun(towards(angle))), segments=1, path="straight")
    photons = frame.photons
    passed = photons.flux[photons.positions[:, 2] < 1 - 1e-4].sum() / frame.energy.sent
    # cos²θ_t is the difference of numbers of order one, each known to a few roundings.
    cosine, slack = math.cos(angle), 8 * EPS * n**2
    squared = 1 - n**2 * (1 - cosine**2)
    low, high = (transmittance(cosine, squared + sign * slack, n) for sign in (-1, 1))
    assert low - 1e-5 <= passed <= high + 1e-5
    if beyond > 1e-6:
        assert passed == 0


@pytest.mark.parametrize("short", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
def test_dxdt_grows_without_bound_as_light_leaves_along_the_surface(short):
    n = 1.5
    angle = math.asin(1 / n) - short
    bent = snell(angle, n, 1.0)
    inside = moving(upside_down(quad("/glass", (0, 0, 1), (1, 0, 0), (0, 1, 0), glass(n))), MOTIONS["rigid"])
    photons = render(scene([inside, floor(half=3 * math.tan(bent) + 3)], sun(towards(angle)))).photons
    assert len(photons) > 900
    expected = 0.05 + 0.03 * math.tan(bent)
    # The square of the cosine, a difference of numbers of order one, is known to a few roundings.
    slack = 1e-5 + 8 * EPS * n**2 / math.cos(bent) ** 2
    np.testing.assert_allclose(photons.dxdt[:, 0], expected, rtol=slack)
    np.testing.assert_allclose(photons.dxdt[:, 1], 0.02, atol=slack * expected)
    assert short > 1e-4 or expected > 1


@pytest.mark.parametrize("beyond", [1e-3, 1e-7, 0.0, -1e-7, -1e-3])
def test_waves_seen_from_inside_straddle_the_critical_angle_without_harm(beyond):
    water = upside_down(ripples(GRID, GRID, 1.0, 0.04, glass(1.5), True))
    frame = render(scene([water, *walls()], sun(towards(math.asin(1 / 1.5) + beyond))), most_lost=0.02)
    assert 0.3 < frame.energy.deposited / frame.energy.sent <= 1


@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-7, 1e-5])
@pytest.mark.parametrize("direction", ["down", "along"])
def test_a_sun_in_the_plane_of_faces_lights_the_others(off, direction):
    body = moving(box("/box", (-0.5, -0.5, 0.5), (0.5, 0.5, 1), glass()), (0.05, 0.02, 0.01))
    lit = {"down": ((off, 0, -1), 1.0), "along": ((1, 0, -off), 0.5)}[direction]
    seen = scene([body, floor(half=6.0)], sun(lit[0]), eye=looking_down((-2, 2, -2, 2), height=0.3))
    # Cells that are traced again at the border ride with the face that they meet first, and one of these is a sliver.
    frame = render(seen, path="straight")
    assert frame.energy.sent == pytest.approx(3 * lit[1], rel=1e-3)


@pytest.mark.parametrize("height", [0.0, 1e-9, 1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("beside", [(2.0, 0.0), (0.2, 0.1)])
def test_a_lamp_in_the_plane_of_a_face_or_on_it_is_harmless(beside, height):
    pane = moving(quad("/pane", (0, 0, 1), (1, 0, 0), (0, 1, 0), glass()), (0.05, 0.02, 0.0))
    light = lamp((*beside, 1 + height), (0.01, 0, 0))
    frame = render(scene([pane, floor(half=6.0)], light, eye=looking_down((-2, 2, -2, 2), height=0.6)))
    assert frame.energy.sent <= 3 * 2 * math.pi
    # Cells in the face's plane would ride past each other without bound: they rest, and are traced at each instant.
    assert "cells that ride too far apart to grow" not in frame.energy.counts
    again = frame.energy.counts.get("cells traced again in time", 0)
    assert (again > 800) == (height > 0.0 and beside == (0.2, 0.1))


@pytest.mark.parametrize("spread", [0.3, 1.0, 100.0, "opposed", "zero", "vanishing"])
@pytest.mark.parametrize("motion", ["deforming", "rigid"])
def test_normals_past_the_horizon_send_no_light_through_the_wrong_side(spread, motion):
    random = np.random.default_rng(1)
    x = np.linspace(-1, 1, 5)
    points, triangles = grid_points(x, x, lambda x, y: 1.0), grid_triangles(5, 5).astype(np.int32)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    turns = 0.3 * random.normal(size=points.shape)
    if spread == "opposed":
        normals[::2] *= -1
    elif spread == "zero":
        normals[:] = 0
    elif spread == "vanishing":
        turns = -2 * normals
    else:
        normals += spread * random.normal(size=points.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    motions = 0.03 * random.normal(size=points.shape) if motion == "deforming" else np.tile([0.1, 0, 0], (25, 1))
    water = MeshAtShutter("/water", points, triangles, motions, normals, turns, triangles, (glass(),))
    frame = render(scene([water, floor(half=30.0)], sun((0.2, 0.1, -1))), segments=1, path="straight")
    # Refracted light lands below; what is reflected leaves upwards, for there is nothing above.
    refracted = frame.photons.bounces == 1
    assert refracted.all() and 0.9 < frame.energy.deposited / frame.energy.sent < 0.965
