"""How far renders are from the truth: the limits below are promises, what is measured is better.

Errors are root mean squares over all pixels, relative to the mean irradiance of the image.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from tests.view.scenes import looking_down, turning_rod_source, wave_source
from tpdwarp.presets import PRESETS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from usd_scenes.oracle import Ellipsoid, Plane, Wave, irradiance_average, trace

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
    assert frame.energy.counts["emitted"] == photons
    assert relative_error(irradiance(frame), wave_truth(motion)) <= limit


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


HALF, PIXELS = 1.2, 128
HEIGHT, RADIUS, LENGTH = 0.4, 0.15, 2.0
DEGREES = 5.0


@cache
def rod_profile(cells: int = 4096, rays: int = 40_001) -> np.ndarray:
    """Mean irradiance on the floor in narrow strips across a lying glass rod under vertical light, over ±HALF·√2.

    In the plane across its axis a rod bends light as a sphere does. Every path of up to six meetings is followed by
    the float64 tracer; the light between two neighbouring rays of a path lands between their images.
    """
    scene = [Ellipsoid("/rod", (0, 0, HEIGHT), (RADIUS,) * 3, ior=1.5), Plane("/floor", (0, 0, 0), (0, 0, 1))]
    reach = HALF * math.sqrt(2)
    edges = np.linspace(-reach, reach, cells + 1)
    x0 = np.linspace(-RADIUS, RADIUS, rays)[1:-1]
    origins = np.stack([x0, 0 * x0, 0 * x0 + 2], axis=1)
    landed = np.zeros(cells)
    paths = [("reflect",), *(("refract", *["reflect"] * k, "refract") for k in range(5))]
    for choices in paths:
        path = trace(scene, origins, np.broadcast_to([0.0, 0, -1], origins.shape), 0.0, choices)
        x, share = path.positions[:, 0], path.throughput
        # A reflected ray that meets the rod again, or leaves upwards, is not one of these paths.
        good = path.landed & (path.bounces == len(choices))
        pair = good[1:] & good[:-1]
        low, high = np.minimum(x[1:], x[:-1])[pair], np.maximum(x[1:], x[:-1])[pair]
        flux = (0.5 * (share[1:] + share[:-1]) * np.diff(x0))[pair]
        landed += spread_over(edges, low, np.maximum(high, low + 1e-9), flux)
    return landed / np.diff(edges)


def spread_over(edges: np.ndarray, low: np.ndarray, high: np.ndarray, flux: np.ndarray) -> np.ndarray:
    """Flux in each cell where each interval's is spread evenly between ``low`` and ``high``, shape [cells]."""
    step = edges[1] - edges[0]
    inside = (high > edges[0]) & (low < edges[-1])
    low, high, flux = low[inside], high[inside], flux[inside]
    density = flux / (high - low)
    cells = np.zeros(len(edges) - 1)
    first = np.floor((low - edges[0]) / step).astype(int)
    last = np.floor((high - edges[0]) / step).astype(int)
    for k in range(int((last - first).max(initial=-1)) + 1):
        cell = first + k
        rows = (cell <= last) & (cell >= 0) & (cell < len(cells))
        start = np.maximum(low[rows], edges[cell[rows]])
        end = np.minimum(high[rows], edges[cell[rows] + 1])
        np.add.at(cells, cell[rows], density[rows] * np.maximum(end - start, 0))
    return cells


def rod_truth(times: int, parts: int) -> np.ndarray:
    """Irradiance over the shutter [0, 1], pixels cut into ``parts``², ``times`` instants: the profile turned about."""
    reach = HALF * math.sqrt(2)
    edges = np.linspace(-reach, reach, len(rod_profile()) + 1)
    cumulative = np.concatenate([[0], np.cumsum(rod_profile())]) * (edges[1] - edges[0])
    part = 2 * HALF / (PIXELS * parts)
    at = -HALF + (np.arange(PIXELS * parts) + 0.5) * part
    x, y = np.meshgrid(at, -at)
    total = np.zeros((PIXELS, PIXELS))
    for k in range(times):
        angle = math.radians(DEGREES) * (k + 0.5) / times
        along, across = math.cos(angle) * x + math.sin(angle) * y, math.cos(angle) * y - math.sin(angle) * x
        # Each part is averaged as if it lay along the rod, from which it turns by five degrees at most.
        low, high = (np.interp(across + side * 0.5 * part, edges, cumulative) for side in (-1, 1))
        covered = np.clip((0.5 * LENGTH - np.abs(along)) / part + 0.5, 0, 1)
        total += (covered * (high - low) / part).reshape(PIXELS, parts, PIXELS, parts).mean(axis=(1, 3))
    return total / times


@cache
def rod() -> tuple[SceneSource, np.ndarray]:
    camera = looking_down((-HALF, HALF, -HALF, HALF), height=0.5 * (HEIGHT - RADIUS))
    return turning_rod_source(DEGREES, camera, HEIGHT), rod_truth(48, 2)


def rod_error(finer: int, **settings) -> float:
    """Error of pixels averaged from ``finer``² smaller ones, which keeps the widening of footprints out of it."""
    source, truth = rod()
    settings = {"photons": 12000, "samples": 1, "segments": 1, **settings}
    frame = frame_of(source, Shutter(0, 0, 1), finer * PIXELS, finer * PIXELS, **settings)
    # Photons are counted where they land: internal reflections make several of one.
    assert 14_000 < frame.energy.counts["landed"] < 20_000
    return relative_error(irradiance(frame).reshape(PIXELS, finer, PIXELS, finer).mean(axis=(1, 3)), truth)


def test_the_truth_of_the_turning_rod_has_converged():
    assert relative_error(rod_truth(24, 1), rod()[1]) < 1e-3


def test_a_turning_glass_rod_is_as_exact_as_promised():
    assert rod_error(3) <= 0.045


def test_a_photon_that_does_not_ride_on_the_rod_is_several_times_worse():
    # Along keyframes, what slides off the rod would be traced again in time.
    assert rod_error(2, anchor="light", path="straight") > 2 * 0.045


@pytest.mark.slow
def test_one_trace_of_a_turning_rod_equals_many_accumulated_ones():
    """At equal pixels, against brute force, whose own error falls like 1/n: a third of what a quarter of n changes."""
    source, _ = rod()
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
