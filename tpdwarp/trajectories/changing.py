"""Light that begins and ends within the shutter: cells whose photons take other paths at its ends than in its middle.

A board passes over the water, a facet turns into view, total reflection sets in, a ball's shadow crosses a caustic:
there, neither D_u x nor D_t x say anything of what the photon of mid shutter stands for at other times. Such cells are
traced again in several parts of the shutter.

Cells ride on the surface as photons do, so that they fit together at all times: at the part s of the shutter a cell
lies s · shift further on the light. Cells that meet nothing go along with those nearest to them. So the border of a
body that moves is no change; what its light meets afterwards may be.

Which cells change is asked of keyframes first, then around those that do of the cells themselves.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.keyframes import END, LARGEST_DRIFT, ShutterKeyframes

# Photons that carry less than this part of their cell's flux are no reason to trace the cell again; nor are those of
# wide footprints, whose share counts by the root of how much narrower others are: what a photon adds to the mean square
# goes with its flux by the root of its area. Chosen, not derived.
LEAST_SHARE = 0.2
# Nor are cells which carry less than this part of the light together. Chosen, not derived: as little as a branch that
# is given up.
LEAST_LIGHT = 0.002
# Parts of the shutter in which cells are traced again. Chosen, not derived: as short as keyframes are.
PARTS = 8

# When keyframes are traced, as parts of the shutter from its middle.
TIMES = (-END, 0.0, END)


@dataclass(frozen=True, eq=False)
class Window:
    """A rectangle of cells of one lattice.

    Attributes:
        first: Its first cell.
        size: Cells along u and along v.
    """

    first: np.ndarray
    size: np.ndarray

    @classmethod
    def around(cls, cells: np.ndarray, margin: int = 0) -> Window:
        """The smallest one that holds ``cells`` [n, 2] and some more on all sides."""
        first, last = cells.min(axis=0) - margin, cells.max(axis=0) + margin
        return cls(first, last - first + 1)

    def grid(self, *width: int, dtype: type = np.float64) -> np.ndarray:
        """Zeros for its cells."""
        return np.zeros((*self.size, *width), dtype)

    def at(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where cells [n, 2] lie in a grid; those outside lie at its border."""
        u, v = (cells - self.first).clip(0, self.size - 1).T
        return u, v

    def holds(self, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] lie in it."""
        return np.all((cells >= self.first) & (cells < self.first + self.size), axis=1)

    def cells(self, chosen: np.ndarray) -> np.ndarray:
        """The cells that a grid of truth values chooses, shape [n, 2]."""
        return np.argwhere(chosen) + self.first


@dataclass(frozen=True, eq=False)
class ChangingCells:
    """Cells that are traced in parts of the shutter of their own.

    Attributes:
        cells: Of each lattice that has any, by its number, with their shift over the whole shutter as offset.
        plan: The lattices.
    """

    cells: dict[int, ChosenCells]
    plan: EmissionPlan

    def __len__(self) -> int:
        return sum(map(len, self.cells.values()))

    def others(self, lattice: Lattice, patch: Patch) -> ChosenCells:
        """The other cells of a patch, which are traced at mid shutter."""
        everything = ChosenCells.of_patch(patch)
        mine = self.cells.get(_number(self.plan, lattice))
        if mine is None:
            return everything
        window = Window.around(mine.cell)
        taken = window.grid(dtype=bool)
        taken[window.at(mine.cell)] = True
        return ChosenCells(everything.cell[~(taken[window.at(everything.cell)] & window.holds(everything.cell))])

    def at(self, part: float) -> Callable[[Lattice, Patch], ChosenCells]:
        """Chooses these cells where they lie at the part ``part`` (−½ … ½) of the shutter."""
        return _riding(self.cells, self.plan, part)


def changing_cells(keyframes: ShutterKeyframes, plan: EmissionPlan, clock: Clock) -> ChangingCells | None:
    """The cells of ``plan`` whose light takes other paths within the shutter; None where none matter."""
    suspects = _suspects(keyframes, plan, clock)
    if not suspects:
        return None
    middle = keyframes.traced(0.0, plan, chosen=_riding(suspects, plan, 0.0))
    with clock.stage("trace"):
        suspects = {
            number: ChosenCells(cells.cell, _own_shift(cells, middle, plan, number))
            for number, cells in suspects.items()
        }
    before, after = (keyframes.traced(part, plan, chosen=_riding(suspects, plan, part)) for part in (-END, END))
    maps = [before, middle, after]
    with clock.stage("trace"):
        # Footprints cover areas that go with those of cells.
        typical = _typical_area(keyframes.photons(0.0)) * keyframes.plan.photons / plan.photons
        found: dict[int, ChosenCells] = {}
        most = np.zeros(len(maps))
        for number, cells in suspects.items():
            window = Window.around(cells.cell)
            here = window.grid(dtype=bool)
            here[window.at(cells.cell)] = True
            changing = _grown(_change(maps, plan, number, window, typical)) & here
            chosen = changing[window.at(cells.cell)]
            if chosen.any():
                found[number] = ChosenCells(cells.cell[chosen], cells.offset[chosen])
                most += [_flux_in(photons, plan, number, window, changing) for photons in maps]
        whole = float(keyframes.photons(0.0).flux.sum(dtype=np.float64))
        if most.max() <= LEAST_LIGHT * max(whole, most.max()):
            return None
    return ChangingCells(found, plan)


def _suspects(keyframes: ShutterKeyframes, plan: EmissionPlan, clock: Clock) -> dict[int, ChosenCells]:
    """The cells of ``plan`` around keyframes' cells that change, with their shift as offset."""
    sparse = keyframes.plan
    maps = [keyframes.photons(part) for part in TIMES]
    with clock.stage("trace"):
        riders: dict[int, ChosenCells] = {}
        windows: dict[int, Window] = {}
        for number in _numbers(maps, sparse):
            cells = np.concatenate([_cells(photons, sparse, number)[1] for photons in maps])
            windows[number] = window = Window.around(cells, margin=1)
            riders[number] = ChosenCells(
                window.cells(np.ones(window.size, bool)), _shifts(maps[1], sparse, number, window).reshape(-1, 2)
            )
        drift = max((END * np.abs(cells.offset).max() for cells in riders.values()), default=0.0)
    if drift > LARGEST_DRIFT:
        ends = [keyframes.traced(part, sparse, chosen=_riding(riders, sparse, part)) for part in (-END, END)]
        maps = [ends[0], maps[1], ends[1]]
    with clock.stage("trace"):
        found: dict[int, ChosenCells] = {}
        typical = _typical_area(maps[1])
        for number, window in windows.items():
            changing = _change(maps, sparse, number, window, typical)
            if changing.any():
                shifts = riders[number].offset.reshape(*window.size, 2)
                found[number] = _finer(plan.lattices[number], sparse.lattices[number], window, changing, shifts)
    return found


def _finer(fine: Lattice, coarse: Lattice, window: Window, changing: np.ndarray, shifts: np.ndarray) -> ChosenCells:
    """The cells of ``fine`` within a cell of those of ``coarse`` that change."""
    wanted = _grown(changing)
    ratio = np.divide(coarse.step, fine.step)
    start = np.subtract(coarse.origin, fine.origin) / fine.step
    inside = window.cells(wanted)
    low = np.floor(inside.min(axis=0) * ratio + start).astype(np.int64)
    high = np.ceil((inside.max(axis=0) + 1) * ratio + start).astype(np.int64)
    cells = Window(low, high - low).cells(np.ones(high - low, bool))
    around = np.floor((cells + 0.5 - start) / ratio).astype(np.int64)
    chosen = window.holds(around) & wanted[window.at(around)]
    return ChosenCells(cells[chosen], (shifts[window.at(around[chosen])] * ratio).astype(np.float32))


def _riding(
    cells: dict[int, ChosenCells], plan: EmissionPlan, part: float
) -> Callable[[Lattice, Patch], ChosenCells]:
    """Chooses ``cells`` of each lattice, moved by the part ``part`` of their offsets."""
    none = ChosenCells(np.zeros((0, 2), np.int64))

    def chosen(lattice: Lattice, patch: Patch) -> ChosenCells:
        mine = cells.get(_number(plan, lattice), none)
        return ChosenCells(mine.cell, None if part == 0.0 or not len(mine) else np.float32(part) * mine.offset)

    return chosen


def _number(plan: EmissionPlan, lattice: Lattice) -> int:
    """Number of a lattice in its plan; −1 for one that was made for a frame alone."""
    return next((number for number, planned in enumerate(plan.lattices) if planned is lattice), -1)


def _numbers(maps: list[PhotonMap], plan: EmissionPlan) -> list[int]:
    """Numbers of the lattices that photons come from."""
    found: set[int] = set()
    for photons in maps:
        _, lattice, planned = plan.paths_of(photons.ids)
        found |= set(np.unique(lattice[planned]).tolist())
    return sorted(found)


def _cells(photons: PhotonMap, plan: EmissionPlan, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the photons of a lattice, and their cells, shape [n, 2]."""
    _, lattice, planned = plan.paths_of(photons.ids)
    rows = np.flatnonzero(planned & (lattice == number))
    return rows, np.floor(photons.emission[rows]).astype(np.int64)


def _areas(photons: PhotonMap) -> np.ndarray:
    """Areas |D_u x × D_v x| of footprints, shape [n]."""
    return np.linalg.norm(np.cross(photons.dxdu.astype(np.float64), photons.dxdv.astype(np.float64)), axis=1)


def _typical_area(photons: PhotonMap) -> float:
    """The median area of footprints, weighted by flux: half of the light falls in smaller ones."""
    areas, flux = _areas(photons), photons.flux.sum(axis=1, dtype=np.float64)
    order = np.argsort(areas)
    return float(areas[order][np.searchsorted(np.cumsum(flux[order]), 0.5 * flux.sum())]) if len(order) else 0.0


def _change(maps: list[PhotonMap], plan: EmissionPlan, number: int, window: Window, typical: float) -> np.ndarray:
    """Cells in which a photon that matters takes a path that none takes in the middle, or at either end of the shutter.

    Args:
        maps: Photons at the opening, in the middle and at the closing.
        number: Of the lattice.
        typical: Area of a footprint that counts as its flux does.
    """
    keys, matter = [], []
    for photons in maps:
        rows, cells = _cells(photons, plan, number)
        inside = window.holds(cells)
        rows, (u, v) = rows[inside], window.at(cells[inside])
        keys.append((u * window.size[1] + v).astype(np.uint64) << np.uint64(32) | photons.path[rows].astype(np.uint64))
        areas = _areas(photons)[rows]
        narrow = np.sqrt(np.minimum(1.0, typical / np.maximum(areas, np.finfo(np.float32).tiny)))
        matter.append(photons.share[rows] * narrow > LEAST_SHARE)
    grid = window.grid(dtype=bool)
    for one, other in ((0, 1), (1, 0), (1, 2), (2, 1)):
        alone = keys[one][matter[one] & ~np.isin(keys[one], keys[other])]
        grid.ravel()[(alone >> np.uint64(32)).astype(np.int64)] = True
    return grid


def _grown(chosen: np.ndarray) -> np.ndarray:
    """Chosen cells of a grid, and those beside them."""
    out = chosen.copy()
    for axis in (0, 1):
        grown = out.copy()
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        grown[tuple(ahead)] |= out[tuple(behind)]
        grown[tuple(behind)] |= out[tuple(ahead)]
        out = grown
    return out


def _shifts(photons: PhotonMap, plan: EmissionPlan, number: int, window: Window) -> np.ndarray:
    """Shift over the whole shutter of all cells of ``window``, of those without a photon as of those nearest."""
    rows, cells = _cells(photons, plan, number)
    grid, known = window.grid(2, dtype=np.float32), window.grid(dtype=bool)
    grid[window.at(cells)], known[window.at(cells)] = photons.shift[rows], True
    if not known.any():
        return grid
    while not known.all():
        total, count = np.zeros_like(grid), np.zeros(known.shape, np.float32)
        for axis in (0, 1):
            ahead, behind = [slice(None)] * 2, [slice(None)] * 2
            ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
            for to, of in ((tuple(ahead), tuple(behind)), (tuple(behind), tuple(ahead))):
                total[to] += np.where(known[of][..., None], grid[of], 0.0)
                count[to] += known[of]
        new = ~known & (count > 0)
        grid[new] = total[new] / count[new][:, None]
        known |= new
    return grid


def _own_shift(cells: ChosenCells, photons: PhotonMap, plan: EmissionPlan, number: int) -> np.ndarray:
    """Shift of ``cells``: of their own photons at mid shutter, else what ``cells`` say."""
    window = Window.around(cells.cell)
    grid = window.grid(2, dtype=np.float32)
    grid[window.at(cells.cell)] = cells.offset
    rows, places = _cells(photons, plan, number)
    grid[window.at(places)] = photons.shift[rows]
    return grid[window.at(cells.cell)]


def _flux_in(photons: PhotonMap, plan: EmissionPlan, number: int, window: Window, chosen: np.ndarray) -> float:
    """Flux of the photons of chosen cells."""
    rows, cells = _cells(photons, plan, number)
    return float(photons.flux[rows][chosen[window.at(cells)]].sum(dtype=np.float64))
