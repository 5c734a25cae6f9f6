"""Curved ways of footprints: how D_t x changes while the shutter is open.

A footprint that goes straight along D_t x is exact to first order in time; what is left is ½ s² D_tt x at the part s of
the shutter. D_tt x varies slowly over the light even where the light on the receiver folds, so a few photons suffice
for it: a sparse lattice of guides is traced as the shutter opens and as it closes, and the difference of their D_t x is
interpolated to where each photon was emitted. A photon that rides on its surface has come from, and goes to, another
place on the light; there its guides are looked up.

Beyond the paper, whose footprints go straight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import Shutter

if TYPE_CHECKING:
    from tpdwarp.estimators.base import Animation, Clock

# Part of the shutter over which guides take D_t x at either end of it.
MOMENT = 0.125
FEWEST_GUIDES = 1024
PHOTONS_PER_GUIDE = 16
# Photons whose D_t x differs by more than this part from the mean of their guides' go straight: they lie beside an edge
# (or the shutter is too long for one segment).
LARGEST_DISAGREEMENT = 0.25

Key = tuple[int, int]


def bent(
    photons: PhotonMap,
    plan: EmissionPlan,
    animation: Animation,
    shutter: Shutter,
    clock: Clock,
    taken: Callable[[str], bool] | None = None,
) -> tuple[PhotonMap, int]:
    """``photons`` with the bend of their ways.

    Args:
        photons: Traced at the middle of ``shutter``.
        plan: Their lattices.
        animation: Where guides are traced.
        shutter: The (sub-)shutter that ``photons.dxdt`` spans.
        clock: Where the time goes.
        taken: Tells which meshes they met first; None where that was any.

    Returns:
        The photons, and the number of guides emitted.
    """
    sparse = animation.plan(min(plan.photons, max(FEWEST_GUIDES, plan.photons // PHOTONS_PER_GUIDE)), clock)
    moment = MOMENT * shutter.exposure
    ends = (
        Shutter(shutter.frame, shutter.open, shutter.open + moment),
        Shutter(shutter.frame, shutter.close - moment, shutter.close),
    )
    fields, count = [], 0
    for end in ends:
        loaded = animation.load(end, clock)
        riding = animation.settings.anchor == "surface"
        guides, account = animation.trace(loaded, sparse, clock, riding=riding, jittered=False, taken=taken)
        count += account.counts.get("emitted", 0)
        with clock.stage("trace"):
            fields.append(_Field(guides, sparse))
    with clock.stage("trace"):
        return replace(photons, bend=_bends(photons, plan, sparse, *fields)), count


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


def _bends(
    photons: PhotonMap, plan: EmissionPlan, sparse: EmissionPlan, opening: _Field, closing: _Field
) -> np.ndarray:
    """Change of D_t x over the shutter, shape [n, 3]; zero where guides do not tell."""
    bends = np.zeros((len(photons), 3), np.float32)
    span = 1.0 - MOMENT
    for key, rows in _rows_by_path(photons, plan):
        fine, coarse = plan.lattices[key[0]], sparse.lattices[key[0]]
        scale = np.divide(fine.step, coarse.step)
        offset = np.subtract(fine.origin, coarse.origin) / coarse.step
        here, receiver = photons.emission[rows].astype(np.float64), photons.receiver[rows]
        aside = 0.5 * span * photons.shift[rows]
        before, told_before = opening.at(key, (here - aside) * scale + offset, receiver)
        after, told_after = closing.at(key, (here + aside) * scale + offset, receiver)
        disagreement = np.linalg.norm(photons.dxdt[rows] - 0.5 * (before + after), axis=1)
        size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
        told = told_before & told_after & (disagreement <= LARGEST_DISAGREEMENT * size)
        bends[rows] = np.where(told[:, None], (after - before) / span, 0.0)
    return bends


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
