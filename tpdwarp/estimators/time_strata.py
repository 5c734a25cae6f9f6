"""Photons dealt out between instants of the shutter: each has one random time, and neighbours have different ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tpdwarp.photons.emission import Patch


def instants(count: int, seed: int) -> np.ndarray:
    """A random instant in each of ``count`` equal parts of the shutter, as fractions of it, shape [count]."""
    return (np.arange(count) + np.random.default_rng(seed).random(count)) / count


def dealt_cells(number: int, count: int, seed: int) -> Callable[[Patch], np.ndarray]:
    """Chooses the lattice cells whose photons belong to instant ``number`` of ``count``.

    The lattice is cut into square blocks of at least ``count`` cells; in each, the instants are shuffled, so that the
    photons of any neighbourhood are spread evenly over the shutter. A cell keeps its instant from frame to frame.
    """

    def chosen(patch: Patch) -> np.ndarray:
        return np.flatnonzero(_numbers(patch, count, seed) == number)

    return chosen


def _numbers(patch: Patch, count: int, seed: int) -> np.ndarray:
    """The instant of each cell of ``patch``, shape [count_u · count_v]."""
    side = math.ceil(math.sqrt(count))
    first = np.array([patch.first_u, patch.first_v]) // side * side
    blocks_u, blocks_v = (
        -(-(start + size - corner) // side)
        for start, size, corner in zip(
            (patch.first_u, patch.first_v), (patch.count_u, patch.count_v), first, strict=True
        )
    )
    u, v = first[0] + np.arange(blocks_u * side), first[1] + np.arange(blocks_v * side)
    keys = _hashed(u[None, :], v[:, None], seed).reshape(blocks_v, side, blocks_u, side).swapaxes(1, 2)
    ranks = keys.reshape(blocks_v, blocks_u, side * side).argsort(axis=2, kind="stable").argsort(axis=2, kind="stable")
    numbers = ranks.reshape(blocks_v, blocks_u, side, side).swapaxes(1, 2).reshape(len(v), len(u)) * count // side**2
    down, right = patch.first_v - first[1], patch.first_u - first[0]
    return numbers[down : down + patch.count_v, right : right + patch.count_u].ravel()


def _hashed(u: np.ndarray, v: np.ndarray, seed: int) -> np.ndarray:
    """A pseudo-random 64-bit number for each cell (the finaliser of SplitMix64)."""
    with np.errstate(over="ignore"):
        z = u.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) + v.astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
        z = z + np.uint64(seed) * np.uint64(0x165667B19E3779F9)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))
