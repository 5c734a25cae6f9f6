"""Cells of which instants do not tell enough: what their light does between these is not clear.

As total reflection ends, light leaves along the face and turns away from it as the root of the time: in an eighth of
the shutter it may pass a large part of the picture, and carries least where it is fastest. So where a path begins or
ends between two parts, and is fast beside the size of its cell, both are traced again in parts of their own. So they
are where a gap opens, or a body comes into the light, of which no edge is near in one of them; and so is the first
part, or the last, where a path begins or ends between its instant and the end of the shutter.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpdwarp.photons.emission import ChosenCells
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.row_numbers import row_numbers
from tpdwarp.photons.vectors import lengths
from tpdwarp.trajectories.passing import Existence
from tpdwarp.trajectories.retraced import (
    LEAST_LIGHT,
    LEAST_SHARE,
    CellsOfLattices,
    RetracedCells,
    Window,
    grown,
)

# A photon that goes further than this in its part, in lengths of its footprint, is not where it begins or ends to
# within what its cell blurs. Chosen, not derived.
LONGEST_WAY = 4.0
# Of all light, what begins or ends between two parts for which these are cut: each takes eight scenes to load. Twice
# that saves a third of the time of a prism with 4 096 photons, which errs by .061 then in place of .055.
LEAST_BETWEEN = 0.5 * LEAST_LIGHT


def unclear_cells(
    maps: list[PhotonMap], existence: list[Existence], changing: RetracedCells, weight: float, light: float
) -> list[RetracedCells]:
    """For each part, the cells of which it is not clear from the instants what their light does meanwhile.

    It rushes on a path that begins or ends between the part and one beside it; nothing tells when its path does so; or,
    in the first part and the last, that begins or ends between their instant and the end of the shutter. None where
    what does so between two parts is hardly any of all ``light``.

    Args:
        maps: Photons of each part.
        existence: In how much of it their paths exist.
        changing: The cells that were traced.
        weight: Part of the exposure that the shutter is.
        light: Flux of all photons of the shutter.
    """
    light = max(light, sum(map(_flux, maps)))
    found: list[list[PhotonMap]] = [[] for _ in maps]
    least = LEAST_BETWEEN * light
    for several in (_rushing(maps, least), _at_times_unknown(maps, existence, least)):
        for photons, more in zip(found, several, strict=True):
            photons += more
    if changing.ends is not None:
        for part, there in zip((0, len(maps) - 1), changing.ends.photons, strict=True):
            found[part] += _beyond(maps[part], there, changing.ends.cells, weight, light)
    if any(found):
        _go_on_along_paths(found, maps, changing, least)
    return [_with_unseen(photons, there, changing) for photons, there in zip(found, maps, strict=True)]


def _go_on_along_paths(
    found: list[list[PhotonMap]], maps: list[PhotonMap], changing: RetracedCells, least: float
) -> None:
    """Adds, to what was ``found`` in each part, the photons of the same cells whose path begins or ends between that
    part and one beside it: for how long was told of both together.

    Args:
        least: Flux that these have at least.
    """
    names = _names(maps)

    def alone(one: int, other: int) -> PhotonMap:
        return maps[one].rows((maps[one].share > LEAST_SHARE) & ~np.isin(names[one], names[other]))

    between = [[alone(part, part + 1), alone(part + 1, part)] for part in range(len(maps) - 1)]
    forth = [(part, part + 1) for part in range(len(maps) - 1)]
    for here, there in [*forth, *((late, early) for early, late in reversed(forth))]:
        cells = changing.of_photons(found[here])
        if len(cells):
            going_on = [photons.rows(cells.holds(photons)) for photons in between[min(here, there)]]
            if _amount(going_on) > least:
                found[there] += going_on


def _with_unseen(found: list[PhotonMap], there: PhotonMap, changing: RetracedCells) -> RetracedCells:
    """The ``changing`` cells of photons ``found`` in a part, and those beside them that their paths are not seen in.

    Light that comes and goes within the part is seen in some cells at the part's instant, and not in as many others:
    where only the former were traced again, it would be less than there is.

    Args:
        there: All photons of the part.
    """
    cells = changing.of_photons(found)
    if not len(cells):
        return cells
    of_found, of_all = ([CellsOfLattices(photons, changing.plan) for photons in maps] for maps in (found, [there]))
    wanted = {}
    for number, mine in changing.cells.items():
        window = Window.around(mine.cell, margin=1)
        sets = []
        for maps in (of_found, of_all):
            pairs = [(each.photons.path[each.of(number)[0]], each.of(number)[1]) for each in maps]
            sets.append([np.concatenate(columns) for columns in zip(*pairs, strict=True)])
        (paths, of_paths), (seen_paths, of_seen) = sets
        unseen = window.grid(dtype=bool)
        unseen[window.at(of_paths)] = True
        for path in np.unique(paths):
            at, seen = window.grid(dtype=bool), window.grid(dtype=bool)
            at[window.at(of_paths[paths == path])] = True
            seen[window.at(of_seen[seen_paths == path])] = True
            unseen |= grown(at) & ~seen
        rows = unseen[window.at(mine.cell)]
        if rows.any():
            wanted[number] = ChosenCells(mine.cell[rows], mine.offset[rows])
    return changing.parted(RetracedCells(wanted, changing.plan))[0]


def _rushing(maps: list[PhotonMap], least: float) -> list[list[PhotonMap]]:
    """For each part, photons that rush where their path begins or ends between it and one beside it."""
    names = _names(maps)
    rushing = [_rushes(photons) for photons in maps]
    found: list[list[PhotonMap]] = [[] for _ in maps]
    for part in range(len(maps) - 1):
        pair = (part, part + 1), (part + 1, part)
        alone = [maps[one].rows(rushing[one] & ~np.isin(names[one], names[other])) for one, other in pair]
        _add_to_both(found, part, alone, least)
    return found


def _at_times_unknown(maps: list[PhotonMap], existence: list[Existence], least: float) -> list[list[PhotonMap]]:
    """For each part, photons whose path begins or ends between it and one beside it where nothing tells when."""
    found: list[list[PhotonMap]] = [[] for _ in maps]
    for part in range(len(maps) - 1):
        unknown = existence[part].after, existence[part + 1].before
        pair = zip(maps[part : part + 2], unknown, strict=True)
        _add_to_both(found, part, [photons.rows(when & (photons.share > LEAST_SHARE)) for photons, when in pair], least)
    return found


def _add_to_both(found: list[list[PhotonMap]], part: int, photons: list[PhotonMap], least: float) -> None:
    """Adds photons whose path begins or ends between a part and the next to both, if they carry more than ``least``."""
    if _amount(photons) > least:
        found[part] += photons
        found[part + 1] += photons


def _beyond(here: PhotonMap, there: PhotonMap, asked: RetracedCells, weight: float, light: float) -> list[PhotonMap]:
    """Photons of the first or last part whose path begins or ends between its instant and the end of the shutter.

    Args:
        here: Photons of the part.
        there: Photons at the end of the shutter, with the flux of the whole exposure.
        asked: The cells that were traced there.
        weight, light: As of :func:`unclear_cells`.
    """
    name_here, name_there = _names([here, there])
    alone = [
        there.rows((there.share > LEAST_SHARE) & ~np.isin(name_there, name_here)),
        here.rows((here.share > LEAST_SHARE) & ~np.isin(name_here, name_there) & asked.holds(here)),
    ]
    # Half of the part lies beyond its instant.
    amount = 0.5 * _amount(alone, (weight * here.duration, 1.0))
    return alone if amount > LEAST_LIGHT * light else []


def _flux(photons: PhotonMap) -> float:
    return float(photons.flux.sum(dtype=np.float64))


def _amount(maps: Sequence[PhotonMap], weights: Sequence[float] = (1.0, 1.0)) -> float:
    """How much light begins or ends, the photons of each map weighted.

    Paths light different places: what they err by adds up by its squares, and so does their flux.
    """
    flux = [weight * photons.flux.sum(axis=1, dtype=np.float64) for weight, photons in zip(weights, maps, strict=True)]
    _, path = np.unique(np.concatenate([photons.path for photons in maps]), return_inverse=True)
    return float(np.linalg.norm(np.bincount(path, weights=np.concatenate(flux))))


def _names(maps: list[PhotonMap]) -> list[np.ndarray]:
    """A number for the cell and path of each photon, one for the same in all of ``maps``, each [n]."""
    names = row_numbers(*(np.concatenate([getattr(photons, name) for photons in maps]) for name in ("ids", "path")))
    return np.split(names, np.cumsum([len(photons) for photons in maps])[:-1])


def _rushes(photons: PhotonMap) -> np.ndarray:
    """Which photons that matter go far in their part of the shutter, shape [n]."""
    way = lengths(photons.dxdt - photons.receiver_motion)
    return (photons.share > LEAST_SHARE) & (way > LONGEST_WAY * photons.size)
