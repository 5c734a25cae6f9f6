"""Temporal photon differentials: footprints swept along D_t x, one trace a segment of the shutter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part, light_of
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.fit import fit_trajectories


class Temporal:
    """The paper's estimator, at mid shutter or as it opens, with the photons shared between the segments."""

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        settings, count = tracer.settings, len(scenes)
        plan = tracer.plan(max(1, settings.photons // count), clock)
        maps: list[PhotonMap] = []
        energy = EnergyAccount()
        for number, seen in enumerate(scenes):
            moves = seen.requirements.photon_motion
            opening = settings.trace_at == "open" and moves
            loaded = tracer.loader.load_opening(seen.scene.shutter, clock) if opening else seen
            photons, account = tracer.trace(loaded, plan, clock, seed=settings.seed + number, weight=1.0 / count)
            curves = settings.path == "curved" and settings.kernel == "bspline" and moves
            if curves and pixel is not None and not opening:
                photons, emitted = fit_trajectories(photons, plan, tracer, seen, clock)
                account.counts["keyframes"] = emitted
            if opening:
                # Footprints stand at mid shutter and sweep to both sides: the same way, seen from its middle.
                photons = replace(photons, position=photons.position + 0.5 * photons.dxdt)
            maps.append(replace(photons, time=(number + 0.5) / count - 0.5, duration=1.0 / count))
            energy.add(account)
        energy.counts["segments traced"] = count
        moves = any(seen.requirements.photon_motion for seen in scenes)
        yield Part(maps, energy, light_of(maps, energy, moves, tracer, pixel, clock), plan, scenes, shutter)
