"""Light from photons at a few pixels of a few frames, for many numbers of photons: what does not change is kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import expose, middle_camera, pixel_of
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.scene.device.loading import LoadedScene, SceneLoader
from tpdwarp.settings import Settings
from tpdwarp.view.film import Film
from tpdwarp.view.queries import CameraView
from tpdwarp.view.query_batches import QueryBatch
from tpdwarp.view.sampling import pixel_grid

# Pixels of a frame that the pilot looks at. Chosen, not derived: the root mean square of so many errors is known to 1 %
# where they are Gaussian.
PILOT_PIXELS = 4096
# Scenes are kept up to so many triangles together, which limits memory to some 2 GB.
KEPT_TRIANGLES = 1 << 21


class Pilot:
    """Pictures of some pixels of some frames.

    Args:
        source: The scene.
        settings: How it is rendered, but for photons, segments and samples.
        shutters: Of the frames.
        width, height: Pixels of the frames; about ``PILOT_PIXELS`` of them are looked at.
    """

    def __init__(
        self, source: SceneSource, settings: Settings, shutters: Sequence[Shutter], width: int, height: int
    ) -> None:
        self._settings = replace(settings, target_error=None, aovs=("caustic",))
        self._shutters, self._size = shutters, (width, height)
        self._pixels = pixel_grid(width, height, PILOT_PIXELS, settings.seed)
        loader = _KeepingLoader(source, Launcher(settings.device, settings.threads), settings.bounces)
        self._context = RenderContext(source, self._settings, loader)
        self._seen: dict[tuple[Shutter, int, int], _Seen] = {}

    @property
    def view_moves(self) -> bool:
        """Whether a camera ray of the pictures seen so far looks at a part of the shutter only, since things move."""
        batches = (batch for seen in self._seen.values() for batch in seen.batches)
        return any(batch.moves or batch.times is not None or batch.window != (0.0, 1.0) for batch in batches)

    def keep(self, frame: int) -> None:
        """From now on, pictures are of this one of the frames alone."""
        self._shutters = self._shutters[frame : frame + 1]

    def __call__(self, photons: int, segments: int, samples: int | None = None) -> np.ndarray:
        """Light from ``photons`` photons in each of ``segments`` segments, shape [frames, n, 3].

        Args:
            photons: Of each segment.
            segments: Of the shutter.
            samples: Camera samples a pixel; None for those of the settings.
        """
        samples = samples or self._settings.samples
        tried = replace(self._settings, photons=photons * segments, segments=segments, samples=samples)
        context = self._context.with_settings(tried)
        return np.stack([self._light(context, shutter) for shutter in self._shutters])

    def _light(self, context: RenderContext, shutter: Shutter) -> np.ndarray:
        settings, clock = context.settings, Clock()
        scenes = context.segmentation.load(shutter, clock)
        key = shutter, settings.segments, settings.samples
        if key not in self._seen:
            self._seen[key] = self._look(context, scenes, clock)
        seen = self._seen[key]
        film = Film(len(self._pixels), 1, settings.samples, context.normalization, seen.scale, settings.aovs)
        pixel = pixel_of(context, scenes, *self._size)
        for part, _ in context.parts(shutter, scenes, pixel, clock, self._size):
            expose(film, {} if part.light is None else {"": part.light}, seen.batches, part.weight, clock)
        channels = film.channels()
        return np.stack([channels[f"caustic.{c}"][0] for c in "RGB"], axis=1).astype(np.float64)

    def _look(self, context: RenderContext, scenes: list[LoadedScene], clock: Clock) -> _Seen:
        view = CameraView(
            scenes, context.settings, context.normalization, context.launcher, *self._size, clock, self._pixels
        )
        batches = [seen for seen in view.look() if isinstance(seen, QueryBatch)]
        return _Seen(batches, middle_camera(scenes).exposure_scale)


@dataclass(frozen=True)
class _Seen:
    """What the camera sees over one shutter, and its exposure's factor on radiance."""

    batches: list[QueryBatch]
    scale: float


class _KeepingLoader(SceneLoader):
    """A loader that keeps the scenes that it loaded last."""

    def __init__(self, source: SceneSource, launcher: Launcher, bounces: int | None) -> None:
        super().__init__(source, launcher, bounces)
        self._kept: OrderedDict[Shutter, LoadedScene] = OrderedDict()

    def load(
        self,
        shutter: Shutter,
        clock: Clock | None = None,
        instead_of: LoadedScene | None = None,
        beside: LoadedScene | None = None,
    ) -> LoadedScene:
        """The scene over ``shutter``, kept from before where it is; it is in the place of none, for all are kept."""
        if shutter not in self._kept:
            self._kept[shutter] = super().load(shutter, clock, beside=beside)
        self._kept.move_to_end(shutter)
        loaded = self._kept[shutter]
        while sum(map(_triangle_count, self._kept.values())) > KEPT_TRIANGLES:
            self._kept.popitem(last=False)
        return loaded


def _triangle_count(loaded: LoadedScene) -> int:
    return sum(len(mesh.triangles) for mesh in loaded.scene.meshes)
