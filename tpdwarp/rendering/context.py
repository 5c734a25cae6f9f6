"""What stays the same from frame to frame: device, units, emission lattices, segments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from functools import partial
from typing import Protocol

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.estimators import estimator_of
from tpdwarp.estimators.estimator import Part
from tpdwarp.estimators.seen_light import Known, SeenLight
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.rendering.camera_sight import CameraSight
from tpdwarp.rendering.light_groups import LightGroups
from tpdwarp.rendering.shared_trace import SharedTrace
from tpdwarp.scene.description import CameraAtShutter, MeshAtShutter, SceneSource, Shutter
from tpdwarp.scene.device.loading import LoadedScene, SceneLoader
from tpdwarp.settings import Settings
from tpdwarp.trajectories.light_splits import choose_splits
from tpdwarp.trajectories.segments import Segmentation, as_few_as_move


class ViewSource(Protocol):
    """Where a camera comes from."""

    def camera_over(self, shutter: Shutter, meshes: Sequence[MeshAtShutter] = ()) -> CameraAtShutter:
        """The camera over ``shutter``, which sees ``meshes``."""
        ...


class RenderContext:
    """One animation with the settings that it is rendered with; whoever renders several frames keeps one.

    Args:
        source: Where scenes come from.
        settings: How to render.
        loader: Loads the scenes; None makes one for the device that the settings name.

    Raises:
        InputError: The device does not exist, or none of the source's reference scenes can be used.
    """

    def __init__(self, source: SceneSource, settings: Settings, loader: SceneLoader | None = None) -> None:
        self.source, self.settings = source, settings
        self.loader = loader or SceneLoader(source, Launcher(settings.device, settings.threads), settings.bounces)
        self.launcher, self.normalization = self.loader.launcher, self.loader.normalization
        self.tracer = PhotonTracer(self.loader, settings, choose_splits)
        self.segmentation = Segmentation(self.tracer)
        self.light_groups = LightGroups.of(settings.light_groups, source)
        self._view_source: ViewSource | None = None
        self._shared: SharedTrace | None = None
        # Of the last size of images; what is known lasts for other settings, too.
        self._seen: dict[tuple[int, int], SeenLight] = {}
        self._known: dict[tuple[int, int], Known] = {}

    def seen_by(self, source: ViewSource, settings: Settings, shared: SharedTrace) -> RenderContext:
        """The same animation through another camera, whose views take scenes and photons from ``shared``.

        Args:
            source: Where the camera comes from.
            settings: How to render; what photons depend on is as before (:func:`.shared_trace.may_share`).
        """
        other = copy(self)
        other.settings, other._view_source, other._shared = settings, source, shared
        other._seen, other._known = {}, {}
        return other

    def scenes(self, shutter: Shutter, clock: Clock) -> list[LoadedScene]:
        """The scenes of the segments of ``shutter``; one where nothing moves.

        Raises:
            InputError: The scene, or the camera, cannot be used there.
        """
        if self._shared is None or self._view_source is None:
            return self.segmentation.load(shutter, clock)
        found = self._shared.scenes(shutter, lambda: self.segmentation.load_each(shutter, clock))
        return as_few_as_move([_through_camera(self.loader, self._view_source, loaded) for loaded in found])

    def parts(
        self, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize, clock: Clock, size: tuple[int, int]
    ) -> Iterator[tuple[Part, PixelSize | None]]:
        """The parts of the exposure that the estimator gives, for the ``scenes`` of its segments.

        Args:
            size: Of the image, in pixels. Where photons go by what it shows, it has its own.

        Yields:
            Each part, and the size of pixel that its light is still to be shaped for; None where it has been.
        """
        seen_light = self._seen_light(size)
        alone = self._shared is None or seen_light.tells_apart(scenes, clock)
        estimator = estimator_of(self.settings, seen_light if alone else None)
        traced = partial(estimator.parts, self.tracer, shutter, scenes, pixel, clock)
        if alone:
            # Nothing here holds on to a part while the next is traced.
            yield from map(lambda part: (part, None), traced())
            return
        for part, of_others in self._shared.parts(scenes, traced):
            yield part, pixel if of_others else None

    def _seen_light(self, size: tuple[int, int]) -> SeenLight:
        """What the camera sees of the light in an image of that size."""
        if size not in self._seen:
            sight_of = partial(CameraSight, self.settings, self.loader, size)
            load, known = partial(_loaded, self.loader, self._view_source), self._known.setdefault(size, {})
            self._seen = {size: SeenLight(self.tracer, load, sight_of, known)}
        return self._seen[size]

    def with_settings(self, settings: Settings) -> RenderContext:
        """The same animation with other photons, segments or AOVs; stills are not read again."""
        other = copy(self)
        other.settings = settings
        other.tracer, other._seen = self.tracer.with_settings(settings), {}
        other.segmentation = Segmentation(other.tracer)
        other.light_groups = LightGroups.of(settings.light_groups, self.source)
        return other


# What a context holds must not hold the context: in a circle, stages would stay open after their renders.
def _loaded(loader: SceneLoader, views: ViewSource | None, shutter: Shutter, clock: Clock) -> LoadedScene:
    """The scene over ``shutter``, through the camera of ``views`` where there are any."""
    loaded = loader.load(shutter, clock)
    return loaded if views is None else _through_camera(loader, views, loaded)


def _through_camera(loader: SceneLoader, views: ViewSource, loaded: LoadedScene) -> LoadedScene:
    """A loaded scene as another camera sees it."""
    return loader.seen_by(loaded, views.camera_over(loaded.scene.shutter, loaded.scene.meshes))
