"""Photon differentials without the time column (2007): the scene stands still at mid shutter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tpdwarp.estimators.base import Animation, Clock, LoadedScene, Part
from tpdwarp.estimators.temporal import shaped
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.scene.description import Shutter


class Static:
    """One trace at mid shutter, static footprints."""

    def parts(
        self, animation: Animation, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        yield still_part(animation, Shutter(shutter.frame, shutter.middle, shutter.middle), 1.0, 0.0, pixel, clock)


def still_part(
    animation: Animation,
    still: Shutter,
    weight: float,
    time: float,
    pixel: PixelSize | None,
    clock: Clock,
    number: int = 0,
) -> Part:
    """Photons of one instant, standing for ``weight`` of the exposure at ``time`` (−½ … ½) in it.

    Instants of other ``number`` throw other dice.
    """
    settings = animation.settings
    loaded = animation.load(still, clock)
    plan = animation.plan(settings.photons, clock)
    photons, energy = animation.trace(loaded, plan, clock, seed=settings.seed + number, weight=weight)
    return shaped([replace(photons, time=time, duration=weight)], energy, plan, False, animation, pixel, clock)
