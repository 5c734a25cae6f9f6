"""Guides: sparse photons traced as the shutter opens and closes, which tell D_t x at its ends anywhere on the light.

D_t x varies slowly over the light even where the light on the receiver folds, so a few photons suffice for it. A photon
that rides on its surface has come from, and goes to, another place on the light; there its guides are looked up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import Shutter

if TYPE_CHECKING:
    from collections.abc import Callable

    from tpdwarp.estimators.base import Animation, Clock

# Part of the shutter over which guides take D_t x at either end of it.
MOMENT = 0.125
# Photons whose D_t x differs by more than this part from the mean of their guides' go straight: they lie beside an edge
# (or the shutter is too long for one segment).
LARGEST_DISAGREEMENT = 0.25

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
        self._plan = plan
        self._fields: list[_Field] = []
        self.emitted = 0
        for end in (opening, closing):
            loaded = animation.load(end, clock)
            riding = animation.settings.anchor == "surface"
            guides, account = animation.trace(loaded, plan, clock, riding=riding, jittered=False, taken=taken)
            self.emitted += account.counts.get("emitted", 0)
            with clock.stage("trace"):
                self._fields.append(_Field(guides, plan))

    def around(self, photons: PhotonMap, plan: EmissionPlan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """D_t x over the whole shutter as it opens and as it closes, [n, 3] each, and whether guides tell both, [n].

        Args:
            photons: At mid shutter, ``shift`` over the whole of it.
            plan: Their lattices.
        """
        before, after = np.zeros((len(photons), 3)), np.zeros((len(photons), 3))
        told = np.zeros(len(photons), bool)
        opening, closing = self._fields
        for key, rows in _rows_by_path(photons, plan):
            fine, coarse = plan.lattices[key[0]], self._plan.lattices[key[0]]
            scale = np.divide(fine.step, coarse.step)
            offset = np.subtract(fine.origin, coarse.origin) / coarse.step
            here, receiver = photons.emission[rows].astype(np.float64), photons.receiver[rows]
            aside = 0.5 * (1.0 - MOMENT) * photons.shift[rows]
            before[rows], told_before = opening.at(key, (here - aside) * scale + offset, receiver)
            after[rows], told_after = closing.at(key, (here + aside) * scale + offset, receiver)
            told[rows] = told_before & told_after
        return before, after, told


def disagreement(photons: PhotonMap, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How far D_t x of each photon is from the mean of its guides', as a part of theirs together, shape [n]."""
    apart = np.linalg.norm(photons.dxdt - 0.5 * (before + after), axis=1)
    size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
    return np.divide(apart, size, out=np.zeros_like(size), where=size > 0)


class _Field:
    """D_t x over the whole shutter as a function of the place on a light, for each lattice and path."""

    def __init__(self, guides: PhotonMap, plan: EmissionPlan) -> None:
        self._grids: dict[Key, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        for key, rows in _rows_by_path(guides, plan):
            cell = np.floor(guides.emission[rows]).astype(np.int64)
            first = cell.min(axis=0)
            size = cell.max(axis=0) - first + 1
            values, receivers = np.zeros((*size, 3)), np.full(size, -1, np.int64)
            at = tuple((cell - first).T)
            values[at], receivers[at] = guides.dxdt[rows] / MOMENT, guides.receiver[rows]
            self._grids[key] = first, values, receivers

    def at(self, key: Key, coordinates: np.ndarray, receiver: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D_t x [n, 3] at lattice ``coordinates`` [n, 2], and whether at least three of four guides tell it."""
        if key not in self._grids:
            return np.zeros((len(coordinates), 3)), np.zeros(len(coordinates), bool)
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
