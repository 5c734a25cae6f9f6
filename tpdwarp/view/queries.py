"""Query batches: what camera samples see, sorted for the gather: still queries together, moving ones by time.

A still point that something moves in front of is seen for part of the shutter, and light there may change meanwhile. So
in pixels where anything moving is met each sample looks at its own part of the shutter, wherever its path ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays, has_shading_normals
from tpdwarp.scene.description import DomeAtShutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.normalization import Normalization
from tpdwarp.settings import Settings
from tpdwarp.view.camera import Camera, camera_of, in_pixels, pixel_size
from tpdwarp.view.domes import DomeArrays, dome_arrays
from tpdwarp.view.lights import LightArrays, light_arrays
from tpdwarp.view.merging import Columns, merged
from tpdwarp.view.sampling import block_order, film_positions, part_count, parts_of, samples_at, time_count
from tpdwarp.view.visibility import PathFlag, VisiblePoints, visible_points

# Samples that are looked at together, which limits memory: their arrays take some 200 MB.
BATCH_SAMPLES = 1 << 20


# What is counted of camera paths.
COUNTED = {
    "views slowed down": PathFlag.TOO_FAST,
    "views of no finite motion": PathFlag.NOT_FINITE,
    "view branches below cutoff": PathFlag.CULLED,
}


@dataclass
class QueryBatch:
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


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """What one pass of camera paths saw: direct light and first surfaces, for the film.

    Attributes:
        points: The paths.
        pixels: Pixel of each, shape [n].
    """

    points: VisiblePoints
    pixels: np.ndarray

    def counts(self) -> dict[str, int]:
        """How many paths were not seen as they are, by what is wrong with them."""
        flags = self.points.arrays.flags.numpy()
        numbers = {name: int(np.count_nonzero(flags & flag)) for name, flag in COUNTED.items()}
        return {name: number for name, number in numbers.items() if number}


@dataclass
class _Rows:
    """Visible points as host arrays, collected pass by pass."""

    moving: bool
    columns: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(
        self, points: VisiblePoints, chosen: np.ndarray, pixels: np.ndarray, spots: np.ndarray, number: int
    ) -> None:
        values = {
            "position": points.queries.position.numpy()[chosen],
            "normal": points.queries.normal.numpy()[chosen],
            "receiver": points.queries.receiver.numpy()[chosen],
            "weight": points.arrays.weight.numpy()[chosen],
            "pixel": pixels[chosen],
            "spot": spots[chosen],
            "first": np.full(len(chosen), int(points.first)),
            "slice": np.full(len(chosen), number),
        }
        if has_shading_normals(points.queries):
            values["shading_normal"] = points.queries.shading_normal.numpy()[chosen]
        if self.moving:
            values["motion"] = points.queries.motion.numpy()[chosen]
        for name, rows in values.items():
            self.columns.setdefault(name, []).append(rows)

    def joined(self) -> Columns:
        """All rows of each column."""
        return {name: np.concatenate(parts) for name, parts in self.columns.items()}


class CameraView:
    """The camera samples of one shutter.

    Args:
        scenes: The scene over each segment of the shutter.
        settings: Samples and seed.
        normalization: The tracer's units.
        launcher: The device.
        width, height: Pixels.
        clock: Where the time goes.
        pixels: The pixels looked at, those close together in the image close together; None for all.
        numbers: By what number each of them is called in what is seen; None for its place in ``pixels``.
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
        pixels: np.ndarray | None = None,
        numbers: np.ndarray | None = None,
    ) -> None:
        self._scenes, self._settings, self._size, self._clock = scenes, settings, (width, height), clock
        self._normalization, self._launcher = normalization, launcher
        self._domes: tuple[tuple[DomeAtShutter, ...], DomeArrays] | None = None
        self._moves = any(s.requirements.view_motion for s in scenes)
        self._times = time_count(settings.samples) if any(s.moves for s in scenes) else 1
        self._pixels = block_order(width, height) if pixels is None else pixels
        self._numbers = self._pixels if pixels is None else np.arange(len(pixels)) if numbers is None else numbers
        middle = scenes[len(scenes) // 2].scene.camera
        self._pixel = pixel_size(camera_of(middle, width, height, normalization), settings.samples)
        # Photon mapping does not average over pixels.
        self._merges = settings.samples > 1 and settings.estimator != "tdpm"

    def look(self) -> Iterator[SeenPoints | QueryBatch]:
        """Follows all camera paths: what each pass saw, and the queries that come of it, as they are complete."""
        pixel_count = max(1, BATCH_SAMPLES // self._settings.samples)
        for first in range(0, len(self._pixels), pixel_count):
            batch = slice(first, first + pixel_count)
            yield from self._look_at(self._pixels[batch], self._numbers[batch])

    def _look_at(self, pixels: np.ndarray, numbers: np.ndarray) -> Iterator[SeenPoints | QueryBatch]:
        """Some pixels, at all times of the shutter."""
        samples, seed = self._settings.samples, self._settings.seed
        still = _Rows(moving=False)
        disturbed = np.zeros(len(pixels), bool)
        for number in range(self._times):
            places, chosen = samples_at(number, self._times, pixels, samples, seed)
            films = film_positions(pixels[places], chosen, self._size[0], samples, seed)
            spots = self._spots(films, pixels[places], places, chosen)
            for points in self._visible(number, films):
                there = places[points.items]
                seen = numbers[there]
                yield SeenPoints(points, seen)
                with self._clock.stage("view"):
                    diffuse = points.queries.receiver.numpy() >= 0
                    moving = np.zeros_like(diffuse)
                    if self._moves:
                        moving = diffuse & points.queries.motion.numpy().any(axis=1)
                        disturbed[there[(points.arrays.flags.numpy() & PathFlag.MET_MOTION) != 0]] = True
                    still.add(points, np.flatnonzero(diffuse & ~moving), seen, spots[points.items], number)
                    moving_rows = np.flatnonzero(moving)
                if len(moving_rows):
                    rows = _Rows(moving=True)
                    rows.add(points, moving_rows, seen, spots[points.items], number)
                    yield self._batch(rows.joined(), True, number)
        if still.columns:
            yield from self._still_batches(still.joined(), disturbed)

    def _still_batches(self, rows: Columns, disturbed: np.ndarray) -> Iterator[QueryBatch]:
        """Still points in one batch over the whole shutter, but those of ``disturbed`` pixels [n] slice by slice."""
        count = self._settings.samples
        place = rows["spot"] // (part_count(count) ** 2 if self._merges else count)
        apart = disturbed[place]
        if not apart.all():
            yield self._batch({name: values[~apart] for name, values in rows.items()}, False)
        for number in np.unique(rows["slice"][apart]):
            chosen = np.flatnonzero(apart & (rows["slice"] == number))
            yield self._batch({name: values[chosen] for name, values in rows.items()}, False, int(number))

    def _time(self, number: int) -> tuple[float, tuple[float, float]]:
        """When in the shutter a slice looks, and middle and length of the part that its samples stand for."""
        samples = self._settings.samples if self._times > 1 else 1
        stratum = number * samples // self._times
        return (number + 0.5) / self._times - 0.5, ((stratum + 0.5) / samples - 0.5, 1.0 / samples)

    def _spots(self, films: np.ndarray, pixels: np.ndarray, places: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """What is looked up together, in the order of pixels: parts of them, or each of their samples; shape [n]."""
        count = self._settings.samples
        if not self._merges:
            return places * count + samples
        parts = part_count(count)
        return places * parts**2 + parts_of(films, pixels, self._size[0], parts)

    def _visible(self, number: int, films: np.ndarray) -> Iterator[VisiblePoints]:
        count = len(self._scenes)
        time = (number + 0.5) / self._times * count
        segment = min(int(time), count - 1)
        loaded = self._scenes[segment]
        with self._clock.stage("view"):
            camera, lights = self._camera_and_lights(loaded)
            surfaces = loaded.geometry.at(time - segment - 0.5, self._launcher)
        passes = visible_points(
            surfaces, lights, camera, films, loaded.requirements, self._launcher,
            moves=self._moves, segments=count, scales_radiance=self._settings.refracted_radiance == "scaled",
            textures=loaded.textures, domes=self._domes_of(loaded), samples=self._settings.samples,
            aovs=self._settings.aovs,
            smallest_throughput=self._settings.view_cutoff,
        )
        while True:
            with self._clock.stage("view"):
                points = next(passes, None)
            if points is None:
                return
            yield points

    def _domes_of(self, loaded: LoadedScene) -> DomeArrays | None:
        """The domes of a scene, made anew only where they are others than the last."""
        domes = loaded.scene.domes
        if not domes:
            return None
        if self._domes is None or self._domes[0] != domes:
            self._domes = domes, dome_arrays(domes, self._normalization, self._launcher)
        return self._domes[1]

    def _camera_and_lights(self, loaded: LoadedScene) -> tuple[Camera, LightArrays]:
        return (
            camera_of(loaded.scene.camera, *self._size, self._normalization),
            light_arrays(loaded.scene.lights, self._normalization, self._launcher),
        )

    def _batch(self, columns: Columns, moves: bool, number: int | None = None) -> QueryBatch:
        """The queries of ``columns``, all of them of slice ``number``; without, they stand for the whole shutter."""
        time, window = (0.0, (0.0, 1.0)) if number is None else self._time(number)
        with self._clock.stage("view"):
            if number is None and self._merges:
                columns = merged(columns, partial(in_pixels, self._pixel))
            elif number is None and self._times > 1:
                # What lies together in the image is gathered together, whenever it was seen.
                by_place = np.argsort(columns["spot"], kind="stable")
                columns = {name: values[by_place] for name, values in columns.items()}
            launcher = self._launcher
            queries = QueryArrays()
            for name in ("position", "normal"):
                setattr(queries, name, launcher.array(columns[name], wp.vec3))
            for name in ("motion", "shading_normal"):
                given = columns.get(name)
                array = launcher.zeros(0, wp.vec3) if given is None else launcher.array(given, wp.vec3)
                setattr(queries, name, array)
            queries.receiver = launcher.array(columns["receiver"], wp.int32)
        return QueryBatch(queries, columns["pixel"], columns["weight"], columns["first"], time, window, moves)
