"""Portions of the light: the cells whose light is looked at, and all others, each on lattices of its own.

Both are cells of one lattice, of which those that are looked at are cut into finer ones. So no light is counted twice
and none is left out, wherever the portions meet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.strips import Grid


@dataclass(frozen=True, eq=False)
class Marks:
    """Some cells of a lattice.

    Attributes:
        lattice: Where its cells lie.
        first: The cell that ``marked`` begins with, shape [2].
        marked: Which of the cells from there on they are, shape [u, v]; none beyond.
    """

    lattice: Grid
    first: np.ndarray
    marked: np.ndarray

    def holds(self, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] are among them, shape [n]."""
        places = cells - self.first
        inside = np.all((places >= 0) & (places < self.marked.shape), axis=1)
        u, v = np.where(inside[:, None], places, 0).T
        return inside & self.marked[u, v]

    def on(self, other: Grid, beside: float = 0.0) -> Marks:
        """The cells of another lattice on the same side of the light that have any part of these.

        Args:
            beside: How far beside them a cell may lie, in its own steps.
        """
        mine, theirs = (np.array([grid.origin, grid.step]) for grid in (self.lattice, other))
        ends = mine[0] + np.stack([self.first, self.first + self.marked.shape]) * mine[1]
        low, high = (ends - theirs[0]) / theirs[1]
        first, stop = np.floor(low - beside).astype(np.int64), np.ceil(high + beside).astype(np.int64)
        # What lies within a rectangle of cells, from sums over those before each corner.
        sums = np.pad(self.marked.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        begins, ends = [], []
        for axis in (0, 1):
            cells = np.arange(first[axis], stop[axis])
            edges = [theirs[0, axis] + (cells + by) * theirs[1, axis] for by in (-beside, 1.0 + beside)]
            places = [(edge - mine[0, axis]) / mine[1, axis] - self.first[axis] for edge in edges]
            size = self.marked.shape[axis]
            # A cell that ends where another begins, but for rounding, has no part of it.
            begins.append(np.floor(places[0] + 1e-4).astype(np.int64).clip(0, size))
            ends.append(np.ceil(places[1] - 1e-4).astype(np.int64).clip(0, size))
        (u0, v0), (u1, v1) = begins, ends
        inside = sums[u1][:, v1] - sums[u0][:, v1] - sums[u1][:, v0] + sums[u0][:, v0]
        return Marks(other, first, inside > 0)


@dataclass(frozen=True, eq=False)
class Portion:
    """The cells of the lattices of a plan that are emitted, of all that meet anything specular.

    Attributes:
        marks: Cells that are looked at, by the number of their lattice; of others none are.
        seen: Whether it is those that are emitted, or all others.
        share: How many cells are emitted, as a part of all.
        finer: Into how many cells of the plan one that is marked is cut along u and along v.
    """

    marks: Mapping[int, Marks]
    seen: bool
    share: float
    finer: tuple[int, int] = (1, 1)

    def holds(self, lattice: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] are emitted, by the number of the lattice that each lies on [n]; shape [n]."""
        marked = np.zeros(len(cells), bool)
        for number, marks in self.marks.items():
            mine = lattice == number
            if mine.any():
                marked[mine] = marks.holds(cells[mine].astype(np.int64) // self.finer)
        return marked == self.seen

    def cut(self, lattice: int, patch: Patch) -> bool:
        """Cuts a patch to what of it may be emitted; whether that is anything.

        Args:
            lattice: Number of the lattice in its plan.
            patch: All that its light emits there; it is changed.
        """
        if not self.seen:
            return True
        if lattice not in self.marks:
            return False
        marks = self.marks[lattice]
        first, count = np.array([[patch.first_u, patch.first_v], [patch.count_u, patch.count_v]])
        low = np.maximum(first, marks.first * self.finer)
        high = np.minimum(first + count, (marks.first + marks.marked.shape) * self.finer)
        (patch.first_u, patch.first_v), (patch.count_u, patch.count_v) = map(int, low), map(int, high - low)
        return bool(np.all(high > low))

    def cells_of(self, lattice: int, patch: Patch) -> ChosenCells:
        """Those cells of a patch, by the number of its lattice."""
        cells = ChosenCells.of_patch(patch).cell
        return ChosenCells(cells[self.holds(np.full(len(cells), lattice), cells)])

    def on(self, lattices: Sequence[Grid], beside: float) -> Portion:
        """About the same part of the light on the lattices of another plan, with what lies beside it.

        Args:
            beside: How far, in steps of those.
        """
        marks = {number: mine.on(lattices[number], beside) for number, mine in self.marks.items()}
        return Portion(marks, self.seen, self.share)
