"""Photons of changing cells, part by part of the shutter; parts in which it is not clear what their light does
(:mod:`.unclear`) are cut again.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.instants import joined_in_time
from tpdwarp.trajectories.keyframes import ShutterKeyframes
from tpdwarp.trajectories.passing import parts_of_existence
from tpdwarp.trajectories.retraced import (
    PARTS,
    RetracedCells,
    along_with_cells,
    cell_of,
    in_middle_of_cell,
    place_in_cell,
)
from tpdwarp.trajectories.rifts import stretched
from tpdwarp.trajectories.unclear import unclear_cells

# Instants at which cells are traced, and where the numbers of parts of these, and of parts of parts, end.
INSTANTS = PARTS + 1
LAST_PART = INSTANTS * (1 + PARTS)


def traced_in_parts(
    tracer: PhotonTracer,
    keyframes: ShutterKeyframes,
    changing: Sequence[RetracedCells],
    shutter: Shutter,
    weight: float,
    light: float,
    bend: Callable[[RetracedCells, PhotonMap, Sequence[PhotonMap]], PhotonMap],
    clock: Clock,
    **options: Any,
) -> tuple[list[list[PhotonMap]], list[list[np.ndarray]], EnergyAccount]:
    """Photons of ``changing`` cells for each part of ``shutter``, by lattices, for how much of the shutter each of them
    shines, shape [n] each, and where their flux went.

    Args:
        keyframes: Whose tags tell paths apart.
        changing: Cells of some lattices, and finer ones of these; the scene of a part is loaded once for all.
        weight: Part of the exposure that the shutter is.
        light: Flux of all photons of the shutter; cells that rush are traced again where they have a part worth it.
        bend: Gives photons of some cells what their neighbours know, which may be others of the same part.
        options: Of the tracer.
    """
    account = EnergyAccount()
    last: LoadedScene | None = None

    def load(piece: Shutter) -> None:
        nonlocal last
        last = tracer.load(piece, clock, instead_of=last, beside=keyframes.middle)

    def traced(cells: RetracedCells, middle: float, share: float, number: int) -> tuple[PhotonMap, EnergyAccount]:
        plan = cells.plan
        given = {"chosen": cells.at(middle, number), "aimed": False, "tags": keyframes.tags.of(last.scene), **options}
        photons, energy = tracer.trace(last, plan, clock, weight=weight * share, **given)
        with clock.stage("trace"):
            photons = along_with_cells(photons, cells, share)
            photons = in_middle_of_cell(photons, plan, place_in_cell(cell_of(photons), number))
            photons = _grown(photons, cells, middle, energy)
        return replace(photons, time=middle, duration=share), energy

    edges = np.concatenate([[0.0], (np.arange(PARTS) + 0.5) / PARTS, [1.0]])
    middles, shares = 0.5 * (edges[1:] + edges[:-1]) - 0.5, np.diff(edges)
    times = shutter.open + shutter.exposure * edges
    pieces = [Shutter(shutter.frame, float(a), float(b)) for a, b in itertools.pairwise(times)]
    found = [_FoundInParts(cells) for cells in changing]
    for part, piece in enumerate(pieces):
        load(piece)
        for each in found:
            photons, energy = traced(each.cells, float(middles[part]), float(shares[part]), part)
            account.add(energy)
            each.maps.append(replace(photons, part=part + 1))
    with clock.stage("trace"):
        unclear = [each.unclear(weight, light) for each in found]
    for part, (piece, of_each) in enumerate(zip(pieces, zip(*unclear, strict=True), strict=True)):
        for each in found:
            each.maps[part] = bend(each.cells, each.maps[part], ())
        again = [(each, cells) for each, cells in zip(found, of_each, strict=True) if len(cells)]
        if not again:
            continue
        middle, share = float(middles[part]), float(shares[part])
        load(piece)
        for each, cells in again:
            account.subtract(traced(cells, middle, share, part)[1])
            each.leave_out(part, cells)
        for number, smaller in enumerate(piece.segments(PARTS)):
            within = (number + 0.5) / PARTS - 0.5
            load(smaller)
            for each, cells in again:
                photons, energy = traced(cells, middle + share * within, share / PARTS, number)
                account.add(energy)
                stay = each.maps[part]
                there = replace(stay, position=stay.position + np.float32(within) * stay.dxdt)
                photons = bend(each.cells, photons, (there,))
                each.maps.append(replace(photons, part=INSTANTS + PARTS * part + number + 1))
                each.extents.append(np.ones(len(photons)))
    with clock.stage("trace"):
        shining = [each.shining() for each in found]
    for each, maps in zip(found, shining, strict=True):
        before, after = (sum(float(p.flux.sum(dtype=np.float64)) for p in those) for those in (each.maps, maps))
        _count_gained(after - before, each.cells.plan, account)
    return shining, [each.times() for each in found], account


@dataclass
class _FoundInParts:
    """Photons of some cells part by part.

    Attributes:
        cells: The cells.
        maps: Their photons in each part, then those of parts of parts.
        extents: In how much of its part the path of each of them exists, shape [n] each.
    """

    cells: RetracedCells
    maps: list[PhotonMap] = field(default_factory=list)
    extents: list[np.ndarray] = field(default_factory=list)

    def unclear(self, weight: float, light: float) -> list[RetracedCells]:
        """Cells of each part that are to be traced again in parts of it, once all parts are."""
        existence = parts_of_existence(self.maps, self.cells)
        self.extents = [found.extent for found in existence]
        return unclear_cells(self.maps, existence, self.cells, weight, light)

    def leave_out(self, part: int, cells: RetracedCells) -> None:
        """Leaves out the photons of some cells in a part."""
        stays = ~cells.holds(self.maps[part])
        self.maps[part], self.extents[part] = self.maps[part].rows(stays), self.extents[part][stays]

    def shining(self) -> list[PhotonMap]:
        """The photons with the flux of all of their parts."""
        return [
            replace(photons, flux=photons.flux * extent[:, None].astype(np.float32))
            for photons, extent in zip(joined_in_time(self.maps), self.extents, strict=True)
        ]

    def times(self) -> list[np.ndarray]:
        """For how much of the shutter each of the photons shines, shape [n] each."""
        return [photons.duration * extent for photons, extent in zip(self.maps, self.extents, strict=True)]


def _grown(photons: PhotonMap, cells: RetracedCells, part: float, energy: EnergyAccount) -> PhotonMap:
    """The photons with the sizes and the flux that their cells have at the part ``part`` of the shutter.

    What cells gain in flux is counted as sent and deposited.
    """
    if not cells.growth:
        return photons
    before = photons.flux.sum(dtype=np.float64)
    photons = stretched(photons, part * cells.growth_of(photons))
    _count_gained(float(photons.flux.sum(dtype=np.float64) - before), cells.plan, energy)
    return photons


def _count_gained(flux: float, plan: EmissionPlan, energy: EnergyAccount) -> None:
    """Counts flux that photons gained as sent and deposited."""
    watts = plan.normalization.power * flux
    energy.sent += watts
    energy.deposited += watts
