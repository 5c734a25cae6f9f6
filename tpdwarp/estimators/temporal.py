"""Temporal photon differentials: footprints swept along D_t x, one trace a segment of the shutter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part, bent, light_of
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.energy import STARVED, EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.changing import changing_cells
from tpdwarp.trajectories.fit import fit_trajectories
from tpdwarp.trajectories.keyframes import ShutterKeyframes
from tpdwarp.trajectories.parts import traced_in_parts


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
            time, duration = (number + 0.5) / count - 0.5, 1.0 / count
            options = {"seed": settings.seed + number}
            if opening:
                loaded = tracer.loader.load_opening(seen.scene.shutter, clock)
                photons, account = tracer.trace(loaded, plan, clock, weight=duration, **options)
                # Footprints stand at mid shutter and sweep to both sides: the same path, seen from its middle.
                traced = [replace(photons, position=photons.position + 0.5 * photons.dxdt)]
            elif settings.path == "curved" and settings.kernel == "bspline" and moves:
                traced, account = _along_keyframes(tracer, plan, seen, duration, options, clock)
            else:
                photons, account = tracer.trace(seen, plan, clock, weight=duration, **options)
                traced = [photons]
            traced = [bent(photons, plan, tracer, pixel, clock) for photons in traced]
            maps += [
                replace(photons, time=time + duration * photons.time, duration=duration * photons.duration)
                for photons in traced
            ]
            energy.add(account)
        energy.counts["segments traced"] = count
        if plan.splits > 1:
            energy.counts["parts of each light with extent"] = plan.splits
        if plan.starved_lights:
            energy.counts[STARVED] = plan.starved_lights
        moves = any(seen.requirements.photon_motion for seen in scenes)
        yield Part(maps, energy, light_of(maps, energy, moves, tracer, pixel, clock), plan, scenes, shutter)


def _along_keyframes(
    tracer: PhotonTracer, plan: EmissionPlan, seen: LoadedScene, weight: float, options: dict[str, Any], clock: Clock
) -> tuple[list[PhotonMap], EnergyAccount]:
    """Photons that go along trajectories, and those of cells whose light begins or ends within the segment.

    Args:
        seen: The scene of the segment.
        weight: Its part of the exposure.
        options: Of the tracer.

    Returns:
        Photons of mid segment, then those of each part of it that has its own; where their flux went.
    """
    keyframes = ShutterKeyframes.over(tracer, plan, seen, clock)
    tags = keyframes.tags.of(seen.scene)
    photons, account = tracer.trace(seen, plan, clock, weight=weight, tags=tags, **options)
    changing, light = None, float(photons.flux.sum(dtype=np.float64))
    if tracer.settings.emission == "lattice":
        changing = changing_cells(keyframes, photons, plan, clock)
    if changing:
        again = {"weight": weight, "chosen": changing.at_middle(), "tags": tags, **options}
        _, replaced = tracer.trace(seen, plan, clock, **again)
        account.subtract(replaced)
        photons = photons.rows(~changing.holds(photons))
    photons, fitted = fit_trajectories(photons, plan, keyframes, clock)
    account.add(fitted)
    traced = [photons]
    if changing:
        parts, more = traced_in_parts(tracer, keyframes, changing, seen.scene.shutter, weight, light, clock, **options)
        account.add(more)
        traced += parts
        account.counts["cells traced again in time"] = len(changing)
    return traced, account
