"""Irradiance from the nearest photons (Jensen's estimate), by SciPy's k-d trees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.footprints.gather import SMALLEST_COSINE
from tpdwarp.footprints.irradiance import Irradiance, Lookup, QueryArrays, has_shading_normals
from tpdwarp.footprints.placing import LARGEST_SHADING_RATIO
from tpdwarp.photons.photon_map import PhotonMap

# Photons on the other side of a thin receiver are passed over; no more than so many times k are searched for others.
# Chosen, not derived.
MOST_SEARCHED = 8
# Distances held in memory at a time: 64 MB of them and of their indices.
BATCH = 1 << 22
# In the tracer's units, in which the scene is of unit size: photons on one spot make no infinite light. Some 16
# roundings of positions.
SMALLEST_RADIUS = 1.0e-6
# Of a photon's part of the shutter, within a query's window: less counts as nothing, as SHORTEST_OVERLAP in the gather.
SMALLEST_SHARE = 1.0e-6


def tree_type() -> Any:
    """SciPy's k-d tree.

    Raises:
        InputError: SciPy is not installed.
    """
    try:
        from scipy.spatial import cKDTree
    except ImportError as error:
        raise InputError("--estimator tdpm needs SciPy (pip install 'tpdwarp[study]')") from error
    return cKDTree


@dataclass(frozen=True, eq=False)
class _Nearby:
    """Photons to search: their tree, normals [n, 3], flux [n, 3], and incidence [n, 3] on smooth receivers."""

    tree: Any
    normal: np.ndarray
    flux: np.ndarray
    incidence: np.ndarray | None


class NearestField:
    """L = Σ Φ K2(d²/r²)/r² over the k photons nearest in space, r the distance of the last, K2 Epanechnikov's kernel.

    Only photons of the query's own object and side count. Where there are fewer than k, r is the distance of the last
    there is. Queries that move take only the photons whose part of the shutter meets theirs.

    Args:
        maps: Photons, one map an instant; ``time`` and ``duration`` say for which part of the shutter it stands.
        neighbours: k.
        threads: Threads that search.

    Attributes:
        longest_way: Queries may move as far as they like: they are looked up where they stand.
    """

    longest_way = math.inf

    def __init__(self, maps: list[PhotonMap], neighbours: int, threads: int) -> None:
        self._tree_type = tree_type()
        self._neighbours, self._threads = neighbours, threads
        self._position = np.concatenate([m.position for m in maps]).astype(np.float64)
        self._normal = np.concatenate([m.normal for m in maps])
        self._flux = np.concatenate([m.flux for m in maps]).astype(np.float64)
        shaded = all(len(m.incidence) == len(m) for m in maps)
        self._incidence = np.concatenate([m.incidence for m in maps]) if shaded else None
        self._receiver = np.concatenate([m.receiver for m in maps])
        self._parts = [(len(m), m.time - 0.5 * m.duration, m.time + 0.5 * m.duration) for m in maps]
        self._trees: dict[tuple[int, float, float], _Nearby] = {}

    def of_photons(self, maps: list[PhotonMap]) -> NearestField:
        """The same estimate from other photons."""
        return NearestField(maps, self._neighbours, self._threads)

    def irradiance(self, queries: QueryArrays, lookup: Lookup) -> Irradiance:
        """Irradiance at ``queries``, as :func:`tpdwarp.footprints.gather.gather` gives it; photons have no motion."""
        position, normal, receiver = (getattr(queries, name).numpy() for name in ("position", "normal", "receiver"))
        shading = queries.shading_normal.numpy() if has_shading_normals(queries) else normal
        light, found = np.zeros((len(receiver), 3)), np.zeros(len(receiver), np.int32)
        middles = np.broadcast_to(lookup.windows()[:, 1], len(receiver))
        for owner, middle in np.unique(np.column_stack([receiver, middles])[receiver >= 0], axis=0):
            rows = np.flatnonzero((receiver == owner) & (middles == middle))
            nearby = self._nearby(int(owner), float(middle), lookup.window[1])
            light[rows], found[rows] = self._estimate(nearby, position[rows], normal[rows], shading[rows])
        if not lookup.with_motion:
            return Irradiance(light)
        return Irradiance(light, np.zeros_like(light), light.sum(axis=1), found)

    def _nearby(self, receiver: int, center: float, length: float) -> _Nearby:
        """The photons of a receiver in a window of the shutter, with the flux they have there."""
        key = (receiver, center, length)
        if key not in self._trees:
            # As in the gather: the share of the photon's part of the shutter that lies in the window, by its length.
            shares = [
                max(0.0, min(end, center + 0.5 * length) - max(start, center - 0.5 * length)) / ((end - start) * length)
                for _, start, end in self._parts
            ]
            share = np.repeat(shares, [count for count, _, _ in self._parts])
            rows = np.flatnonzero((self._receiver == receiver) & (share > SMALLEST_SHARE))
            tree = self._tree_type(self._position[rows])
            incidence = None if self._incidence is None else self._incidence[rows]
            self._trees[key] = _Nearby(tree, self._normal[rows], self._flux[rows] * share[rows, None], incidence)
        return self._trees[key]

    def _estimate(
        self, nearby: _Nearby, position: np.ndarray, normal: np.ndarray, shading: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        light, found = np.zeros((len(position), 3)), np.zeros(len(position), np.int32)
        count = len(nearby.flux)
        if not count:
            return light, found
        pending, fetched = np.arange(len(position)), min(self._neighbours, count)
        while len(pending):
            unfinished = []
            for rows in _batches(pending, max(1, BATCH // fetched)):
                distances, indices = nearby.tree.query(position[rows], range(1, fetched + 1), workers=self._threads)
                beside = np.einsum("nkc,nc->nk", nearby.normal[indices], normal[rows]) > SMALLEST_COSINE
                place = beside.cumsum(axis=1)
                last = fetched >= min(MOST_SEARCHED * self._neighbours, count)
                done = (place[:, -1] >= self._neighbours) | last
                counted = beside & (place <= self._neighbours)
                radius = np.maximum(np.where(counted, distances, 0.0).max(axis=1), SMALLEST_RADIUS)
                weights = _epanechnikov(distances / radius[:, None]) / radius[:, None] ** 2
                weights[~counted] = 0.0
                if nearby.incidence is not None:
                    ratio = np.einsum("nkc,nc->nk", nearby.incidence[indices], shading[rows])
                    weights *= ratio.clip(0.0, LARGEST_SHADING_RATIO)
                sums = np.einsum("nk,nkc->nc", weights, nearby.flux[indices])
                light[rows[done]], found[rows[done]] = sums[done], counted[done].sum(axis=1)
                unfinished.append(rows[~done])
            pending = np.concatenate(unfinished)
            fetched = min(2 * fetched, count)
        return light, found


def _epanechnikov(y: np.ndarray) -> np.ndarray:
    """Table 1's kernel K2, whose integral over the unit disk is one."""
    return (2.0 / np.pi) * np.maximum(1.0 - y * y, 0.0)


def _batches(rows: np.ndarray, size: int) -> Iterator[np.ndarray]:
    for first in range(0, len(rows), size):
        yield rows[first : first + size]
