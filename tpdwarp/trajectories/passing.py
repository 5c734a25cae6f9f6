"""Passing edges: for how much of a part of the shutter a path exists that begins or ends between two parts.

Cells that change are traced at the middles of the parts of a shutter (:mod:`.parts`). A path that is there in one of
them and not in the next ends somewhere between; taken for half of the way, edges that pass over many cells within a
part would stand still in between and leave steps. In each of the two parts the edge is where the cells on the path are
beside those that are not. So with d cells from a cell to the edge in the part in which its path is there, and d' from
it to the edge in the other, the edge passes it after

    d/(d + d')

of the time between: exact for edges that pass evenly. Distances in whole cells are as wrong as half a cell, which shows
as noise where an edge passes over bright light. So where light is steady until it is cut off, and an edge is straight,
they are taken from all cells around: of these the part on this side of the edge tells how far that is.

Where a path has no edge near in the other part, since a body or a gap came into the light in between, nothing tells
when; such cells are traced at more instants.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.row_numbers import row_numbers
from tpdwarp.photons.vectors import lengths as lengths_of
from tpdwarp.trajectories.retraced import LEAST_LIGHT, RetracedCells, Window, cell_of, distances, grown

# Cells that an edge is looked for from each; of one farther off it is not known when it passes, since what lies as far
# may be another edge, at rest. Chosen on a board that uncovers half a glass torus in the last fifth of a shutter, 16 k
# photons: with 32 it errs by .26, with 12 by .20, with 6 by .12 for a third more CPU time.
FARTHEST = 6
# Cells that stay as they are from one part to the next tell of edges that go by as many cells between. Chosen on a
# stick that passes above a lens (``scripts/benchmarks/strangers.py stick-over-a-bowl``): with 6 it errs by .037, with
# 12 by .025.
FARTHEST_KEPT = 12
# Deviation [cells] of the normal weights with which cells around one tell how far it lies from an edge, and how many
# cells these go. Chosen on a board over still water (``scripts/benchmarks/solids.py board-over-water``, 16 k photons):
# with 1.1 it errs by .031, with 1.5 by .030, without by .032.
BLUR, REACH = 1.5, 4
# The part of these weights that belongs to cells that tell, at least. Chosen, not derived.
LEAST_KNOWN = 0.7
# Beyond so many deviations from an edge too few cells lie on its other side to tell. Chosen, not derived.
MOST_DEVIATIONS = 2.2
# How far [cells] the two distances may differ: where they do by more, the edge is no straight one, or there are two.
# Chosen on a cube that turns, whose edges cross: it errs by .0423 with this alone, by .0435 without (16 k photons).
LARGEST_DIFFERENCE = 0.75
# Light that changes by less than this from part to part is cut off, and does not fade. Chosen, not derived.
LARGEST_CHANGE = 0.1
# So is that which moves by less than so many lengths of its footprint within a part. Chosen on a prism at the end of
# total reflection, whose light grows as the root of the time: with one it errs by .027, with a half by .026.
LONGEST_WAY = 0.5
# Cells that those around are looked up of at once, so that these stay in the cache.
LOOKED_UP = 1 << 12
_APART = np.arange(-REACH, REACH + 1) ** 2
_WEIGHTS = np.exp(-0.5 * (_APART[:, None] + _APART) / BLUR**2).ravel()
_DEVIATIONS = np.linspace(-MOST_DEVIATIONS, MOST_DEVIATIONS, 129)
_NORMAL = np.array([0.5 * math.erfc(-s / math.sqrt(2.0)) for s in _DEVIATIONS])


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
    first_of_parts = np.cumsum([len(photons) for photons in maps])[:-1]
    numbers, lattices = np.split(numbers, first_of_parts), np.split(lattice, first_of_parts)
    flux = [photons.flux.sum(axis=1, dtype=np.float64) for photons in maps]
    calm = [np.where(_is_calm(photons), weights, 0.0) for photons, weights in zip(maps, flux, strict=True)]
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
        power, dark = np.zeros(there.shape), np.broadcast_to(known, there.shape).copy()
        for part, (photons, lattice) in enumerate(zip(maps, lattices, strict=True)):
            lit = cell_of(photons)[lattice == lattice_of[name]]
            u, v = window.at(lit[window.holds(lit)])
            dark[part, u, v] = False
        for part, (u, v) in enumerate(places):
            there[part, u, v] = True
            power[part, u, v] = calm[part][rows[part]] / lengths[part]
        extent, unknown = _extents(there, known, power, lengths, dark)
        for part, (u, v) in enumerate(places):
            found[part].extent[rows[part]] = extent[part, u, v]
            found[part].before[rows[part]], found[part].after[rows[part]] = unknown[:, part, u, v]
    return found


def _is_calm(photons: PhotonMap) -> np.ndarray:
    """Which photons go hardly anywhere in their part of the shutter, shape [n]."""
    return lengths_of(photons.dxdt - photons.receiver_motion) <= LONGEST_WAY * photons.size


def _finer_shares(
    there: np.ndarray, tells: np.ndarray, passings: _Passings, d: np.ndarray, beyond: np.ndarray
) -> np.ndarray:
    """The shares d/(d + d') with parts of cells for d and d', where an edge is straight; else NaN; shape [n].

    Args:
        there: Where the path is there in each part, shape [parts, u, v].
        tells: Cells that tell of the edge, shape [u, v].
        d, beyond: Distances of the cells of ``passings`` in whole cells, shape [n].
    """
    inside, outside = _from_edges(there, tells, passings) * np.array([[1.0], [-1.0]])
    way = inside + outside
    # The nearest cell on the other side lies half a cell beyond the edge.
    apart = np.maximum(np.abs(inside - d + 0.5), np.abs(outside - beyond + 0.5))
    straight = (way > 0.5) & (apart < LARGEST_DIFFERENCE)
    return np.where(straight, np.clip(inside / np.where(straight, way, 1.0), 0.0, 1.0), np.nan)


def _from_edges(there: np.ndarray, tells: np.ndarray, passings: _Passings) -> np.ndarray:
    """How many cells those of ``passings`` lie within an edge in the part in which their path is there, and in the
    other one, negative beyond it, NaN where that is unknown; shape [2, n]; other arguments as of :func:`_finer_shares`.

    Each cell around shows at one place of it whether the path is there: by normal weights a straight edge at the
    distance s leaves the part Φ(s/σ) of them, whatever its direction.
    """
    # What tells of the path, and the path in each part, as bits of one grid, so that cells around are looked up once.
    dtype = np.min_scalar_type((2 << len(there)) - 1)
    one = dtype.type(1)
    bits = np.zeros([size + 2 * REACH for size in tells.shape], dtype)
    within = bits[REACH:-REACH, REACH:-REACH]
    within |= tells.astype(dtype)
    for number, grid in enumerate(there):
        within |= (grid & tells).astype(dtype) << dtype.type(number + 1)
    offsets = (np.arange(2 * REACH + 1)[:, None] * bits.shape[1] + np.arange(2 * REACH + 1)).ravel()
    first = passings.u * bits.shape[1] + passings.v
    numbers = np.stack([passings.part, passings.other])[..., None].astype(dtype) + one
    lit = np.empty((2, len(first)))
    for begin in range(0, len(first), LOOKED_UP):
        rows = slice(begin, begin + LOOKED_UP)
        around = bits.ravel().take(first[rows, None] + offsets)
        whole = (around & one) @ _WEIGHTS
        enough = whole > LEAST_KNOWN * _WEIGHTS.sum()
        share = (around >> numbers[:, rows] & one) @ _WEIGHTS
        lit[:, rows] = np.divide(share, whole, out=np.full(share.shape, np.nan), where=enough)
    deviations = np.interp(lit, _NORMAL, _DEVIATIONS, left=np.nan, right=np.nan)
    # Places are spread evenly over their cells.
    return math.sqrt(BLUR**2 + 1.0 / 12.0) * deviations


def _extents(
    there: np.ndarray, known: np.ndarray, power: np.ndarray, lengths: np.ndarray, dark: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How much of each part a path stands for, shape [parts, u, v], and where its begin or its end is not known, shape
    [2, parts, u, v].

    Args:
        there: Where the path is there in each part, shape [parts, u, v].
        known: The cells that were traced, shape [u, v].
        power: Flux by time of what is there and does not go far, else 0, shape [parts, u, v].
        lengths: Of the parts, shape [parts].
        dark: Which cells that were traced have light on no path in each part, shape [parts, u, v].
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
    # What stays as it is from one part to the next tells edges apart: the other side of a stick, or of a gap, that is
    # narrower than its way leaves cells behind which have changed, too.
    kept = [distances(of[:-1] & of[1:] & changes, FARTHEST_KEPT, ends | begins) for of in (absent, there)]
    # Where an edge at rest goes, on both sides of it, cells tell of that one.
    always, at_no_time = known & there.all(axis=0), known & ~there.any(axis=0)
    tells = known & ~(grown(always, 2) & at_no_time) & ~(grown(at_no_time, 2) & always)
    extents, unknown = np.ones(there.shape), np.zeros((2, *there.shape), bool)
    for side, passings in enumerate((_Passings.of(begins, 1, 0), _Passings.of(ends, 0, 1))):
        part, other, u, v = passings.part, passings.other, passings.u, passings.v
        d, beyond = inside[part, u, v].astype(np.float64), outside[other, u, v].astype(np.float64)
        near = (d <= FARTHEST) & (beyond <= FARTHEST)
        of_kept = np.stack([of[np.minimum(part, other), u, v] for of in kept])
        told = (of_kept.sum(axis=0) <= FARTHEST_KEPT) & dark[other, u, v] & (power[part, u, v] > 0.0)
        d[told], beyond[told] = of_kept[:, told]
        near |= told
        unknown[side, part, u, v] = ~near
        # Half way where no edge is near in either.
        share = np.where(near, d / (d + beyond), 0.5)
        behind = 2 * part - other
        seen = (behind >= 0) & (behind < len(there))
        now, before = power[part, u, v], power[np.where(seen, behind, part), u, v]
        near = near & seen & (np.abs(now - before) < LARGEST_CHANGE * now)
        finer = _finer_shares(there, tells, passings.rows(near), d[near], beyond[near])
        share[near] = np.where(np.isfinite(finer), finer, share[near])
        between = 0.5 * (lengths[part] + lengths[other])
        extents[part, u, v] += share * between / lengths[part] - 0.5
    return extents, unknown


@dataclass(frozen=True, eq=False)
class _Passings:
    """Edges that pass cells between one part and the next, one row a cell.

    Attributes:
        part, other: In which part the path is there, and in which of those beside it it is not; shape [n].
        u, v: The cell.
    """

    part: np.ndarray
    other: np.ndarray
    u: np.ndarray
    v: np.ndarray

    @classmethod
    def of(cls, passed: np.ndarray, part: int, other: int) -> _Passings:
        """Those of a grid [parts − 1, u, v], each between a part and the next one.

        Args:
            part, other: Which of these two, 0 or 1, are those of the attributes.
        """
        first, u, v = np.nonzero(passed)
        return cls(first + part, first + other, u, v)

    def rows(self, chosen: np.ndarray) -> _Passings:
        """Some of them."""
        return _Passings(self.part[chosen], self.other[chosen], self.u[chosen], self.v[chosen])
