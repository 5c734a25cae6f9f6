"""Temporal photon differentials: footprints swept along D_t x, one trace a segment of the shutter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tpdwarp.estimators.base import Animation, Clock, FootprintField, LoadedScene, Part
from tpdwarp.footprints.gather import GatherForm
from tpdwarp.footprints.shaping import PixelSize, shape_footprints
from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.record import EnergyAccount
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import Shutter
from tpdwarp.trajectories.fit import bent
from tpdwarp.trajectories.segments import Level


class Temporal:
    """The paper's estimator, at mid shutter or as it opens, with the photons shared between the segments."""

    def parts(
        self, animation: Animation, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        first, *others = animation.levels(shutter, clock)
        yield self._part(animation, first, scenes, pixel, clock)
        for level in others:
            yield self._part(animation, level, animation.load_segments(shutter, clock, level), pixel, clock)

    def _part(
        self, animation: Animation, level: Level, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Part:
        """The photons of one level."""
        settings, count = animation.settings, len(scenes)
        plan = animation.plan(max(1, settings.photons // count), clock)
        maps: list[PhotonMap] = []
        energy = EnergyAccount()
        for number, seen in enumerate(scenes):
            opening = settings.trace_at == "open" and seen.requirements.photon_motion
            loaded = animation.load_opening(seen.scene.shutter, clock) if opening else seen
            riding, seed = settings.anchor == "surface", settings.seed + number
            photons, account = animation.trace(
                loaded, plan, clock, riding=riding, seed=seed, weight=1.0 / count, taken=level.taken
            )
            curved = settings.path == "curved" and settings.kernel == "bspline" and seen.requirements.photon_motion
            if curved and pixel is not None and not opening:
                photons, guides = bent(photons, plan, animation, seen, clock, level.taken)
                account.counts["guides"] = guides
            if opening:
                # Footprints stand at mid shutter and sweep to both sides: the same way, told from its middle.
                photons = replace(photons, position=photons.position + 0.5 * photons.dxdt)
            maps.append(replace(photons, time=(number + 0.5) / count - 0.5, duration=1.0 / count))
            energy.add(account)
        energy.counts["segments traced"] = count
        return shaped(maps, energy, plan, any(s.requirements.photon_motion for s in scenes), animation, pixel, clock)


def shaped(
    maps: list[PhotonMap],
    energy: EnergyAccount,
    plan: EmissionPlan,
    moves: bool,
    animation: Animation,
    pixel: PixelSize | None,
    clock: Clock,
) -> Part:
    """A part whose footprints are shaped for ``pixel`` and evaluated as the settings say."""
    settings = animation.settings
    light = None
    if pixel is not None:
        with clock.stage("footprints"):
            footprints = shape_footprints(
                maps, settings.kernel, settings.smoothing, pixel, moves, animation.launcher
            )
        if footprints.count:
            form = GatherForm(settings.kernel, settings.footprint, settings.time_filter)
            light = FootprintField(footprints, form, animation.launcher)
        if footprints.clamped:
            energy.counts["footprints clamped"] = energy.counts.get("footprints clamped", 0) + footprints.clamped
    return Part(maps, energy, light, plan)
