"""Accumulation: the exact answer by brute force, many instants of the shutter traced in full and averaged."""

from __future__ import annotations

from collections.abc import Iterator

from tpdwarp.estimators.base import Animation, Clock, LoadedScene, Part
from tpdwarp.estimators.static import still_part
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.scene.description import Shutter


class Accumulation:
    """``accumulation_times`` instants, each with all the photons and static footprints."""

    def parts(
        self, animation: Animation, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        times = animation.settings.accumulation_times if any(scene.moves for scene in scenes) else 1
        for number in range(times):
            where = (number + 0.5) / times
            instant = shutter.open + where * shutter.exposure
            still = Shutter(shutter.frame, instant, instant)
            yield still_part(animation, still, 1.0 / times, where - 0.5, pixel, clock, number)
