"""Shutter keyframes: sparse photons traced as the shutter opens and closes, which know x and D_t x there.

D_t x varies slowly over the light even where the light on the receiver folds, so few photons suffice, and their values
are interpolated at any place on the light. A photon that rides on its surface has come from, and goes to, another place
on the light; there its keyframes are looked up.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.path_tags import PathTags
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene

# Part of the shutter over which keyframes take D_t x at either end of it. Chosen, not derived: a difference over it
# errs by its square over 24, 7e-4 of D_ttt x.
KEYFRAME_DURATION = 0.125
# Middles of these parts, from that of the shutter.
END = 0.5 * (1.0 - KEYFRAME_DURATION)
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

Key = tuple[int, int]


def keyframe_shutters(shutter: Shutter) -> tuple[Shutter, Shutter, Shutter]:
    """Short shutters at the opening, middle and closing of ``shutter``."""
    duration = KEYFRAME_DURATION * shutter.exposure
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
    """

    dxdt: np.ndarray
    position: np.ndarray
    valid: np.ndarray
    drift: np.ndarray
    log_flux: np.ndarray

    def rows(self, chosen: np.ndarray) -> KeyframeState:
        """The same of some of the photons."""
        return KeyframeState(*(getattr(self, field.name)[chosen] for field in fields(self)))


class ShutterKeyframes:
    """Keyframes at either end of a shutter, and in its middle once they are wanted.

    Args:
        tracer: Traces them.
        plan: Their lattices.
        middle: The scene at mid shutter, where the photons are traced.
        opening, closing: The scenes as the shutter opens and closes, over ``KEYFRAME_DURATION`` of it.
        tags: Tell paths apart, for keyframes and photons alike.
        clock: Where the time goes.

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
    ) -> None:
        self.tracer, self.plan, self.tags, self.emitted = tracer, plan, tags, 0
        self.middle, self.opening, self.closing = middle, opening, closing
        self._clock = clock
        self._grids: dict[float, _KeyframeGrids] = {}

    @classmethod
    def over(cls, tracer: PhotonTracer, plan: EmissionPlan, loaded: LoadedScene, clock: Clock) -> ShutterKeyframes:
        """Keyframes of the shutter of ``loaded``, for photons on the lattices of ``plan``."""
        sparse = tracer.plan(
            min(plan.photons, max(FEWEST_KEYFRAME_PHOTONS, plan.photons // PHOTONS_PER_KEYFRAME_PHOTON)), clock
        )
        opening, _, closing = (tracer.load(end, clock) for end in keyframe_shutters(loaded.scene.shutter))
        with clock.stage("plan"):
            tags = PathTags(loaded.scene, plan.photons)
        return cls(tracer, sparse, loaded, opening, closing, tags, clock)

    def around(self, photons: PhotonMap, plan: EmissionPlan) -> tuple[KeyframeState, KeyframeState]:
        """Photons of mid shutter, as it opens and as it closes; ``photons.shift`` is that over the whole of it."""
        return self._looked_up(photons, plan, -END), self._looked_up(photons, plan, END)

    def at_middle(self, photons: PhotonMap, plan: EmissionPlan) -> KeyframeState:
        """Photons of mid shutter as keyframes see them, in the scene that the photons were traced through."""
        return self._looked_up(photons, plan, 0.0)

    def photons(self, part: float) -> PhotonMap:
        """The keyframes' own photons at ``-END``, 0 or ``END``."""
        return self._at(part).photons

    def traced(self, part: float, plan: EmissionPlan, **options: Any) -> PhotonMap:
        """Photons of ``plan`` at ``-END``, 0 or ``END`` of the shutter; ``options`` are those of the tracer."""
        loaded = self.middle if part == 0.0 else self.opening if part < 0.0 else self.closing
        tags = self.tags.of(loaded.scene)
        photons, account = self.tracer.trace(loaded, plan, self._clock, jittered=False, tags=tags, **options)
        self.emitted += account.counts.get("emitted", 0)
        return photons

    def _at(self, part: float) -> _KeyframeGrids:
        if part not in self._grids:
            photons = self.traced(part, self.plan)
            with self._clock.stage("trace"):
                rate = 1.0 if part == 0.0 else 1.0 / KEYFRAME_DURATION
                self._grids[part] = _KeyframeGrids(photons, self.plan, rate)
        return self._grids[part]

    def _looked_up(self, photons: PhotonMap, plan: EmissionPlan, part: float) -> KeyframeState:
        """Keyframes at the part ``part`` (−½ … ½) of the shutter, at the places on the light that photons have then."""
        grids = self._at(part)
        count = len(photons)
        found = KeyframeState(
            np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, bool), np.zeros(count), np.zeros(count)
        )
        for key, rows in rows_by_path(photons, plan):
            fine, coarse = plan.lattices[key[0]], self.plan.lattices[key[0]]
            scale = np.divide(fine.step, coarse.step)
            offset = np.subtract(fine.origin, coarse.origin) / coarse.step
            drift = part * photons.shift[rows]
            place = (photons.emission[rows] + drift.astype(np.float64)) * scale + offset
            value, found.valid[rows] = grids.at(key, place, photons.path[rows])
            found.dxdt[rows], found.position[rows], found.log_flux[rows] = value[:, :3], value[:, 3:6], value[:, 6]
            found.drift[rows] = np.abs(drift * scale).max(axis=1)
        return found


def disagreement(photons: PhotonMap, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far D_t x of each photon is from the mean of its keyframes', as a part of theirs together, shape [n]."""
    apart = np.linalg.norm(photons.dxdt - 0.5 * (before + after), axis=1)
    size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
    return np.divide(apart, size, out=np.zeros_like(size), where=size > 0)


class _KeyframeGrids:
    """D_t x over the whole shutter, x and ln Φ as functions of the place on a light, for each lattice and path.

    ``rate`` is by how much shorter the shutter is over which the keyframes take D_t x.
    """

    def __init__(self, photons: PhotonMap, plan: EmissionPlan, rate: float) -> None:
        self.photons = photons
        self._grids: dict[Key, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        for key, rows in rows_by_path(photons, plan):
            cell = np.floor(photons.emission[rows]).astype(np.int64)
            first = cell.min(axis=0)
            size = cell.max(axis=0) - first + 1
            values, paths = np.zeros((*size, 7)), np.full(size, -1, np.int64)
            at = tuple((cell - first).T)
            flux = np.log(np.maximum(photons.flux[rows].max(axis=1), np.finfo(np.float32).tiny))
            values[at] = np.column_stack([rate * photons.dxdt[rows], photons.position[rows], flux])
            paths[at] = photons.path[rows]
            self._grids[key] = first, values, paths

    def at(self, key: Key, coordinates: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D_t x, x and ln Φ [n, 7] at lattice ``coordinates`` [n, 2], bilinearly, and whether they are valid.

        Values are valid where at least three of the four photons around took ``path`` [n], too.
        """
        if key not in self._grids:
            return np.zeros((len(coordinates), 7)), np.zeros(len(coordinates), bool)
        first, values, paths = self._grids[key]
        place = coordinates - 0.5 - first
        # Outside the outermost photons, by up to a cell, it is as on the line that they make.
        last = np.array(paths.shape) - 1
        near = np.all((place > -1) & (place < last + 1), axis=1)
        place = place.clip(0, last)
        corner = np.minimum(np.floor(place).astype(np.int64), np.maximum(last - 1, 0))
        part = place - corner
        corners = [corner + offset for offset in ((0, 0), (1, 0), (0, 1), (1, 1))]
        found, valid = [], []
        for cell in corners:
            inside = np.all((cell >= 0) & (cell < paths.shape), axis=1)
            u, v = np.where(inside[:, None], cell, 0).T
            valid.append(inside & (paths[u, v] == path))
            found.append(values[u, v])
        a, b, c, d = found
        # A missing corner lies on the plane through the other three.
        for number, plane in enumerate((b + c - d, a + d - c, a + d - b, b + c - a)):
            found[number] = np.where(valid[number][:, None], found[number], plane)
        u, v = part.T[:, :, None]
        a, b, c, d = found
        value = (1 - u) * (1 - v) * a + u * (1 - v) * b + (1 - u) * v * c + u * v * d
        return value, near & (np.sum(valid, axis=0) >= 3)


def rows_by_path(photons: PhotonMap, plan: EmissionPlan) -> list[tuple[Key, np.ndarray]]:
    """Rows of the photons of each lattice of ``plan`` on each path, by (lattice, mask)."""
    mask, lattice, foreseen = plan.paths_of(photons.ids)
    planned = np.flatnonzero(foreseen)
    order = planned[np.lexsort((lattice[planned], mask[planned]))]
    if not len(order):
        return []
    keys = np.stack([lattice[order], mask[order]], axis=1)
    starts = np.flatnonzero(np.any(np.diff(keys, axis=0, prepend=keys[:1] - 1), axis=1))
    return [
        ((int(keys[start, 0]), int(keys[start, 1])), rows)
        for start, rows in zip(starts, np.split(order, starts[1:]), strict=True)
    ]
