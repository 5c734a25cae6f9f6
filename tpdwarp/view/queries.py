"""What a frame's camera samples see, sorted for the gather: queries that stand still together, moving ones by time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from tpdwarp.estimators.base import Animation, Clock, LoadedScene
from tpdwarp.footprints.gather import QueryArrays
from tpdwarp.view.camera import Camera, camera_of, pixel_size, sides_at
from tpdwarp.view.film import Film
from tpdwarp.view.merging import merged
from tpdwarp.view.sampling import block_order, film_positions, part_count, parts_of, samples_at, time_count
from tpdwarp.view.visibility import LightArrays, VisiblePoints, light_arrays, visible_points

# Samples that are looked at, and gathered, together.
BATCH = 1 << 20
KEPT_SAMPLES = 1 << 22


@dataclass
class Sight:
    """Visible points on diffuse surfaces that are gathered together.

    Attributes:
        queries: Where they are.
        pixels: Pixel of each, shape [n]: its place in the image, or in the list of pixels looked at.
        weights: Irradiance times this is radiance at the camera, shape [n, 3].
        first: Samples whose first path ends there, shape [n]; none where a later one does.
        time: When in the shutter (−½ … ½) they stand there.
        window: Middle and length of the part of the shutter they stand for.
        moves: Whether they move.
    """

    queries: QueryArrays
    pixels: np.ndarray
    weights: np.ndarray
    first: np.ndarray
    time: float = 0.0
    window: tuple[float, float] = (0.0, 1.0)
    moves: bool = False


@dataclass
class _Rows:
    """Visible points as host arrays, piled up batch by batch."""

    moving: bool
    columns: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, points: VisiblePoints, chosen: np.ndarray, pixels: np.ndarray, spots: np.ndarray) -> None:
        values = {
            "position": points.queries.position.numpy()[chosen],
            "normal": points.queries.normal.numpy()[chosen],
            "receiver": points.queries.receiver.numpy()[chosen],
            "weight": points.arrays.weight.numpy()[chosen],
            "pixel": pixels[chosen],
            "spot": spots[chosen],
            "first": np.full(len(chosen), int(points.first)),
        }
        if self.moving:
            values["motion"] = points.queries.motion.numpy()[chosen]
        for name, rows in values.items():
            self.columns.setdefault(name, []).append(rows)


class View:
    """The camera samples of one frame.

    Args:
        animation: Settings, device and units.
        scenes: The scene over each segment of the shutter.
        width, height: Pixels.
        clock: Where the time goes.
        keep: Whether sights are kept for the next time they are asked for (where there is room).
        pixels: The pixels looked at, those close together in the image close together; None for all.

    Attributes:
        pixel: What its queries stand for.
    """

    def __init__(
        self,
        animation: Animation,
        scenes: list[LoadedScene],
        width: int,
        height: int,
        clock: Clock,
        keep: bool,
        pixels: np.ndarray | None = None,
    ) -> None:
        self._animation, self._scenes, self._size, self._clock = animation, scenes, (width, height), clock
        settings = animation.settings
        self._moves = any(s.requirements.view_motion for s in scenes)
        self._times = time_count(settings.samples) if any(s.moves for s in scenes) else 1
        self._pixels = block_order(width, height) if pixels is None else pixels
        self._numbers = self._pixels if pixels is None else np.arange(len(pixels))
        middle = scenes[len(scenes) // 2].scene.camera
        self.pixel = pixel_size(camera_of(middle, width, height, animation.normalization), settings.samples)
        # Photon mapping does not average over pixels.
        self._merges = settings.samples > 1 and settings.estimator != "tdpm"
        self._keep = keep and len(self._pixels) * settings.samples <= KEPT_SAMPLES
        self._kept: list[Sight] = []

    def sights(self, film: Film | None) -> Iterator[Sight]:
        """All visible points; what they show by direct light is added to ``film``."""
        if self._kept:
            yield from self._kept
            return
        for sight in self._look(film):
            if self._keep:
                self._kept.append(sight)
            yield sight

    def _look(self, film: Film | None) -> Iterator[Sight]:
        pixel_count = max(1, BATCH // self._animation.settings.samples)
        for first in range(0, len(self._pixels), pixel_count):
            batch = slice(first, first + pixel_count)
            yield from self._look_at(self._pixels[batch], self._numbers[batch], film)

    def _look_at(self, pixels: np.ndarray, numbers: np.ndarray, film: Film | None) -> Iterator[Sight]:
        """Sights of some pixels, at all times of the shutter."""
        samples = self._animation.settings.samples
        still = _Rows(moving=False)
        for number in range(self._times):
            where, window = self._time(number)
            places, chosen = samples_at(number, self._times, pixels, samples, self._animation.settings.seed)
            films = film_positions(pixels[places], chosen, self._size[0], samples, self._animation.settings.seed)
            spots = self._spots(films, pixels[places], places, chosen)
            for points in self._visible(number, films):
                seen = numbers[places][points.items]
                with self._clock.stage("view"):
                    if film is not None:
                        film.add_view(points, seen)
                    receiver = points.queries.receiver.numpy()
                    diffuse = receiver >= 0
                    moving = np.zeros_like(diffuse)
                    if self._moves:
                        moving = diffuse & points.queries.motion.numpy().any(axis=1)
                    still.add(points, np.flatnonzero(diffuse & ~moving), seen, spots[points.items])
                    racing = np.flatnonzero(moving)
                if len(racing):
                    rows = _Rows(moving=True)
                    rows.add(points, racing, seen, spots[points.items])
                    yield self._sight(rows, where, window)
        if still.columns:
            yield self._sight(still, 0.0, (0.0, 1.0))

    def _time(self, number: int) -> tuple[float, tuple[float, float]]:
        """When in the shutter a slice looks, and middle and length of the part that its samples stand for."""
        samples = self._animation.settings.samples if self._times > 1 else 1
        stratum = number * samples // self._times
        return (number + 0.5) / self._times - 0.5, ((stratum + 0.5) / samples - 0.5, 1.0 / samples)

    def _spots(self, films: np.ndarray, pixels: np.ndarray, places: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """What is looked up together, in the order of pixels: parts of them, or each of their samples; shape [n]."""
        count = self._animation.settings.samples
        if not self._merges:
            return places * count + samples
        parts = part_count(count)
        return places * parts**2 + parts_of(films, pixels, self._size[0], parts)

    def _visible(self, number: int, films: np.ndarray) -> Iterator[VisiblePoints]:
        launcher = self._animation.launcher
        count = len(self._scenes)
        where = (number + 0.5) / self._times * count
        segment = min(int(where), count - 1)
        loaded = self._scenes[segment]
        with self._clock.stage("view"):
            camera, lights = self._equipment(loaded)
            surfaces = loaded.geometry.at(where - segment - 0.5, launcher)
        passes = visible_points(
            surfaces, lights, camera, films, loaded.requirements, launcher, moves=self._moves, segments=count
        )
        while True:
            with self._clock.stage("view"):
                points = next(passes, None)
            if points is None:
                return
            yield points

    def _equipment(self, loaded: LoadedScene) -> tuple[Camera, LightArrays]:
        norm = self._animation.normalization
        return (
            camera_of(loaded.scene.camera, *self._size, norm),
            light_arrays(loaded.scene.lights, norm, self._animation.launcher),
        )

    def _sight(self, rows: _Rows, time: float, window: tuple[float, float]) -> Sight:
        with self._clock.stage("view"):
            columns = {name: np.concatenate(parts) for name, parts in rows.columns.items()}
            if not rows.moving and self._merges:
                columns = merged(columns, lambda positions: sides_at(self.pixel, positions))
            elif not rows.moving and self._times > 1:
                # What lies together in the image is gathered together, whenever it was seen.
                by_place = np.argsort(columns["spot"], kind="stable")
                columns = {name: values[by_place] for name, values in columns.items()}
            launcher = self._animation.launcher
            queries = QueryArrays()
            for name in ("position", "normal"):
                setattr(queries, name, launcher.array(columns[name], wp.vec3))
            queries.motion = launcher.array(columns["motion"], wp.vec3) if rows.moving else launcher.zeros(0, wp.vec3)
            queries.receiver = launcher.array(columns["receiver"], wp.int32)
        return Sight(queries, columns["pixel"], columns["weight"], columns["first"], time, window, rows.moving)
