"""Shutter keyframes: sparse photons traced as the shutter opens and closes, which know x and D_t x there.

D_t x varies slowly over the light even where the light on the receiver folds, so few photons suffice, and their values
are interpolated at any place on the light. A photon that rides on its surface has come from, and goes to, another place
on the light; there its keyframes are looked up. At the borders of bodies and facets, and on what is narrow, they have
too few photons to say; those cells are traced at either end themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.path_tags import PathTags
from tpdwarp.photons.photon_map import PhotonMap, row_index
from tpdwarp.photons.power_curves import PowerCurve
from tpdwarp.photons.row_numbers import row_numbers
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.photons.vectors import lengths
from tpdwarp.scene.description import LightAtShutter, Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.brightening import lights_change, power_curves, steady_lights
from tpdwarp.trajectories.grids import Riders, StateArrays, grids_of, interpolate
from tpdwarp.trajectories.neighbours import neighbours
from tpdwarp.trajectories.retraced import FAINT_BRANCH, LEAST_SHARE, CellsOfLattices, riding

# Part of the shutter over which keyframes take D_t x at either end of it. Chosen, not derived: a difference over it
# errs by its square over 24, 7e-4 of D_ttt x.
KEYFRAME_DURATION = 0.125
# Middles of these parts, from that of the shutter.
END = 0.5 * (1.0 - KEYFRAME_DURATION)
# Part of the shutter that its first and its last instant are: long enough to tell vertices apart in single precision.
INSTANT = 2.0**-10
# Photons of a keyframe: a sixteenth of those traced (a quarter of the cells along either axis), no fewer than these.
# Chosen, not derived: three keyframes then cost a fifth of the trace.
FEWEST_KEYFRAME_PHOTONS = 1024
PHOTONS_PER_KEYFRAME_PHOTON = 16
# Photons whose D_t x differs by more than this part from the mean of their keyframes' go straight: they lie beside an
# edge (or the shutter is too long for one segment). At 1 the error of one long trace falls, but a turned scene then
# differs by 5 % (tests/properties).
LARGEST_DISAGREEMENT = 0.25
# Cells of the keyframes that a photon may ride over for these to say where its light is, not only how fast it moves.
# Chosen, not derived: interpolation between other cells errs by more.
LARGEST_DRIFT = 0.1
# How far beside a portion of the light keyframes are, in their cells: photons look them up among four, where they ride.
BESIDE_PORTION = 2.0
# Rounding of a place among cells.
SAME_PLACE = 1e-6
# Lattices that a plan may have: the rest of a key, of 64 bits, is a path's mask of 31 bits and its wavelength.
MOST_LATTICES = 1 << 24


def shift_over_shutter(shift: np.ndarray, part: float) -> np.ndarray:
    """Shifts over the whole shutter of photons that were traced at ``part`` of it (:meth:`ShutterKeyframes.traced`)."""
    return shift if part == 0.0 else shift / (KEYFRAME_DURATION if abs(part) == END else INSTANT)


def keyframe_shutters(shutter: Shutter) -> tuple[Shutter, Shutter, Shutter]:
    """The shutters of keyframes at the opening, middle and closing of ``shutter``."""
    return short_shutters(shutter, KEYFRAME_DURATION)


def short_shutters(shutter: Shutter, part: float) -> tuple[Shutter, Shutter, Shutter]:
    """Short shutters at the opening, middle and closing of ``shutter``, each a ``part`` of it."""
    duration = part * shutter.exposure
    middle = shutter.middle
    return (
        Shutter(shutter.frame, shutter.open, shutter.open + duration),
        Shutter(shutter.frame, middle - 0.5 * duration, middle + 0.5 * duration),
        Shutter(shutter.frame, shutter.close - duration, shutter.close),
    )


@dataclass(frozen=True, eq=False)
class KeyframeState:
    """What keyframes say of photons at one time.

    Attributes:
        dxdt: D_t x over the whole shutter, shape [n, 3].
        position: Where their light is, shape [n, 3].
        valid: Whether the keyframes around each photon took its path to its receiver, shape [n].
        drift: How many of the keyframes' cells photons have moved over the light since mid shutter, shape [n].
        log_flux: Logarithm of the flux of the keyframes' photons there, shape [n].
        growth: How fast cells that ride grow then, over the whole shutter and by their size then, shape [n].
        rough: Second differences of that logarithm from one of the keyframes' cells to the next, shape [n].
        corners: Which of the four of the keyframes' cells around each photon say so, as bits, shape [n].
        beyond: How many cells outside of these it lies along u and v, shape [n, 2].
    """

    dxdt: np.ndarray
    position: np.ndarray
    valid: np.ndarray
    drift: np.ndarray
    log_flux: np.ndarray
    growth: np.ndarray
    rough: np.ndarray
    corners: np.ndarray
    beyond: np.ndarray

    def seen_as(self, other: KeyframeState) -> np.ndarray:
        """Of which photons both say what they do by the same cells around, shape [n]."""
        apart = np.abs(self.beyond - other.beyond).max(axis=1)
        return (self.corners == other.corners) & (apart < SAME_PLACE)

    def rows(self, chosen: np.ndarray) -> KeyframeState:
        """The same of some of the photons."""
        index = row_index(chosen)
        return KeyframeState(*(getattr(self, field.name).take(index, axis=0) for field in fields(self)))


@dataclass(frozen=True, eq=False)
class KeyframeScenes:
    """The scenes as a shutter opens and closes, over ``KEYFRAME_DURATION`` of it, in the light of all of it.

    Attributes:
        opening, closing: The scenes.
        lights_change: Whether lights change their power over the shutter.
    """

    opening: LoadedScene
    closing: LoadedScene
    lights_change: bool

    @classmethod
    def of(cls, tracer: PhotonTracer, loaded: LoadedScene, clock: Clock) -> KeyframeScenes:
        """Those of the shutter of ``loaded``."""
        ends = keyframe_shutters(loaded.scene.shutter)[::2]
        opening, closing = (tracer.load(end, clock, beside=loaded) for end in ends)
        (opening, closing), changes = steadily_lit(tracer, [opening, closing], [-END, END], loaded.scene.lights)
        return cls(opening, closing, changes)


class ShutterKeyframes:
    """Keyframes at either end of a shutter, and in its middle once they are wanted.

    Args:
        tracer: Traces them.
        plan: Their lattices.
        middle: The scene at mid shutter, where the photons are traced.
        opening, closing: The scenes as the shutter opens and closes, over ``KEYFRAME_DURATION`` of it.
        tags: Tell paths apart, for keyframes and photons alike.
        clock: Where the time goes.
        lights_change: Whether lights change their power over the shutter.
        weight: Part of the light that photons are traced with which keyframes are asked about; they have all of it.

    Attributes:
        emitted: Number of photons traced for them.
    """

    def __init__(
        self,
        tracer: PhotonTracer,
        plan: EmissionPlan,
        middle: LoadedScene,
        opening: LoadedScene,
        closing: LoadedScene,
        tags: PathTags,
        clock: Clock,
        lights_change: bool = False,
        weight: float = 1.0,
    ) -> None:
        self.tracer, self.plan, self.tags, self.emitted = tracer, plan, tags, 0
        self.middle, self.opening, self.closing = middle, opening, closing
        self._clock, self._lights_change, self._weight = clock, lights_change, weight
        self._photons: dict[float, PhotonMap] = {}
        self._grids: dict[float, _KeyframeGrids] = {}
        # The scenes of the first and of the last instant, once they are wanted.
        self._instants: dict[float, LoadedScene] = {}
        # Of the lattices that were last asked for, photons that were traced at either end themselves.
        self._ends: tuple[EmissionPlan, list[PhotonMap]] | None = None
        self._curves: dict[tuple[str, ...], tuple[PowerCurve | None, ...]] = {}

    @classmethod
    def over(
        cls,
        tracer: PhotonTracer,
        plan: EmissionPlan,
        loaded: LoadedScene,
        clock: Clock,
        weight: float = 1.0,
        ends: KeyframeScenes | None = None,
    ) -> ShutterKeyframes:
        """Keyframes of the shutter of ``loaded``, for photons on the lattices of ``plan`` with that ``weight``.

        Args:
            ends: The scenes at either end, where they are loaded already.
        """
        share = 1.0 if plan.portion is None else plan.portion.share
        fewest = max(FEWEST_KEYFRAME_PHOTONS / share, plan.photons // PHOTONS_PER_KEYFRAME_PHOTON)
        sparse = tracer.plan(min(plan.photons, round(fewest)), clock, shared=False).foreseeing(loaded.scene)
        if plan.strip is not None:
            sparse = replace(sparse, strip=plan.strip.on(plan.lattices, sparse.lattices))
        if plan.portion is not None:
            sparse = replace(sparse, portion=plan.portion.on(sparse.lattices, BESIDE_PORTION))
        ends = ends or KeyframeScenes.of(tracer, loaded, clock)
        with clock.stage("plan"):
            tags = PathTags(loaded.scene, plan.photons)
        return cls(tracer, sparse, loaded, ends.opening, ends.closing, tags, clock, ends.lights_change, weight)

    def around(self, photons: PhotonMap, plan: EmissionPlan) -> tuple[KeyframeState, KeyframeState]:
        """Photons of mid shutter, as it opens and as it closes; ``photons.shift`` is that over the whole of it."""
        return self._looked_up(photons, plan, -END), self._looked_up(photons, plan, END)

    def at_middle(self, photons: PhotonMap, plan: EmissionPlan) -> KeyframeState:
        """Photons of mid shutter as keyframes see them, in the scene that the photons were traced through."""
        return self._looked_up(photons, plan, 0.0)

    def states(self, photons: PhotonMap, plan: EmissionPlan) -> tuple[KeyframeState, KeyframeState, KeyframeState]:
        """Photons of mid shutter as it opens, in its middle, and as it closes.

        Where keyframes are too sparse to say, at the borders of bodies and facets, cells of photons that matter are
        traced at the ends themselves, each where it rides; then the photon itself is what they are compared with.
        """
        before, after = self.around(photons, plan)
        middle = self.at_middle(photons, plan)
        unknown = ~(before.valid & middle.valid & after.valid) & (photons.share > LEAST_SHARE)
        rows = np.flatnonzero(unknown & plan.paths_of(photons.ids)[2])
        if not len(rows) or self.tracer.settings.emission != "lattice":
            return before, middle, after
        if self._ends is None or self._ends[0] is not plan:
            with self._clock.stage("trace"):
                cells = _with_shifts(photons.rows(rows), plan)
            ends = [self.bright(part, plan, riding(cells, plan, part)) for part in (-END, END)]
            self._ends = plan, ends
        # Of photons of which some were asked for before, no others are unknown.
        ends = self._ends[1]
        with self._clock.stage("trace"):
            at = [_same_photons(photons, rows, end) for end in ends]
            both = (at[0] >= 0) & (at[1] >= 0)
            rows = rows[both]
            own = [end.rows(found[both]) for end, found in zip(ends, at, strict=True)]
            for state, end, rate, weight in (
                (before, own[0], KEYFRAME_DURATION, 1.0),
                (middle, photons.rows(rows), 1.0, self._weight),
                (after, own[1], KEYFRAME_DURATION, 1.0),
            ):
                state.dxdt[rows], state.position[rows] = end.dxdt / rate, end.position
                state.valid[rows] = True
                state.corners[rows], state.beyond[rows] = 0, 0.0
                flux = end.flux.max(axis=1) / np.float32(weight)
                state.log_flux[rows] = np.log(np.maximum(flux, np.finfo(np.float32).tiny))
                # What is not known of them is how their growth changes.
                state.growth[rows] = state.rough[rows] = 0.0
        return before, middle, after

    def photons(self, part: float) -> PhotonMap:
        """The keyframes' own photons at a part of the shutter, as of :meth:`traced`."""
        if part not in self._photons:
            self._photons[part] = self.traced(part, self.plan)
        return self._photons[part]

    def power_curves(self, lights: tuple[str, ...]) -> tuple[PowerCurve | None, ...]:
        """How the power of lights, by their paths, changes over the shutter; None of those that stay as they are, and
        nothing where all do."""
        if not self._lights_change:
            return ()
        if lights not in self._curves:
            self._curves[lights] = power_curves(self.tracer.source, self.middle.scene.shutter, lights)
        return self._curves[lights]

    def traced(self, part: float, plan: EmissionPlan, **options: Any) -> PhotonMap:
        """Photons of ``plan`` at a part of the shutter: −½, ``-END``, 0, ``END`` or ½.

        D_t x is that over ``KEYFRAME_DURATION`` at ``-END`` and ``END``, and over ``INSTANT`` at −½ and ½.

        Args:
            part: When.
            plan: The lattices.
            options: Of the tracer.
        """
        loaded = self._loaded(part)
        tags = self.tags.of(loaded.scene)
        photons, account = self.tracer.trace(loaded, plan, self._clock, jittered=False, tags=tags, **options)
        self.emitted += account.counts.get("emitted", 0)
        return photons

    def bright(
        self, part: float, plan: EmissionPlan, chosen: Callable[[Lattice, Patch], ChosenCells]
    ) -> PhotonMap:
        """The same of ``chosen`` cells without their faint branches, which are no reason to look at a cell."""
        cutoff = max(FAINT_BRANCH, self.tracer.settings.branch_cutoff)
        return self.traced(part, plan, chosen=chosen, aimed=False, smallest_branch=cutoff)

    def _loaded(self, part: float) -> LoadedScene:
        """The scene at a part of the shutter, as of :meth:`traced`."""
        if abs(part) < 0.5:
            return self.middle if part == 0.0 else self.opening if part < 0.0 else self.closing
        if part not in self._instants:
            scene = self.middle.scene
            first, _, last = short_shutters(scene.shutter, INSTANT)
            loaded = self.tracer.load(first if part < 0.0 else last, self._clock)
            (loaded,), _ = steadily_lit(self.tracer, [loaded], [part], scene.lights, INSTANT)
            self._instants[part] = loaded
        return self._instants[part]

    def _at(self, part: float) -> _KeyframeGrids:
        if part not in self._grids:
            photons = self.photons(part)
            with self._clock.stage("trace"):
                rate = 1.0 if part == 0.0 else 1.0 / KEYFRAME_DURATION
                self._grids[part] = _KeyframeGrids(photons, self.plan, rate, self.tracer.launcher)
        return self._grids[part]

    def _looked_up(self, photons: PhotonMap, plan: EmissionPlan, part: float) -> KeyframeState:
        """Keyframes at the part ``part`` (−½ … ½) of the shutter, at the places on the light that photons have then."""
        grids = self._at(part)
        with self._clock.stage("trace"):
            return grids.looked_up(photons, plan, part)


def steadily_lit(
    tracer: PhotonTracer,
    scenes: Sequence[LoadedScene],
    parts: Sequence[float],
    lights: Sequence[LightAtShutter],
    duration: float = KEYFRAME_DURATION,
) -> tuple[list[LoadedScene], bool]:
    """Scenes of keyframes in light of the power that it has over the whole shutter, and whether it has another then.

    So keyframes tell where light goes while its lamp is dark, and of how flux changes what lamps themselves do not.

    Args:
        tracer: Loaded them.
        scenes: Each over a part of the shutter.
        parts: Where in the shutter they lie, −½ … ½.
        lights: Over the whole shutter.
        duration: Part of the shutter that each scene is of.
    """
    if not any(lights_change(loaded.scene.lights, lights) for loaded in scenes):
        return list(scenes), False
    lit = [
        tracer.loader.lit_by(loaded, steady_lights(loaded.scene.lights, lights, part, duration))
        for loaded, part in zip(scenes, parts, strict=True)
    ]
    return lit, True


def disagreement(photons: PhotonMap, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far D_t x of each photon is from the mean of its keyframes', as a part of theirs together, shape [n]."""
    apart = lengths(photons.dxdt - 0.5 * (before + after))
    size = lengths(before) + lengths(after)
    return np.divide(apart, size, out=np.zeros_like(size), where=size > 0)


class _KeyframeGrids:
    """Keyframes' photons at one time of the shutter, with a grid for each lattice and path.

    ``rate`` is by how much shorter the shutter is over which the keyframes take D_t x.
    """

    def __init__(self, photons: PhotonMap, plan: EmissionPlan, rate: float, launcher: Launcher) -> None:
        self.photons, self._plan, self._rate, self._launcher = photons, plan, rate, launcher
        rows, keys = rows_by_path(photons, plan)
        starts = np.flatnonzero(np.diff(keys, prepend=-1))
        self._keys = keys[starts]
        self._grids = grids_of(photons, rows, starts, neighbours(photons, plan), launcher) if len(rows) else None

    def looked_up(self, photons: PhotonMap, plan: EmissionPlan, part: float) -> KeyframeState:
        """What they say of photons at the part ``part`` of the shutter."""
        launcher = self._launcher
        out = launcher.rows(StateArrays, len(photons))
        rows, keys = rows_by_path(photons, plan)
        if self._grids and len(rows):
            number = np.searchsorted(self._keys, keys).clip(max=len(self._keys) - 1)
            known = self._keys[number] == keys
            riders = self._riders(photons, plan, rows[known], number[known])
            which = launcher.array(rows[known].astype(np.int32), wp.int32)
            launcher(interpolate, len(which), [*self._grids, riders, which, float(part), out], in_turn=True)
        valid = out.valid.numpy() > 0
        columns = [out.position.numpy(), valid, out.drift.numpy(), out.log_flux.numpy()]
        columns += [self._rate * out.growth.numpy(), out.rough.numpy(), out.corners.numpy(), out.beyond.numpy()]
        return KeyframeState(self._rate * out.dxdt.numpy(), *columns)

    def _riders(self, photons: PhotonMap, plan: EmissionPlan, rows: np.ndarray, numbers: np.ndarray) -> Riders:
        """Photons on the lattices of ``plan``, of which ``rows`` are looked up in the grids ``numbers``, both [n]."""
        launcher, riders = self._launcher, Riders()
        for name, dtype in (("emission", wp.vec2), ("shift", wp.vec2), ("path", wp.uint32)):
            setattr(riders, name, launcher.array(getattr(photons, name), dtype))
        grid = np.zeros(len(photons), np.int32)
        grid[rows] = numbers
        pairs = [(plan.lattices[number], self._plan.lattices[number]) for number in self._keys % MOST_LATTICES]
        scale = [np.divide(fine.step, coarse.step) for fine, coarse in pairs]
        offset = [np.subtract(fine.origin, coarse.origin) / coarse.step for fine, coarse in pairs]
        riders.grid = launcher.array(grid, wp.int32)
        riders.scale, riders.offset = (launcher.array(np.array(values), wp.vec2d) for values in (scale, offset))
        return riders


def _with_shifts(photons: PhotonMap, plan: EmissionPlan) -> dict[int, ChosenCells]:
    """The cells of photons with their shifts as offsets, by lattice."""
    found = {}
    own = CellsOfLattices(photons, plan)
    for number in own.numbers():
        rows, cells = own.of(number)
        cells, first = np.unique(cells, axis=0, return_index=True)
        found[number] = ChosenCells(cells, photons.shift[rows[first]])
    return found


def _same_photons(photons: PhotonMap, rows: np.ndarray, others: PhotonMap) -> np.ndarray:
    """Rows of ``others`` that are of the same cells and paths as ``rows`` of photons, −1 where there are none."""
    names = ("ids", "path", "receiver")
    pairs = ((getattr(others, name), getattr(photons, name)[rows]) for name in names)
    numbers = row_numbers(*(np.concatenate(pair) for pair in pairs))
    at = np.full(numbers.max(initial=-1) + 1, -1)
    at[numbers[: len(others)]] = np.arange(len(others))
    return at[numbers[len(others) :]]


def rows_by_path(photons: PhotonMap, plan: EmissionPlan) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the photons on lattices of ``plan``, path by path, and a key for the lattice and path of each, [n]."""
    mask, lattice, foreseen = plan.paths_of(photons.ids)
    planned = np.flatnonzero(foreseen)
    keys = mask[planned] * MOST_LATTICES + lattice[planned]
    # Photons come path by path, which a stable sort makes use of.
    order = np.argsort(keys, kind="stable")
    return planned[order], keys[order]
