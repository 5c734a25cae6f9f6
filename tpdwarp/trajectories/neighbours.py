"""Photons from cells side by side on the light that took the same path."""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap

Pairs = tuple[np.ndarray, np.ndarray]


def neighbours(photons: PhotonMap, plan: EmissionPlan) -> tuple[Pairs, Pairs]:
    """Rows of photons and of those one cell on in u, and likewise in v, on the same path."""
    mask, lattice, _ = plan.paths_of(photons.ids)
    cell = np.floor(photons.emission).astype(np.int64)
    pairs = []
    for axis in (0, 1):
        order = np.lexsort((cell[:, axis], cell[:, 1 - axis], lattice, mask))
        a, b = order[:-1], order[1:]
        beside = (cell[b, axis] - cell[a, axis] == 1) & (cell[b, 1 - axis] == cell[a, 1 - axis])
        beside &= (lattice[a] == lattice[b]) & (mask[a] == mask[b]) & (photons.path[a] == photons.path[b])
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
