"""Cells of a lattice that are traced again, because their photon does not stand for all that they light.

What those that change in time (:mod:`.changing`) and those that edges at rest go through (:mod:`.edges`) have in
common: which cells they are, which of them count, and where in them photons start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.vectors import areas
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.trajectories.bends import reaches

# Photons that carry less than this part of their cell's flux are no reason to trace the cell again; nor are those of
# wide footprints, whose share counts by the root of how much narrower others are: what a photon adds to the mean square
# goes with its flux by the root of its area. Chosen, not derived.
LEAST_SHARE = 0.2
# Branches that carry less of their cell's flux are faint. Half of what counts as a change, so that nothing that counts
# is cut off; the blob errs by .0962 with it, by .0967 with all of that and by .0957 without (16 k photons).
FAINT_BRANCH = 0.5 * LEAST_SHARE
# Nor are cells which carry less than this part of the light together. Chosen, not derived: as little as a branch that
# is given up.
LEAST_LIGHT = 0.002
# Parts of the shutter in which cells are traced again. Chosen, not derived: as short as keyframes are. The first and
# the last instant stand for half a part each, since what begins and ends before the first one or after the last one is
# not seen to: so there is one more than parts.
PARTS = 8
# Grids that are bits of one.
LAYERS = 64


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
        # Coordinate by coordinate, here and below: row by row NumPy takes ten times as long.
        first, last = (np.array([end(along) for along in cells.T]) for end in (np.min, np.max))
        return cls(first - margin, last - first + 2 * margin + 1)

    @classmethod
    def of_patch(cls, patch: Patch) -> Window:
        """The cells of a patch."""
        return cls(np.array([patch.first_u, patch.first_v]), np.array([patch.count_u, patch.count_v]))

    def grid(self, *width: int, dtype: type = np.float64) -> np.ndarray:
        """Zeros for its cells."""
        return np.zeros((*self.size, *width), dtype)

    def at(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where cells [n, 2] lie in a grid; those outside lie at its border."""
        u, v = (
            (along - first).clip(0, size - 1)
            for along, first, size in zip(cells.T, self.first, self.size, strict=True)
        )
        return u, v

    def holds(self, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] lie in it."""
        u, v = (
            (along >= first) & (along < first + size)
            for along, first, size in zip(cells.T, self.first, self.size, strict=True)
        )
        return u & v

    def cells(self, chosen: np.ndarray) -> np.ndarray:
        """The cells that a grid of truth values chooses, shape [n, 2]."""
        return np.argwhere(chosen) + self.first


@dataclass(frozen=True, eq=False)
class RetracedCells:
    """Cells that are traced again, with photons in parts of the shutter, or of the cell, of their own.

    Attributes:
        cells: Of each lattice that has any, by its number, with their shift over the whole shutter as offset.
        plan: The lattices.
        growth: ∇S of the field that cells ride along (:mod:`.rifts`), for each of those of a lattice, shape [n, 2, 2];
            none where they keep their size.
        limited: How many of them keep their size although they ride apart.
        ends: What some of them are like as the shutter opens and as it closes; None where that is not known.
    """

    cells: dict[int, ChosenCells]
    plan: EmissionPlan
    growth: dict[int, np.ndarray] = field(default_factory=dict)
    limited: int = 0
    ends: CellsAtEnds | None = None

    def __len__(self) -> int:
        return sum(map(len, self.cells.values()))

    def holds(self, photons: PhotonMap, by: int = 0) -> np.ndarray:
        """Which of the photons stand for one of these cells, or for one up to ``by`` cells beside them, shape [n]."""
        held = np.zeros(len(photons), bool)
        of_lattices = CellsOfLattices(photons, self.plan)
        for number, mine in self.cells.items():
            rows, theirs = of_lattices.of(number)
            if len(rows):
                held[rows] = _among(theirs, mine.cell, by)
        return held

    def growth_of(self, photons: PhotonMap) -> np.ndarray:
        """∇S of the cell that each of the photons stands for, shape [n, 2, 2]; zero of others."""
        return self._of_cells(photons, self.growth, (2, 2), np.float64)

    def offset_of(self, photons: PhotonMap) -> np.ndarray:
        """Shift over the whole shutter of the cell that each of the photons stands for, shape [n, 2]; of others 0."""
        offsets = {number: mine.offset for number, mine in self.cells.items()}
        return self._of_cells(photons, offsets, (2,), np.float32)

    def _of_cells(
        self, photons: PhotonMap, values: dict[int, np.ndarray], shape: tuple[int, ...], dtype: type
    ) -> np.ndarray:
        """What ``values`` say, for the cells of each lattice, of the cell that each of the photons stands for; shape
        [n, *shape], zero of others."""
        found = np.zeros((len(photons), *shape), dtype)
        of_lattices = CellsOfLattices(photons, self.plan)
        for number, of_cells in values.items():
            cells = self.cells[number].cell
            window = Window.around(cells)
            grid = window.grid(*shape, dtype=dtype)
            grid[window.at(cells)] = of_cells
            rows, theirs = of_lattices.of(number)
            inside = window.holds(theirs)
            found[rows[inside]] = grid[window.at(theirs[inside])]
        return found

    def _shared_with(self, others: RetracedCells) -> Iterator[tuple[int, ChosenCells, np.ndarray]]:
        """The cells of each lattice, by its number, and which of them are among ``others``."""
        for number, mine in self.cells.items():
            rows = np.zeros(len(mine), bool)
            if number in others.cells:
                rows = _among(mine.cell, others.cells[number].cell)
            yield number, mine, rows

    def without(self, others: RetracedCells) -> RetracedCells:
        """Those of these cells that are not among ``others`` of the same lattices."""
        found = {
            number: ChosenCells(mine.cell[~rows]) for number, mine, rows in self._shared_with(others) if not rows.all()
        }
        return RetracedCells(found, self.plan)

    def parted(self, others: RetracedCells) -> tuple[RetracedCells, RetracedCells]:
        """Those of these cells that are among ``others`` of the same lattices, and those that are not."""
        parts = []
        for among in (True, False):
            cells, growth = {}, {}
            for number, mine, rows in self._shared_with(others):
                if np.any(rows == among):
                    cells[number] = ChosenCells(mine.cell[rows == among], mine.offset[rows == among])
                    if number in self.growth:
                        growth[number] = self.growth[number][rows == among]
            parts.append(replace(self, cells=cells, growth=growth, limited=0 if among else self.limited))
        return parts[0], parts[1]

    def at_middle(self) -> Callable[[Lattice, Patch], ChosenCells]:
        """Chooses these cells at mid shutter, their photons in the middle of each."""
        return riding(self.cells, self.plan, 0.0)

    def of_photons(self, maps: list[PhotonMap]) -> RetracedCells:
        """Those of these cells that photons of ``maps`` stand for."""
        found, growth = {}, {}
        of_lattices = [CellsOfLattices(photons, self.plan) for photons in maps]
        for number, mine in self.cells.items():
            theirs = [cells.of(number)[1] for cells in of_lattices]
            theirs = np.concatenate(theirs) if theirs else mine.cell[:0]
            if len(theirs):
                rows = _among(mine.cell, theirs)
                if rows.any():
                    found[number] = ChosenCells(mine.cell[rows], mine.offset[rows])
                    if number in self.growth:
                        growth[number] = self.growth[number][rows]
        return RetracedCells(found, self.plan, growth)

    def at(self, part: float, number: int) -> Callable[[Lattice, Patch], ChosenCells]:
        """Chooses these cells where they lie at the part ``part`` (−½ … ½) of the shutter, at place ``number``."""
        moved = {
            lattice: ChosenCells(mine.cell, np.float32(part) * mine.offset + place_in_cell(mine.cell, number))
            for lattice, mine in self.cells.items()
        }
        return riding(moved, self.plan, 1.0)


@dataclass(frozen=True, eq=False)
class CellsAtEnds:
    """What cells are like as the shutter opens and as it closes.

    Attributes:
        cells: Those that were traced then, from where they ride to.
        photons: Theirs at the opening and at the closing, with the flux of the whole exposure.
    """

    cells: RetracedCells
    photons: tuple[PhotonMap, PhotonMap]


def _among(cells: np.ndarray, chosen: np.ndarray, by: int = 0) -> np.ndarray:
    """Which of the cells [n, 2] of a lattice are among the ``chosen`` ones of it [m, 2], of which there is one, or lie
    up to ``by`` cells beside them."""
    window = Window.around(chosen, margin=by)
    taken = window.grid(dtype=bool)
    taken[window.at(chosen)] = True
    return window.holds(cells) & grown(taken, by)[window.at(cells)]


def place_in_cell(cell: np.ndarray, number: int) -> np.ndarray:
    """Where in their cells photons start in part ``number`` of the shutter, in lattice steps from the middle; [n, 2].

    The places of all parts are a Hammersley set in time and along each side of the cell, shifted digitally by a hash of
    the cell (that of the last half part is that of the first): so edges across a cell, and those that pass over it,
    divide it as exactly as eight places can, and what they err by differs from cell to cell.

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


def in_middle_of_cell(photons: PhotonMap, plan: EmissionPlan, place: np.ndarray) -> PhotonMap:
    """Photons moved from their place in the cell [n, 2], in steps from its middle, to that by D_u x, D_v x.

    Where these grow without bound light would be moved out of the picture: they count as far as neighbours are.
    """
    u, v = (reaches(photons, plan, place) * place).T[:, :, None]
    return replace(photons, position=photons.position - u * photons.dxdu - v * photons.dxdv)


def along_with_cells(photons: PhotonMap, cells: RetracedCells, share: float) -> PhotonMap:
    """The photons with D_t x as seen from their cells: those ride on the first surface, these as they are asked to.

    A cell goes by d more cells on the light than its photon within the part ``share`` of the shutter, so that its light
    goes by d_u D_u x + d_v D_v x more. Cells that rest on the light are not of one point of the surface for long.
    """
    more = np.float32(share) * cells.offset_of(photons) - photons.shift
    u, v = more.T[:, :, None]
    dxdt = photons.dxdt + u * photons.dxdu + v * photons.dxdv
    return replace(photons, dxdt=dxdt.astype(np.float32), shift=photons.shift + more)


def riding(cells: dict[int, ChosenCells], plan: EmissionPlan, part: float) -> Callable[[Lattice, Patch], ChosenCells]:
    """Chooses ``cells`` of each lattice, moved by the part ``part`` of their offsets."""
    none = ChosenCells(np.zeros((0, 2), np.int64))

    def chosen(lattice: Lattice, patch: Patch) -> ChosenCells:
        mine = cells.get(plan.number_of(lattice), none)
        return ChosenCells(mine.cell, None if part == 0.0 or not len(mine) else np.float32(part) * mine.offset)

    return chosen


@dataclass(frozen=True, eq=False)
class EmittedCells:
    """The cells of a lattice that are emitted in a scene.

    Attributes:
        plan: Its plan.
        number: Its number there.
        window: Where those of all portions of the light lie.
    """

    plan: EmissionPlan
    number: int
    window: Window

    def holds(self, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] they are, shape [n]."""
        inside = self.window.holds(cells)
        if self.plan.portion is None:
            return inside
        return inside & self.plan.portion.holds(np.full(len(cells), self.number), cells)


def emitted_cells(plan: EmissionPlan, scene: SceneAtShutter) -> dict[int, EmittedCells]:
    """The cells of each lattice that are emitted in a scene, by its number."""
    found = {}
    for lattice, patch in plan.patches(scene, whole=True):
        number = plan.number_of(lattice)
        found[number] = EmittedCells(plan, number, Window.of_patch(patch))
    return found


def numbers_of(maps: Sequence[CellsOfLattices]) -> list[int]:
    """Numbers of the lattices that photons of any of ``maps`` come from."""
    return sorted(set().union(*(cells.numbers() for cells in maps)))


def cell_of(photons: PhotonMap, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
    """The cell that each photon stands for, shape [n, 2].

    Args:
        rows: Of which photons, by index; all without.
    """
    return np.floor(photons.emission[rows]).astype(np.int64)


class CellsOfLattices:
    """Rows and cells of photons by the lattice that they come from; those of all are found at once.

    Args:
        photons: Of which those of lattices that were made for one frame are left out.
        plan: The lattices.
        among: Which of the photons count, shape [n]; all without.
    """

    def __init__(self, photons: PhotonMap, plan: EmissionPlan, among: np.ndarray | None = None) -> None:
        self.photons = photons
        _, lattice, planned = plan.paths_of(photons.ids)
        rows = np.flatnonzero(planned if among is None else planned & among)
        rows = rows[np.argsort(lattice[rows], kind="stable")]
        numbers, starts = np.unique(lattice[rows], return_index=True)
        self._rows = dict(zip(numbers.tolist(), np.split(rows, starts[1:]), strict=True)) if len(rows) else {}

    def numbers(self) -> list[int]:
        """Numbers of the lattices that photons come from, in their order."""
        return list(self._rows)

    def of(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the photons of a lattice, shape [n], and their cells, shape [n, 2]."""
        rows = self._rows.get(number, np.zeros(0, np.int64))
        return rows, cell_of(self.photons, rows)


def typical_area(photons: PhotonMap) -> float:
    """The median area of footprints, weighted by flux: half of the light falls in smaller ones."""
    sizes, flux = areas(photons.dxdu, photons.dxdv), photons.flux.sum(axis=1, dtype=np.float64)
    order = np.argsort(sizes)
    return float(sizes[order][np.searchsorted(np.cumsum(flux[order]), 0.5 * flux.sum())]) if len(order) else 0.0


def matters(photons: PhotonMap, typical: float, least: float) -> np.ndarray:
    """Which photons are a reason to trace their cell again, shape [n].

    Args:
        typical: Area of a footprint that counts as its flux does.
        least: The part of their cell's flux from which on photons are.
    """
    sizes = np.maximum(areas(photons.dxdu, photons.dxdv), np.finfo(np.float32).tiny)
    narrow = np.sqrt(np.minimum(1.0, typical / sizes))
    return photons.share * narrow > least


def grown(chosen: np.ndarray, by: int = 1) -> np.ndarray:
    """Chosen cells of a grid [..., u, v], and those up to ``by`` beside them along either side."""
    for _ in range(by):
        chosen = _beside(_beside(chosen, -2), -1)
    return chosen


def distances(sources: np.ndarray, most: int, wanted: np.ndarray | None = None) -> np.ndarray:
    """How many cells each one of a grid [..., u, v] lies from the nearest of ``sources``, about; ``most`` + 1 beyond.

    Steps go to four neighbours and to eight by turns: what is as far as another lies on an octagon around it. Where
    cells are ``wanted``, others but sources count as beyond.
    """
    found = np.where(sources, 0, most + 1).astype(np.int32)
    layers, values = sources.reshape(-1, *sources.shape[-2:]), found.reshape(-1, *sources.shape[-2:])
    chosen = (~sources if wanted is None else wanted & ~sources).reshape(layers.shape)
    for start in range(0, len(layers), LAYERS):
        own = slice(start, start + LAYERS)
        values[own][chosen[own]] = _steps_to(layers[own], chosen[own], most)
    return found


def _steps_to(sources: np.ndarray, wanted: np.ndarray, most: int) -> np.ndarray:
    """The same for each of the cells ``wanted`` of a few layers [k, u, v], which grow together as bits of one grid."""
    layer, u, v = np.nonzero(wanted)
    steps = np.full(len(layer), most + 1, np.int32)
    if not len(layer) or not sources.any():
        return steps
    # What lies farther off than that from all that is wanted is not looked at.
    window = tuple(slice(max(0, at.min() - most), at.max() + most + 1) for at in (u, v))
    u, v = u - window[0].start, v - window[1].start
    dtype = np.min_scalar_type((1 << len(sources)) - 1)
    reached = np.zeros(sources[0][window].shape, dtype)
    for number, there in enumerate(sources):
        reached |= there[window].astype(dtype) << dtype.type(number)
    left = np.arange(len(layer))
    for step in range(1, most + 1):
        along_u = _beside(reached, -2)
        reached = _beside(along_u, -1) if step % 2 == 0 else along_u | _beside(reached, -1)
        here = (reached[u[left], v[left]] >> layer[left].astype(dtype)) & dtype.type(1) != 0
        steps[left[here]] = step
        left = left[~here]
        if not len(left):
            break
    return steps


def _beside(chosen: np.ndarray, axis: int) -> np.ndarray:
    """Chosen cells of a grid, or of layers of bits, and those on both sides of them along an axis."""
    out = chosen.copy()
    ahead, behind = [slice(None)] * chosen.ndim, [slice(None)] * chosen.ndim
    ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
    out[tuple(ahead)] |= chosen[tuple(behind)]
    out[tuple(behind)] |= chosen[tuple(ahead)]
    return out


def flux_in(photons: PhotonMap, plan: EmissionPlan, chosen: dict[int, np.ndarray] | None = None) -> float:
    """Flux of the photons of chosen cells [n, 2] of each lattice; without, of all."""
    if chosen is None:
        return float(photons.flux.sum(dtype=np.float64))
    cells = RetracedCells({number: ChosenCells(found) for number, found in chosen.items()}, plan)
    return float(photons.flux[cells.holds(photons)].sum(dtype=np.float64))
