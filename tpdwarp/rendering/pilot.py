"""Light from photons at a few pixels of a few frames, for many numbers of photons: what does not change is kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.estimators.base import Animation, Clock, LoadedScene
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.rendering.frame import expose_film
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.film import Film
from tpdwarp.view.queries import Sight, View
from tpdwarp.view.sampling import pixel_grid

PILOT_PIXELS = 4096
# Scenes are kept up to so many triangles together.
KEPT_TRIANGLES = 1 << 21


class Pilot:
    """Pictures of some pixels of some frames.

    Args:
        source: The scene.
        settings: How it is rendered, but for photons and segments.
        shutters: Of the frames.
        width, height: Pixels of the frames; about ``PILOT_PIXELS`` of them are looked at.
    """

    def __init__(
        self, source: SceneSource, settings: Settings, shutters: Sequence[Shutter], width: int, height: int
    ) -> None:
        self._settings = replace(settings, target_error=None, aovs=("caustic",))
        self._shutters, self._size = shutters, (width, height)
        self._pixels = pixel_grid(width, height, PILOT_PIXELS, settings.seed)
        self._animation = _KeepingAnimation(source, self._settings)
        self._seen: dict[tuple[Shutter, int], _Seen] = {}

    def __call__(self, photons: int, segments: int) -> np.ndarray:
        """Light from ``photons`` photons in each of ``segments`` segments, shape [frames, n, 3]."""
        tried = replace(self._settings, photons=photons * segments, segments=segments)
        animation = self._animation.with_settings(tried)
        return np.stack([self._light(animation, shutter) for shutter in self._shutters])

    def _light(self, animation: Animation, shutter: Shutter) -> np.ndarray:
        settings, clock = animation.settings, Clock()
        scenes = animation.load_segments(shutter, clock)
        key = shutter, settings.segments
        if key not in self._seen:
            self._seen[key] = self._look(animation, scenes, clock)
        seen = self._seen[key]
        film = Film(len(self._pixels), 1, settings.samples, animation.normalization, seen.scale, settings.aovs)
        expose_film(film, animation, shutter, scenes, lambda _: seen.sights, seen.pixel, clock)
        channels = film.channels()
        return np.stack([channels[f"caustic.{c}"][0] for c in "RGB"], axis=1).astype(np.float64)

    def _look(self, animation: Animation, scenes: list[LoadedScene], clock: Clock) -> _Seen:
        middle = scenes[len(scenes) // 2].scene.camera
        view = View(animation, scenes, *self._size, clock, False, self._pixels)
        return _Seen(list(view.sights(None)), view.pixel, middle.exposure_scale)


@dataclass(frozen=True)
class _Seen:
    """What the camera sees over one shutter, what its sights stand for, and its exposure's factor on radiance."""

    sights: list[Sight]
    pixel: PixelSize
    scale: float


class _KeepingAnimation(Animation):
    """An animation that keeps the scenes that it loaded last."""

    def __init__(self, source: SceneSource, settings: Settings) -> None:
        super().__init__(source, settings)
        self._kept: OrderedDict[Shutter, LoadedScene] = OrderedDict()

    def load(self, shutter: Shutter, clock: Clock | None = None) -> LoadedScene:
        if shutter not in self._kept:
            self._kept[shutter] = super().load(shutter, clock)
        self._kept.move_to_end(shutter)
        loaded = self._kept[shutter]
        while sum(map(_triangle_count, self._kept.values())) > KEPT_TRIANGLES:
            self._kept.popitem(last=False)
        return loaded


def _triangle_count(loaded: LoadedScene) -> int:
    return sum(len(mesh.triangles) for mesh in loaded.scene.meshes)
