"""Query batches: what camera samples see, sorted for the gather: still queries together, moving ones by time.

A still point that something moves in front of is seen for part of the shutter, and light there may change meanwhile. So
in pixels where anything moving is met each sample looks at its own part of the shutter, wherever its path ends.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays, rows_of
from tpdwarp.footprints.morton import morton_codes
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.scene.normalization import Normalization
from tpdwarp.settings import Settings
from tpdwarp.view.merging import merge
from tpdwarp.view.mixed_pixels import mixed_pixels, rays_of_sample
from tpdwarp.view.query_batches import QueryBatch, Rows, SeenPoints, chosen_rows, columns_of
from tpdwarp.view.sampling import block_order, film_positions, part_count, parts_of, rays_by_time, samples_by_time
from tpdwarp.view.shutter_view import ShutterView
from tpdwarp.view.visibility import VisiblePoints

# Samples that are looked at together, which limits memory: their arrays take some 200 MB.
BATCH_SAMPLES = 1 << 20
# Points that are looked up together at their own times, likewise: cut into pieces of their ways they take some 300 MB.
BATCH_ROWS = 1 << 17
# How far off what it sees a point may be that moves straight on, in sides of what it stands for: farther off a round
# thing footprints no longer count there. Chosen, not derived.
LARGEST_BEND = 0.25


class CameraView:
    """The camera samples of one shutter.

    Args:
        scenes, settings, normalization, launcher, width, height, clock: As
            :class:`~tpdwarp.view.shutter_view.ShutterView` takes them.
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
        self._settings, self._launcher, self._width, self._clock = settings, launcher, width, clock
        self._view = ShutterView(scenes, settings, normalization, launcher, width, height, clock)
        self._pixels = block_order(width, height) if pixels is None else pixels
        self._numbers = self._pixels if pixels is None else np.arange(len(pixels)) if numbers is None else numbers
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
                    for seen in self._look_at(self._pixels[chosen], self._numbers[chosen], self._rays):
                        yield seen.scaled(1.0 / self._rays)

    def _look_at(
        self, pixels: np.ndarray, numbers: np.ndarray, rays: int = 1
    ) -> Generator[SeenPoints | QueryBatch, None, np.ndarray]:
        """Some pixels, at all times of the shutter.

        The first paths of all times lie in one array, a row for each ray, pixel by pixel and sample by sample.

        Args:
            rays: How many stand for each sample. With a single one, pixels that see several surfaces are left out.

        Returns:
            The pixels left out, by index.
        """
        settings, view = self._settings, self._view
        of_pixel = settings.samples * rays
        with self._clock.stage("view"):
            place = np.repeat(np.arange(len(pixels), dtype=np.int32), of_pixel)
            films = film_positions(pixels, self._width, of_pixel, settings.seed)
            spots = self._spots(films, pixels[place])
            device_films = self._launcher.array(films.astype(np.float32), wp.vec2)
            seen = view.room_for(place)
            pixel_of = numbers[place]
        slices = np.zeros(len(place), np.int32)
        disturbed = np.zeros(len(pixels), bool)
        looks_closer = rays < self._rays
        later, still_rows, moving_rows = [], Rows(), Rows()
        for number, items in enumerate(self._rays_by_time(pixels, rays)):
            slices[items] = number
            for points in view.at(number, device_films, items, seen, rays):
                if looks_closer:
                    later.append(points)
                else:
                    yield SeenPoints(points, pixel_of[points.items])
                with self._clock.stage("view"):
                    still, moving = view.told_apart(points, place[points.items], disturbed)
                    still_rows.add(points, np.flatnonzero(still), points.items, slices, False)
                    moving_rows.add(points, np.flatnonzero(moving), points.items, slices, True)
        with self._clock.stage("view"):
            mixed = np.zeros(len(pixels), bool)
            if looks_closer:
                found = seen.queries, seen.arrays.flags, settings.samples, view.pixel, self._launcher
                mixed = mixed_pixels(*found).numpy() == 1
            once = ~mixed[place]
        while later:
            points = later.pop(0)
            yield SeenPoints(points, pixel_of[points.items], once[points.items])
        yield SeenPoints(seen, pixel_of, once)
        with self._clock.stage("view"):
            still, moving = view.told_apart(seen, place, disturbed)
            still &= once
            moving &= once
        if self._merges and view.times > 1 and rays == 1 and moving.any():
            yield from self._moving_batches(seen, moving, slices, spots, numbers)
        with self._clock.stage("view"):
            every = np.arange(len(place), dtype=np.int32)
            moving_rows.add(seen, np.flatnonzero(moving), every, slices, True)
            apart = Rows()
            if view.times > 1:
                apart.add(seen, np.flatnonzero(still & disturbed[place]), every, slices, False)
                still &= ~disturbed[place]
            alone = disturbed[place] & once
            if rays > 1:
                # What is seen directly lies apart from what is seen otherwise.
                spots = 2 * (0 if spots is None else spots) + seen.turned
        yield from self._still_batches(seen, still, spots, numbers, rays)
        yield from self._later_batches(still_rows.joined(once & ~alone), spots, numbers, rays)
        for rows in (still_rows.joined(alone), moving_rows.joined(once), apart.joined(once)):
            if rows:
                yield from self._batches_by_time(self._together(rows, spots, rays), numbers, rays)
        return np.flatnonzero(mixed)

    def _rays_by_time(self, pixels: np.ndarray, rays: int) -> Iterator[np.ndarray]:
        """For each time slice, which of so many ``rays`` for each sample of ``pixels`` look at it."""
        samples, times = self._settings.samples, self._view.times
        if rays > 1:
            yield from rays_by_time(times, len(pixels), samples, rays)
            return
        for places, numbers in samples_by_time(times, pixels, samples, self._settings.seed):
            yield (places * samples + numbers).astype(np.int32)

    def _together(self, rows: dict[str, np.ndarray], spots: np.ndarray | None, rays: int) -> dict[str, np.ndarray]:
        """Rows of several rays a sample: those of a sample that meet one surface in one way as one row.

        They meet in the middle of the part of the shutter that the sample stands for: those that move are brought there
        along their motion.
        """
        if rays == 1:
            return rows
        with self._clock.stage("view"):
            rows = dict(rows)
            if "motion" in rows:
                late = self._view.windows(rows["slice"])[0] @ (1.0, -1.0)
                rows["position"] = rows["position"] - late[:, None] * rows["motion"].astype(np.float64)
                rows["slice"] = self._view.middles(rows["slice"])
            queries, weights = self._queries(rows)
            begins = np.flatnonzero(np.diff(rows["item"] // rays, prepend=-1, append=-1)).astype(np.int32)
            counts = self._merged(queries, weights, begins, 2 * spots[rows["item"]] + rows["first"], rays)
            taken = np.flatnonzero(counts)
            rows = chosen_rows(rows, taken)
            rows |= columns_of(queries, taken, "motion" in rows)
            return rows | {"weight": weights.numpy()[taken], "first": rows["first"] * counts[taken]}

    def _still_batches(
        self, seen: VisiblePoints, still: np.ndarray, spots: np.ndarray | None, numbers: np.ndarray, rays: int
    ) -> Iterator[QueryBatch]:
        """The ``still`` points of first paths in one batch over the whole shutter."""
        of_pixel = rays * self._settings.samples
        if not still.any():
            return
        with self._clock.stage("view"):
            receivers = np.where(still, seen.queries.receiver.numpy(), -1)
            seen.queries.receiver = self._launcher.array(receivers.astype(np.int32), wp.int32)
            counts = still.astype(np.int32)
            if self._merges:
                begins = np.arange(len(numbers) + 1, dtype=np.int32) * of_pixel
                counts = self._merged(seen.queries, seen.arrays.weight, begins, spots, rays)
            pixels = np.repeat(numbers, of_pixel)
            batch = self._rows_that_count(seen.queries, seen.arrays.weight.numpy(), counts, pixels)
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
            late = (slices[rows] + 0.5) / self._view.times - 0.5
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
            bends = np.abs(off) > LARGEST_BEND * self._view.sides(queries.position.numpy())
            met = (counts == sizes[of_spot]) & (np.bincount(of_spot, bends)[of_spot] == 0)
            complete = np.isin(of_spot, of_spot[met])
            batch = self._rows_that_count(queries, weights.numpy(), np.where(met, counts, 0), numbers[rows // samples])
            batch.moves = True
            moving[rows[complete]] = False
        if len(batch.pixels):
            yield batch

    def _later_batches(
        self, rows: dict[str, np.ndarray], spots: np.ndarray | None, numbers: np.ndarray, rays: int
    ) -> Iterator[QueryBatch]:
        """Still points of later paths in one batch over the whole shutter."""
        if not rows:
            return
        with self._clock.stage("view"):
            place = rows["item"] // (rays * self._settings.samples)
            queries, weights = self._queries(rows)
            counts = np.ones(len(place), np.int32)
            if self._merges:
                begins = np.searchsorted(place, np.arange(len(numbers) + 1)).astype(np.int32)
                parts = None if spots is None else spots[rows["item"]]
                counts = self._merged(queries, weights, begins, parts, rays)
            # What branches from a pixel lands far apart, and the gather serves neighbours together.
            batch = self._rows_that_count(queries, weights.numpy(), counts, numbers[place], in_space=True)
            batch.first = np.zeros(len(batch.pixels), np.int32)
        if len(batch.pixels):
            yield batch

    def _batches_by_time(self, rows: dict[str, np.ndarray], numbers: np.ndarray, rays: int) -> Iterator[QueryBatch]:
        """Points that look at their own time and part of the shutter, so many in each batch as memory allows."""
        for begin in range(0, len(rows["item"]), BATCH_ROWS):
            with self._clock.stage("view"):
                some = {name: values[begin : begin + BATCH_ROWS] for name, values in rows.items()}
                queries, weights = self._queries(some)
                times, length = self._view.windows(some["slice"])
                pixels = numbers[some["item"] // (rays * self._settings.samples)]
                moves = "motion" in some
                own = times if moves or length < 1.0 else None
                batch = QueryBatch(queries, pixels, weights.numpy(), some["first"], (0.0, length), own, moves)
            yield batch

    def _spots(self, films: np.ndarray, pixels: np.ndarray) -> np.ndarray | None:
        """The part of its pixel that each film position lies in, shape [n]; None where pixels have one part."""
        parts = part_count(self._settings.samples)
        if not self._merges or parts == 1:
            return None
        return parts_of(films, pixels, self._width, parts).astype(np.int32)

    def _merged(
        self, queries: QueryArrays, weights: wp.array, begins: np.ndarray, spots: np.ndarray | None, rays: int = 1
    ) -> np.ndarray:
        return merge(queries, weights, begins, spots, self._view.pixel, self._launcher, rays)

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
