"""Photon differentials without the time column (2007): the photons of mid shutter stand still."""

from __future__ import annotations

from collections.abc import Iterator

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part, at_edges, bent, light_of
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene


class Static:
    """One trace at mid shutter, static footprints, seen through the moving scene."""

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        loaded = tracer.load(Shutter(shutter.frame, shutter.middle, shutter.middle), clock)
        plan = tracer.plan(tracer.settings.photons, clock)
        photons, energy = tracer.trace(loaded, plan, clock, seed=tracer.settings.seed)
        photons = at_edges(bent(photons, plan, tracer, pixel, clock), plan, loaded, tracer, pixel, clock)
        light = light_of([photons], energy, False, tracer, pixel, clock)
        yield Part([photons], energy, light, plan, scenes, shutter)
