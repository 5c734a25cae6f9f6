"""Bodies that spin within the shutter, against as many traces as there are instants."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import box, glass
from tests.photons.traced import sun
from tests.view.scenes import Source, floor, looking_down
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from usd_scenes.shapes import rotation

OPEN = Shutter(0, 0, 1)
AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
TILT = rotation((1.0, 0.0, 0.0), 30.0) @ rotation((0.0, 1.0, 0.0), 20.0)
BOX = box("/box", (-0.3, -0.3, -0.3), (0.3, 0.3, 0.3), glass())


def spinning(degrees: float) -> Source:
    """A box of glass that goes round by so much in a frame."""

    def at(shutter: Shutter) -> SceneAtShutter:
        points = BOX.points @ (rotation(tuple(AXIS), degrees * shutter.middle) @ TILT).T
        motions = np.radians(degrees) * shutter.exposure * np.cross(AXIS, points)
        body = replace(BOX, points=points + np.array([0.0, 0.0, 0.7]), motions=motions if shutter.exposure else None)
        return SceneAtShutter(shutter, (floor(), body), (sun(),), looking_down(height=0.1))

    return Source(at)


def rendered(degrees: float, **changes) -> tuple[Frame, float]:
    """A frame, and the CPU seconds that it took."""
    settings = Settings(samples=4, segments="auto", aovs=("irradiance",), **changes)
    start = time.process_time()
    frame = render_frame(RenderContext(spinning(degrees), settings), OPEN, 64, 64)
    return frame, time.process_time() - start


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [45.0, 200.0])
def test_fast_spins_are_right_within_a_twentieth_at_ten_times_the_cost_of_slow_ones(degrees):
    photons = 1 << 16
    rendered(5.0, photons=1024)
    _, slow = rendered(5.0, photons=photons)
    frame, fast = rendered(degrees, photons=photons)
    truth, _ = rendered(degrees, photons=1 << 14, estimator="accumulation", accumulation_times=128)
    found, truth = (one.channels["irradiance.R"].astype(float) for one in (frame, truth))
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.05 * truth.mean()
    assert fast < 10.0 * slow


@pytest.mark.parametrize("degrees", [45.0, 200.0])
def test_fast_spins_keep_their_light(degrees):
    frame, _ = rendered(degrees, photons=4096)
    truth, _ = rendered(degrees, photons=1024, estimator="accumulation", accumulation_times=64)
    found, truth = (one.channels["irradiance.R"].mean(dtype=np.float64) for one in (frame, truth))
    assert found == pytest.approx(truth, rel=0.03)
