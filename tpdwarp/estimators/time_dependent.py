"""Time dependent photon mapping (Cammarano & Jensen 2002): photons with times, and the k nearest within the shutter.

``tdpm_between`` = B puts the times at t_j = j e/(B+1), j = 0 … B, each with an equal share of the photons; without it
every photon has a random time, which is the fairer variant.
"""

from __future__ import annotations

from collections.abc import Iterator

from tpdwarp.estimators.base import Animation, Clock, LoadedScene, Part
from tpdwarp.estimators.distribution import dealt_photons, random_times
from tpdwarp.estimators.nearest import NearestField, tree_type
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.scene.description import Shutter


class TimeDependent:
    """One photon map over the shutter, searched for the k nearest photons in space."""

    def parts(
        self, animation: Animation, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        tree_type()
        settings = animation.settings
        times = random_times(animation, scenes)
        if settings.tdpm_between is not None and len(times) > 1:
            count = settings.tdpm_between + 1
            times = [number / count for number in range(count)]
        maps, energy, plan = dealt_photons(animation, shutter, times, clock)
        light = None
        if pixel is not None and any(map(len, maps)):
            with clock.stage("footprints"):
                light = NearestField(maps, settings.tdpm_neighbours, animation.launcher.threads)
        yield Part(maps, energy, light, plan)
