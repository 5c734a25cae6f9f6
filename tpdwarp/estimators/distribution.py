"""Distribution ray tracing in time (Cook 1984): every photon has one random time, and no differential in time.

The shutter is cut into as many parts as ``accumulation_times`` says, one random time is taken in each, and the photons
are shared between them.
"""

from __future__ import annotations

from collections.abc import Iterator

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part, bent, light_of
from tpdwarp.estimators.time_strata import photons_at_stratified_times, random_times
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene


class Distribution:
    """All photons in one map, each traced at its own time, with static footprints of their lattice cells."""

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        times = random_times(tracer, scenes)
        maps, energy, plan = photons_at_stratified_times(tracer, shutter, times, clock)
        if len(maps) == 1:
            # At rest neighbours are in one map; else they have times of their own.
            maps = [bent(maps[0], plan, tracer, pixel, clock)]
        yield Part(maps, energy, light_of(maps, energy, False, tracer, pixel, clock), plan, scenes, shutter)
