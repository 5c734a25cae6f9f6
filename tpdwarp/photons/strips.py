"""Strips of the light: photons that are too many to hold at once are traced and looked up strip after strip.

Each strip is some lattices, of the first and the last of them some rows of cells, and rows beside these that the
neighbours of its photons lie in. They are traced with two strips and count in one, so that the footprints of all strips
add up to those of whole lattices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tpdwarp.photons.emission import ChosenCells, Patch

# Photons that are sent at once, about: with what is known of them they take 1 GB. Chosen, not derived.
PHOTONS_OF_STRIP = 1 << 20
# Rows beside a strip that are traced with it: as many as neighbours are looked for in, and some.
BESIDE = 8


class Grid(Protocol):
    """Cells of a lattice: the lower corner of cell (0, 0), and their size."""

    @property
    def origin(self) -> tuple[float, float]: ...

    @property
    def step(self) -> tuple[float, float]: ...


@dataclass(frozen=True)
class Strip:
    """Rows of cells of each lattice of a plan, across the side with more cells: all of them, some, or none.

    Attributes:
        number: From 0 on. The first strip also has the lattices that are made for one frame.
        count: How many strips there are.
        axes: Along which side of each planned lattice rows are counted, 0 for u, 1 for v.
        first, stop: Where its rows begin and end there, in cells.
    """

    number: int
    count: int
    axes: tuple[int, ...]
    first: tuple[float, ...]
    stop: tuple[float, ...]

    def cut(self, lattice: int, patch: Patch) -> bool:
        """Cuts a patch to these rows and those beside them; whether anything is left of it.

        Args:
            lattice: Number of the lattice in its plan; −1 of one that was made for a frame.
            patch: All that its light emits there; it is changed.
        """
        if lattice < 0:
            return self.number == 0
        low, count = (patch.first_v, patch.count_v) if self.axes[lattice] else (patch.first_u, patch.count_u)
        high = low + count
        low = math.floor(min(high, max(low, self.first[lattice] - BESIDE)))
        high = math.ceil(max(low, min(high, self.stop[lattice] + BESIDE)))
        if self.axes[lattice]:
            patch.first_v, patch.count_v = low, high - low
        else:
            patch.first_u, patch.count_u = low, high - low
        return high > low

    def holds(self, lattice: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] count in this strip, by the number of the lattice that each lies on [n], −1 for one
        that was made for a frame; shape [n]."""
        planned = lattice >= 0
        number = np.where(planned, lattice, 0)
        row = np.take_along_axis(cells, np.array(self.axes)[number][:, None], axis=1)[:, 0]
        mine = (row >= np.array(self.first)[number]) & (row < np.array(self.stop)[number])
        return np.where(planned, mine, self.number == 0)

    def cells_beside(self, lattice: int, patch: Patch) -> ChosenCells:
        """Cells of a patch that is cut which count in other strips; arguments as of :meth:`cut`."""
        cells = ChosenCells.of_patch(patch).cell
        return ChosenCells(cells[~self.holds(np.full(len(cells), lattice), cells)])

    def on(self, lattices: Sequence[Grid], others: Sequence[Grid]) -> Strip:
        """The same strip of the light on as many ``others`` as the ``lattices`` that it is of."""
        ends = [
            tuple(
                (mine.origin[axis] + row * mine.step[axis] - other.origin[axis]) / other.step[axis]
                for axis, row, mine, other in zip(self.axes, rows, lattices, others, strict=True)
            )
            for rows in (self.first, self.stop)
        ]
        return Strip(self.number, self.count, self.axes, ends[0], ends[1])


def strips_of(lattices: int, emitted: Sequence[tuple[int, Patch]], count: int) -> list[Strip]:
    """Strips of as many cells, of one lattice after the other, so that of many lattices most are not cut.

    Args:
        lattices: How many are planned.
        emitted: What they emit, each with its number; those numbered −1 go with the first strip.
        count: Number of strips.
    """
    first, stop = (np.full((lattices, 2), sign * np.inf) for sign in (1.0, -1.0))
    for number, patch in emitted:
        if number >= 0:
            low, size = np.array([patch.first_u, patch.first_v]), np.array([patch.count_u, patch.count_v])
            first[number] = np.minimum(first[number], low)
            stop[number] = np.maximum(stop[number], low + size)
    size = np.maximum(stop - first, 0.0)
    axes, cells = np.argmax(size, axis=1), size.prod(axis=1)
    before = np.cumsum(cells) - cells
    low, across = np.take_along_axis(first, axes[:, None], axis=1)[:, 0], np.maximum(size.min(axis=1), 1.0)
    # What lies beyond all cells that are known goes with the outermost.
    ends = [np.full(lattices, -np.inf)]
    for number in range(1, count):
        past = cells.sum() * number / count - before
        ends.append(np.select([past <= 0.0, past >= cells], [-np.inf, np.inf], np.floor(low + past / across)))
    ends.append(np.full(lattices, np.inf))
    rows = [tuple(end.tolist()) for end in ends]
    return [Strip(n, count, tuple(axes.tolist()), rows[n], rows[n + 1]) for n in range(count)]
