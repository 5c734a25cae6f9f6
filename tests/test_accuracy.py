"""How far renders are from the truth: the limits below are promises, what is measured is better.

Errors are root mean squares over all pixels, relative to the mean irradiance of the image.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tpdwarp.presets import PRESETS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from usd_scenes.in_memory import rod_and_truth, wave_source
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.oracle.caustic_rod import PIXELS, irradiance_of_rod

COLUMNS, ROWS = 256, 32
EDGES = np.linspace(-1, 1, COLUMNS + 1)


def frame_of(source: SceneSource, shutter: Shutter, width: int, height: int, **settings) -> Frame:
    return render_frame(RenderContext(source, Settings(aovs=("irradiance",), **settings)), shutter, width, height)


def irradiance(frame: Frame) -> np.ndarray:
    return frame.channels["irradiance.R"].astype(float)


def relative_error(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean())


@cache
def wave_truth(motion: str, frame: int = 0) -> np.ndarray:
    """Mean irradiance of each pixel column, shape [256]. Twice the times change it by less than 1e-4 (asserted)."""
    return irradiance_average(EDGES, Wave(), frame, frame + 1, 64, motion)


def test_the_truth_of_the_wave_has_converged():
    for motion in ("smooth", "linear"):
        finer = irradiance_average(EDGES, Wave(), 0, 1, 128, motion, per_wavelength=8192)
        assert relative_error(wave_truth(motion), finer) < 1e-4


@pytest.mark.parametrize("motion", ["smooth", "linear"])
@pytest.mark.parametrize(("photons", "segments", "limit"), [(4096, 1, 0.0025), (16384, 1, 0.002), (65536, 4, 0.001)])
def test_a_travelling_wave_is_as_exact_as_promised(motion, photons, segments, limit):
    source = wave_source(Wave(), motion)
    frame = frame_of(source, Shutter(0, 0, 1), COLUMNS, ROWS, photons=photons, segments=segments)
    assert 0.8 * photons < frame.energy.counts["emitted"] <= 1.05 * photons
    assert relative_error(irradiance(frame), wave_truth(motion)) <= limit


@pytest.mark.parametrize("exposure", [3, 4])
def test_long_exposures_of_few_photons_have_no_stripes(exposure):
    """Nor is any pixel far off: bands that go by three or four eighths of a wavelength would leave marks."""
    truth = irradiance_average(EDGES, Wave(), 2, 2 + exposure, 96 * exposure)
    frame = frame_of(wave_source(Wave()), Shutter(2, 2, 2 + exposure), COLUMNS, ROWS, photons=1000, segments="auto")
    found = irradiance(frame)
    assert relative_error(found, truth) <= 0.02
    assert np.abs(found - truth).max() < 0.05 * truth.mean()


@pytest.mark.parametrize(("preset", "limit"), [("draft", 0.02), ("standard", 0.01), ("final", 0.004)])
def test_presets_are_as_exact_as_promised_where_light_folds(preset, limit):
    wave = Wave(wavelength=0.65, speed=0.65 / 8)
    frame = frame_of(wave_source(wave), Shutter(0, 0, 1), COLUMNS, ROWS, **PRESETS[preset])
    assert relative_error(irradiance(frame), irradiance_average(EDGES, wave, 0, 1, 256)) <= limit


@pytest.mark.parametrize("motion", ["smooth", "linear"])
def test_the_light_of_consecutive_frames_varies_no_more_than_the_truth_does(motion):
    source, limit = wave_source(Wave(), motion), 0.002
    frames = range(4)
    found = [irradiance(frame_of(source, Shutter(f, f, f + 1), COLUMNS, ROWS, photons=16384)).mean() for f in frames]
    truth = [wave_truth(motion, f).mean() for f in frames]
    # A mean is off by no more than the root mean square promised above.
    allowed = np.abs(np.diff(truth)) + 2 * limit * np.mean(truth)
    assert np.all(np.abs(np.diff(found)) <= allowed)
    np.testing.assert_allclose(found, truth, rtol=limit)


def test_accumulation_converges_to_the_truth():
    source, instants = wave_source(Wave()), 8
    assert relative_error(irradiance_average(EDGES, Wave(), 0, 1, instants), wave_truth("smooth")) < 0.001
    settings = {"estimator": "accumulation", "photons": 16384, "accumulation_times": instants}
    frame = frame_of(source, Shutter(0, 0, 1), COLUMNS, ROWS, **settings)
    # As many photons in each instant as K = 4 shares out between its segments.
    assert relative_error(irradiance(frame), wave_truth("smooth")) <= 0.001
    middle = frame_of(source, Shutter(0, 0, 1), COLUMNS, ROWS, photons=16384, estimator="pd")
    assert relative_error(irradiance(middle), wave_truth("smooth")) > 10 * 0.001


def rod_error(finer: int, **settings) -> float:
    """Error of pixels averaged from ``finer``² smaller ones, which keeps the widening of footprints out of it."""
    source, truth = rod_and_truth()
    settings = {"photons": 12000, "samples": 1, "segments": 1, **settings}
    frame = frame_of(source, Shutter(0, 0, 1), finer * PIXELS, finer * PIXELS, **settings)
    # Photons are counted where they land: internal reflections make several of one.
    assert 14_000 < frame.energy.counts["landed"] < 20_000
    return relative_error(irradiance(frame).reshape(PIXELS, finer, PIXELS, finer).mean(axis=(1, 3)), truth)


def test_the_truth_of_the_turning_rod_has_converged():
    assert relative_error(irradiance_of_rod(24, 1), rod_and_truth()[1]) < 1e-3


def test_a_turning_glass_rod_is_as_exact_as_promised():
    assert rod_error(3) <= 0.045


def test_a_photon_that_does_not_ride_on_the_rod_is_several_times_worse():
    # Along keyframes, what slides off the rod would be traced again in time.
    assert rod_error(2, anchor="light", path="straight") > 2 * 0.045


@pytest.mark.slow
def test_one_trace_of_a_turning_rod_equals_many_accumulated_ones():
    """At equal pixels, against brute force, whose own error falls like 1/n: a third of what a quarter of n changes."""
    source, _ = rod_and_truth()
    found, truth, coarse = (
        irradiance(frame_of(source, Shutter(0, 0, 1), PIXELS, PIXELS, accumulation_times=16, **settings))
        for settings in (
            {"photons": 8192},
            {"photons": 65536, "estimator": "accumulation"},
            {"photons": 16384, "estimator": "accumulation"},
        )
    )
    assert relative_error(coarse, truth) / 3 <= 0.01
    assert relative_error(found, truth) <= 0.06
