"""One frame: photons, footprints, what the camera sees, and the film."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tpdwarp.estimators import ESTIMATORS
from tpdwarp.estimators.base import Animation, Clock, LoadedScene
from tpdwarp.photons.record import EnergyAccount, PhotonRecord
from tpdwarp.photons.tracing import record_of
from tpdwarp.scene.description import CameraAtShutter, SceneSource, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.camera import camera_of, pixel_size
from tpdwarp.view.film import Film
from tpdwarp.view.sampling import block_order, film_positions, samples_at, time_count
from tpdwarp.view.visible import VisiblePoints, light_arrays, visible_points

BATCH = 1 << 18
KEPT_SAMPLES = 1 << 22


@dataclass
class Traced:
    """Photons of one shutter.

    Attributes:
        photons: The photons that landed, in scene units.
        energy: Where the flux went [W].
        seconds: Wall time by stage.
    """

    photons: PhotonRecord
    energy: EnergyAccount
    seconds: dict[str, float]


@dataclass
class Frame(Traced):
    """A rendered frame.

    Attributes:
        channels: ``R``, ``G``, ``B``, ``A`` and the AOVs asked for, each [height, width] float32, rows from the top.
        camera: The camera that saw it.
    """

    channels: dict[str, np.ndarray]
    camera: CameraAtShutter


@lru_cache(maxsize=1)
def _animation(source: SceneSource, settings: Settings) -> Animation:
    return Animation(source, settings)


def trace_frame(source: SceneSource, shutter: Shutter, settings: Settings) -> Traced:
    """Traces the photons of one shutter."""
    clock = Clock()
    animation = _animation(source, settings)
    scenes = animation.load_segments(shutter, clock)
    energy = EnergyAccount()
    maps = []
    for part in ESTIMATORS[settings.estimator]().parts(animation, shutter, scenes, None, clock):
        energy.add(part.energy)
        maps += part.maps
        plan = part.plan
    return Traced(record_of(maps, plan, scenes[0].geometry.paths), energy, clock.seconds)


def render_frame(source: SceneSource, shutter: Shutter, settings: Settings, width: int, height: int) -> Frame:
    """Renders one frame of ``width`` × ``height`` pixels.

    Args:
        source: The scene; its ``at`` must supply a camera.
    """
    clock = Clock()
    animation = _animation(source, settings)
    scenes = animation.load_segments(shutter, clock)
    middle = scenes[len(scenes) // 2].scene.camera
    norm = animation.normalization
    pixel = pixel_size(camera_of(middle, width, height, norm))
    film = Film(width, height, settings.samples, norm, middle.exposure_scale)
    with_motion = bool({"motion", "photons"} & set(settings.aovs))
    view = _View(animation, scenes, width, height, clock)
    energy = EnergyAccount()
    maps = []
    estimator = ESTIMATORS[settings.estimator]()
    for number, part in enumerate(estimator.parts(animation, shutter, scenes, pixel, clock)):
        for points, pixels, time, window in view.points():
            with clock.stage("gather"):
                if number == 0:
                    film.add_view(points, pixels)
                if part.light is not None:
                    light = part.light.irradiance(
                        points.queries,
                        time=time,
                        window=window,
                        query_moves=view.moves,
                        with_motion=with_motion,
                    )
                    film.add_caustic(points, pixels, light)
        energy.add(part.energy)
        maps += part.maps
        plan = part.plan
    record = record_of(maps, plan, scenes[0].geometry.paths)
    return Frame(record, energy, clock.seconds, film.channels(settings.aovs), middle)


_Seen = tuple[VisiblePoints, np.ndarray, float, tuple[float, float]]


class _View:
    """Visible points of all camera samples, in batches; kept between parts where there is room."""

    def __init__(
        self, animation: Animation, scenes: list[LoadedScene], width: int, height: int, clock: Clock
    ) -> None:
        self._animation, self._scenes, self._size, self._clock = animation, scenes, (width, height), clock
        self.moves = any(s.requirements.view_motion for s in scenes)
        in_time = self.moves or any(s.requirements.photon_motion for s in scenes)
        self._times = time_count(animation.settings.samples) if in_time else 1
        several = animation.settings.estimator == "accumulation"
        self._keep = several and width * height * animation.settings.samples <= KEPT_SAMPLES
        self._kept: list[_Seen] = []

    def points(self) -> Iterator[_Seen]:
        """Visible points, the pixel of each, when in the shutter (−½ … ½) they were seen, and for which part of it."""
        if self._kept:
            yield from self._kept
            return
        for found in self._trace():
            if self._keep:
                self._kept.append(found)
            yield found

    def _trace(self) -> Iterator[_Seen]:
        settings, launcher, norm = self._animation.settings, self._animation.launcher, self._animation.normalization
        width, height = self._size
        times = self._times
        count = len(self._scenes)
        order = block_order(width, height)
        for slice_index in range(times):
            where = (slice_index + 0.5) / times
            segment = min(int(where * count), count - 1)
            loaded = self._scenes[segment]
            strata = settings.samples if times > 1 else 1
            window = ((slice_index * strata // times + 0.5) / strata - 0.5, 1.0 / strata)
            with self._clock.stage("view"):
                camera = camera_of(loaded.scene.camera, width, height, norm)
                lights = light_arrays(loaded.scene.lights, norm, launcher)
                surfaces = loaded.geometry.at(where * count - segment - 0.5, launcher)
            batches = samples_at(
                slice_index, times, order, settings.samples, settings.seed, max(1, BATCH // settings.samples)
            )
            for pixels, samples in batches:
                films = film_positions(pixels, samples, width, settings.samples, settings.seed)
                passes = visible_points(
                    surfaces,
                    lights,
                    camera,
                    films,
                    loaded.requirements,
                    launcher,
                    moves=self.moves,
                    segments=count,
                )
                while True:
                    with self._clock.stage("view"):
                        points = next(passes, None)
                    if points is None:
                        break
                    yield points, pixels[points.items], where - 0.5, window
