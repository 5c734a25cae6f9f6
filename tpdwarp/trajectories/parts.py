"""Photons of changing cells, part by part of the shutter; parts in which it is not clear what their light does
(:mod:`.unclear`) are cut again.

Beyond the paper, whose photons shine for the whole shutter.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
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
    changing: RetracedCells,
    shutter: Shutter,
    weight: float,
    light: float,
    bend: Callable[[PhotonMap, Sequence[PhotonMap]], PhotonMap],
    clock: Clock,
    **options: Any,
) -> tuple[list[PhotonMap], EnergyAccount]:
    """Photons of ``changing`` cells for each part of ``shutter``, and where their flux went.

    Args:
        keyframes: Whose tags tell paths apart.
        weight: Part of the exposure that the shutter is.
        light: Flux of all photons of the shutter; cells that rush are traced again where they have a part worth it.
        bend: Gives photons what their neighbours know, which may be others of the same part.
        options: Of the tracer.
    """
    account, maps = EnergyAccount(), []
    plan = changing.plan
    last: LoadedScene | None = None

    def traced(
        cells: RetracedCells, piece: Shutter, middle: float, share: float, number: int
    ) -> tuple[PhotonMap, EnergyAccount]:
        nonlocal last
        last = tracer.load(piece, clock, instead_of=last, beside=keyframes.middle)
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
    for part, piece in enumerate(pieces):
        photons, energy = traced(changing, piece, float(middles[part]), float(shares[part]), part)
        account.add(energy)
        maps.append(replace(photons, part=part + 1))
    with clock.stage("trace"):
        existence = parts_of_existence(maps, changing)
        unclear = unclear_cells(maps, existence, changing, weight, light)
        extents = [found.extent for found in existence]
    for part, (piece, cells) in enumerate(zip(pieces, unclear, strict=True)):
        maps[part] = bend(maps[part], ())
        if not len(cells):
            continue
        middle, share = float(middles[part]), float(shares[part])
        account.subtract(traced(cells, piece, middle, share, part)[1])
        stays = ~cells.holds(maps[part])
        maps[part], extents[part] = maps[part].rows(stays), extents[part][stays]
        stay = maps[part]
        for number, smaller in enumerate(piece.segments(PARTS)):
            within = (number + 0.5) / PARTS - 0.5
            photons, energy = traced(cells, smaller, middle + share * within, share / PARTS, number)
            account.add(energy)
            there = replace(stay, position=stay.position + np.float32((number + 0.5) / PARTS - 0.5) * stay.dxdt)
            photons = bend(photons, (there,))
            maps.append(replace(photons, part=INSTANTS + PARTS * part + number + 1))
            extents.append(np.ones(len(photons)))
    with clock.stage("trace"):
        shining = [
            replace(photons, flux=photons.flux * extent[:, None].astype(np.float32))
            for photons, extent in zip(joined_in_time(maps), extents, strict=True)
        ]
    before, after = (sum(float(photons.flux.sum(dtype=np.float64)) for photons in each) for each in (maps, shining))
    _count_gained(after - before, plan, account)
    return shining, account


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
