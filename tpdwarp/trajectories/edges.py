"""Edges on the light: cells beside which a photon has no neighbour on its path.

A body ends, a facet begins, total reflection sets in: the photon of a cell through which such an edge goes stands for
a part of it, or for more than it, and D_u x, D_v x of that part lead nowhere in the rest. Where the light of such cells
moves within the shutter they are traced in parts of it (:mod:`.changing`). Where it is at rest they are traced again in
finer cells, ``FINER`` along either side: edges are then as sharp as those are narrow, and what lies within one cell, as
the strip of light that a thin slab's side sends, has a footprint of its own. Where cells are larger than pixels, and
footprints B-splines, they have those of the whole cell: finer ones would not fit together with those beside them.

Beyond the paper, whose photons start at random.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.emission import ChosenCells
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.row_numbers import distinct_rows, row_numbers
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.photons.vectors import lengths
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.neighbours import neighbours
from tpdwarp.trajectories.parts import LAST_PART
from tpdwarp.trajectories.retraced import (
    LEAST_LIGHT,
    PARTS,
    CellsOfLattices,
    EmittedCells,
    RetracedCells,
    Window,
    cell_of,
    emitted_cells,
    flux_in,
    grown,
    in_middle_of_cell,
    matters,
    riding,
    typical_area,
)

# Cells at an edge on the light are traced again where photons beside it carry more than this: a silhouette of glass,
# where light grazes, gains nothing. Chosen on cube and torus: .2 costs the torus a third more for nothing.
LEAST_BORDER = 0.5
# Photons at an edge are looked at together in squares of so many cells. Chosen, not derived: an edge passes about as
# many of them, each anywhere.
NEARBY = 16
# Finer cells along either side of one that an edge at rest goes through. Chosen on a board under a lens (16 k photons):
# with 3 it errs by .022, with 4 by .019, with 5 by .017 for a third more CPU time.
FINER = 4
# Finer cells at most, by the photons asked for. Chosen: a ball behind a slab errs by .088 without any (4 096 photons).
MOST_FINER = 2
# Light that moves by less than so many lengths of its footprint within the shutter is at rest: its edges are seen.
# Chosen on a wedge that turns: with 1 it errs by .020 (16 k photons), with 4 by .032, as keyframes do not follow light
# at edges.
LONGEST_WAY_AT_REST = 1.0
# Parts that whole segments and parts of them have for numbers end here (:mod:`.parts`).
FIRST_PART = LAST_PART + 1

Cells = dict[int, np.ndarray]


def edge_cells(
    photons: PhotonMap, plan: EmissionPlan, loaded: LoadedScene, *, tell_apart: bool = True
) -> tuple[Cells, Cells]:
    """Cells on both sides of edges on the light, [n, 2] of each lattice: those whose light moves, and those at rest.

    Where the cells end that are emitted, so does a sheet that fills them: it ends just there. Where there are edges
    among the cells as well, there are bodies, of which another side may show in less than the last of the cells.

    Args:
        photons: Of all cells of ``plan`` at mid shutter.
        loaded: The scene that they were traced through.
        tell_apart: Whether light is ever at rest; else all count among those that move.
    """
    important = matters(photons, typical_area(photons), LEAST_BORDER)
    moving: Cells = {}
    resting: Cells = {}
    size = photons.size
    way = lengths(photons.dxdt - photons.receiver_motion)
    fast = important & (way > LONGEST_WAY_AT_REST * size)
    if not tell_apart:
        return _beside_edges(photons, plan, emitted_cells(plan, loaded.scene), important), resting
    going = CellsOfLattices(photons, plan, fast)
    for number, cells in _beside_edges(photons, plan, emitted_cells(plan, loaded.scene), important).items():
        window = Window.around(cells, margin=1)
        moves = window.grid(dtype=bool)
        there = going.of(number)[1]
        moves[window.at(there[window.holds(there)])] = True
        moves = grown(moves)[window.at(cells)]
        for found, rows in ((moving, moves), (resting, ~moves)):
            if rows.any():
                found[number] = cells[rows]
    return moving, resting


def resting_edges(
    photons: PhotonMap, plan: EmissionPlan, resting: Cells, besides: RetracedCells | None = None
) -> RetracedCells | None:
    """Cells at edges ``resting`` that are traced again; None where their light is hardly any, or they nearly all.

    Their finer cells are no more than ``MOST_FINER`` times the photons asked for, lest a frame take many times as many.

    Args:
        besides: Cells that are traced again already.
    """
    cells = RetracedCells({number: ChosenCells(found) for number, found in resting.items()}, plan)
    if besides is not None:
        cells = cells.without(besides)
    if FINER**2 * len(cells) > MOST_FINER * plan.photons_at_once:
        return None
    light = float(photons.flux.sum(dtype=np.float64))
    chosen = {number: mine.cell for number, mine in cells.cells.items()}
    return cells if flux_in(photons, plan, chosen) > LEAST_LIGHT * light else None


def finer_in_time(changing: RetracedCells, resting: Cells) -> tuple[RetracedCells, RetracedCells | None]:
    """Cells that change in time, without those that an edge at rest goes through as well; finer cells of the latter.

    A board passes below the rim of a lens: there light is missing at the edge and in time. Each of the finer cells is
    traced at some ten instants; where they would be more than cells in all, there are none.
    """
    plan = changing.plan
    at_edges = RetracedCells({number: ChosenCells(cells) for number, cells in resting.items()}, plan)
    both, others = changing.parted(at_edges)
    if not len(both) or FINER**2 * PARTS * len(both) > plan.photons_at_once:
        return changing, None
    cells = {
        number: ChosenCells(_finer_cells(mine.cell), np.repeat(FINER * mine.offset, FINER**2, axis=0))
        for number, mine in both.cells.items()
    }
    growth = {number: np.repeat(rates, FINER**2, axis=0) for number, rates in both.growth.items()}
    return others, RetracedCells(cells, plan.finer(FINER, FINER), growth)


def _finer_cells(cells: np.ndarray) -> np.ndarray:
    """The ``FINER``² cells in each of some cells [n, 2], one after the other, shape [FINER² n, 2]."""
    parts = np.stack(np.meshgrid(np.arange(FINER), np.arange(FINER), indexing="ij"), axis=-1).reshape(-1, 2)
    return (cells[:, None] * FINER + parts).reshape(-1, 2)


def traced_finer(
    tracer: PhotonTracer, loaded: LoadedScene, edges: RetracedCells, clock: Clock, **options: Any
) -> tuple[PhotonMap, EmissionPlan, EnergyAccount]:
    """Photons of the finer cells of ``edges``, the lattices that they lie on, and where their flux went.

    Args:
        options: Of the tracer.
    """
    plan = edges.plan.finer(FINER, FINER)
    cells = {number: _finer_cells(mine.cell) for number, mine in edges.cells.items()}
    placed = {number: ChosenCells(fine, place_in_finer_cell(fine)) for number, fine in cells.items()}
    photons, account = tracer.trace(loaded, plan, clock, chosen=riding(placed, plan, 1.0), **options)
    with clock.stage("trace"):
        return in_middle_of_cell(photons, plan, place_in_finer_cell(cell_of(photons))), plan, account


def place_in_finer_cell(cell: np.ndarray) -> np.ndarray:
    """Where in finer cells [n, 2] photons start, in their steps from the middle, shape [n, 2].

    Those of one coarse cell start at ``FINER``² places along either of its sides, evenly apart, so that an edge along
    the lattice divides the coarse cell as exactly as so many places can.
    """
    return ((cell[:, ::-1] % FINER + 0.5) / FINER - 0.5).astype(np.float32)


def coarse_paths(ids: np.ndarray, fine: EmissionPlan, plan: EmissionPlan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ids of the paths of ``plan`` that paths of finer cells are parts of, and which columns and rows of their lattices
    these cells are; shape [n] each.

    Args:
        ids: Of paths of the finer cells.
    """
    mask, lattice, _ = fine.paths_of(ids)
    first = np.array([entry.first_id for entry in fine.lattices])[lattice]
    across = np.array([entry.wrap[0] for entry in fine.lattices])[lattice]
    v, u = np.divmod(ids % fine.id_count - first, across)
    return mask * plan.id_count + first // FINER**2 + (v // FINER) * (across // FINER) + u // FINER, u, v


def in_coarse_cells(photons: PhotonMap, fine: EmissionPlan, plan: EmissionPlan) -> Iterator[PhotonMap]:
    """Photons of finer cells as parts of those of ``plan``: one map for each place in a cell."""
    ids, u, v = coarse_paths(photons.ids, fine, plan)
    coarse = replace(photons, ids=ids, emission=photons.emission / FINER, shift=photons.shift / FINER)
    place = u % FINER + FINER * (v % FINER)
    for number in range(FINER**2):
        middle = 0.5 * (FINER - 1)
        within = number % FINER - middle, number // FINER - middle
        part = FIRST_PART + FINER**2 * photons.part + number
        yield replace(coarse.rows(place == number), part=part, finer=FINER, place=within)


def _beside_edges(
    photons: PhotonMap, plan: EmissionPlan, emitted: dict[int, EmittedCells], important: np.ndarray
) -> Cells:
    """Cells on both sides of edges: there photons, most of them ``important`` [n], have no neighbour on their path."""
    _, lattice, planned = plan.paths_of(photons.ids)
    cells = cell_of(photons)
    lonely = []
    for axis, (a, b) in enumerate(neighbours(photons, plan)):
        for step, beside in ((1, a), (-1, b)):
            alone = planned.copy()
            alone[beside] = False
            lonely.append((axis, step, np.flatnonzero(alone)))
    rows = np.unique(np.concatenate([rows for _, _, rows in lonely]))
    chosen = np.zeros(len(photons), bool)
    chosen[rows] = _mostly(important[rows], lattice[rows], photons.path[rows], cells[rows])
    found: dict[int, list[np.ndarray]] = {}
    last: dict[int, list[np.ndarray]] = {}
    for axis, step, rows in lonely:
        rows = rows[chosen[rows]]
        for number in np.unique(lattice[rows]):
            here = cells[rows[lattice[rows] == number]]
            there = here.copy()
            there[:, axis] += step
            inside = emitted[int(number)].holds(there)
            found.setdefault(int(number), []).extend([here[inside], there[inside]])
            last.setdefault(int(number), []).append(here[~emitted[int(number)].window.holds(there)])
    edges = {number: parts for number, parts in found.items() if any(map(len, parts))}
    return {number: distinct_rows(np.concatenate([*parts, *last[number]])) for number, parts in edges.items()}


def _mostly(important: np.ndarray, lattice: np.ndarray, path: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Which photons at edges lie near others at the edge of their path half of which are important, shape [n].

    Of the photon itself that depends on where in its cell the edge passes: light is faint where it grazes, just inside
    of a silhouette. Cells whose middle a body all but leaves out stand for all of themselves, those whose middle it
    just misses for nothing; with only the latter traced again, a ball in 91 lattices sends 1 % too much light.
    """
    square = row_numbers(lattice, path, *(cells // NEARBY).T)
    others = np.bincount(square)[square] - 1
    of_others = np.bincount(square, important)[square] - important
    return np.where(others > 0, of_others >= 0.5 * others, important)
