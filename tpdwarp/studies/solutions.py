"""Rendering one case and noting what it cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.studies.memory import peak_bytes, reset_peak
from tpdwarp.usd.read.stage import StageScene

_WARM_PHOTONS, _WARM_PIXELS = 64, 8


@dataclass(frozen=True, eq=False)
class Solution:
    """Frames rendered in one way.

    Attributes:
        caustic: Radiance from photons, shape [frames, h, w, 3] float32.
        beauty: Radiance in all, shape [frames, h, w, 3] float32.
        cpu_seconds: CPU time a frame by stage, all threads together.
        seconds: Wall time a frame by stage.
        landed: Photons landed a frame.
        memory: Largest resident memory of the process [bytes].
    """

    caustic: np.ndarray
    beauty: np.ndarray
    cpu_seconds: dict[str, float]
    seconds: dict[str, float]
    landed: float
    memory: int


class Renderer:
    """Renders frames of a stage in one way after the other.

    Args:
        source: The stage.
        width, height: Pixels.
    """

    def __init__(self, source: StageScene, width: int, height: int) -> None:
        self.source, self.width, self.height = source, width, height
        self._warm: set[tuple[object, ...]] = set()

    def render(self, shutters: Sequence[Shutter], settings: Settings) -> Solution:
        """Renders the frames exposed by ``shutters``.

        Kernels are compiled before the clock runs. What is planned once for an animation (emission lattices, the number
        of segments) is the stage ``plan``, spread over the frames.

        Raises:
            InputError: The stage cannot be used.
            FrameError: A frame cannot be rendered.
        """
        settings = replace(settings, aovs=("caustic",))
        self._compile(shutters[0], settings)
        clock = Clock()
        reset_peak()
        context = RenderContext(self.source, settings)
        frames = [render_frame(context, shutter, self.width, self.height, clock) for shutter in shutters]
        return Solution(
            np.stack([_stacked(frame.channels, "caustic.") for frame in frames]),
            np.stack([_stacked(frame.channels, "") for frame in frames]),
            {stage: seconds / len(frames) for stage, seconds in clock.cpu_seconds.items()},
            {stage: seconds / len(frames) for stage, seconds in clock.seconds.items()},
            float(np.mean([len(frame.photons) for frame in frames])),
            peak_bytes(),
        )

    def _compile(self, shutter: Shutter, settings: Settings) -> None:
        form = (settings.kernel, settings.footprint, settings.time_filter, settings.emission, settings.anchor)
        variant = (settings.estimator, settings.trace_at, shutter.exposure > 0, *form)
        if variant not in self._warm:
            small = replace(settings, photons=_WARM_PHOTONS, accumulation_times=1)
            render_frame(RenderContext(self.source, small), shutter, _WARM_PIXELS, _WARM_PIXELS)
            self._warm.add(variant)


def _stacked(channels: dict[str, np.ndarray], prefix: str) -> np.ndarray:
    return np.stack([channels[f"{prefix}{color}"] for color in "RGB"], axis=-1)
