"""Query batches: what camera samples see, sorted for the gather: still queries together, moving ones by time.

A still point that something moves in front of is seen for part of the shutter, and light there may change meanwhile. So
in pixels where anything moving is met each sample looks at its own part of the shutter, wherever its path ends.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays, has_shading_normals, rows_of
from tpdwarp.footprints.morton import morton_codes
from tpdwarp.scene.description import DomeAtShutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.normalization import Normalization
from tpdwarp.settings import Settings
from tpdwarp.view.area_lights import AreaLightArrays, area_light_arrays
from tpdwarp.view.camera import Camera, camera_of, pixel_size
from tpdwarp.view.domes import DomeArrays, dome_arrays
from tpdwarp.view.lights import LightArrays, light_arrays
from tpdwarp.view.merging import merge
from tpdwarp.view.mixed_pixels import mixed_pixels, rays_of_sample
from tpdwarp.view.sampling import block_order, film_positions, part_count, parts_of, samples_by_time, time_count
from tpdwarp.view.visibility import PathFlag, VisiblePoints, visible_points

# Samples that are looked at together, which limits memory: their arrays take some 200 MB.
BATCH_SAMPLES = 1 << 20
# Points that are looked up together at their own times, likewise: cut into pieces of their ways they take some 300 MB.
BATCH_ROWS = 1 << 17
# How far off what it sees a point may be that moves straight on, in sides of what it stands for: farther off a round
# thing footprints no longer count there. Chosen, not derived.
LARGEST_BEND = 0.25


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
        first: Samples whose first path ends there, shape [n], or parts of samples; none where a later one does.
        window: Middle and length of the part of the shutter they stand for.
        times: When in the shutter (−½ … ½) each stands there, and the middle of its own window, shape [n, 2]; None
            where all look over the same one.
        moves: Whether they move.
    """

    queries: QueryArrays
    pixels: np.ndarray
    weights: np.ndarray
    first: np.ndarray
    window: tuple[float, float] = (0.0, 1.0)
    times: np.ndarray | None = None
    moves: bool = False


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """What one pass of camera paths saw: direct light and first surfaces, for the film.

    Attributes:
        points: The paths.
        pixels: Pixel of each, shape [n].
        shares: The part of a sample that each of them stands for, shape [n], or all of them.
    """

    points: VisiblePoints
    pixels: np.ndarray
    shares: np.ndarray | float = 1.0

    def counts(self) -> dict[str, int]:
        """How many paths were not seen as they are, by what is wrong with them."""
        flags = self.points.arrays.flags.numpy()
        numbers = {name: int(np.count_nonzero(flags & flag)) for name, flag in COUNTED.items()}
        return {name: number for name, number in numbers.items() if number}


def _columns_of(queries: QueryArrays, rows: np.ndarray, moves: bool) -> dict[str, np.ndarray]:
    """Where some queries are and what they lie on, on the host, with their motion or not."""
    names = ["position", "normal", "receiver", *(["motion"] if moves else [])]
    if has_shading_normals(queries):
        names.append("shading_normal")
    return {name: getattr(queries, name).numpy()[rows] for name in names}


@dataclass
class _Rows:
    """Visible points as host arrays, collected pass by pass."""

    columns: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(
        self, points: VisiblePoints, chosen: np.ndarray, items: np.ndarray, slices: np.ndarray, moves: bool
    ) -> None:
        """Adds the ``chosen`` rows of a pass, with their motion or not.

        Args:
            items: The sample of each row, shape [n].
            slices: The time slice that each sample looks in.
        """
        if not len(chosen):
            return
        values = _columns_of(points.queries, chosen, moves)
        values["weight"] = points.arrays.weight.numpy()[chosen]
        values["item"] = items[chosen]
        values["slice"] = slices[values["item"]]
        values["first"] = np.full(len(chosen), int(points.first), np.int32)
        for name, rows in values.items():
            self.columns.setdefault(name, []).append(rows)

    def joined(self) -> dict[str, np.ndarray]:
        """All rows of each column, what lies together in the image together, whenever it was seen."""
        joined = {name: np.concatenate(parts) for name, parts in self.columns.items()}
        order = np.argsort(joined["item"], kind="stable") if joined else []
        return {name: values[order] for name, values in joined.items()}


def _chosen(rows: dict[str, np.ndarray], mask: np.ndarray) -> dict[str, np.ndarray]:
    """Some rows of each column."""
    return {name: values[mask] for name, values in rows.items()}


def _of_rays(batch: QueryBatch, share: float) -> QueryBatch:
    """The points of a batch, each of which stands for that part of a sample."""
    weights = (share * batch.weights).astype(np.float32)
    return replace(batch, weights=weights, first=(share * batch.first).astype(np.float32))


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
        self._shot: tuple[LoadedScene, tuple[Camera, LightArrays, AreaLightArrays]] | None = None
        self._moves = any(s.requirements.view_motion for s in scenes)
        self._smooth = any(s.requirements.smooth_receivers for s in scenes)
        self._times = time_count(settings.samples) if any(s.moves for s in scenes) else 1
        self._pixels = block_order(width, height) if pixels is None else pixels
        self._numbers = self._pixels if pixels is None else np.arange(len(pixels)) if numbers is None else numbers
        middle = scenes[len(scenes) // 2].scene.camera
        self._pixel = pixel_size(camera_of(middle, width, height, normalization), settings.samples)
        # Photon mapping does not average over pixels.
        self._merges = settings.samples > 1 and settings.estimator != "tdpm"
        self._rays = rays_of_sample(settings.samples) if self._merges else 1

    def look(self) -> Iterator[SeenPoints | QueryBatch]:
        """Follows all camera paths: what each pass saw, and the queries that come of it, as they are complete."""
        pixel_count = max(1, BATCH_SAMPLES // self._settings.samples)
        for first in range(0, len(self._pixels), pixel_count):
            batch = slice(first, first + pixel_count)
            mixed = yield from self._look_at(self._pixels[batch], self._numbers[batch])
            closer_count = max(1, BATCH_SAMPLES // (self._rays * self._settings.samples))
            for chosen in np.split(first + mixed, range(closer_count, len(mixed), closer_count)):
                if len(chosen):
                    yield from self._look_closer(self._pixels[chosen], self._numbers[chosen])

    def _look_at(
        self, pixels: np.ndarray, numbers: np.ndarray
    ) -> Generator[SeenPoints | QueryBatch, None, np.ndarray]:
        """Some pixels, at all times of the shutter, but for first paths of those that see several surfaces.

        The first paths of all times lie in one array, a row for each sample, pixel by pixel.

        Returns:
            The pixels that see several surfaces, by index.
        """
        samples, seed, launcher = self._settings.samples, self._settings.seed, self._launcher
        with self._clock.stage("view"):
            place = np.repeat(np.arange(len(pixels), dtype=np.int32), samples)
            films = film_positions(pixels, self._size[0], samples, seed)
            spots = self._spots(films, pixels[place])
            device_films = launcher.array(films.astype(np.float32), wp.vec2)
            seen = VisiblePoints.empty(place, self._smooth, self._settings.aovs, True, launcher)
            pixel_of = numbers[place]
        slices = np.zeros(len(place), np.int32)
        later, moving_rows, disturbed = _Rows(), _Rows(), np.zeros(len(pixels), bool)
        for number, (places, chosen) in enumerate(samples_by_time(self._times, pixels, samples, seed)):
            items = (places * samples + chosen).astype(np.int32)
            slices[items] = number
            for points in self._visible(number, device_films, items, seen):
                yield SeenPoints(points, pixel_of[points.items])
                with self._clock.stage("view"):
                    still, moving = self._told_apart(points, place[points.items], disturbed)
                    later.add(points, np.flatnonzero(still), points.items, slices, False)
                    moving_rows.add(points, np.flatnonzero(moving), points.items, slices, True)
        with self._clock.stage("view"):
            mixed = self._mixed(seen)
            once = ~mixed[place]
        yield SeenPoints(seen, pixel_of, once if mixed.any() else 1.0)
        with self._clock.stage("view"):
            still, moving = self._told_apart(seen, place, disturbed)
            still &= once
            moving &= once
        if self._merges and self._times > 1 and moving.any():
            yield from self._moving_batches(seen, moving, slices, spots, numbers)
        with self._clock.stage("view"):
            every = np.arange(len(place), dtype=np.int32)
            moving_rows.add(seen, np.flatnonzero(moving), every, slices, True)
            apart = _Rows()
            if self._times > 1:
                apart.add(seen, np.flatnonzero(still & disturbed[place]), every, slices, False)
                still &= ~disturbed[place]
        yield from self._still_batches(seen, still, spots, numbers)
        if rows := later.joined():
            with self._clock.stage("view"):
                alone = disturbed[rows["item"] // samples]
            yield from self._later_batches(_chosen(rows, ~alone), spots, numbers)
            yield from self._batches_by_time(_chosen(rows, alone), numbers)
        yield from self._batches_by_time(moving_rows.joined(), numbers)
        yield from self._batches_by_time(apart.joined(), numbers)
        return np.flatnonzero(mixed)

    def _mixed(self, seen: VisiblePoints) -> np.ndarray:
        """Which pixels see several surfaces, so that more rays are to tell how much of each; of the paths of all."""
        samples = self._settings.samples
        if self._rays == 1:
            return np.zeros(len(seen.items) // samples, bool)
        return mixed_pixels(seen.queries, samples, self._pixel, self._launcher).numpy() == 1

    def _look_closer(self, pixels: np.ndarray, numbers: np.ndarray) -> Iterator[SeenPoints | QueryBatch]:
        """First paths of some pixels, more of them at each sample's time of the shutter (:mod:`.mixed_pixels`).

        They lie in one array, pixel by pixel, those of each sample together.
        """
        samples, seed, rays, launcher = self._settings.samples, self._settings.seed, self._rays, self._launcher
        share = 1.0 / rays
        with self._clock.stage("view"):
            place = np.repeat(np.arange(len(pixels), dtype=np.int32), samples * rays)
            films = film_positions(pixels, self._size[0], samples * rays, seed)
            spots = self._spots(films, pixels[place])
            device_films = launcher.array(films.astype(np.float32), wp.vec2)
            seen = VisiblePoints.empty(place, self._smooth, self._settings.aovs, True, launcher)
        slices = np.zeros(len(place), np.int32)
        for number, (places, chosen) in enumerate(samples_by_time(self._times, pixels, samples, seed)):
            of_samples = (places * samples + chosen).astype(np.int32)[:, None] * rays
            items = (of_samples + np.arange(rays, dtype=np.int32)).ravel()
            slices[items] = number
            for _ in self._visible(number, device_films, items, seen, only_first=True):
                pass
        yield SeenPoints(seen, numbers[place], share)
        with self._clock.stage("view"):
            disturbed = np.zeros(len(pixels), bool)
            still, moving = self._told_apart(seen, place, disturbed)
            apart = still & disturbed[place] if self._times > 1 else np.zeros_like(still)
            each = seen, slices, spots
            by_time = self._of_samples(*each, moving, moves=True), self._of_samples(*each, apart, moves=False)
        for batch in self._still_batches(seen, still & ~apart, spots, numbers, rays):
            yield _of_rays(batch, share)
        for rows in by_time:
            for batch in self._batches_by_time(rows, numbers, rays):
                yield _of_rays(batch, share)

    def _of_samples(
        self, seen: VisiblePoints, slices: np.ndarray, spots: np.ndarray | None, chosen: np.ndarray, *, moves: bool
    ) -> dict[str, np.ndarray]:
        """The ``chosen`` [n] of the rays, those of a sample that meet one surface put together."""
        rows = np.flatnonzero(chosen)
        queries = rows_of(seen.queries, rows, self._launcher)
        weights = self._launcher.array(seen.arrays.weight.numpy()[rows], wp.vec3)
        begins = np.flatnonzero(np.diff(rows // self._rays, prepend=-1, append=-1)).astype(np.int32)
        parts = None if spots is None else spots[rows]
        counts = self._merged(queries, weights, begins, parts, self._rays)
        taken = np.flatnonzero(counts)
        if not len(taken):
            return {}
        columns = _columns_of(queries, taken, moves)
        columns |= {"weight": weights.numpy()[taken], "item": rows[taken], "slice": slices[rows[taken]]}
        return columns | {"first": counts[taken]}

    def _told_apart(
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

    def _still_batches(
        self, seen: VisiblePoints, still: np.ndarray, spots: np.ndarray | None, numbers: np.ndarray, rays: int = 1
    ) -> Iterator[QueryBatch]:
        """The ``still`` points of first paths in one batch over the whole shutter."""
        samples = rays * self._settings.samples
        if not still.any():
            return
        with self._clock.stage("view"):
            receivers = np.where(still, seen.queries.receiver.numpy(), -1)
            seen.queries.receiver = self._launcher.array(receivers.astype(np.int32), wp.int32)
            counts = still.astype(np.int32)
            if self._merges:
                begins = np.arange(len(numbers) + 1, dtype=np.int32) * samples
                counts = self._merged(seen.queries, seen.arrays.weight, begins, spots, rays)
            batch = self._rows_that_count(seen.queries, seen.arrays.weight.numpy(), counts, np.repeat(numbers, samples))
        yield batch

    def _moving_batches(
        self,
        seen: VisiblePoints,
        moving: np.ndarray,
        slices: np.ndarray,
        spots: np.ndarray | None,
        numbers: np.ndarray,
    ) -> Iterator[QueryBatch]:
        """First paths of pixels that see one object move all the time, over the whole shutter; unset in ``moving`` [n].

        Each sample is brought to mid shutter along its motion. Where they meet there, they are one point that moves,
        unless the surface is so round that the point would leave it on its straight way.
        """
        samples, launcher = self._settings.samples, self._launcher
        with self._clock.stage("view"):
            receivers = seen.queries.receiver.numpy().reshape(-1, samples)
            whole = moving.reshape(-1, samples).all(axis=1) & (receivers == receivers[:, :1]).all(axis=1)
            rows = np.flatnonzero(np.repeat(whole, samples))
            if not len(rows):
                return
            queries = rows_of(seen.queries, rows, launcher)
            motion = queries.motion.numpy().astype(np.float64)
            late = (slices[rows] + 0.5) / self._times - 0.5
            queries.position = launcher.array((queries.position.numpy() - late[:, None] * motion), wp.vec3)
            weights = launcher.array(seen.arrays.weight.numpy()[rows], wp.vec3)
            begins = np.arange(len(rows) // samples + 1, dtype=np.int32) * samples
            parts = None if spots is None else spots[rows]
            counts = self._merged(queries, weights, begins, parts)

            # ---- Of the spots, those all of whose samples meet
            of_spot = np.arange(len(rows)) // samples
            if parts is not None:
                of_spot = of_spot * part_count(samples) ** 2 + parts
            sizes = np.bincount(of_spot)
            mean = np.stack([np.bincount(of_spot, motion[:, axis]) for axis in range(3)], axis=1)
            mean /= np.maximum(sizes, 1)[:, None]
            queries.motion = launcher.array(mean[of_spot], wp.vec3)
            off = late * np.sum((motion - mean[of_spot]) * queries.normal.numpy(), axis=1)
            bends = np.abs(off) > LARGEST_BEND * self._sides(queries.position.numpy())
            met = (counts == sizes[of_spot]) & (np.bincount(of_spot, bends)[of_spot] == 0)
            complete = np.isin(of_spot, of_spot[met])
            batch = self._rows_that_count(queries, weights.numpy(), np.where(met, counts, 0), numbers[rows // samples])
            batch.moves = True
            moving[rows[complete]] = False
        if len(batch.pixels):
            yield batch

    def _later_batches(
        self, rows: dict[str, np.ndarray], spots: np.ndarray | None, numbers: np.ndarray
    ) -> Iterator[QueryBatch]:
        """Still points of later paths in one batch over the whole shutter."""
        with self._clock.stage("view"):
            place = rows["item"] // self._settings.samples
            queries, weights = self._queries(rows)
            counts = np.ones(len(place), np.int32)
            if self._merges:
                begins = np.searchsorted(place, np.arange(len(numbers) + 1)).astype(np.int32)
                parts = None if spots is None else spots[rows["item"]]
                counts = self._merged(queries, weights, begins, parts)
            # What branches from a pixel lands far apart, and the gather serves neighbours together.
            batch = self._rows_that_count(queries, weights.numpy(), counts, numbers[place], in_space=True)
            batch.first = np.zeros(len(batch.pixels), np.int32)
        if len(batch.pixels):
            yield batch

    def _batches_by_time(
        self, rows: dict[str, np.ndarray], numbers: np.ndarray, rays: int = 1
    ) -> Iterator[QueryBatch]:
        """Points that look at their own time and part of the shutter, so many in each batch as memory allows."""
        count = len(rows["item"]) if rows else 0
        for begin in range(0, count, BATCH_ROWS):
            with self._clock.stage("view"):
                some = {name: values[begin : begin + BATCH_ROWS] for name, values in rows.items()}
                queries, weights = self._queries(some)
                times, length = self._windows(some["slice"])
                pixels = numbers[some["item"] // (rays * self._settings.samples)]
                moves = "motion" in some
                own = times if moves or length < 1.0 else None
                batch = QueryBatch(queries, pixels, weights.numpy(), some["first"], (0.0, length), own, moves)
            yield batch

    def _windows(self, slices: np.ndarray) -> tuple[np.ndarray, float]:
        """When in the shutter time ``slices`` [n] look, and the middle of the part that each stands for; its length."""
        samples = self._settings.samples if self._times > 1 else 1
        strata = slices * samples // self._times
        return np.column_stack([(slices + 0.5) / self._times - 0.5, (strata + 0.5) / samples - 0.5]), 1.0 / samples

    def _spots(self, films: np.ndarray, pixels: np.ndarray) -> np.ndarray | None:
        """The part of its pixel that each film position lies in, shape [n]; None where pixels have one part."""
        parts = part_count(self._settings.samples)
        if not self._merges or parts == 1:
            return None
        return parts_of(films, pixels, self._size[0], parts).astype(np.int32)

    def _visible(
        self, number: int, films: wp.array, items: np.ndarray, seen: VisiblePoints, *, only_first: bool = False
    ) -> Iterator[VisiblePoints]:
        """Follows the paths of ``items`` at time slice ``number``: first ones go to ``seen``, later ones come back."""
        count = len(self._scenes)
        time = (number + 0.5) / self._times * count
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
            textures=loaded.textures, domes=self._domes_of(loaded), samples=self._settings.samples,
            aovs=self._settings.aovs,
            smallest_throughput=self._settings.view_cutoff,
            only_first=only_first,
        )  # fmt: skip
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

    def _camera_and_lights(self, loaded: LoadedScene) -> tuple[Camera, LightArrays, AreaLightArrays]:
        """Those of a scene, made anew only where it is another than the last."""
        if self._shot is None or self._shot[0] is not loaded:
            paths = loaded.geometry.paths if loaded.requirements.linked else ()
            lights = loaded.scene.lights, self._normalization, self._launcher, paths
            camera = camera_of(loaded.scene.camera, *self._size, self._normalization, self._launcher)
            self._shot = loaded, (camera, light_arrays(*lights), area_light_arrays(*lights))
        return self._shot[1]

    def _sides(self, places: np.ndarray) -> np.ndarray:
        """How wide what a query stands for is at some places, across the view, shape [n]; in the tracer's units."""
        size = self._pixel
        side = float(np.linalg.norm(size.right))
        if size.orthographic:
            return np.full(len(places), side)
        return side * np.abs((places - np.array(size.eye)) @ np.array(size.back))

    def _merged(
        self, queries: QueryArrays, weights: wp.array, begins: np.ndarray, spots: np.ndarray | None, rays: int = 1
    ) -> np.ndarray:
        return merge(queries, weights, begins, spots, self._pixel, self._launcher, rays)

    def _queries(self, columns: dict[str, np.ndarray]) -> tuple[QueryArrays, wp.array]:
        """Queries with their weights, from host arrays."""
        launcher, queries = self._launcher, QueryArrays()
        for name in ("position", "normal", "shading_normal", "motion"):
            given = columns.get(name)
            array = launcher.zeros(0, wp.vec3) if given is None else launcher.array(given, wp.vec3)
            setattr(queries, name, array)
        queries.receiver = launcher.array(columns["receiver"], wp.int32)
        return queries, launcher.array(columns["weight"], wp.vec3)

    def _rows_that_count(
        self,
        queries: QueryArrays,
        weights: np.ndarray,
        counts: np.ndarray,
        pixels: np.ndarray,
        in_space: bool = False,
    ) -> QueryBatch:
        """The rows that stand for any samples at all, over the whole shutter; in their order, or side by side."""
        rows = np.flatnonzero(counts)
        if in_space and len(rows):
            rows = rows[np.argsort(morton_codes(queries.position.numpy()[rows]), kind="stable")]
        if in_space or len(rows) < len(counts):
            queries, weights = rows_of(queries, rows, self._launcher), weights[rows]
            counts, pixels = counts[rows], pixels[rows]
        return QueryBatch(queries, pixels, weights, counts)
