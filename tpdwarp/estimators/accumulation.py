"""Accumulation: the exact answer by brute force, many instants of the shutter rendered in full and averaged.

At each instant lights with extent are points: they stand at another place on them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part, at_edges, bent, light_of
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.light_places import place_lights

# Places are taken in an order that is far from theirs: a prime, which divides no number of instants in use.
STEP = 7919


class Accumulation:
    """``accumulation_times`` instants, each with all the photons and static footprints, and a view of its own.

    So it is a truth for edges and for direct light, too. Instants and places on lights go along with each other in
    steps that have no common measure, so that each part of the shutter sees all of the light.
    """

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        settings = tracer.settings
        varies = any(scene.moves or scene.requirements.extended_lights for scene in scenes)
        count = settings.accumulation_times if varies else 1
        plan = tracer.plan(settings.photons, clock)
        for number in range(count):
            part = (number + 0.5) / count
            instant = shutter.open + part * shutter.exposure
            still = Shutter(shutter.frame, instant, instant)
            loaded = tracer.load(still, clock)
            if loaded.requirements.extended_lights:
                scene = place_lights(loaded.scene, number * STEP % count, count)
                needs = replace(loaded.requirements, extended_lights=())
                loaded = replace(loaded, scene=scene, requirements=needs)
            # Instants throw dice of their own.
            photons, energy = tracer.trace(loaded, plan, clock, seed=settings.seed + number, weight=1.0 / count)
            photons = at_edges(bent(photons, plan, tracer, pixel, clock), plan, loaded, tracer, pixel, clock)
            maps = [replace(photons, time=part - 0.5, duration=1.0 / count)]
            light = light_of(maps, energy, False, tracer, pixel, clock)
            yield Part(maps, energy, light, plan, [loaded], still, 1.0 / count)
