"""Shutter keyframes: sparse photons traced as the shutter opens and closes, which know x and D_t x there.

D_t x varies slowly over the light even where the light on the receiver folds, so few photons suffice, and their values
are interpolated at any place on the light. A photon that rides on its surface has come from, and goes to, another place
on the light; there its keyframes are looked up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene

# Part of the shutter over which keyframes take D_t x at either end of it.
KEYFRAME_DURATION = 0.125
# Photons whose D_t x differs by more than this part from the mean of their keyframes' go straight: they lie beside an
# edge (or the shutter is too long for one segment). At 1 the error of one long trace falls, but a turned scene then
# differs by 5 % (tests/properties).
LARGEST_DISAGREEMENT = 0.25
# Cells of the keyframes that a photon may ride over for these to say where its light is, not only how fast it moves.
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
    """

    dxdt: np.ndarray
    position: np.ndarray
    valid: np.ndarray
    drift: np.ndarray

    def rows(self, chosen: np.ndarray) -> KeyframeState:
        """The same of some of the photons."""
        return KeyframeState(self.dxdt[chosen], self.position[chosen], self.valid[chosen], self.drift[chosen])


class ShutterKeyframes:
    """Keyframes at either end of a shutter.

    Args:
        tracer: Traces them.
        plan: Their lattices.
        opening, closing: When they are traced.
        clock: Where the time goes.

    Attributes:
        emitted: Number of photons traced for them.
    """

    def __init__(
        self, tracer: PhotonTracer, plan: EmissionPlan, opening: Shutter, closing: Shutter, clock: Clock
    ) -> None:
        self._tracer, self._plan, self._clock = tracer, plan, clock
        self.emitted = 0
        self._opening, self._closing = (
            self._traced(tracer.load(end, clock), 1.0 / KEYFRAME_DURATION) for end in (opening, closing)
        )

    def around(self, photons: PhotonMap, plan: EmissionPlan) -> tuple[KeyframeState, KeyframeState]:
        """Photons of mid shutter, as it opens and as it closes; ``photons.shift`` is that over the whole of it."""
        half = 0.5 * (1.0 - KEYFRAME_DURATION)
        return (
            self._looked_up(self._opening, photons, plan, -half),
            self._looked_up(self._closing, photons, plan, half),
        )

    def at_middle(self, photons: PhotonMap, plan: EmissionPlan, loaded: LoadedScene) -> KeyframeState:
        """Photons of mid shutter as keyframes see them, in the scene that the photons were traced through."""
        return self._looked_up(self._traced(loaded, 1.0), photons, plan, 0.0)

    def _traced(self, loaded: LoadedScene, rate: float) -> _KeyframeGrids:
        photons, account = self._tracer.trace(loaded, self._plan, self._clock, jittered=False)
        self.emitted += account.counts.get("emitted", 0)
        with self._clock.stage("trace"):
            return _KeyframeGrids(photons, self._plan, rate)

    def _looked_up(self, grids: _KeyframeGrids, photons: PhotonMap, plan: EmissionPlan, part: float) -> KeyframeState:
        """Keyframes at the part ``part`` (−½ … ½) of the shutter, at the places on the light that photons have then."""
        count = len(photons)
        found = KeyframeState(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, bool), np.zeros(count))
        for key, rows in _rows_by_path(photons, plan):
            fine, coarse = plan.lattices[key[0]], self._plan.lattices[key[0]]
            scale = np.divide(fine.step, coarse.step)
            offset = np.subtract(fine.origin, coarse.origin) / coarse.step
            drift = part * photons.shift[rows]
            place = (photons.emission[rows] + drift.astype(np.float64)) * scale + offset
            value, found.valid[rows] = grids.at(key, place, photons.receiver[rows])
            found.dxdt[rows], found.position[rows] = value[:, :3], value[:, 3:]
            found.drift[rows] = np.abs(drift * scale).max(axis=1)
        return found


def disagreement(photons: PhotonMap, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far D_t x of each photon is from the mean of its keyframes', as a part of theirs together, shape [n]."""
    apart = np.linalg.norm(photons.dxdt - 0.5 * (before + after), axis=1)
    size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
    return np.divide(apart, size, out=np.zeros_like(size), where=size > 0)


class _KeyframeGrids:
    """D_t x over the whole shutter and x as functions of the place on a light, for each lattice and path.

    ``rate`` is by how much shorter the shutter is over which the keyframes take D_t x.
    """

    def __init__(self, photons: PhotonMap, plan: EmissionPlan, rate: float) -> None:
        self._grids: dict[Key, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        for key, rows in _rows_by_path(photons, plan):
            cell = np.floor(photons.emission[rows]).astype(np.int64)
            first = cell.min(axis=0)
            size = cell.max(axis=0) - first + 1
            values, receivers = np.zeros((*size, 6)), np.full(size, -1, np.int64)
            at = tuple((cell - first).T)
            values[at] = np.concatenate([rate * photons.dxdt[rows], photons.position[rows]], axis=1)
            receivers[at] = photons.receiver[rows]
            self._grids[key] = first, values, receivers

    def at(self, key: Key, coordinates: np.ndarray, receiver: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D_t x and x [n, 6] at lattice ``coordinates`` [n, 2], interpolated bilinearly, and whether they are valid.

        Values are valid where at least three of the four photons around took this path to ``receiver`` [n].
        """
        if key not in self._grids:
            return np.zeros((len(coordinates), 6)), np.zeros(len(coordinates), bool)
        first, values, receivers = self._grids[key]
        place = coordinates - 0.5 - first
        # Outside the outermost photons, by up to a cell, it is as on the line that they make.
        last = np.array(receivers.shape) - 1
        near = np.all((place > -1) & (place < last + 1), axis=1)
        place = place.clip(0, last)
        corner = np.minimum(np.floor(place).astype(np.int64), np.maximum(last - 1, 0))
        part = place - corner
        corners = [corner + offset for offset in ((0, 0), (1, 0), (0, 1), (1, 1))]
        found, valid = [], []
        for cell in corners:
            inside = np.all((cell >= 0) & (cell < receivers.shape), axis=1)
            u, v = np.where(inside[:, None], cell, 0).T
            valid.append(inside & (receivers[u, v] == receiver))
            found.append(values[u, v])
        a, b, c, d = found
        # A missing corner lies on the plane through the other three.
        for number, plane in enumerate((b + c - d, a + d - c, a + d - b, b + c - a)):
            found[number] = np.where(valid[number][:, None], found[number], plane)
        u, v = part.T[:, :, None]
        a, b, c, d = found
        value = (1 - u) * (1 - v) * a + u * (1 - v) * b + (1 - u) * v * c + u * v * d
        return value, near & (np.sum(valid, axis=0) >= 3)


def _rows_by_path(photons: PhotonMap, plan: EmissionPlan) -> list[tuple[Key, np.ndarray]]:
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
