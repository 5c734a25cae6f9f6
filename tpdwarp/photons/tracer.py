"""The photon tracer of one animation: loaded scenes and emission lattices brought together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

from tpdwarp.clock import Clock
from tpdwarp.photons.dispersion import WAVELENGTHS
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan, plan_emission
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracing import trace_photons
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene, SceneLoader
from tpdwarp.settings import LightSettings


@dataclass(frozen=True)
class LightSplits:
    """The parts that lights with extent are cut into.

    Attributes:
        count: Their number.
        error: The error that is foreseen of it where another number would err far less; else 0.
        gains: What light of so few parts is brighter by, by the paths of lights, so that it is as much as that of many.
    """

    count: int
    error: float = 0.0
    gains: Mapping[str, float] = field(default_factory=dict)


class PhotonTracer:
    """Traces photons through any shutter of an animation, from lattices that stay the same from frame to frame.

    Args:
        loader: Loads the scenes.
        settings: How photons are emitted and what they ride on.
        choose_splits: What gives the parts that lights with extent are cut into, by a tracer with one part a light and
            what the settings ask for. Without, there are as many as those ask for, or one.
    """

    def __init__(
        self,
        loader: SceneLoader,
        settings: LightSettings,
        choose_splits: Callable[[PhotonTracer, int | str], LightSplits] | None = None,
    ) -> None:
        self.loader, self.settings, self._choose_splits = loader, settings, choose_splits
        self.source, self.launcher, self.normalization = loader.source, loader.launcher, loader.normalization
        self._plans: dict[int, EmissionPlan] = {}
        # What was chosen for which settings, also by tracers with others.
        self._chosen_splits: dict[tuple[int, str, int | str], LightSplits] = {}

    def with_settings(self, settings: LightSettings) -> PhotonTracer:
        """The same tracer with other settings; stills are not read again where lattices keep their shape."""
        other = copy(self)
        other.settings = settings
        if other._square != self._square or other._split != self._split:
            other._plans = {}
        return other

    @property
    def splits(self) -> int:
        """Parts that a light with extent is cut into; each has lattices and columns of its own."""
        return self._split.count

    @property
    def split_error(self) -> float:
        """The error that is foreseen of light with extent where the settings ask for a bad number of parts."""
        return self._split.error

    @property
    def _split(self) -> LightSplits:
        settings = self.settings
        # Accumulation goes through places on lights by itself.
        if not self.loader.extended_lights or settings.estimator == "accumulation":
            return LightSplits(1)
        if self._choose_splits is None:
            return LightSplits(1 if settings.light_splits == "auto" else int(settings.light_splits))
        key = settings.photons, settings.estimator, settings.light_splits
        if key not in self._chosen_splits:
            whole = copy(self)
            whole.settings, whole._plans, whole._choose_splits = replace(settings, light_splits=1), {}, None
            self._chosen_splits[key] = self._choose_splits(whole, settings.light_splits)
        return self._chosen_splits[key]

    @property
    def _square(self) -> bool:
        # What knows no footprints gains nothing from long cells, and dice are thrown as the paper throws them.
        return self.settings.estimator == "tdpm" or self.settings.emission == "jittered"

    @property
    def riding(self) -> bool:
        """Whether photons ride on the surface that they hit first (beyond the paper)."""
        return self.settings.anchor == "surface"

    def load(
        self,
        shutter: Shutter,
        clock: Clock | None = None,
        instead_of: LoadedScene | None = None,
        beside: LoadedScene | None = None,
    ) -> LoadedScene:
        """The scene over ``shutter``, on the device; see :meth:`SceneLoader.load`."""
        return self.loader.load(shutter, clock, instead_of, beside)

    def load_each(self, shutters: Iterable[Shutter], clock: Clock) -> list[LoadedScene]:
        """The scenes over several shutters of one frame; they share what is large."""
        scenes: list[LoadedScene] = []
        for shutter in shutters:
            scenes.append(self.load(shutter, clock, beside=scenes[0] if scenes else None))
        return scenes

    def plan(self, photons: int, clock: Clock | None = None, *, shared: bool = True) -> EmissionPlan:
        """Emission lattices for ``photons`` photons a shutter; made once for the whole animation.

        Args:
            shared: Whether the wavelengths of light that is dispersed share these photons; else each has as many.
        """
        if shared and self.loader.dispersive:
            photons = max(1, photons // len(WAVELENGTHS))
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
        options = {"square": self._square, "splits": self.splits, "stills": self.loader.stills_once()}
        plan = plan_emission(self.source, photons, self.normalization, **options)
        return replace(plan, gains=self._split.gains) if self._split.gains else plan
