"""Camera paths at all times of one shutter: what a camera sees with the scene as it stands then."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.scene.description import DomeAtShutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.normalization import Normalization
from tpdwarp.settings import Settings
from tpdwarp.view.area_lights import AreaLightArrays, area_light_arrays
from tpdwarp.view.camera import Camera, camera_of, pixel_size
from tpdwarp.view.domes import DomeArrays, dome_arrays
from tpdwarp.view.lights import LightArrays, light_arrays
from tpdwarp.view.sampling import time_count
from tpdwarp.view.visibility import PathFlag, VisiblePoints, visible_points


class ShutterView:
    """What a camera sees over one shutter.

    Args:
        scenes: The scene over each segment of the shutter.
        settings: Samples, their seed, and channels.
        normalization: The tracer's units.
        launcher: The device.
        width, height: Pixels.
        clock: Where the time goes.

    Attributes:
        times: How many times of the shutter are looked at; one where nothing moves.
        pixel: What a query stands for.
    """

    def __init__(
        self,
        scenes: list[LoadedScene],
        settings: Settings,
        normalization: Normalization,
        launcher: Launcher,
        width: int,
        height: int,
        clock: Clock,
    ) -> None:
        self._scenes, self._settings, self._size, self._clock = scenes, settings, (width, height), clock
        self._normalization, self._launcher = normalization, launcher
        self._domes: tuple[tuple[DomeAtShutter, ...], DomeArrays] | None = None
        self._shot: tuple[LoadedScene, tuple[Camera, LightArrays, AreaLightArrays]] | None = None
        self._moves = any(s.requirements.view_motion for s in scenes)
        self._smooth = any(s.requirements.smooth_receivers for s in scenes)
        self.times = time_count(settings.samples) if any(s.moves for s in scenes) else 1
        middle = scenes[len(scenes) // 2].scene.camera
        self.pixel = pixel_size(camera_of(middle, width, height, normalization), settings.samples)

    def room_for(self, items: np.ndarray) -> VisiblePoints:
        """Rows for the first paths of ``items``."""
        return VisiblePoints.empty(items, self._smooth, self._settings.aovs, True, self._launcher)

    def at(
        self, number: int, films: wp.array, items: np.ndarray, seen: VisiblePoints, rays: int = 1
    ) -> Iterator[VisiblePoints]:
        """Follows the paths of ``items`` at time slice ``number``: first ones go to ``seen``, later ones come back.

        Args:
            films: Film positions, vec2: those of a pixel follow each other.
            rays: How many of them stand for each sample.
        """
        count = len(self._scenes)
        time = (number + 0.5) / self.times * count
        segment = min(int(time), count - 1)
        loaded = self._scenes[segment]
        with self._clock.stage("view"):
            camera, *lights = self._camera_and_lights(loaded)
            surfaces = loaded.geometry.at(time - segment - 0.5, self._launcher)
        passes = visible_points(
            surfaces, *lights, camera, films, items, replace(loaded.requirements, smooth_receivers=self._smooth),
            self._launcher,
            moves=self._moves, into=seen, segments=count,
            scales_radiance=self._settings.refracted_radiance == "scaled",
            textures=loaded.textures, domes=self._domes_of(loaded), samples=self._settings.samples, rays=rays,
            aovs=self._settings.aovs,
            smallest_throughput=self._settings.view_cutoff,
        )  # fmt: skip
        while True:
            with self._clock.stage("view"):
                points = next(passes, None)
            if points is None:
                return
            yield points

    def told_apart(
        self, points: VisiblePoints, place: np.ndarray, disturbed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Which paths end on something diffuse whose view stands still, and on what moves; shape [n] each.

        Args:
            place: Place of each path's pixel in ``disturbed``.
            disturbed: Is set for pixels where anything that moves was met.
        """
        still = points.queries.receiver.numpy() >= 0
        moving = np.zeros_like(still)
        if self._moves:
            moving = still & points.queries.motion.numpy().any(axis=1)
            still = still & ~moving
            disturbed[place[(points.arrays.flags.numpy() & PathFlag.MET_MOTION) != 0]] = True
        return still, moving

    def windows(self, slices: np.ndarray) -> tuple[np.ndarray, float]:
        """When in the shutter time ``slices`` [n] look, and the middle of the part that each stands for; its length."""
        samples = self._settings.samples if self.times > 1 else 1
        strata = slices * samples // self.times
        return np.column_stack([(slices + 0.5) / self.times - 0.5, (strata + 0.5) / samples - 0.5]), 1.0 / samples

    def middles(self, slices: np.ndarray) -> np.ndarray:
        """Of time ``slices`` [n], where the part of the shutter that each stands for has its middle, in slices too."""
        stride = self.times // self._settings.samples if self.times > 1 else 1
        return slices // stride * stride + 0.5 * (stride - 1)

    def sides(self, places: np.ndarray) -> np.ndarray:
        """How wide what a query stands for is at some places, across the view, shape [n]; in the tracer's units."""
        size = self.pixel
        side = float(np.linalg.norm(size.right))
        if size.orthographic:
            return np.full(len(places), side)
        return side * np.abs((places - np.array(size.eye)) @ np.array(size.back))

    def _domes_of(self, loaded: LoadedScene) -> DomeArrays | None:
        """The domes of a scene, made anew only where they are others than the last."""
        domes = loaded.scene.domes
        if not domes:
            return None
        if self._domes is None or self._domes[0] != domes:
            self._domes = domes, dome_arrays(domes, self._normalization, self._launcher)
        return self._domes[1]

    def _camera_and_lights(self, loaded: LoadedScene) -> tuple[Camera, LightArrays, AreaLightArrays]:
        """Those of a scene, made anew only where it is another than the last."""
        if self._shot is None or self._shot[0] is not loaded:
            paths = loaded.geometry.paths if loaded.requirements.linked else ()
            lights = loaded.scene.lights, self._normalization, self._launcher, paths
            camera = camera_of(loaded.scene.camera, *self._size, self._normalization, self._launcher)
            self._shot = loaded, (camera, light_arrays(*lights), area_light_arrays(*lights))
        return self._shot[1]
