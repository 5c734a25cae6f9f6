"""What all estimators of caustic irradiance share: the context of a frame, and the parts they hand to the film."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass, field
from typing import Any, Protocol

from tpdwarp.device import Launcher
from tpdwarp.errors import InputError
from tpdwarp.footprints.gather import GatherForm, Irradiance, QueryArrays, gather
from tpdwarp.footprints.shaping import FootprintMap, PixelSize
from tpdwarp.photons.emission import EmissionPlan, plan_emission
from tpdwarp.photons.record import EnergyAccount
from tpdwarp.photons.tracing import PhotonMap, trace_photons
from tpdwarp.scene.coordinate_range import require_reach
from tpdwarp.scene.description import SceneAtShutter, SceneSource, Shutter, reference_scenes
from tpdwarp.scene.device.geometry import Geometry, geometry_of
from tpdwarp.scene.normalization import Normalization
from tpdwarp.scene.opening import scene_at_opening
from tpdwarp.scene.requirements import Requirements, requirements_of
from tpdwarp.settings import Settings
from tpdwarp.trajectories.segments import Level, levels


@dataclass
class Clock:
    """Seconds by stage of the work: wall time, and CPU time of all threads together."""

    seconds: dict[str, float] = field(default_factory=dict)
    cpu_seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start, cpu_start = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
            self.cpu_seconds[name] = self.cpu_seconds.get(name, 0.0) + time.process_time() - cpu_start


@dataclass
class LoadedScene:
    """One (sub-)shutter of the scene: its description, its device arrays, and what it requires."""

    scene: SceneAtShutter
    geometry: Geometry
    requirements: Requirements

    @property
    def moves(self) -> bool:
        """Whether photons or the view move over the shutter."""
        return self.requirements.photon_motion or self.requirements.view_motion


class Animation:
    """A scene source with what stays the same from frame to frame: units, emission lattices, device.

    Args:
        source: Where scenes come from.
        settings: How to render.
    """

    def __init__(self, source: SceneSource, settings: Settings) -> None:
        self.source, self.settings = source, settings
        self.launcher = Launcher(settings.device, settings.threads)
        self.normalization = _normalization(reference_scenes(source), source.file)
        self._plans: dict[int, EmissionPlan] = {}
        self._levels: dict[tuple[float, float], tuple[Level, ...]] = {}

    def with_settings(self, settings: Settings) -> Animation:
        """The same animation with other photons, segments or AOVs; stills are not read again."""
        other = copy(self)
        other.settings = settings
        return other

    def load(self, shutter: Shutter, clock: Clock | None = None) -> LoadedScene:
        """The scene over ``shutter``, on the device; what only plans needs no clock of its own."""
        clock = clock or Clock()
        with clock.stage("read"):
            scene = self.source.at(shutter)
        return self._built(scene, clock)

    def load_opening(self, shutter: Shutter, clock: Clock) -> LoadedScene:
        """The scene as it stands when ``shutter`` opens, with its forward difference; without a camera."""
        with clock.stage("read"):
            scene = scene_at_opening(self.source, shutter)
        return self._built(scene, clock)

    def _built(self, scene: SceneAtShutter, clock: Clock) -> LoadedScene:
        with clock.stage("build"):
            require_reach(scene, self.normalization, self.source.file)
            needs = requirements_of(scene)
            with_motions = needs.photon_motion or needs.view_motion
            geometry = geometry_of(scene, self.normalization, self.launcher, with_motions=with_motions)
        return LoadedScene(scene, geometry, needs)

    def load_segments(self, shutter: Shutter, clock: Clock, level: Level | None = None) -> list[LoadedScene]:
        """The scenes of the segments of ``shutter``, of its first level or another; one where nothing moves."""
        level = level or self.levels(shutter, clock)[0]
        scenes = [self.load(part, clock) for part in shutter.segments(level.segments)]
        return scenes if any(scene.moves for scene in scenes) else scenes[:1]

    def levels(self, shutter: Shutter, clock: Clock) -> tuple[Level, ...]:
        """Into how many segments shutters like this one are cut, and for which meshes; that of the most first.

        ``auto`` is decided once for the whole animation.
        """
        if self.settings.segments != "auto":
            return (Level(self.settings.segments),)
        if self.settings.estimator != "tpd":
            return (Level(1),)
        key = (round(shutter.open - shutter.frame, 6), round(shutter.close - shutter.frame, 6))
        if key not in self._levels:
            with clock.stage("plan"):
                self._levels[key] = levels(self, shutter, Clock())
        return self._levels[key]

    def trace(
        self, loaded: LoadedScene, plan: EmissionPlan, clock: Clock, **options: Any
    ) -> tuple[PhotonMap, EnergyAccount]:
        """Photons of ``plan`` through a loaded scene; ``options`` are those of ``trace_photons``."""
        with clock.stage("trace"):
            return trace_photons(
                loaded.scene,
                loaded.geometry,
                plan,
                loaded.requirements,
                self.launcher,
                **{"jittered": self.settings.emission == "jittered", **options},
            )

    def plan(self, photons: int, clock: Clock | None = None) -> EmissionPlan:
        """Emission lattices for ``photons`` photons a shutter; made once for the whole animation."""
        if photons not in self._plans:
            with (clock or Clock()).stage("plan"):
                self._plans[photons] = self._planned(photons)
        return self._plans[photons]

    def _planned(self, photons: int) -> EmissionPlan:
        if self._plans:
            return next(iter(self._plans.values())).with_photons(photons)
        # What knows no footprints gains nothing from long cells, and dice are thrown as the paper throws them.
        square = self.settings.estimator == "tdpm" or self.settings.emission == "jittered"
        return plan_emission(self.source, photons, self.normalization, square=square)


def _normalization(stills: list[SceneAtShutter], file: str) -> Normalization:
    """What suits all ``stills``, but for those in which something has gone astray: they must not make others vanish."""
    shown = [still for still in stills if still.meshes]
    if not shown:
        return Normalization.of(*stills)
    smallest = max((Normalization.of(still) for still in shown), key=lambda found: found.scale)
    usable = []
    for still in shown:
        with suppress(InputError):
            require_reach(still, smallest, file)
            usable.append(still)
    return Normalization.of(*usable)


class IrradianceField(Protocol):
    """Irradiance from photons at any point."""

    def irradiance(
        self,
        queries: QueryArrays,
        *,
        time: float,
        window: tuple[float, float],
        query_moves: bool,
        with_motion: bool,
    ) -> Irradiance:
        """Irradiance at ``queries``; the arguments are those of :func:`tpdwarp.footprints.gather.gather`."""
        ...


@dataclass(frozen=True, eq=False)
class FootprintField:
    """The irradiance that footprints add up to.

    Attributes:
        footprints: The footprints.
        form: How they are evaluated.
        launcher: Where.
    """

    footprints: FootprintMap
    form: GatherForm
    launcher: Launcher

    def irradiance(
        self,
        queries: QueryArrays,
        *,
        time: float,
        window: tuple[float, float],
        query_moves: bool,
        with_motion: bool,
    ) -> Irradiance:
        """Irradiance at ``queries``."""
        return gather(
            self.footprints,
            queries,
            self.form,
            self.launcher,
            time=time,
            window=window,
            query_moves=query_moves,
            with_motion=with_motion,
        )


@dataclass
class Part:
    """Part of a frame's photons; the irradiances of all parts add up.

    Attributes:
        maps: The photons, one map a (sub-)shutter.
        energy: Where their flux went.
        light: The irradiance they make; None where there is none, or where photons are only traced.
        plan: The lattices they come from.
    """

    maps: list[PhotonMap]
    energy: EnergyAccount
    light: IrradianceField | None
    plan: EmissionPlan


class Estimator(Protocol):
    """An estimator of caustic irradiance over one shutter."""

    def parts(
        self, animation: Animation, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        """Traces photons through ``scenes`` and shapes footprints for pixels of the given size.

        There is one scene a segment of the first level. Without ``pixel`` photons are only traced.
        """
        ...
