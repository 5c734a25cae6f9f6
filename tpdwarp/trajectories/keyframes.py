"""Guides: sparse photons traced as the shutter opens and closes, which tell x and D_t x there anywhere on the light.

D_t x varies slowly over the light even where the light on the receiver folds, so a few photons suffice for it. A photon
that rides on its surface has come from, and goes to, another place on the light; there its guides are looked up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import Shutter

if TYPE_CHECKING:
    from collections.abc import Callable

    from tpdwarp.estimators.base import Animation, Clock, LoadedScene

# Part of the shutter over which guides take D_t x at either end of it.
MOMENT = 0.125
# Photons whose D_t x differs by more than this part from the mean of their guides' go straight: they lie beside an edge
# (or the shutter is too long for one segment).
LARGEST_DISAGREEMENT = 0.25
# Cells of the guides that a photon may ride over for these to tell where its light is, not only how fast.
FARTHEST_ASIDE = 0.1

Key = tuple[int, int]


def moments(shutter: Shutter) -> tuple[Shutter, Shutter, Shutter]:
    """Short shutters at the opening, middle and closing of ``shutter``."""
    moment = MOMENT * shutter.exposure
    middle = shutter.middle
    return (
        Shutter(shutter.frame, shutter.open, shutter.open + moment),
        Shutter(shutter.frame, middle - 0.5 * moment, middle + 0.5 * moment),
        Shutter(shutter.frame, shutter.close - moment, shutter.close),
    )


@dataclass(frozen=True, eq=False)
class Moment:
    """What guides tell of photons at one time.

    Attributes:
        dxdt: D_t x over the whole shutter, shape [n, 3].
        position: Where their light is, shape [n, 3].
        told: Whether they tell, shape [n].
        aside: How many of the guides' cells photons have moved over the light since mid shutter, shape [n].
    """

    dxdt: np.ndarray
    position: np.ndarray
    told: np.ndarray
    aside: np.ndarray

    def at(self, rows: np.ndarray) -> Moment:
        """The same of some of the photons."""
        return Moment(self.dxdt[rows], self.position[rows], self.told[rows], self.aside[rows])


class Guides:
    """Guides at either end of a shutter.

    Args:
        animation: Where they are traced.
        plan: Their lattices.
        opening, closing: When they are traced.
        clock: Where the time goes.
        taken: Tells which meshes they meet first; None where that is any.

    Attributes:
        emitted: Number of guides.
    """

    def __init__(
        self,
        animation: Animation,
        plan: EmissionPlan,
        opening: Shutter,
        closing: Shutter,
        clock: Clock,
        taken: Callable[[str], bool] | None = None,
    ) -> None:
        self._animation, self._plan, self._clock, self._taken = animation, plan, clock, taken
        self.emitted = 0
        self._opening, self._closing = (
            self._traced(animation.load(end, clock), 1.0 / MOMENT) for end in (opening, closing)
        )

    def _traced(self, loaded: LoadedScene, faster: float) -> _Field:
        riding = self._animation.settings.anchor == "surface"
        options = {"riding": riding, "jittered": False, "taken": self._taken}
        guides, account = self._animation.trace(loaded, self._plan, self._clock, **options)
        self.emitted += account.counts.get("emitted", 0)
        with self._clock.stage("trace"):
            return _Field(guides, self._plan, faster)

    def around(self, photons: PhotonMap, plan: EmissionPlan) -> tuple[Moment, Moment]:
        """Photons at mid shutter, ``shift`` over the whole of it, as it opens and as it closes."""
        reach = 0.5 * (1.0 - MOMENT)
        return self._looked_up(self._opening, photons, plan, -reach), self._looked_up(
            self._closing, photons, plan, reach
        )

    def amid(self, photons: PhotonMap, plan: EmissionPlan, loaded: LoadedScene) -> Moment:
        """Photons at mid shutter as guides see them, in the scene that the photons were traced through."""
        return self._looked_up(self._traced(loaded, 1.0), photons, plan, 0.0)

    def _looked_up(self, field: _Field, photons: PhotonMap, plan: EmissionPlan, part: float) -> Moment:
        count = len(photons)
        found = Moment(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, bool), np.zeros(count))
        for key, rows in _rows_by_path(photons, plan):
            fine, coarse = plan.lattices[key[0]], self._plan.lattices[key[0]]
            scale = np.divide(fine.step, coarse.step)
            offset = np.subtract(fine.origin, coarse.origin) / coarse.step
            aside = part * photons.shift[rows]
            place = (photons.emission[rows] + aside.astype(np.float64)) * scale + offset
            value, found.told[rows] = field.at(key, place, photons.receiver[rows])
            found.dxdt[rows], found.position[rows] = value[:, :3], value[:, 3:]
            found.aside[rows] = np.abs(aside * scale).max(axis=1)
        return found


def disagreement(photons: PhotonMap, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far D_t x of each photon is from the mean of its guides', as a part of theirs together, shape [n]."""
    apart = np.linalg.norm(photons.dxdt - 0.5 * (before + after), axis=1)
    size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
    return np.divide(apart, size, out=np.zeros_like(size), where=size > 0)


class _Field:
    """D_t x over the whole shutter and x as functions of the place on a light, for each lattice and path.

    ``faster`` is how much shorter the shutter is over which guides tell D_t x.
    """

    def __init__(self, guides: PhotonMap, plan: EmissionPlan, faster: float) -> None:
        self._grids: dict[Key, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        for key, rows in _rows_by_path(guides, plan):
            cell = np.floor(guides.emission[rows]).astype(np.int64)
            first = cell.min(axis=0)
            size = cell.max(axis=0) - first + 1
            values, receivers = np.zeros((*size, 6)), np.full(size, -1, np.int64)
            at = tuple((cell - first).T)
            values[at] = np.concatenate([faster * guides.dxdt[rows], guides.position[rows]], axis=1)
            receivers[at] = guides.receiver[rows]
            self._grids[key] = first, values, receivers

    def at(self, key: Key, coordinates: np.ndarray, receiver: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D_t x and x [n, 6] at lattice ``coordinates`` [n, 2], and whether three of four guides or all tell them."""
        if key not in self._grids:
            return np.zeros((len(coordinates), 6)), np.zeros(len(coordinates), bool)
        first, values, receivers = self._grids[key]
        place = coordinates - 0.5 - first
        # Outside the outermost guides, by up to a cell, it is as on the line that they make.
        last = np.array(receivers.shape) - 1
        near = np.all((place > -1) & (place < last + 1), axis=1)
        place = place.clip(0, last)
        corner = np.minimum(np.floor(place).astype(np.int64), np.maximum(last - 1, 0))
        part = place - corner
        corners = [corner + offset for offset in ((0, 0), (1, 0), (0, 1), (1, 1))]
        found, told = [], []
        for cell in corners:
            inside = np.all((cell >= 0) & (cell < receivers.shape), axis=1)
            u, v = np.where(inside[:, None], cell, 0).T
            told.append(inside & (receivers[u, v] == receiver))
            found.append(values[u, v])
        a, b, c, d = found
        # A missing corner lies on the plane through the other three.
        for number, plane in enumerate((b + c - d, a + d - c, a + d - b, b + c - a)):
            found[number] = np.where(told[number][:, None], found[number], plane)
        u, v = part.T[:, :, None]
        a, b, c, d = found
        value = (1 - u) * (1 - v) * a + u * (1 - v) * b + (1 - u) * v * c + u * v * d
        return value, near & (np.sum(told, axis=0) >= 3)


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
