"""Laws of random times without differentials."""

from __future__ import annotations

import numpy as np

from tests.estimators.frames import STILL_SCENE, irradiance, rendered, traced
from tests.view.scenes import wave_source
from usd_scenes.oracle import Wave


def test_every_photon_is_traced_once_and_carries_its_whole_flux():
    one, dealt = traced(estimator="pd"), traced(estimator="distribution")
    assert dealt.energy.counts["emitted"] == one.energy.counts["emitted"]
    np.testing.assert_allclose(dealt.energy.sent, one.energy.sent, rtol=1e-6)
    assert len(np.unique(dealt.photons.ids)) == len(dealt.photons)


def test_photons_have_no_motion_and_land_where_the_light_of_their_instant_does():
    wave = Wave()
    dealt, middle = traced(wave_source(wave), estimator="distribution"), traced(wave_source(wave), estimator="pd")
    assert not dealt.photons.dxdt.any()
    where = {tuple(cell): x for cell, x in zip(middle.photons.emission, middle.photons.positions[:, 0], strict=True)}
    moved = [x - where[tuple(c)] for c, x in zip(dealt.photons.emission, dealt.photons.positions[:, 0], strict=True)]
    # Caustics travel with the wave: photons of the whole shutter lie on both sides of those of its middle.
    assert min(moved) < 0 < max(moved)


def test_at_rest_it_is_a_still():
    still, dealt = rendered(STILL_SCENE, estimator="pd"), rendered(STILL_SCENE, estimator="distribution")
    np.testing.assert_array_equal(dealt.channels["R"], still.channels["R"])


def test_its_error_is_noise_that_averages_out_over_seeds():
    source = wave_source(Wave())
    truth = irradiance(rendered(source, estimator="accumulation", photons=16384))
    found = [irradiance(rendered(source, estimator="distribution", seed=seed)) for seed in range(9)]

    def error(image: np.ndarray) -> float:
        return float(np.sqrt(np.mean((image - truth) ** 2)))

    # A third, if seeds are independent; half leaves room for what does not average out.
    assert error(np.mean(found, axis=0)) < 0.5 * np.mean([error(image) for image in found])


def test_dice_are_thrown_anew_for_every_instant_of_an_accumulation():
    photons = traced(estimator="accumulation", emission="jittered", accumulation_times=4, photons=256).photons
    within = photons.emission.reshape(4, -1, 2) % 1
    assert all(np.abs(within[k] - within[0]).mean() > 0.2 for k in (1, 2, 3))
