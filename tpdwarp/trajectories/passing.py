"""Passing edges: for how much of a part of the shutter a path exists that begins or ends between two parts.

Cells that change are traced at the middles of the parts of a shutter (:mod:`.parts`). A path that is there in one of
them and not in the next ends somewhere between; taken for half of the way, edges that pass over many cells within a
part would stand still in between and leave steps. In each of the two parts the edge is where the cells on the path are
beside those that are not. So with d cells from a cell to the edge in the part in which its path is there, and d' from
it to the edge in the other, the edge passes it after

    d/(d + d')

of the time between: exact for edges that pass evenly.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.retraced import LEAST_LIGHT, RetracedCells, Window, cell_of, distances

# Cells that an edge is looked for from each; farther off it passes in the middle of the time between. Chosen, not
# derived: a quarter of a million photons over a picture that an edge passes in one shutter have it go as far in a part.
FARTHEST = 32


def parts_of_existence(maps: Sequence[PhotonMap], changing: RetracedCells) -> list[np.ndarray]:
    """How much of its part each photon stands for, of each of ``maps`` [n]: one where its path goes on to either side.

    Args:
        maps: Photons of all parts of a shutter, in the order of time.
        changing: The cells that were traced.
    """
    extents = [np.ones(len(photons)) for photons in maps]
    plan = changing.plan
    lengths = np.array([photons.duration for photons in maps])
    keys = []
    for photons in maps:
        mask, lattice, planned = plan.paths_of(photons.ids)
        keys.append(np.stack([np.where(planned, lattice, -1), mask, photons.path.astype(np.int64)], axis=1))
    names, numbers = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    splits = np.cumsum([len(photons) for photons in maps])[:-1]
    numbers = np.split(numbers.reshape(-1), splits)
    flux = [photons.flux.sum(axis=1, dtype=np.float64) for photons in maps]
    light = sum(np.bincount(of, weights, len(names)) for of, weights in zip(numbers, flux, strict=True))
    for name in np.flatnonzero(light > LEAST_LIGHT * light.sum()):
        cells = changing.cells.get(int(names[name, 0]))
        if cells is None:
            continue
        window = Window.around(cells.cell, margin=1)
        known = window.grid(dtype=bool)
        known[window.at(cells.cell)] = True
        rows = [np.flatnonzero(of == name) for of in numbers]
        there = np.zeros((len(maps), *window.size), bool)
        places = [window.at(cell_of(photons)[chosen]) for photons, chosen in zip(maps, rows, strict=True)]
        for part, (u, v) in enumerate(places):
            there[part, u, v] = True
        extent = _extents(there, known, lengths)
        for part, (u, v) in enumerate(places):
            extents[part][rows[part]] = extent[part, u, v]
    return extents


def _extents(there: np.ndarray, known: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """How much of each part a path stands for, shape [parts, u, v].

    Args:
        there: Where the path is there in each part, shape [parts, u, v].
        known: The cells that were traced, shape [u, v].
        lengths: Of the parts, shape [parts].
    """
    absent = known & ~there
    # Of what is there how far from what is not, and of what is not how far from what is.
    inside, outside = distances(absent, FARTHEST), distances(there, FARTHEST)
    extents = np.ones(there.shape)
    for part in range(len(there)):
        for other in (part - 1, part + 1):
            if 0 <= other < len(there):
                ends = there[part] & absent[other]
                d, beyond = inside[part][ends].astype(np.float64), outside[other][ends]
                # Half way where no edge is near in either.
                share = np.where((d <= FARTHEST) & (beyond <= FARTHEST), d / (d + beyond), 0.5)
                between = 0.5 * (lengths[part] + lengths[other])
                extents[part][ends] += share * between / lengths[part] - 0.5
    return extents
