"""Distribution ray tracing in time (Cook 1984): every photon has one random time, and no differential in time.

A scene at a time of its own for every photon is out of reach with one BVH a scene, so the shutter is cut into as many
parts as ``accumulation_times`` says, one random instant is taken in each, and the photons are dealt out between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from tpdwarp.estimators.base import Animation, Clock, LoadedScene, Part
from tpdwarp.estimators.temporal import shaped
from tpdwarp.estimators.time_strata import dealt_cells, instants
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.record import EnergyAccount
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import Shutter


class Distribution:
    """All photons in one map, each traced at its own time, with static footprints of their lattice cells."""

    def parts(
        self, animation: Animation, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        maps, energy, plan = dealt_photons(animation, shutter, random_times(animation, scenes), clock)
        yield shaped(maps, energy, plan, False, animation, pixel, clock)


def random_times(animation: Animation, scenes: list[LoadedScene]) -> Sequence[float]:
    """A random instant in each part of the shutter, as fractions of it; its middle where nothing moves."""
    if not any(scene.moves for scene in scenes):
        return [0.5]
    return instants(animation.settings.accumulation_times, animation.settings.seed)


def dealt_photons(
    animation: Animation, shutter: Shutter, times: Sequence[float], clock: Clock
) -> tuple[list[PhotonMap], EnergyAccount, EmissionPlan]:
    """The photons of one lattice, dealt out between instants of the shutter.

    Args:
        times: Instants, as fractions of the shutter, one in each of as many equal parts of it.

    Returns:
        One map an instant, standing for its part of the shutter, where the flux went, and the lattice.
    """
    settings, count = animation.settings, len(times)
    plan = animation.plan(settings.photons, clock)
    maps: list[PhotonMap] = []
    energy = EnergyAccount()
    for number, time in enumerate(times):
        instant = shutter.open + float(time) * shutter.exposure
        loaded = animation.load(Shutter(shutter.frame, instant, instant), clock)
        chosen = dealt_cells(number, count, settings.seed)
        photons, account = animation.trace(loaded, plan, clock, seed=settings.seed, chosen=chosen)
        maps.append(replace(photons, time=(number + 0.5) / count - 0.5, duration=1.0 / count))
        energy.add(account)
    return maps, energy, plan
