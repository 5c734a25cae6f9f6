"""Time dependent photon mapping (Cammarano & Jensen 2002): photons with times, and the k nearest within the shutter.

``tdpm_between`` = B puts the times at t_j = j e/(B+1), j = 0 … B, each with an equal share of the photons; without it
every photon has a random time, which is the fairer variant.
"""

from __future__ import annotations

from collections.abc import Iterator

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part
from tpdwarp.estimators.nearest import NearestField, tree_type
from tpdwarp.estimators.time_strata import photons_at_stratified_times, random_times
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene


class TimeDependent:
    """One photon map over the shutter, searched for the k nearest photons in space."""

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        tree_type()
        settings = tracer.settings
        times = random_times(tracer, scenes)
        if settings.tdpm_between is not None and len(times) > 1:
            count = settings.tdpm_between + 1
            times = [number / count for number in range(count)]
        maps, energy, plan = photons_at_stratified_times(tracer, shutter, times, clock)
        light = None
        if pixel is not None and any(map(len, maps)):
            with clock.stage("footprints"):
                light = NearestField(maps, settings.tdpm_neighbours, tracer.launcher.threads)
        yield Part(maps, energy, light, plan, scenes, shutter)
