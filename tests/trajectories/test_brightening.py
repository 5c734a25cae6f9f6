"""Laws of lights that change while the shutter is open, against the exact light under a wave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.estimators.frames import OPEN, rendered, traced
from tests.trajectories.test_fit import fitted_photons
from tests.view.scenes import Source, wave_source
from tpdwarp.photons.power_curves import PowerCurve
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.trajectories.brightening import follow_lights, gained_flux
from usd_scenes.oracle import Wave
from usd_scenes.oracle.caustic_1d import column_irradiance

WAVE = Wave()
TIMES = (np.arange(256) + 0.5) / 256

Power = Callable[[np.ndarray], np.ndarray]


def six_stops(time: np.ndarray) -> np.ndarray:
    """Red, green and blue light [n, 3] of a light that brightens by six stops."""
    return np.tile(2.0 ** (6.0 * time - 3.0)[:, None], 3)


def red_to_blue(time: np.ndarray) -> np.ndarray:
    return np.stack([1.0 - time, 0.0 * time, time], axis=1)


def flash(time: np.ndarray) -> np.ndarray:
    return np.tile(((time > 77 / 256) & (time < 141 / 256)).astype(float)[:, None], 3)


def first_quarter(time: np.ndarray) -> np.ndarray:
    """A lamp that is switched off: one piece, in which it does not change."""
    return np.tile((time < 0.25).astype(float)[:, None], 3)


CHANGES = {"six stops": six_stops, "red to blue": red_to_blue, "flash": flash, "first quarter": first_quarter}


def wave_under(power: Power) -> Source:
    source = wave_source(WAVE)

    def at(shutter: Shutter) -> SceneAtShutter:
        scene = source.at(shutter)
        mean = power(shutter.open + shutter.exposure * TIMES).mean(axis=0)
        return replace(scene, lights=tuple(replace(light, power=tuple(mean)) for light in scene.lights))

    return Source(at)


def curve_of(power: Power) -> PowerCurve:
    def mean(begin: float, end: float) -> np.ndarray:
        return power(begin + (end - begin) * TIMES).mean(axis=0)

    return PowerCurve.of(mean)


@cache
def moments() -> np.ndarray:
    """Light of a steady lamp in 128 columns at each of the times, shape [256, 128]."""
    edges = np.linspace(-1, 1, 129)
    return np.array([column_irradiance(edges, float(time), WAVE, "smooth", 4096) for time in TIMES])


@pytest.mark.parametrize("segments", [1, 4])
@pytest.mark.parametrize("power", CHANGES.values(), ids=CHANGES)
def test_light_moves_with_the_power_that_its_lamp_has_meanwhile(power, segments):
    truth = np.einsum("tx,tc->xc", moments(), power(TIMES)) / len(TIMES)
    frame = rendered(wave_under(power), columns=128, photons=1 << 16, segments=segments)
    found = np.stack([frame.channels[f"irradiance.{colour}"].mean(axis=0) for colour in "RGB"], axis=1)
    # Light that is the same all the time errs by .0001 of its mean here (in four segments .0002), and the flash, which
    # is known to a 64th of the shutter, by .0013; light whose flux goes along one line by .1, .08 and .03.
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.002 * truth.mean()


def test_light_that_does_not_change_is_not_cut():
    photons, _ = fitted_photons(wave_source(WAVE))
    assert not any(photons.power_curves)
    assert follow_lights(photons) == [photons]


@pytest.mark.parametrize("power", CHANGES.values(), ids=CHANGES)
def test_parts_have_all_the_light_and_lie_where_the_photon_is(power):
    photons, _ = fitted_photons(wave_under(power))
    parts = follow_lights(photons)
    assert len(parts) > 1 or parts[0].duration < 1.0
    flux = sum(part.flux.sum(axis=0, dtype=np.float64) for part in parts)
    whole = photons.flux.sum(axis=0, dtype=np.float64)
    assert flux.sum() == pytest.approx(whole.sum() + gained_flux(photons), rel=1e-5)
    curve = photons.trajectory
    for part in parts:
        for within in (-0.5, 0.0, 0.5):
            s, at = part.time + part.duration * within, part.trajectory
            there = photons.position + s * photons.dxdt + s**2 / 2 * curve.dxdtt + s**3 / 6 * curve.dxdttt
            here = part.position + within * part.dxdt + within**2 / 2 * at.dxdtt + within**3 / 6 * at.dxdttt
            np.testing.assert_allclose(here, there, atol=1e-6)


@pytest.mark.parametrize(("stops", "pieces"), [(0.5, 1), (1.0, 2), (2.0, 4), (6.0, 6)])
def test_a_light_takes_as_many_lines_as_its_power_bends(stops, pieces):
    assert len(curve_of(lambda time: np.tile(2.0 ** (stops * time)[:, None], 3)).pieces) == pieces


def test_colours_that_fade_into_each_other_take_a_line_each():
    red, blue = curve_of(red_to_blue).pieces
    np.testing.assert_allclose(red.power, (1, 0, 0))
    np.testing.assert_allclose(blue.power, (0, 0, 1))
    assert red.gain == pytest.approx(-2.0) and blue.gain == pytest.approx(2.0)


def test_jumps_are_found_to_a_64th_of_the_shutter():
    pieces = curve_of(lambda time: np.tile((time > 0.3)[:, None], 3)).pieces
    before = sum(piece.duration for piece in pieces if piece.time + 0.5 + piece.duration / 2 <= 0.3)
    assert all(piece.time + 0.5 + piece.duration / 2 > 0.3 for piece in pieces) and before == 0.0
    assert min(piece.time - piece.duration / 2 for piece in pieces) + 0.5 == pytest.approx(0.3, abs=1 / 64)
    assert len(pieces) <= 8


def test_light_that_flickers_evenly_is_not_taken_for_steady():
    pieces = curve_of(lambda time: np.tile((1.0 + 0.8 * np.sin(8.0 * np.pi * time))[:, None], 3)).pieces
    assert len(pieces) >= 8


@pytest.mark.parametrize("power", CHANGES.values(), ids=CHANGES)
def test_pieces_have_the_power_of_the_light_and_no_more(power):
    total = sum(piece.duration * piece.power for piece in curve_of(power).pieces)
    np.testing.assert_allclose(total, power(TIMES).any(axis=0), rtol=1e-6)


def test_light_that_brightens_as_it_grows_is_counted():
    source = wave_under(lambda time: np.tile((0.2 + 1.6 * time)[:, None], 3))
    frame = traced(source, OPEN, photons=1 << 12)
    energy = frame.energy
    gone = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert gone == pytest.approx(energy.sent, rel=1e-4)
