"""Light that begins and ends, in time or on the light: cells that their photon of mid shutter does not stand for.

A board passes over the water, a facet turns into view, total reflection sets in, a ball's shadow crosses a caustic:
there, neither D_u x nor D_t x say anything of what the photon of mid shutter stands for at other times. Nor does a
photon stand for its cell where an edge goes through it: where its neighbours take other paths, or none. Such cells are
traced again in several parts of the shutter, each time through another place of the cell. What they find there is the
cell's: the photon is moved back to the middle of its cell by its differentials, so that cells still fill the lattice.

Cells ride on the surface as photons do, so that they fit together at all times: at the part s of the shutter a cell
lies s · shift further on the light. Cells that meet nothing go along with those nearest to them. So the border of a
body that moves is no change in time; what its light meets afterwards may be.

Which cells change in time is asked of keyframes first, then around those that do of the cells themselves.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.trajectories.bends import reaches
from tpdwarp.trajectories.keyframes import END, LARGEST_DRIFT, ShutterKeyframes
from tpdwarp.trajectories.neighbours import neighbours

# Photons that carry less than this part of their cell's flux are no reason to trace the cell again; nor are those of
# wide footprints, whose share counts by the root of how much narrower others are: what a photon adds to the mean square
# goes with its flux by the root of its area. Chosen, not derived.
LEAST_SHARE = 0.2
# Cells at an edge on the light are traced again where a photon beside it carries more than this: a silhouette of glass,
# where light grazes, gains nothing. Chosen on cube and torus: .2 costs the torus a third more for nothing.
LEAST_BORDER = 0.5
# Nor are cells which carry less than this part of the light together. Chosen, not derived: as little as a branch that
# is given up.
LEAST_LIGHT = 0.002
# Parts of the shutter in which cells are traced again. Chosen, not derived: as short as keyframes are.
PARTS = 8

# Flux of nothing, to divide by.
_TINY = np.finfo(np.float64).tiny

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

    def holds(self, photons: PhotonMap) -> np.ndarray:
        """Which of the photons stand for one of these cells, shape [n]."""
        _, lattice, planned = self.plan.paths_of(photons.ids)
        cells, held = _cell_of(photons), np.zeros(len(photons), bool)
        for number, mine in self.cells.items():
            window = Window.around(mine.cell)
            taken = window.grid(dtype=bool)
            taken[window.at(mine.cell)] = True
            held |= planned & (lattice == number) & window.holds(cells) & taken[window.at(cells)]
        return held

    def at_middle(self) -> Callable[[Lattice, Patch], ChosenCells]:
        """Chooses these cells at mid shutter, their photons in the middle of each."""
        return _riding(self.cells, self.plan, 0.0)

    def of_photons(self, maps: list[PhotonMap]) -> ChangingCells:
        """Those of these cells that photons of ``maps`` stand for."""
        found = {}
        for number, mine in self.cells.items():
            theirs = np.concatenate([_cells(photons, self.plan, number)[1] for photons in maps])
            if len(theirs):
                window = Window.around(theirs)
                taken = window.grid(dtype=bool)
                taken[window.at(theirs)] = True
                rows = window.holds(mine.cell) & taken[window.at(mine.cell)]
                if rows.any():
                    found[number] = ChosenCells(mine.cell[rows], mine.offset[rows])
        return ChangingCells(found, self.plan)

    def at(self, part: float, number: int) -> Callable[[Lattice, Patch], ChosenCells]:
        """Chooses these cells where they lie at the part ``part`` (−½ … ½) of the shutter, at place ``number``."""
        moved = {
            lattice: ChosenCells(mine.cell, np.float32(part) * mine.offset + place_in_cell(mine.cell, number))
            for lattice, mine in self.cells.items()
        }
        return _riding(moved, self.plan, 1.0)


def place_in_cell(cell: np.ndarray, number: int) -> np.ndarray:
    """Where in their cells photons start in part ``number`` of the shutter, in lattice steps from the middle; [n, 2].

    The places of all parts are a Hammersley set in time and along each side of the cell, shifted digitally by a hash of
    the cell: so edges across a cell, and those that pass over it, divide it as exactly as eight places can, and what
    they err by differs from cell to cell.

    Args:
        cell: Which cells, shape [n, 2].
    """
    with np.errstate(over="ignore"):
        hashed = (cell[:, 0].astype(np.uint32) * np.uint32(0x9E3779B1)) ^ (
            cell[:, 1].astype(np.uint32) * np.uint32(0x85EBCA77)
        )
        hashed = (hashed ^ (hashed >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
    hashed = hashed ^ (hashed >> np.uint32(12))
    reversed_bits = (number & 1) << 2 | (number & 2) | (number & 4) >> 2
    places = [(reversed_bits ^ (hashed & 7)), ((3 * number + 1) % PARTS) ^ (hashed >> np.uint32(3) & 7)]
    return np.stack([(place + 0.5) / PARTS - 0.5 for place in places], axis=1).astype(np.float32)


def in_middle_of_cell(photons: PhotonMap, plan: EmissionPlan, number: int) -> PhotonMap:
    """Photons of part ``number`` of the shutter, moved from their place in the cell to its middle by D_u x, D_v x.

    Where these grow without bound light would be moved out of the picture: they count as far as neighbours are.
    """
    place = place_in_cell(_cell_of(photons), number)
    u, v = (reaches(photons, plan, place) * place).T[:, :, None]
    return replace(photons, position=photons.position - u * photons.dxdu - v * photons.dxdv)


def changing_cells(
    keyframes: ShutterKeyframes, photons: PhotonMap, plan: EmissionPlan, clock: Clock
) -> ChangingCells | None:
    """The cells that their photons of mid shutter do not stand for; None where none matter.

    Args:
        keyframes: Of the shutter.
        photons: Of all cells of ``plan`` at mid shutter, with the keyframes' tags.
    """
    suspects = _suspects(keyframes, plan, clock)
    with clock.stage("trace"):
        suspects = {
            number: ChosenCells(cells.cell, _shifts_of(cells.cell, photons, plan, number, cells))
            for number, cells in suspects.items()
        }
    ends: list[PhotonMap] = []
    if suspects:
        ends = [keyframes.traced(part, plan, chosen=_riding(suspects, plan, part)) for part in (-END, END)]
    with clock.stage("trace"):
        typical = _typical_area(photons)
        chosen = _borders(photons, plan, _emitted(plan, keyframes.middle.scene), typical)
        for number, cells in suspects.items():
            window = Window.around(cells.cell)
            here = window.grid(dtype=bool)
            here[window.at(cells.cell)] = True
            changing = window.cells(_grown(_change([ends[0], photons, ends[1]], plan, number, window, typical)) & here)
            chosen[number] = np.unique(np.concatenate([changing, chosen.get(number, changing)]), axis=0)
        chosen = {number: cells for number, cells in chosen.items() if len(cells)}
        # The ends are traced with the flux of the whole exposure, as keyframes are.
        shares = [_flux_in(photons, plan, chosen) / max(_flux_in(photons, plan), _TINY)]
        whole = max(_flux_in(keyframes.photons(0.0), keyframes.plan), _TINY)
        shares += [_flux_in(end, plan, chosen) / whole for end in ends]
        if max(shares) <= LEAST_LIGHT:
            return None
        return ChangingCells(
            {
                number: ChosenCells(cells, _shifts_of(cells, photons, plan, number, suspects.get(number)))
                for number, cells in chosen.items()
            },
            plan,
        )


def _suspects(keyframes: ShutterKeyframes, plan: EmissionPlan, clock: Clock) -> dict[int, ChosenCells]:
    """The cells of ``plan`` around keyframes' cells that change, with their shift as offset."""
    sparse = keyframes.plan
    maps = [keyframes.photons(part) for part in TIMES]
    with clock.stage("trace"):
        riders: dict[int, ChosenCells] = {}
        windows: dict[int, Window] = {}
        shifts: dict[int, np.ndarray] = {}
        for number in _numbers(maps, sparse):
            cells = np.concatenate([_cells(photons, sparse, number)[1] for photons in maps])
            windows[number] = window = Window.around(cells, margin=1)
            inside = window.cells(np.ones(window.size, bool))
            inside = inside[sparse.lattices[number].holds(inside)]
            shifts[number] = _shifts(maps[1], sparse, number, window)
            riders[number] = ChosenCells(inside, shifts[number][window.at(inside)])
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
                lattices = plan.lattices[number], sparse.lattices[number]
                found[number] = _finer(*lattices, window, changing, shifts[number])
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
    chosen = window.holds(around) & wanted[window.at(around)] & fine.holds(cells)
    return ChosenCells(cells[chosen], (shifts[window.at(around[chosen])] * ratio).astype(np.float32))


def _riding(cells: dict[int, ChosenCells], plan: EmissionPlan, part: float) -> Callable[[Lattice, Patch], ChosenCells]:
    """Chooses ``cells`` of each lattice, moved by the part ``part`` of their offsets."""
    none = ChosenCells(np.zeros((0, 2), np.int64))

    def chosen(lattice: Lattice, patch: Patch) -> ChosenCells:
        mine = cells.get(_number(plan, lattice), none)
        return ChosenCells(mine.cell, None if part == 0.0 or not len(mine) else np.float32(part) * mine.offset)

    return chosen


def _emitted(plan: EmissionPlan, scene: SceneAtShutter) -> dict[int, Window]:
    """The cells of each lattice that are emitted in a scene."""
    return {
        _number(plan, lattice): Window(
            np.array([patch.first_u, patch.first_v]), np.array([patch.count_u, patch.count_v])
        )
        for lattice, patch in plan.patches(scene)
    }


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


def _cell_of(photons: PhotonMap) -> np.ndarray:
    """The cell that each photon stands for, shape [n, 2]."""
    return np.floor(photons.emission).astype(np.int64)


def _cells(photons: PhotonMap, plan: EmissionPlan, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the photons of a lattice, and their cells, shape [n, 2]."""
    _, lattice, planned = plan.paths_of(photons.ids)
    rows = np.flatnonzero(planned & (lattice == number))
    return rows, _cell_of(photons)[rows]


def _areas(photons: PhotonMap) -> np.ndarray:
    """Areas |D_u x × D_v x| of footprints, shape [n]."""
    return np.linalg.norm(np.cross(photons.dxdu.astype(np.float64), photons.dxdv.astype(np.float64)), axis=1)


def _typical_area(photons: PhotonMap) -> float:
    """The median area of footprints, weighted by flux: half of the light falls in smaller ones."""
    areas, flux = _areas(photons), photons.flux.sum(axis=1, dtype=np.float64)
    order = np.argsort(areas)
    return float(areas[order][np.searchsorted(np.cumsum(flux[order]), 0.5 * flux.sum())]) if len(order) else 0.0


def _matters(photons: PhotonMap, typical: float, least: float) -> np.ndarray:
    """Which photons are a reason to trace their cell again, shape [n].

    Args:
        typical: Area of a footprint that counts as its flux does.
        least: The part of their cell's flux from which on photons are.
    """
    narrow = np.sqrt(np.minimum(1.0, typical / np.maximum(_areas(photons), np.finfo(np.float32).tiny)))
    return photons.share * narrow > least


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
        matter.append(_matters(photons.rows(rows), typical, LEAST_SHARE))
    grid = window.grid(dtype=bool)
    for one, other in ((0, 1), (1, 0), (1, 2), (2, 1)):
        alone = keys[one][matter[one] & ~np.isin(keys[one], keys[other])]
        grid.ravel()[(alone >> np.uint64(32)).astype(np.int64)] = True
    return grid


def _borders(
    photons: PhotonMap, plan: EmissionPlan, emitted: dict[int, Window], typical: float
) -> dict[int, np.ndarray]:
    """Cells on both sides of edges on the light, where a photon that matters has no neighbour on its path; [n, 2] each.

    Where the cells end that are ``emitted``, so does a sheet that fills them: it ends just there. Where there are edges
    among the cells as well, there are bodies, of which another side may show in less than the last of the cells.
    """
    _, lattice, planned = plan.paths_of(photons.ids)
    matters, cells = _matters(photons, typical, LEAST_BORDER) & planned, _cell_of(photons)
    found: dict[int, list[np.ndarray]] = {}
    last: dict[int, list[np.ndarray]] = {}
    for axis, (a, b) in enumerate(neighbours(photons, plan)):
        for step, beside in ((1, a), (-1, b)):
            alone = matters.copy()
            alone[beside] = False
            for number in np.unique(lattice[alone]):
                here = cells[alone & (lattice == number)]
                there = here.copy()
                there[:, axis] += step
                inside = emitted[int(number)].holds(there)
                found.setdefault(int(number), []).extend([here[inside], there[inside]])
                last.setdefault(int(number), []).append(here[~inside])
    edges = {number: parts for number, parts in found.items() if any(map(len, parts))}
    return {number: np.unique(np.concatenate([*parts, *last[number]]), axis=0) for number, parts in edges.items()}


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


def _shifts(
    photons: PhotonMap, plan: EmissionPlan, number: int, window: Window, given: ChosenCells | None = None
) -> np.ndarray:
    """Shift over the whole shutter of all cells of ``window``, of those without a photon as ``given`` or as of those
    nearest; shape [u, v, 2]."""
    grid, known = window.grid(2, dtype=np.float32), window.grid(dtype=bool)
    if given is not None:
        inside = window.holds(given.cell)
        grid[window.at(given.cell[inside])], known[window.at(given.cell[inside])] = given.offset[inside], True
    rows, cells = _cells(photons, plan, number)
    inside = window.holds(cells)
    grid[window.at(cells[inside])], known[window.at(cells[inside])] = photons.shift[rows[inside]], True
    if not known.any():
        return grid
    _spread(grid, known)
    return grid


def _spread(grid: np.ndarray, known: np.ndarray) -> None:
    """Fills the cells of a grid [u, v, 2] that are not ``known`` from those that are, ring by ring, by their means."""
    size = np.array(known.shape)
    beside = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])

    def neighbours_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cells on the four sides of others, shape [n, 4, 2], and which of them lie in the grid."""
        cells = cells[:, None] + beside
        inside = np.all((cells >= 0) & (cells < size), axis=2)
        return np.where(inside[..., None], cells, 0), inside

    last = np.argwhere(known)
    while len(last):
        around, inside = neighbours_of(last)
        places = np.ravel_multi_index(tuple(around[inside].T), known.shape)
        ring = np.stack(np.unravel_index(np.unique(places[~known.ravel()[places]]), known.shape), axis=1)
        around, inside = neighbours_of(ring)
        u, v = around[..., 0], around[..., 1]
        counts = inside & known[u, v]
        total = np.where(counts[..., None], grid[u, v], 0.0).sum(axis=1)
        grid[tuple(ring.T)] = total / counts.sum(axis=1, dtype=np.float32)[:, None]
        known[tuple(ring.T)] = True
        last = ring


def _shifts_of(
    cells: np.ndarray, photons: PhotonMap, plan: EmissionPlan, number: int, given: ChosenCells | None
) -> np.ndarray:
    """Shift of ``cells`` [n, 2], as :func:`_shifts` has it."""
    window = Window.around(cells, margin=1)
    return _shifts(photons, plan, number, window, given)[window.at(cells)]


def _flux_in(photons: PhotonMap, plan: EmissionPlan, chosen: dict[int, np.ndarray] | None = None) -> float:
    """Flux of the photons of chosen cells [n, 2] of each lattice; without, of all."""
    if chosen is None:
        return float(photons.flux.sum(dtype=np.float64))
    cells = ChangingCells({number: ChosenCells(found) for number, found in chosen.items()}, plan)
    return float(photons.flux[cells.holds(photons)].sum(dtype=np.float64))
