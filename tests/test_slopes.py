"""How fast errors fall: with photons, with shorter exposures, with more segments; slopes are fitted to measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from tests.estimators.frames import irradiance, rendered
from tests.view.scenes import wave_source
from tpdwarp.photons import lattices
from tpdwarp.photons.lattice_shape import OWN_AXES
from tpdwarp.rendering.context import RenderContext
from tpdwarp.scene.description import Shutter
from usd_scenes.oracle import Wave, irradiance_average

WAVE = Wave()
# Pixels so small that the widening of footprints by a part of them is no error to speak of.
COLUMNS = 1024


def error(exposure: float, **settings) -> float:
    """Relative RMSE of the soft wave, centred on the middle of a frame, against its exact irradiance."""
    shutter = Shutter(0, 0.5 - 0.5 * exposure, 0.5 + 0.5 * exposure)
    times = 256 if exposure > 0 else 1
    truth = irradiance_average(np.linspace(-1, 1, COLUMNS + 1), WAVE, shutter.open, shutter.close, times, "smooth")
    found = irradiance(rendered(wave_source(WAVE), shutter, columns=COLUMNS, samples=2, **settings))
    return float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean())


def slope(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Exponent of the power law through the errors."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.fixture(autouse=True)
def even_cells(monkeypatch):
    """All cells alike, wherever the camera looks: so the number of photons tells how fine they are, and none is finer
    than the mesh."""
    monkeypatch.setattr(RenderContext, "_seen_light", lambda *_: None)


@pytest.fixture
def square_cells(monkeypatch):
    """Lattices that do not care in which direction light varies."""
    monkeypatch.setattr(lattices, "lattice_shape", lambda views: OWN_AXES)


def test_the_error_in_space_falls_as_one_over_the_photons(square_cells):
    photons = (1024, 4096, 16384)
    assert slope(photons, [error(0.0, photons=n) for n in photons]) == pytest.approx(-1, abs=0.2)


def test_where_light_varies_in_one_direction_all_photons_go_there():
    # Up to 1 024 of them in eight rows.
    photons = (256, 512, 1024)
    assert slope(photons, [error(0.0, photons=n) for n in photons]) == pytest.approx(-2, abs=0.4)


def test_in_motion_it_falls_as_fast_until_the_error_in_time_is_reached(square_cells):
    photons = (256, 1024, 4096)
    assert slope(photons, [error(1.0, photons=n) for n in photons]) == pytest.approx(-1, abs=0.25)
    straight = [error(1.0, photons=n, path="straight") for n in (16384, 65536)]
    assert straight[1] > 0.8 * straight[0] > 4 * error(1.0, photons=65536)


def test_straight_trajectories_err_by_the_square_of_the_exposure():
    exposures = (0.75, 1.0, 1.5)
    errors = [error(e, photons=65536, path="straight") for e in exposures]
    # A little less than two: what a longer exposure errs about is blurred by it, too.
    assert slope(exposures, errors) == pytest.approx(2, abs=0.35)


def test_straight_trajectories_err_by_the_square_of_a_segment():
    segments = (1, 2, 4)
    errors = [error(2.0, photons=16384 * k, segments=k, path="straight") for k in segments]
    assert slope(segments, errors) == pytest.approx(-2, abs=0.25)


def test_curved_trajectories_err_by_a_higher_power_of_the_exposure():
    exposures = (2.0, 3.0, 4.0)
    errors = [error(e, photons=65536) for e in exposures]
    assert slope(exposures, errors) > 2.7
    # Of third order they still are much smaller where straight ones go wrong.
    assert 3 * errors[0] < error(2.0, photons=65536, path="straight")
