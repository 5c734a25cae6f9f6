"""Laws of footprints whose ways are bent: what D_t x changes by while the shutter is open."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.frames import OPEN, SETTINGS, irradiance, rendered
from tests.oracle import Wave, irradiance_average
from tests.oracle.caustic_1d import landing
from tests.view.scenes import SUN, WATER, Source, bumpy, floor, looking_down, turning_rod_source, wave_source
from tpdwarp.estimators.base import Animation, Clock
from tpdwarp.estimators.bending import bent
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings

FOLDED = Wave(wavelength=0.65, speed=0.65 / 8)


def bent_photons(source, shutter: Shutter = OPEN, **changes) -> tuple[PhotonMap, Animation]:
    settings = Settings.of(SETTINGS, **changes)
    animation, clock = Animation(source, settings), Clock()
    plan = animation.plan(settings.photons)
    photons, _ = animation.trace(animation.load(shutter), plan, clock, riding=settings.anchor == "surface")
    found, guides = bent(photons, plan, animation, shutter, clock)
    assert guides > 0
    return found, animation


def test_light_under_a_wave_bends_as_its_exact_second_derivative_says():
    wave = Wave()
    photons, animation = bent_photons(wave_source(wave), photons=16384)
    scale = animation.normalization.scale
    # Vertical light on water from −2 to 2, which the lattice fills.
    x0 = photons.emission[:, 0] * 4 / np.ceil(photons.emission[:, 0].max()) - 2
    half = 0.4375
    exact = (landing(x0, 0.5 + half, wave) - 2 * landing(x0, 0.5, wave) + landing(x0, 0.5 - half, wave)) / half**2
    size = np.sqrt(np.mean(exact**2))
    # Means of D_tt x over the shutter with other weights, between guides λ/10 apart; beyond the last ones are none.
    error = np.abs(photons.bend[:, 0] / scale - exact)[np.abs(x0) < 1.9]
    assert np.sqrt(np.mean(error**2)) < 0.1 * size
    np.testing.assert_allclose(photons.bend[:, 1:], 0, atol=1e-3 * size * scale)


@pytest.mark.parametrize("degrees", [5.0, 20.0])
def test_light_that_rides_on_a_turning_rod_goes_in_circles(degrees):
    source = turning_rod_source(degrees, looking_down(height=0.1))
    photons, animation = bent_photons(source, photons=16384)
    position = animation.normalization.world_points(photons.position)[:, :2]
    bend = photons.bend[:, :2] / animation.normalization.scale
    told = np.any(bend != 0, axis=1)
    assert told.mean() > 0.6
    expected = -(math.radians(degrees) ** 2) * position
    # The chord of an arc of D_t x, and facets that are not quite a cylinder.
    error = np.linalg.norm(bend - expected, axis=1)[told]
    assert np.median(error) < 0.05 * np.median(np.linalg.norm(expected, axis=1))


def test_light_that_rides_on_what_moves_straight_on_goes_straight():
    def at(shutter: Shutter) -> SceneAtShutter:
        way = np.array([0.2, 0.0, 0.0])
        water = bumpy("/water", WATER, 1.0, False)
        motions = np.tile(shutter.exposure * way, (len(water.points), 1)) if shutter.exposure else None
        water = replace(water, points=water.points + (shutter.middle - 0.5) * way, motions=motions)
        return SceneAtShutter(shutter, (floor(), water), (SUN,), looking_down(height=0.6))

    photons, animation = bent_photons(Source(at), photons=16384)
    assert np.median(np.abs(photons.bend)) < 1e-3 * 0.2 * animation.normalization.scale


@pytest.mark.parametrize(("wave", "photons", "gain"), [(Wave(), 16384, 3), (FOLDED, 65536, 2.5)], ids=["soft", "folds"])
def test_curved_ways_take_most_of_what_straight_ones_err_by(wave, photons, gain):
    truth = irradiance_average(np.linspace(-1, 1, 257), wave, 0, 1, 256, "smooth")
    source = wave_source(wave)
    frames = [rendered(source, columns=256, photons=photons, path=path) for path in ("curved", "straight")]
    curved, straight = (np.sqrt(np.mean((irradiance(frame) - truth) ** 2)) for frame in frames)
    assert gain * curved < straight


def test_curved_ways_keep_the_flux():
    curved, straight = (
        rendered(wave_source(FOLDED), columns=128, photons=16384, path=path) for path in ("curved", "straight")
    )
    assert curved.energy.sent == straight.energy.sent and curved.energy.deposited == straight.energy.deposited
    # Light that crosses the rims of the picture aside, of which at most 2 % move by more or less.
    assert irradiance(curved).mean() == pytest.approx(irradiance(straight).mean(), rel=5e-3)
    assert curved.energy.counts["guides"] > 0 and "guides" not in straight.energy.counts


def test_where_nothing_moves_nothing_is_traced_twice():
    still = rendered(shutter=Shutter(0, 0.5, 0.5), photons=1024)
    assert "guides" not in still.energy.counts
