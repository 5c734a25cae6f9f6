"""Passing edges: for how much of a part of the shutter a path exists that begins or ends between two parts.

Cells that change are traced at the middles of the parts of a shutter (:mod:`.parts`). A path that is there in one of
them and not in the next ends somewhere between; taken for half of the way, edges that pass over many cells within a
part would stand still in between and leave steps. In each of the two parts the edge is where the cells on the path are
beside those that are not. So with d cells from a cell to the edge in the part in which its path is there, and d' from
it to the edge in the other, the edge passes it after

    d/(d + d')

of the time between: exact for edges that pass evenly. Where a path has no edge near in the other part, since a body or
a gap came into the light in between, nothing tells when; such cells are traced at more instants.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import math
from statistics import NormalDist

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.row_numbers import row_numbers
from tpdwarp.trajectories.retraced import LEAST_LIGHT, RetracedCells, Window, cell_of, distances, grown

# Cells that an edge is looked for from each; of one farther off it is not known when it passes, since what lies as far
# may be another edge, at rest. Chosen on a board that uncovers half a glass torus in the last fifth of a shutter, 16 k
# photons: with 32 it errs by .26, with 12 by .20, with 6 by .12 for a third more CPU time.
FARTHEST = 6
BLUR, REACH, LEAST_KNOWN = 1.5, 4, 0.7
NEAR = 0.75
STEADY = 0.1
CALM = 0.5


@dataclass(frozen=True, eq=False)
class Existence:
    """In how much of a part of the shutter paths of photons exist.

    Attributes:
        extent: How much of its part each photon stands for, shape [n]: one where its path goes on to either side.
        before, after: Whose path begins after the part before, or ends before the part after, nobody knows when: there
            it is taken for the middle of the time between; both [n] bool.
    """

    extent: np.ndarray
    before: np.ndarray
    after: np.ndarray


def parts_of_existence(maps: Sequence[PhotonMap], changing: RetracedCells) -> list[Existence]:
    """In how much of its part the path of each photon exists, for each of ``maps``.

    Args:
        maps: Photons of all parts of a shutter, in the order of time.
        changing: The cells that were traced.
    """
    found = [Existence(np.ones(len(photons)), *(np.zeros(len(photons), bool) for _ in range(2))) for photons in maps]
    plan = changing.plan
    lengths = np.array([photons.duration for photons in maps])
    ids, paths = (np.concatenate([getattr(photons, name) for photons in maps]) for name in ("ids", "path"))
    mask, lattice, planned = plan.paths_of(ids)
    lattice = np.where(planned, lattice, -1)
    numbers = row_numbers(lattice, mask, paths)
    lattice_of = np.zeros(int(numbers.max(initial=-1)) + 1, np.int64)
    lattice_of[numbers] = lattice
    numbers = np.split(numbers, np.cumsum([len(photons) for photons in maps])[:-1])
    flux = [photons.flux.sum(axis=1, dtype=np.float64) for photons in maps]
    light = sum(np.bincount(of, weights, len(lattice_of)) for of, weights in zip(numbers, flux, strict=True))
    for name in np.flatnonzero(light > LEAST_LIGHT * light.sum()):
        cells = changing.cells.get(int(lattice_of[name]))
        if cells is None:
            continue
        rows = [np.flatnonzero(of == name) for of in numbers]
        there_cells = [cell_of(photons)[chosen] for photons, chosen in zip(maps, rows, strict=True)]
        window = Window.around(np.concatenate(there_cells), margin=FARTHEST)
        known, there = window.grid(dtype=bool), np.zeros((len(maps), *window.size), bool)
        known[window.at(cells.cell[window.holds(cells.cell)])] = True
        places = [window.at(cell) for cell in there_cells]
        for part, (u, v) in enumerate(places):
            there[part, u, v] = True
        power = window.grid(dtype=np.float32)[None].repeat(len(maps), axis=0)
        for part, (u, v) in enumerate(places):
            m = maps[part].rows(rows[part])
            calm = np.linalg.norm(m.dxdt - m.receiver_motion, axis=1) <= CALM * m.size
            power[part, u, v] = np.where(calm, flux[part][rows[part]] / lengths[part], 0.0)
        extent, unknown = _extents(there, known, lengths, power)
        for part, (u, v) in enumerate(places):
            found[part].extent[rows[part]] = extent[part, u, v]
            found[part].before[rows[part]], found[part].after[rows[part]] = unknown[:, part, u, v]
    return found


def _from_edge(there: np.ndarray, valid: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """How many cells those ``wanted`` of a grid lie within an edge, negative beyond it; shape [n], NaN of others."""
    padded_there, padded = (np.pad(grid, REACH) for grid in (there & valid, valid))
    u, v = np.nonzero(wanted)
    share, whole = np.zeros(len(u)), np.zeros(len(u))
    for du in range(2 * REACH + 1):
        for dv in range(2 * REACH + 1):
            weight = math.exp(-((du - REACH) ** 2 + (dv - REACH) ** 2) / (2.0 * BLUR**2))
            share += weight * padded_there[u + du, v + dv]
            whole += weight * padded[u + du, v + dv]
    total = sum(math.exp(-(d**2) / (2.0 * BLUR**2)) for d in range(-REACH, REACH + 1)) ** 2
    lit = np.where(whole > LEAST_KNOWN * total, share / np.maximum(whole, 1e-30), np.nan)
    lit = np.where((lit > 0.015) & (lit < 0.985), lit, np.nan)
    return math.sqrt(BLUR**2 + 1.0 / 12.0) * np.array([NormalDist().inv_cdf(x) if x == x else np.nan for x in lit])


def _extents(there: np.ndarray, known: np.ndarray, lengths: np.ndarray, power) -> tuple[np.ndarray, np.ndarray]:
    """How much of each part a path stands for, shape [parts, u, v], and where its begin or its end is not known, shape
    [2, parts, u, v].

    Args:
        there: Where the path is there in each part, shape [parts, u, v].
        known: The cells that were traced, shape [u, v].
        lengths: Of the parts, shape [parts].
    """
    absent = known & ~there
    # What ends or begins between one part and the next.
    ends, begins = there[:-1] & absent[1:], absent[:-1] & there[1:]
    never = np.zeros_like(there[:1])
    passed = np.concatenate([ends, never]) | np.concatenate([never, begins])
    to_pass = np.concatenate([begins, never]) | np.concatenate([never, ends])
    # Of what is there how far from what is not, and of what is not how far from what is; what always is the one or the
    # other lies at an edge at rest, such as the rim of a body.
    changes = there.any(axis=0) & absent.any(axis=0)
    inside, outside = distances(absent & changes, FARTHEST, passed), distances(there & changes, FARTHEST, to_pass)
    # Beyond the first instant and the last nothing shows what changes: there any counts where no other is near.
    for part in (0, len(there) - 1):
        for nearest, sources, wanted in ((inside, absent, passed), (outside, there, to_pass)):
            lost = wanted[part] & (nearest[part] > FARTHEST)
            if lost.any():
                nearest[part][lost] = distances(sources[part], FARTHEST, lost)[lost]
    always, never_there = known & there.all(axis=0), known & ~there.any(axis=0)
    valid = known & ~(grown(always, 2) & never_there) & ~(grown(never_there, 2) & always)
    extents, unknown = np.ones(there.shape), np.zeros((2, *there.shape), bool)
    for part in range(len(there)):
        for side, (other, chosen) in enumerate(((part - 1, begins), (part + 1, ends))):
            if 0 <= other < len(there):
                here = chosen[min(part, other)]
                d, beyond = inside[part][here].astype(np.float64), outside[other][here]
                near = (d <= FARTHEST) & (beyond <= FARTHEST)
                unknown[side, part][here] = ~near
                # Half way where no edge is near in either.
                share = np.where(near, d / (d + beyond), 0.5)
                own, far = _from_edge(there[part], valid, here), _from_edge(there[other], valid, here)
                fine = near & np.isfinite(own) & np.isfinite(far) & (own - far > 0.5)
                before = 2 * part - other
                if 0 <= before < len(there):
                    fine &= (power[part][here] > 0) & (power[before][here] > 0)
                    fine &= np.abs(power[before][here] - power[part][here]) < STEADY * power[part][here]
                else:
                    fine &= False
                fine &= (np.abs(own - d + 0.5) < NEAR) & (np.abs(far + beyond - 0.5) < NEAR)
                share = np.where(fine, np.clip(own / np.where(fine, own - far, 1.0), 0.0, 1.0), share)
                between = 0.5 * (lengths[part] + lengths[other])
                extents[part][here] += share * between / lengths[part] - 0.5
    return extents, unknown
