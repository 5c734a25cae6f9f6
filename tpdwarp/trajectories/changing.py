"""Light that begins and ends, in time or on the light: cells that their photon of mid shutter does not stand for.

A board passes over the water, a facet turns into view, total reflection sets in, a ball's shadow crosses a caustic:
there, neither D_u x nor D_t x say anything of what the photon of mid shutter stands for at other times. Nor does a
photon stand for its cell where an edge goes through it: where its neighbours take other paths, or none. Such cells are
traced again in several parts of the shutter, each time through another place of the cell. What they find there is the
cell's: the photon is moved back to the middle of its cell by its differentials, so that cells still fill the lattice.

Cells ride on the surface as photons do, so that they fit together at all times: at the part s of the shutter a cell
lies s · shift further on the light. Cells that meet nothing go along with those nearest to them. So the border of a
body that moves is no change in time; what its light meets afterwards may be. Where one body passes before another,
cells around its border ride along a field that goes over from the one to the other (:mod:`.rifts`). Cells of what turns
over within the shutter rest, and those of a lattice whose rifts are as wide as it is.

Which cells change in time is asked of keyframes first, then around those that do of the cells themselves. To these
come cells whose light is there all the time and yet goes where no curve of third order leads, just after total
reflection has ended or where glass spins: keyframes disagree on it.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.emission import ChosenCells
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.row_numbers import distinct_rows, row_numbers
from tpdwarp.photons.vectors import lengths
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.scene.light_places import prim_of
from tpdwarp.trajectories.fit import LARGEST_ROUGHNESS
from tpdwarp.trajectories.keyframes import (
    END,
    KEYFRAME_DURATION,
    LARGEST_DISAGREEMENT,
    LARGEST_DRIFT,
    KeyframeState,
    ShutterKeyframes,
    disagreement,
    shift_over_shutter,
)
from tpdwarp.trajectories.neighbours import differences, neighbours
from tpdwarp.trajectories.retraced import (
    LEAST_LIGHT,
    LEAST_SHARE,
    CellsAtEnds,
    CellsOfLattices,
    EmittedCells,
    RetracedCells,
    Window,
    emitted_cells,
    flux_in,
    grown,
    matters,
    numbers_of,
    riding,
    typical_area,
)
from tpdwarp.trajectories.rifts import LARGEST_DRIFT_APART, gradients, rift_cells
from tpdwarp.trajectories.shadows import shadowed_ways
from tpdwarp.trajectories.swept import mark_ways, swept_cells

# Flux of nothing, to divide by.
_TINY = np.finfo(np.float64).tiny

# Light that keyframes do not follow is traced in parts of the shutter where it leaves its straight way by more than
# this part of its footprint. Chosen on a ball that rolls by 57 degrees within a segment: 1 and 0.3 err alike, by .127,
# and straight ways by .368.
LARGEST_SAGITTA = 0.5
# So is light that they follow, but not well: it leaves the curve by more than this part of its footprint. Chosen on a
# ball that rolls by 29 degrees (scripts/benchmarks/solids.py ball-rolling, 16 k photons, one segment): with .25 of a
# footprint it errs by .114, with .1 by .107, without by .123.
LARGEST_MISS = 0.1
# Keyframes disagree by more than this then. Chosen: with .03 the same ball errs by .095 in one segment, but as before
# in the three that it has by default, and waves over a sphere by .050 in place of .048 (65 k photons).
LEAST_DISAGREEMENT = 0.1
# Light at the rim of a cone that passes is traced in parts of the shutter where its mean is off that of mid shutter by
# more than this part of the most that there is. Chosen, not derived.
LARGEST_BEND = 0.01
# Cells that would grow by more times their size as they ride keep it: those of a mirror that turns by 85 degrees within
# a shutter grow by two. Chosen, not derived.
LARGEST_GROWTH = 4.0
# Cells of a path that grow by more of their size within the shutter do not go along with what turns over: at 2 they
# have no size left as it opens or closes. Chosen on mirrors, panes and coins that turn through edge-on: a mirror that
# does so between two segments errs by 1.2 in two with 2, by .04 with 1 (16 384 photons). With a half it errs by .06 in
# four, not by .24; but then all cells of a gliding ball rest, which takes four times as long and errs by .013, not by
# .014 (65 536 photons).
TURNS_OVER = 1.0

# When the shutter opens and closes, as parts of it from its middle.
OPENS, CLOSES = -0.5, 0.5


def changing_cells(
    keyframes: ShutterKeyframes,
    photons: PhotonMap,
    plan: EmissionPlan,
    states: Sequence[KeyframeState],
    clock: Clock,
    besides: dict[int, np.ndarray] | None = None,
    finest: float = 0.0,
) -> RetracedCells | None:
    """The cells that their photons of mid shutter do not stand for; None where none matter.

    Args:
        keyframes: Of the shutter.
        photons: Of all cells of ``plan`` at mid shutter, with the keyframes' tags.
        plan: Their lattices.
        states: What keyframes say of them, in the order of time.
        clock: Where the time goes.
        besides: Cells [n, 2] of each lattice that are traced again in any case: those at edges that move.
        finest: Area below which footprints are not told apart: wide ones count beside these as beside a pixel.
    """
    suspects, swept = _suspects(keyframes, plan, clock, finest)
    with clock.stage("trace"):
        turned_over: dict[int, np.ndarray] = {}
        if not is_a_sheet_alone(keyframes):
            photons, turned_over = resting_where_turned_over(photons, plan)
        here = CellsOfLattices(photons, plan)
        suspects = {
            number: ChosenCells(cells.cell, _shifts_of(cells.cell, here, number, cells))
            for number, cells in suspects.items()
        }
    ends: list[PhotonMap] = []
    if suspects:
        ends = [keyframes.bright(part, plan, riding(suspects, plan, part)) for part in (OPENS, CLOSES)]
    with clock.stage("trace"):
        typical = max(finest, *map(typical_area, [photons, *ends]))
    with clock.stage("trace"):
        unfollowed = _unfollowed(states, photons, plan, typical, _of_passing_cones(photons, keyframes.middle.scene))
        chosen = dict(besides or {})
        for found in (unfollowed, turned_over, swept):
            for number, cells in found.items():
                chosen[number] = distinct_rows(np.concatenate([cells, chosen.get(number, cells)]))
        change_in = _Change([ends[0], photons, ends[1]], plan, typical) if suspects else None
        for number, cells in suspects.items():
            window = Window.around(cells.cell)
            suspected = window.grid(dtype=bool)
            suspected[window.at(cells.cell)] = True
            change = change_in.within(number, window)
            changing = window.cells(grown(change) & suspected)
            chosen[number] = distinct_rows(np.concatenate([changing, chosen.get(number, changing)]))
        chosen = {number: cells for number, cells in chosen.items() if len(cells)}
        fields = {
            number: _field(here, plan.lattices[number], number, suspects.get(number)) for number in here.numbers()
        }
        for number, ride in fields.items():
            if ride.torn is not None:
                cells = [ride.torn, *([chosen[number]] if number in chosen else [])]
                chosen[number] = distinct_rows(np.concatenate(cells))
            elif ride.rests and np.abs(ride.shifts).max() <= max(ride.window.size):
                # What goes farther than it is wide, out of all measure, leaves the light.
                chosen[number] = _lit_meanwhile(keyframes, plan, number, here.of(number)[1])
        # The ends are traced with the flux of the whole exposure, as keyframes are.
        shares = [flux_in(photons, plan, chosen) / max(flux_in(photons, plan), _TINY)]
        whole = max(flux_in(keyframes.photons(0.0), keyframes.plan), _TINY)
        shares += [flux_in(end, plan, chosen) / whole for end in ends]
        if max(shares) <= LEAST_LIGHT:
            return None
        found, growth, limited = {}, {}, 0
        for number, cells in chosen.items():
            ride = fields.get(number)
            if ride is not None and ride.rests:
                found[number] = ChosenCells(cells, np.zeros(cells.shape, np.float32))
                continue
            if ride is None or ride.torn is None:
                window = Window.around(cells, margin=1)
                ride = _Field(window, shifts_over(here, number, window, suspects.get(number)), None)
            found[number] = ChosenCells(cells, ride.shifts[ride.window.at(cells)].astype(np.float32))
            growth[number] = gradients(ride.shifts)[ride.window.at(cells)]
            if ride.torn is None:
                # Neighbours that ride so far apart are of no one sheet.
                apart = np.abs(growth[number]).max(axis=(1, 2)) > LARGEST_GROWTH
                growth[number][apart] = 0.0
                limited += int(np.sum(apart))
        at_ends = CellsAtEnds(RetracedCells(suspects, plan), (ends[0], ends[1])) if suspects else None
        return RetracedCells(found, plan, growth, limited, at_ends)


def resting_where_turned_over(photons: PhotonMap, plan: EmissionPlan) -> tuple[PhotonMap, dict[int, np.ndarray]]:
    """Photons that rest on the light where most cells of their path would grow far as they ride, as those of a mirror
    do that passes through edge-on: nothing of them goes along a straight way.

    Returns:
        The photons, and the cells [n, 2] of each lattice that rest.
    """
    growth = np.zeros(len(photons))
    for pairs in neighbours(photons, plan):
        growth = np.maximum(growth, np.abs(differences(photons.shift, pairs)).max(axis=1))
    if not np.any(growth > TURNS_OVER):
        return photons, {}
    _, lattice, planned = plan.paths_of(photons.ids)
    paths = row_numbers(np.where(planned, lattice, -1), photons.path)
    flux = photons.flux.sum(axis=1, dtype=np.float64)
    above = np.bincount(paths, flux * (growth > TURNS_OVER))
    rests = (above > 0.5 * np.bincount(paths, flux))[paths]
    cells = CellsOfLattices(photons, plan, rests)
    shift = np.where(rests[:, None], np.float32(0.0), photons.shift)
    return replace(photons, shift=shift), {number: distinct_rows(cells.of(number)[1]) for number in cells.numbers()}


def _unfollowed(
    states: Sequence[KeyframeState], photons: PhotonMap, plan: EmissionPlan, typical: float, shaped: np.ndarray
) -> dict[int, np.ndarray]:
    """Cells [n, 2] of each lattice whose photons matter and leave the way that they have at mid shutter, and whose
    trajectories do not curve, since keyframes disagree, or leave the curve; arguments as of :class:`_Change`.

    So do those at the rim of a cone that passes over them: keyframes are too sparse to tell by how much their flux
    bends. ``shaped`` [n] are photons of lights with cones that move.

    At the ends of the shutter a curve of third order misses D_tttt x/384, which is estimated as for a sine or a root:
    as the square of D_ttt x over D_tt x.
    """
    before, middle, after = states
    sagitta = lengths(after.dxdt - before.dxdt) / 8.0
    second = lengths(after.dxdt - before.dxdt) / (2.0 * END)
    third = lengths(before.dxdt + after.dxdt - 2.0 * middle.dxdt) / END**2
    miss = np.divide(third**2, 384.0 * second, out=np.zeros_like(third), where=second > 0.0)
    apart = disagreement(photons, before.dxdt, after.dxdt)
    off = (apart > LARGEST_DISAGREEMENT) & (sagitta > LARGEST_SAGITTA * photons.size)
    off |= (apart > LEAST_DISAGREEMENT) & (np.minimum(miss, sagitta) > LARGEST_MISS * photons.size)
    if shaped.any():
        opened, there, closed = (np.exp(state.log_flux) for state in states)
        bend = np.abs(opened + closed - 2.0 * there) / (24.0 * END**2)
        rough = np.maximum(np.maximum(before.rough, after.rough), middle.rough) >= LARGEST_ROUGHNESS
        off |= shaped & rough & (bend > LARGEST_BEND * np.maximum(np.maximum(opened, closed), there))
    off &= before.valid & after.valid
    lost = CellsOfLattices(photons, plan, off & matters(photons, typical, LEAST_SHARE))
    return {number: distinct_rows(lost.of(number)[1]) for number in lost.numbers()}


def _of_passing_cones(photons: PhotonMap, scene: SceneAtShutter) -> np.ndarray:
    """Which photons are of lights with cones that move, shape [n]."""
    moving = {prim_of(light.path) for light in scene.lights if light.shaping is not None and light.moves}
    passing = np.array([prim_of(path) in moving for path in photons.light_paths], bool)
    return passing[photons.light] if passing.any() else np.zeros(len(photons), bool)


@dataclass(frozen=True, eq=False)
class _Field:
    """How the cells of a lattice ride: their shifts over the whole shutter.

    Attributes:
        window: The cells.
        shifts: Of each of them, shape [u, v, 2]; around rifts those of a smooth field.
        torn: Cells around rifts, shape [n, 2]; None where there are none.
        rests: Whether rifts are too wide for cells to ride at all.
    """

    window: Window
    shifts: np.ndarray
    torn: np.ndarray | None
    rests: bool = False


def _field(found: CellsOfLattices, lattice: Lattice, number: int, given: ChosenCells | None) -> _Field:
    """How the cells of a lattice ride, of which photons were found."""
    rows, cells = found.of(number)
    window = Window.around(cells, margin=1)
    if np.ptp(found.photons.shift[rows], axis=0).max() <= LARGEST_DRIFT_APART:
        return _Field(window, window.grid(2), None)
    shifts = shifts_over(found, number, window, given)
    torn, smooth = rift_cells(shifts)
    if not torn.any():
        return _Field(window, shifts, None, not smooth.any())
    cells = window.cells(torn)
    return _Field(window, np.where(torn[..., None], smooth, shifts), cells[lattice.holds(cells)])


def _suspects(
    keyframes: ShutterKeyframes, plan: EmissionPlan, clock: Clock, finest: float
) -> tuple[dict[int, ChosenCells], dict[int, np.ndarray]]:
    """The cells of ``plan`` around keyframes' cells that change, with their shift as offset, and those [n, 2] that
    change between the instants at which these are asked; arguments as of :func:`changing_cells`."""
    sparse = keyframes.plan
    maps = _at_keyframes(keyframes)
    if not is_a_sheet_alone(keyframes):
        maps[0.0] = resting_where_turned_over(maps[0.0], sparse)[0]
        maps |= {part: keyframes.photons(part) for part in (OPENS, CLOSES)}
    with clock.stage("trace"):
        riders: dict[int, ChosenCells] = {}
        windows: dict[int, Window] = {}
        shifts: dict[int, np.ndarray] = {}
        known: dict[int, np.ndarray] = {}
        of_lattices = {part: CellsOfLattices(photons, sparse) for part, photons in maps.items()}
        emitted = emitted_cells(sparse, keyframes.middle.scene)
        for number in numbers_of(list(of_lattices.values())):
            inside = emitted.get(number)
            cells = np.concatenate([_at_middle(found, number, part, inside) for part, found in of_lattices.items()])
            windows[number] = window = Window.around(cells, margin=1)
            inside = window.cells(np.ones(window.size, bool))
            inside = inside[sparse.lattices[number].holds(inside)]
            shifts[number] = shifts_over(of_lattices[0.0], number, window)
            known[number] = _lit(of_lattices[0.0], number, window)
            riders[number] = ChosenCells(inside, shifts[number][window.at(inside)])
        drift = max((END * np.abs(cells.offset).max() for cells in riders.values()), default=0.0)
    drifted = drift > LARGEST_DRIFT
    if drifted:
        for part in sorted(maps.keys() - {0.0}):
            maps[part] = keyframes.traced(part, sparse, chosen=riding(riders, sparse, part), aimed=False)
    with clock.stage("trace"):
        found: dict[int, ChosenCells] = {}
        swept: dict[int, np.ndarray] = {}
        in_order = [maps[part] for part in sorted(maps)]
        typical = max(finest, *map(typical_area, in_order))
        change = _Change(in_order, sparse, typical)
        at_keyframes = [
            (CellsOfLattices(_over_shutter(maps[part], part), sparse), matters(maps[part], typical, LEAST_SHARE))
            for part in (-END, 0.0, END)
        ]
        of_maps = {part: CellsOfLattices(photons, sparse) for part, photons in maps.items()}
        in_time = {
            -END: (keyframes.opening, KEYFRAME_DURATION),
            0.0: (keyframes.middle, 1.0),
            END: (keyframes.closing, KEYFRAME_DURATION),
        }
        for number, window in windows.items():
            lattices = plan.lattices[number], sparse.lattices[number]
            # Halfway to the next keyframe.
            passed = [swept_cells(*at_keyframe, number, window, 0.5 * END) for at_keyframe in at_keyframes]
            passed += [
                _ways_of_lost(of_maps[part], number, window, part, shifts[number], known[number])
                for part in (-END, END)
            ]
            lit = {part: _lit(of_maps[part], number, window) for part in in_time}
            at_any_time = np.any(list(lit.values()), axis=0)
            for part, (loaded, duration) in in_time.items():
                given = loaded.scene, sparse, number, window, part if drifted else 0.0, shifts[number]
                passed.append(shadowed_ways(*given, at_any_time & ~lit[part], duration, 0.5 * END))
            passed = np.any(passed, axis=0)
            if passed.any():
                swept[number] = _finer(*lattices, window, passed, shifts[number]).cell
            changing = change.within(number, window)
            if changing.any():
                found[number] = _finer(*lattices, window, changing, shifts[number])
    return found, swept


def _over_shutter(photons: PhotonMap, part: float) -> PhotonMap:
    """Photons of a keyframe with D_t x over the whole shutter."""
    if part == 0.0:
        return photons
    rate = np.float32(1.0 / KEYFRAME_DURATION)
    return replace(photons, dxdt=rate * photons.dxdt, receiver_motion=rate * photons.receiver_motion)


def _at_middle(found: CellsOfLattices, number: int, part: float, emitted: EmittedCells | None) -> np.ndarray:
    """The cells of a lattice whose photons were found at a part of the shutter, and where these ride at its middle,
    shape [n, 2]: what a roof hides then may be lit as the shutter opens or closes.

    Where light grazes, shifts grow without bound: no cell rides to where none is ``emitted`` in the middle.
    """
    rows, cells = found.of(number)
    if part == 0.0 or emitted is None:
        return cells
    shift = shift_over_shutter(found.photons.shift[rows], part)
    there = np.rint(cells - part * shift.astype(np.float64))
    return np.concatenate([cells, there[emitted.holds(there)].astype(np.int64)])


def _lit(found: CellsOfLattices, number: int, window: Window) -> np.ndarray:
    """Which cells of ``window`` of a lattice have a photon, shape [u, v]."""
    lit = window.grid(dtype=bool)
    cells = found.of(number)[1]
    lit[window.at(cells[window.holds(cells)])] = True
    return lit


def _ways_of_lost(
    found: CellsOfLattices, number: int, window: Window, part: float, shifts: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Which cells of ``window`` light of a part of the shutter goes through until its middle, shape [u, v], that no
    photon is ``known`` of then.

    What a mirror throws past all receivers in the middle says nothing of how its cells ride there: they ride as those
    beside them, and their light goes through others meanwhile.

    Args:
        found: Photons of that part, of cells that ride along ``shifts`` [u, v, 2].
    """
    rows, cells = found.of(number)
    inside = window.holds(cells)
    inside[inside] = ~known[window.at(cells[inside])]
    rows, cells = rows[inside], cells[inside]
    u, v = window.at(cells)
    ways = shift_over_shutter(found.photons.shift[rows], part).astype(np.float64) - shifts[u, v]
    passed = window.grid(dtype=bool)
    mark_ways(passed, np.stack([u, v], axis=1), abs(part) * ways)
    return passed


def _lit_meanwhile(keyframes: ShutterKeyframes, plan: EmissionPlan, number: int, cells: np.ndarray) -> np.ndarray:
    """The cells of a lattice of ``plan`` that light goes through at any time of the shutter, shape [n, 2].

    What bends or turns so unevenly that no cell rides along with it leaves those that it stands for in the middle.

    Args:
        cells: Those in the middle [n, 2].
    """
    sparse, share = keyframes.plan, 0.5 * END
    places, ways = [], []
    for part, photons in _at_keyframes(keyframes).items():
        found = CellsOfLattices(photons, sparse)
        rows, there = found.of(number)
        places.append(there)
        ways.append(share * shift_over_shutter(photons.shift[rows], part))
    window = Window.around(np.concatenate(places), margin=1)
    beside = np.ceil(np.minimum(np.abs(np.concatenate(ways)).max(axis=0, initial=0.0), window.size)).astype(np.int64)
    window = Window(window.first - beside, window.size + 2 * beside)
    lit = window.grid(dtype=bool)
    for there, way in zip(places, ways, strict=True):
        lit[window.at(there)] = True
        mark_ways(lit, there - window.first, way)
    lattices = plan.lattices[number], sparse.lattices[number]
    return distinct_rows(np.concatenate([cells, _finer(*lattices, window, lit, window.grid(2)).cell]))


def _at_keyframes(keyframes: ShutterKeyframes) -> dict[float, PhotonMap]:
    """The photons of keyframes by when they were traced."""
    return {part: keyframes.photons(part) for part in (-END, 0.0, END)}


def is_a_sheet_alone(keyframes: ShutterKeyframes) -> bool:
    """Whether nothing moves but one refracting surface, whose light takes one path at all keyframes.

    Then it is taken to do so in between and at the ends, too.
    """
    needs, meshes = keyframes.middle.requirements, keyframes.middle.scene.meshes
    if needs.reflection or needs.moving_lights or len(needs.moving_meshes) != 1:
        return False
    paths = {tuple(np.unique(photons.path)) for photons in _at_keyframes(keyframes).values()}
    (path,) = needs.moving_meshes
    return any(mesh.path == path and mesh.specular for mesh in meshes) and len(paths) == 1 and len(paths.pop()) == 1


def _finer(fine: Lattice, coarse: Lattice, window: Window, changing: np.ndarray, shifts: np.ndarray) -> ChosenCells:
    """The cells of ``fine`` within a cell of those of ``coarse`` that change."""
    wanted = grown(changing)
    ratio = np.divide(coarse.step, fine.step)
    start = np.subtract(coarse.origin, fine.origin) / fine.step
    inside = window.cells(wanted)
    low = np.floor(inside.min(axis=0) * ratio + start).astype(np.int64)
    high = np.ceil((inside.max(axis=0) + 1) * ratio + start).astype(np.int64)
    cells = Window(low, high - low).cells(np.ones(high - low, bool))
    around = np.floor((cells + 0.5 - start) / ratio).astype(np.int64)
    chosen = window.holds(around) & wanted[window.at(around)] & fine.holds(cells)
    return ChosenCells(cells[chosen], (shifts[window.at(around[chosen])] * ratio).astype(np.float32))


class _Change:
    """Cells in which a photon that matters takes a path at one time that none takes at the next or at that before.

    Args:
        maps: Photons at some times, in their order.
        plan: Their lattices.
        typical: Area of a footprint that counts as its flux does.
    """

    def __init__(self, maps: list[PhotonMap], plan: EmissionPlan, typical: float) -> None:
        self._maps = [CellsOfLattices(photons, plan) for photons in maps]
        self._matter = [matters(photons, typical, LEAST_SHARE) for photons in maps]

    def within(self, number: int, window: Window) -> np.ndarray:
        """Which cells of ``window`` of a lattice they are, shape [u, v]."""
        keys, matter = [], []
        for found, important in zip(self._maps, self._matter, strict=True):
            rows, cells = found.of(number)
            inside = window.holds(cells)
            rows, (u, v) = rows[inside], window.at(cells[inside])
            path = found.photons.path[rows].astype(np.uint64)
            keys.append((u * window.size[1] + v).astype(np.uint64) << np.uint64(32) | path)
            matter.append(important[rows])
        grid = window.grid(dtype=bool)
        for early, late in itertools.pairwise(range(len(keys))):
            for one, other in ((early, late), (late, early)):
                alone = keys[one][matter[one] & ~np.isin(keys[one], keys[other])]
                grid.ravel()[(alone >> np.uint64(32)).astype(np.int64)] = True
        return grid


def shifts_over(found: CellsOfLattices, number: int, window: Window, given: ChosenCells | None = None) -> np.ndarray:
    """Shift over the whole shutter of all cells of ``window``, of those without a photon as ``given`` or as of those
    nearest; shape [u, v, 2]."""
    grid, known = window.grid(2, dtype=np.float32), window.grid(dtype=bool)
    if given is not None:
        inside = window.holds(given.cell)
        grid[window.at(given.cell[inside])], known[window.at(given.cell[inside])] = given.offset[inside], True
    rows, cells = found.of(number)
    inside = window.holds(cells)
    grid[window.at(cells[inside])], known[window.at(cells[inside])] = found.photons.shift[rows[inside]], True
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


def _shifts_of(cells: np.ndarray, found: CellsOfLattices, number: int, given: ChosenCells | None) -> np.ndarray:
    """Shift of ``cells`` [n, 2], as :func:`shifts_over` has it."""
    window = Window.around(cells, margin=1)
    return shifts_over(found, number, window, given)[window.at(cells)]
