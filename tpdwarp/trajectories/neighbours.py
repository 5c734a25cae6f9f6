"""Photons from cells side by side on the light that took the same path."""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap

Pairs = tuple[np.ndarray, np.ndarray]


def neighbours(photons: PhotonMap, plan: EmissionPlan) -> tuple[Pairs, Pairs]:
    """Rows of photons and of those one cell on in u, and likewise in v, on the same path."""
    if not len(photons):
        none = np.zeros(0, np.int64)
        return (none, none), (none, none)
    mask, lattice, _ = plan.paths_of(photons.ids)
    _, sheet = np.unique(mask * len(plan.lattices) + lattice, return_inverse=True)
    cell = np.floor(photons.emission).astype(np.int64)
    u, v = (cell - cell.min(axis=0)).T
    # One more than there are, so that the end of a row and the start of the next are no neighbours.
    width, height = u.max() + 2, v.max() + 2
    numbers = (sheet * height + v) * width + u
    # Photons come in the order of their cells, path by path, which a stable sort makes use of.
    order = np.argsort(numbers, kind="stable")
    numbers = numbers[order]
    pairs = []
    for step in (1, width):
        there = np.minimum(np.searchsorted(numbers, numbers + step), len(numbers) - 1)
        a, b = order, order[there]
        beside = (numbers[there] == numbers + step) & (photons.path[a] == photons.path[b])
        pairs.append((a[beside], b[beside]))
    return pairs[0], pairs[1]


def differences(values: np.ndarray, pairs: Pairs) -> np.ndarray:
    """Central differences of ``values`` [n, 3] per cell; one-sided at the ends of a row, zero without neighbours."""
    a, b = pairs
    change = values[b] - values[a]
    total, count = np.zeros_like(values), np.zeros((len(values), 1), values.dtype)
    # A photon has one neighbour at most on either side.
    for side in (a, b):
        total[side] += change
        count[side] += 1
    return total / np.maximum(count, 1)
