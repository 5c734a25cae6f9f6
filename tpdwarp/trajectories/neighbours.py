"""Photons from cells side by side on the light that took the same path."""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap

Pairs = tuple[np.ndarray, np.ndarray]


# Cells of a table of rows for each photon at most; of photons that lie farther apart on the light, rows are sorted.
# Chosen, not derived.
MOST_CELLS = 8


def neighbours(photons: PhotonMap, plan: EmissionPlan) -> tuple[Pairs, Pairs]:
    """Rows of photons and of those one cell on in u, and likewise in v, on the same path."""
    count = len(photons)
    if not count:
        none = np.zeros(0, np.int64)
        return (none, none), (none, none)
    sheet = _sheets(photons, plan)
    cell = np.floor(photons.emission).astype(np.int64)
    u, v = (cell - cell.min(axis=0)).T
    # One more than there are, so that the end of a row and the start of the next are no neighbours.
    width, height = u.max() + 2, v.max() + 2
    numbers = (sheet * height + v) * width + u
    rows = np.arange(count)
    pairs = []
    if numbers.max() + width < MOST_CELLS * count:
        table = np.full(numbers.max() + width + 1, -1, np.int32)
        table[numbers] = rows
        for step in (1, width):
            there = table[numbers + step]
            pairs.append((rows, there, there >= 0))
    else:
        order = np.argsort(numbers, kind="stable")
        numbers = numbers[order]
        for step in (1, width):
            there = np.minimum(np.searchsorted(numbers, numbers + step), count - 1)
            pairs.append((order, order[there], numbers[there] == numbers + step))
    beside = [(a[there], b[there].astype(np.int64)) for a, b, there in pairs]
    same = [photons.path[a] == photons.path[b] for a, b in beside]
    u, v = ((a[alike], b[alike]) for (a, b), alike in zip(beside, same, strict=True))
    return u, v


def _sheets(photons: PhotonMap, plan: EmissionPlan) -> np.ndarray:
    """A number for each lattice and path that photons come from, shape [n]."""
    mask, lattice, _ = plan.paths_of(photons.ids)
    keys = mask * len(plan.lattices) + lattice
    # Photons come path by path: there are few runs of them.
    starts = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1))
    numbers = np.unique(keys[starts], return_inverse=True)[1].reshape(-1)
    return np.repeat(numbers, np.diff(starts, append=len(keys)))


def differences(values: np.ndarray, pairs: Pairs) -> np.ndarray:
    """Central differences of ``values`` [n, 3] per cell; one-sided at the ends of a row, zero without neighbours."""
    ahead, behind, rows = _beside(len(values), pairs)
    between = np.where((ahead != rows) & (behind != rows), 0.5, 1.0).astype(values.dtype)
    return (values.take(ahead, axis=0) - values.take(behind, axis=0)) * between[:, None]


def second_differences(values: np.ndarray, pairs: Pairs) -> np.ndarray:
    """Second differences of ``values`` [n] per cell; at the ends of a row those of the one beside, zero where it has
    fewer than three."""
    ahead, behind, rows = _beside(len(values), pairs)
    inside = (ahead != rows) & (behind != rows)
    found = np.where(inside, values[ahead] + values[behind] - 2.0 * values, 0.0)
    return np.where(inside, found, found[np.where(ahead != rows, ahead, behind)])


def has_three(count: int, pairs: Pairs) -> np.ndarray:
    """Which of ``count`` photons lie in a row of three or more, shape [n]."""
    ahead, behind, rows = _beside(count, pairs)
    inside = (ahead != rows) & (behind != rows)
    return inside | inside[ahead] | inside[behind]


def beside_edges(photons: PhotonMap, plan: EmissionPlan, cells: int = 2) -> np.ndarray:
    """Rows of photons that have no neighbour on their path on some side, or lie up to ``cells`` beside such."""
    pairs = neighbours(photons, plan)
    sides = np.zeros(len(photons), np.int8)
    for a, b in pairs:
        sides[a] += 1
        sides[b] += 1
    near = sides < 2 * len(pairs)
    for _ in range(cells - 1):
        beside = near.copy()
        for a, b in pairs:
            beside[a] |= near[b]
            beside[b] |= near[a]
        near = beside
    return np.flatnonzero(near)


def _beside(count: int, pairs: Pairs) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of the photons one cell ahead and behind, of ``count`` photons, their own without; and all rows."""
    a, b = pairs
    rows = np.arange(count)
    ahead, behind = rows.copy(), rows.copy()
    # A photon has one neighbour at most on either side.
    ahead[a], behind[b] = b, a
    return ahead, behind, rows


def growth_of(photons: PhotonMap, beside: tuple[Pairs, Pairs]) -> np.ndarray:
    """∂_u S_u + ∂_v S_v of the shifts S of photons: by which part cells that ride grow, shape [n]."""
    return sum(differences(photons.shift, pairs)[:, axis] for axis, pairs in enumerate(beside))
