"""The photon tracer of one animation: loaded scenes and emission lattices brought together."""

from __future__ import annotations

from copy import copy
from typing import Any

from tpdwarp.clock import Clock
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan, plan_emission
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracing import trace_photons
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene, SceneLoader
from tpdwarp.settings import LightSettings


class PhotonTracer:
    """Traces photons through any shutter of an animation, from lattices that stay the same from frame to frame.

    Args:
        loader: Loads the scenes.
        settings: How photons are emitted and what they ride on.
    """

    def __init__(self, loader: SceneLoader, settings: LightSettings) -> None:
        self.loader, self.settings = loader, settings
        self.source, self.launcher, self.normalization = loader.source, loader.launcher, loader.normalization
        self._plans: dict[int, EmissionPlan] = {}

    def with_settings(self, settings: LightSettings) -> PhotonTracer:
        """The same tracer with other settings; stills are not read again where lattices keep their shape."""
        other = copy(self)
        other.settings = settings
        if other._square != self._square:
            other._plans = {}
        return other

    @property
    def _square(self) -> bool:
        # What knows no footprints gains nothing from long cells, and dice are thrown as the paper throws them.
        return self.settings.estimator == "tdpm" or self.settings.emission == "jittered"

    @property
    def riding(self) -> bool:
        """Whether photons ride on the surface that they hit first (beyond the paper)."""
        return self.settings.anchor == "surface"

    def load(self, shutter: Shutter, clock: Clock | None = None) -> LoadedScene:
        """The scene over ``shutter``, on the device."""
        return self.loader.load(shutter, clock)

    def plan(self, photons: int, clock: Clock | None = None) -> EmissionPlan:
        """Emission lattices for ``photons`` photons a shutter; made once for the whole animation."""
        if photons not in self._plans:
            with (clock or Clock()).stage("plan"):
                self._plans[photons] = self._planned(photons)
        return self._plans[photons]

    def trace(
        self, loaded: LoadedScene, plan: EmissionPlan, clock: Clock, **options: Any
    ) -> tuple[PhotonMap, EnergyAccount]:
        """Photons of ``plan`` through a loaded scene; ``options`` are those of :func:`trace_photons`."""
        with clock.stage("trace"):
            return trace_photons(
                loaded.scene,
                loaded.geometry,
                plan,
                loaded.requirements,
                self.launcher,
                textures=loaded.textures,
                **{
                    "jittered": self.settings.emission == "jittered",
                    "riding": self.riding,
                    "smallest_branch": self.settings.branch_cutoff,
                    **options,
                },
            )

    def _planned(self, photons: int) -> EmissionPlan:
        if self._plans:
            return next(iter(self._plans.values())).with_photons(photons)
        return plan_emission(self.source, photons, self.normalization, square=self._square)
