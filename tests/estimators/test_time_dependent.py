"""Laws of time dependent photon mapping."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.frames import OPEN, SETTINGS, STILL_SCENE, irradiance, rendered, traced
from tests.view.scenes import wave_source
from tpdwarp.errors import InputError
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from usd_scenes.oracle import Wave


def test_without_in_between_frames_all_photons_are_those_of_shutter_open():
    source = wave_source(Wave())
    opening = traced(source, Shutter(0, 0, 0), estimator="pd", emission="jittered").photons
    found = traced(source, estimator="tdpm", emission="jittered", tdpm_between=0).photons
    np.testing.assert_array_equal(found.positions, opening.positions)


def test_in_between_frames_share_photons_and_flux_equally():
    source, between = wave_source(Wave()), 3
    result = traced(source, estimator="tdpm", tdpm_between=between, emission="jittered")
    assert result.energy.counts["emitted"] == SETTINGS.photons
    alone = traced(source, estimator="pd", emission="jittered")
    np.testing.assert_allclose(result.energy.sent, alone.energy.sent, rtol=1e-6)
    quarter = SETTINGS.photons // (between + 1)
    for j in range(between + 1):
        at = Shutter(0, j / (between + 1), j / (between + 1))
        alone = traced(source, at, estimator="pd", emission="jittered").photons
        there = {tuple(cell): place for cell, place in zip(alone.emission, alone.positions, strict=True)}
        cells = result.photons.emission[j * quarter : (j + 1) * quarter]
        mine = result.photons.positions[j * quarter : (j + 1) * quarter]
        np.testing.assert_array_equal(mine, [there[tuple(cell)] for cell in cells])


def test_without_a_number_of_frames_photons_have_the_times_of_distribution():
    source = wave_source(Wave())
    dealt, found = (traced(source, estimator=name, emission="jittered") for name in ("distribution", "tdpm"))
    np.testing.assert_array_equal(found.photons.positions, dealt.photons.positions)


def test_at_rest_in_between_frames_change_nothing():
    random, frames = (rendered(STILL_SCENE, estimator="tdpm", tdpm_between=between) for between in (None, 5))
    assert random.channels["R"].any()
    np.testing.assert_array_equal(frames.channels["R"], random.channels["R"])


def test_more_photons_blur_less_and_come_closer_to_the_truth():
    source = wave_source(Wave())
    truth = irradiance(rendered(source, estimator="accumulation", photons=16384))

    def error(photons: int) -> float:
        settings = {"photons": photons, "tdpm_neighbours": 160, "accumulation_times": 64}
        found = irradiance(rendered(source, estimator="tdpm", **settings))
        return float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean())

    # The same k reaches over a disk of a quarter of the radius.
    assert error(65536) < error(4096) / 4


def test_numbers_that_mean_nothing_are_refused():
    for changes in ({"tdpm_neighbours": 1}, {"tdpm_neighbours": 2.5}, {"tdpm_between": -1}, {"tdpm_between": 0.5}):
        (name,) = changes
        with pytest.raises(InputError, match=f"{name} must be"):
            Settings(**changes)


def test_it_renders_with_every_channel():
    frame = rendered(shutter=OPEN, estimator="tdpm", aovs=("irradiance", "motion", "photons"))
    assert frame.channels["photons"].max() == SETTINGS.tdpm_neighbours
    assert not frame.channels["motion.X"].any()
