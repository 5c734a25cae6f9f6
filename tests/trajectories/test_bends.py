"""Bends of footprints against the exact second derivatives of light under a wave, and where there are none."""

from __future__ import annotations

import numpy as np

from tests.estimators.frames import OPEN, SETTINGS
from tests.trajectories.test_fit import on_water, root_mean_square
from tests.view.scenes import wave_source
from tpdwarp.clock import Clock
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.rendering.context import RenderContext
from tpdwarp.settings import Settings
from tpdwarp.trajectories.bends import with_bends
from usd_scenes.oracle import Wave
from usd_scenes.oracle.caustic_1d import landing


def bent_photons(wave: Wave, photons: int) -> tuple[PhotonMap, float]:
    """Photons under a wave at mid shutter, and the size of the scene in the tracer's units."""
    context = RenderContext(wave_source(wave), Settings.of(SETTINGS, photons=photons))
    plan = context.tracer.plan(photons)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    return with_bends(found, plan), context.normalization.scale


def test_light_under_a_wave_bends_by_half_of_its_second_derivative():
    wave = Wave()
    photons, scale = bent_photons(wave, 1024)
    x0, cell = on_water(photons), 4 / np.ceil(photons.emission[:, 0].max())
    # The change of D_u x from one neighbour to the other, by differences a tenth of a cell apart.
    sides = [(landing(x0 + k * cell + 0.1 * cell, 0.5, wave) - landing(x0 + k * cell - 0.1 * cell, 0.5, wave)) / 0.2
             for k in (-1, 1)]  # fmt: skip
    exact = 0.25 * (sides[1] - sides[0])
    inside = np.abs(x0) < 1.9
    error = (photons.bend[:, 0] / scale - exact)[inside]
    # The mesh's normals are straight between vertices, as bends are between cells.
    assert root_mean_square(error) < 0.1 * root_mean_square(exact[inside])
    np.testing.assert_allclose(photons.bend[inside, 1:], 0, atol=2e-2 * root_mean_square(exact) * scale)


def test_light_that_lies_elsewhere_bends_nothing():
    """Every second column of cells lands on another receiver, or far off: no neighbour lies where it should."""
    context = RenderContext(wave_source(Wave()), Settings.of(SETTINGS, photons=4096))
    plan = context.tracer.plan(4096)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    odd = np.floor(found.emission).astype(int).sum(axis=1) % 2 == 1
    found.receiver[odd] += 1
    np.testing.assert_array_equal(with_bends(found, plan).bend, 0)
    found.receiver[odd] -= 1
    found.position[odd] += np.float32([0.3, 0.0, 0.0])
    np.testing.assert_array_equal(with_bends(found, plan).bend, 0)
