"""Small frames of a travelling wave, and of water at rest."""

from __future__ import annotations

import numpy as np

from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, steady, wave_source
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, Traced, render_frame, trace_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from usd_scenes.oracle import Wave

OPEN = Shutter(0, 0, 1)
STILL_SCENE = steady([floor(), bumpy("/water", WATER, 1.0, False)], (SUN,), looking_down(height=0.6))
SETTINGS = Settings(photons=4096, segments=1, samples=2, accumulation_times=16, aovs=("irradiance",))
COLUMNS, ROWS = 64, 8


def traced(source=None, shutter: Shutter = OPEN, **changes) -> Traced:
    return trace_frame(RenderContext(source or wave_source(Wave()), Settings.of(SETTINGS, **changes)), shutter)


def rendered(source=None, shutter: Shutter = OPEN, columns: int = COLUMNS, **changes) -> Frame:
    context = RenderContext(source or wave_source(Wave()), Settings.of(SETTINGS, **changes))
    return render_frame(context, shutter, columns, ROWS)


def irradiance(frame: Frame) -> np.ndarray:
    """Photon irradiance of the first channel, shape [h, w]."""
    return frame.channels["irradiance.R"].astype(float)
