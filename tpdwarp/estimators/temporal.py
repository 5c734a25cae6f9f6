"""Temporal photon differentials: footprints swept along D_t x, one trace a segment of the shutter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.estimators.estimator import Part, at_edges, bent, light_of
from tpdwarp.estimators.seen_light import PortionPlan, SeenLight, has_finer_cells
from tpdwarp.footprints.pixel_areas import typical_pixel_area
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.energy import COARSE_PARTS, STARVED, EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.path_tags import PathTags
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.portions import Portion
from tpdwarp.photons.strips import PHOTONS_OF_STRIP, Strip
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.changing import changing_cells
from tpdwarp.trajectories.edges import FINER, edge_cells, finer_in_time, in_coarse_cells, resting_edges, traced_finer
from tpdwarp.trajectories.faint_branches import cutoff_in_parts, shining_on
from tpdwarp.trajectories.fit import fit_trajectories
from tpdwarp.trajectories.keyframes import ShutterKeyframes
from tpdwarp.trajectories.parts import traced_in_parts
from tpdwarp.trajectories.retraced import RetracedCells, cell_of

# So many cells around one its columns, and those of its neighbours, are told by.
NEIGHBOURS_ASKED = 3

Traced = tuple[PhotonMap, EmissionPlan]


class Temporal:
    """The paper's estimator, at mid shutter or as it opens, with the photons shared between the segments.

    Args:
        seen_light: What is looked at of the light; None where light is wanted wherever it falls.
    """

    def __init__(self, seen_light: SeenLight | None = None) -> None:
        self._seen_light = seen_light

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        settings, count = tracer.settings, len(scenes)
        plan = tracer.plan(max(1, settings.photons // count), clock)
        for seen in scenes:
            plan = plan.foreseeing(seen.scene)
        counts = {"segments traced": count}
        if plan.splits > 1:
            counts["parts of each light with extent"] = plan.splits
        if tracer.split_error:
            counts[COARSE_PARTS] = round(1000.0 * tracer.split_error)
        if plan.starved_lights:
            counts[STARVED] = plan.starved_lights
        moves = any(seen.requirements.photon_motion for seen in scenes)
        weight = 1.0
        strips = -(-settings.photons // PHOTONS_OF_STRIP)
        for number, emitted in enumerate(plan.in_strips([seen.scene for seen in scenes], strips)):
            energy = EnergyAccount(counts=counts)
            portions = partial(self._portions, tracer, plan, scenes, clock, number, strips)
            traced = _traced(tracer, emitted, portions, scenes, pixel, energy, clock)
            maps = [photons for photons, _ in traced]
            light = light_of(maps, energy, moves, tracer, pixel, clock)
            yield Part(maps, energy, light, emitted, scenes, shutter, weight, [lattices for _, lattices in traced])
            # What the camera sees besides is in the first part; the next makes room for its photons.
            weight, counts = 0.0, {}
            del maps, light, traced

    def _portions(
        self,
        tracer: PhotonTracer,
        plan: EmissionPlan,
        scenes: list[LoadedScene],
        clock: Clock,
        strip: int,
        strips: int,
        seen: LoadedScene,
    ) -> list[PortionPlan] | None:
        """Lattices of what is looked at in one segment of a shutter, and of the rest of the light; None where there is
        no reason to tell them apart.

        Args:
            plan: All of the light.
            scenes: Those of all segments.
            strip: Number of the strip of ``strips`` that is traced.
            seen: The scene of the segment.
        """
        if self._seen_light is None:
            return None
        found = self._seen_light.portions(plan, seen, 1.0 / len(scenes), scenes, clock)
        if found is None:
            return None
        return [(portion.in_strips([seen.scene], strips)[strip], keyframes) for portion, keyframes in found]


def _traced(
    tracer: PhotonTracer,
    plan: EmissionPlan,
    portions_of: Callable[[LoadedScene], list[PortionPlan] | None],
    scenes: list[LoadedScene],
    pixel: PixelSize | None,
    energy: EnergyAccount,
    clock: Clock,
) -> list[Traced]:
    """The photons of ``plan`` in all segments of a shutter, with their lattices; where their flux went is added to
    ``energy``.

    Args:
        portions_of: Gives other lattices for the photons of a segment, of that scene.
    """
    settings, count = tracer.settings, len(scenes)
    traced: list[Traced] = []
    for number, seen in enumerate(scenes):
        time, duration = (number + 0.5) / count - 0.5, 1.0 / count
        options = {"seed": settings.seed + number}
        for portion, keyframes in portions_of(seen) or [(plan, None)]:
            found, account = _of_segment(tracer, portion, seen, duration, keyframes, options, pixel, clock)
            traced += [
                (replace(photons, time=time + duration * photons.time, duration=duration * photons.duration), portion)
                for photons in found
            ]
            energy.add(account)
    return traced


def _of_segment(
    tracer: PhotonTracer,
    plan: EmissionPlan,
    seen: LoadedScene,
    weight: float,
    keyframes: ShutterKeyframes | None,
    options: dict[str, Any],
    pixel: PixelSize | None,
    clock: Clock,
) -> tuple[list[PhotonMap], EnergyAccount]:
    """The photons of ``plan`` in one segment of a shutter, and where their flux went; arguments as of
    :func:`_along_keyframes`."""
    settings = tracer.settings
    moves = seen.requirements.photon_motion
    emits = seen
    if settings.trace_at == "open" and moves:
        emits = tracer.loader.load_opening(seen.scene.shutter, clock)
        photons, account = tracer.trace(emits, plan, clock, weight=weight, **options)
        # Footprints stand at mid shutter and sweep to both sides: the same path, seen from its middle.
        photons = replace(photons, position=photons.position + 0.5 * photons.dxdt)
        traced = [(bent(photons, plan, tracer, pixel, clock), plan)]
    elif settings.path == "curved" and settings.kernel == "bspline" and moves and not _is_unseen(plan):
        traced, account = _along_keyframes(tracer, plan, seen, weight, keyframes, options, pixel, clock)
    else:
        traced, account = _whole(tracer, plan, seen, weight, options, pixel, clock)
    ending = partial(at_edges, loaded=seen, tracer=tracer, pixel=pixel, clock=clock)
    traced = [
        (ending(photons, lattices, finer=1 if lattices is plan else FINER), lattices) for photons, lattices in traced
    ]
    maps = [
        part
        for photons, lattices in traced
        for part in ([photons] if lattices is plan else in_coarse_cells(photons, lattices, plan))
    ]
    for cut in filter(None, (plan.strip, plan.portion)):
        maps = [_held_by(cut, photons, plan) for photons in maps]
    if plan.strip is not None:
        account.subtract(_beside_strip(tracer, plan, emits, weight, options, clock))
    return maps, account


def _is_unseen(plan: EmissionPlan) -> bool:
    """Whether nobody looks at the light of a plan: it is counted, and no better than that."""
    return plan.portion is not None and not plan.portion.seen


def _held_by(cut: Strip | Portion, photons: PhotonMap, plan: EmissionPlan) -> PhotonMap:
    """Those of the photons whose cells count in a strip or a portion of ``plan``: those beside are traced, too."""
    _, lattice, planned = plan.paths_of(photons.ids)
    return photons.rows(cut.holds(np.where(planned, lattice, -1), cell_of(photons)))


def _beside_strip(
    tracer: PhotonTracer, plan: EmissionPlan, seen: LoadedScene, weight: float, options: dict[str, Any], clock: Clock
) -> EnergyAccount:
    """Where the flux of cells went that count in other strips than that of ``plan``; arguments as of :func:`_whole`."""

    def beside(lattice: Lattice, patch: Patch) -> ChosenCells:
        cells = plan.strip.cells_beside(plan.number_of(lattice), patch).cell
        if plan.portion is None:
            return ChosenCells(cells)
        return ChosenCells(cells[plan.portion.holds(np.full(len(cells), plan.number_of(lattice)), cells)])

    return tracer.trace(seen, plan, clock, weight=weight, chosen=beside, **options)[1]


def _whole(
    tracer: PhotonTracer,
    plan: EmissionPlan,
    seen: LoadedScene,
    weight: float,
    options: dict[str, Any],
    pixel: PixelSize | None,
    clock: Clock,
) -> tuple[list[Traced], EnergyAccount]:
    """Photons that shine for the whole segment as they are at its middle; arguments as of :func:`_along_keyframes`."""
    options = {"weight": weight, **options}
    if seen.requirements.photon_motion or not has_finer_cells(tracer.settings) or _is_unseen(plan):
        photons, account = tracer.trace(seen, plan, clock, **options)
        return [(bent(photons, plan, tracer, pixel, clock), plan)], account
    with clock.stage("plan"):
        options["tags"] = PathTags(seen.scene, plan.photons).of(seen.scene)
    photons, account = tracer.trace(seen, plan, clock, **options)
    with clock.stage("trace"):
        _, resting = edge_cells(photons, plan, seen)
        edges = resting_edges(photons, plan, resting)
    # What is traced again is beside the rest all the same.
    photons = bent(photons, plan, tracer, pixel, clock)
    if edges is None:
        return [(photons, plan)], account
    finer, more = _finer_edges(edges, tracer, seen, options, clock)
    account.add(more)
    finer = bent(*finer, tracer, pixel, clock), finer[1]
    return [(photons.rows(~edges.holds(photons)), plan), finer], account


def _along_keyframes(
    tracer: PhotonTracer,
    plan: EmissionPlan,
    seen: LoadedScene,
    weight: float,
    keyframes: ShutterKeyframes | None,
    options: dict[str, Any],
    pixel: PixelSize | None,
    clock: Clock,
) -> tuple[list[Traced], EnergyAccount]:
    """Photons that go along trajectories, and those of cells whose light begins or ends within the segment.

    Args:
        seen: The scene of the segment.
        weight: Its part of the exposure.
        keyframes: Of its photons, where they are known already.
        options: Of the tracer.

    Returns:
        Photons of mid segment, those of finer cells at edges, and those of each part of it that has its own, with their
        lattices; where their flux went.
    """
    keyframes = keyframes or ShutterKeyframes.over(tracer, plan, seen, clock, weight)
    tagged = {"tags": keyframes.tags.of(seen.scene), "weight": weight, **options}
    photons, account = tracer.trace(seen, plan, clock, **tagged)
    states = keyframes.states(photons, plan)
    changing = edges = None
    light = float(photons.flux.sum(dtype=np.float64))
    if tracer.settings.emission == "lattice":
        with clock.stage("trace"):
            moving, resting = edge_cells(photons, plan, seen, tell_apart=has_finer_cells(tracer.settings))
        finest = typical_pixel_area(photons, pixel)
        changing = changing_cells(keyframes, photons, plan, states, clock, moving, finest)
        edges = resting_edges(photons, plan, resting, changing)
    finer = None
    if edges:
        finer, more = _finer_edges(edges, tracer, seen, tagged, clock)
        account.add(more)
        stays = ~edges.holds(photons)
        photons, states = photons.rows(stays), tuple(state.rows(stays) for state in states)
    # What is traced again is beside the rest all the same.
    photons = bent(photons, plan, tracer, pixel, clock)
    if changing:
        entered = {"smallest_branch": cutoff_in_parts(photons, changing, states, tracer.settings.branch_cutoff)}
        again, replaced = tracer.trace(seen, plan, clock, chosen=changing.at_middle(), **tagged, **entered)
        account.subtract(replaced)
        stays = ~np.isin(photons.ids, again.ids)
        photons, states = photons.rows(stays), tuple(state.rows(stays) for state in states)
    stay = photons.rows(changing.holds(photons, NEIGHBOURS_ASKED)) if changing else None
    photons, fitted = fit_trajectories(photons, plan, keyframes, clock, states)
    account.add(fitted)
    traced = [(photons, plan)]
    if changing:
        shutter, apart = seen.scene.shutter, [cells for cells in finer_in_time(changing, resting) if cells]
        bend = partial(_bent_beside, stay, plan, tracer, pixel, clock)
        given = tracer, keyframes, apart, shutter, weight, light, bend, clock
        parts, times, more = traced_in_parts(*given, **options, **entered)
        account.add(more)
        in_parts = [(part, cells.plan) for cells, of_cells in zip(apart, parts, strict=True) for part in of_cells]
        if entered["smallest_branch"] > tracer.settings.branch_cutoff:
            faint = changing.holds(photons)
            shine = plan, in_parts, list(chain.from_iterable(times)), replaced, more, account
            photons = shining_on(photons, faint, *shine)
        traced = [(photons, plan), *in_parts]
        account.counts["cells traced again in time"] = len(changing)
        if changing.limited:
            account.counts["cells that ride too far apart to grow"] = changing.limited
    if finer:
        photons, fitted = fit_trajectories(*finer, keyframes, clock)
        account.add(fitted)
        traced.append((bent(photons, finer[1], tracer, pixel, clock), finer[1]))
    return traced, account


def _bent_beside(
    stay: PhotonMap,
    plan: EmissionPlan,
    tracer: PhotonTracer,
    pixel: PixelSize | None,
    clock: Clock,
    cells: RetracedCells,
    photons: PhotonMap,
    others: Sequence[PhotonMap] = (),
) -> PhotonMap:
    """Photons of ``cells`` in a part of the shutter with what their neighbours know: each other, ``others`` of that
    part, and those that ``stay`` as they are at its middle, on the lattices of ``plan``."""
    if cells.plan is not plan:
        return bent(photons, cells.plan, tracer, pixel, clock, others)
    there = replace(stay, position=stay.position + np.float32(photons.time) * stay.dxdt)
    return bent(photons, plan, tracer, pixel, clock, [*others, there])


def _finer_edges(
    edges: RetracedCells, tracer: PhotonTracer, seen: LoadedScene, options: dict[str, Any], clock: Clock
) -> tuple[Traced, EnergyAccount]:
    """The photons of the finer cells of ``edges``, and where the flux of these went instead."""
    account = EnergyAccount()
    _, replaced = tracer.trace(seen, edges.plan, clock, chosen=edges.at_middle(), **options)
    account.subtract(replaced)
    fine, lattices, more = traced_finer(tracer, seen, edges, clock, **options)
    account.add(more)
    account.counts["cells traced again at edges"] = len(edges)
    return (fine, lattices), account
