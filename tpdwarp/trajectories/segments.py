"""Segments: into how many parts a shutter is cut for a given number of photons.

K segments let footprints stand right in the middle of each, and multiply the area of footprints, and what they blur, by
K. Light whose irradiance changes over a length L, moved by s, errs by s/L of itself; blurred by a kernel of variance
σ², by σ²/(2L²). With derivatives over the whole shutter, and footprints h wide (σ² = h²/4 for the quadratic B-spline),
that is on average

    |D_tt x|/(24 L K²) for straight trajectories,  |D_tttt x|/(1240 L K⁴) for curved ones,  h² K/(8L²) for the blur

and √K times as much light as for one segment lies within a cell of where light ends; light that begins or ends within
the shutter, or whose flux grows along a straight trajectory, errs by a part of it ∝ 1/K. All are means over the photons
of a coarse trace, weighted by flux and by the root of how bright their light is. L comes from the footprints
themselves: irradiance goes with the inverse of their area; h is each photon's own width, which vanishes with L at
folds. D_t x is known from keyframes as the shutter opens and closes, as it is for trajectories, which go straight where
keyframes disagree: so a few segments more may be far better. A curved trajectory that knows D_t x at the times ±σ
misses (s⁴ − 2σ² s²)/24 of D_tttt x at the part s of the shutter, and that is as large as D_tt x by the ratio of D_ttt x
to D_t x, as in a swing. (Those that know where they pass miss less, but axes that follow to first order only err more.)

Where motion breaks between two time samples of a stage, a curved trajectory that leads past the break errs by 0.03 of
the change of D_t x there, as

    0.72 |D_tt x|/(24 L K²)

since that change is D_tt x. So numbers of segments that begin where samples do are far better than others, often better
than larger ones.

What turns has a segment for every few degrees in any case (:mod:`.turns`).
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.path_tags import PathTags
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import SceneAtShutter, SceneSource, Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.brightening import lights_change
from tpdwarp.trajectories.changing import (
    LARGEST_MISS,
    LARGEST_SAGITTA,
    LEAST_DISAGREEMENT,
    is_a_sheet_alone,
    resting_where_turned_over,
    shifts_over,
)
from tpdwarp.trajectories.keyframes import (
    END,
    KEYFRAME_DURATION,
    LARGEST_DISAGREEMENT,
    KeyframeState,
    ShutterKeyframes,
    disagreement,
    keyframe_shutters,
    steadily_lit,
)
from tpdwarp.trajectories.neighbours import Pairs, growth_of, neighbours
from tpdwarp.trajectories.retraced import (
    LEAST_SHARE,
    PARTS,
    CellsOfLattices,
    Window,
    matters,
    typical_area,
)
from tpdwarp.trajectories.rifts import rift_cells, widths_of_rifts
from tpdwarp.trajectories.turns import segments_needed

# Photons of the trace from which the number of segments is chosen. Chosen, not derived.
PILOT_PHOTONS = 4096
# Photons that a segment has at least. Chosen, not derived.
FEWEST_PHOTONS = 256
# Each segment is a scene to load and trace. Chosen, not derived.
MOST_SEGMENTS = 64
# Frames looked at, spread over the animation. Chosen, not derived.
MOST_FRAMES = 4
# Light ends at a border of the lattice within half a cell of where it should, and its edge is as blurred as the cells
# are wide: there it errs as by the blur of what changes over a cell.
BORDER_ERROR = 0.125
# Light that begins or ends within the shutter errs by a quarter of itself on average if it counts for all or nothing;
# traced in parts of the shutter by a quarter of one, of which an eighth is left where edges are found between these
# (``scripts/benchmarks/solids.py board-over-water``, 65 k photons: .0165 in one segment, .0217 in two).
PASSING_ERROR = 0.25
PASSING_ERROR_IN_PARTS = 0.03125 / PARTS
# Of light that begins or ends within the shutter so much lies at the edges that pass, which are as blurred as cells are
# wide. Chosen on a thin mirror that turns over, which errs by .019 in one segment, .023 in two and .040 in four (16 k
# photons; else it took 59), and on a prism (``scripts/benchmarks/solids.py prism-turning``), for which two are best.
PASSING_BORDER = 0.03125
# Where bodies pass one another cells ride along a field that goes over from the one to the other, over twice the width
# of the rift between them, and not where that is wider than half of the lattice. (Of one alone that light grazes cells
# drift apart, too.) Two glass balls of radius .35 that cross each other by 1.0 err by .25 in one segment, .115 in two,
# .026 in three and .032 in six (16 k photons).
WIDEST_RIFT = 0.4
# Less of the light that lands is not worth a segment for what it falls on. Chosen, not derived.
LEAST_LIT = 0.02
# Segments up to which it is asked whether cells ride apart. Chosen, not derived.
MOST_TORN = 8
# Parts into which longer shutters are cut to be looked at.
MOST_PARTS = 8
# Beyond this quantile D_tt x belongs to light that appears and vanishes at edges, which no trajectory follows. Chosen,
# not derived.
LARGEST_QUANTILE = 0.95
# Footprints finer than this quantile of their areas lie at folds, where light is as bright as if they had it. Chosen,
# not derived.
FINEST = 0.05
# What curved trajectories that lead past a break err by, as a part of what straight ones of a smooth motion do: 0.03 of
# the change of D_t x, as above, over the 1/24 of those.
BREAK_ERROR = 0.72
# How near, in segments, the end of one counts as lying on a break: breaks are rounded to 1e-6 of the shutter, which 64
# segments make 6e-5.
AT_BREAK = 1e-4
# Another segment has to lessen the error by more than this part to pay for another scene. Chosen, not derived.
LEAST_GAIN = 0.1


class Segmentation:
    """Cuts the shutters of one animation into segments.

    Args:
        tracer: Traces the photons from which ``auto`` is decided.
    """

    def __init__(self, tracer: PhotonTracer) -> None:
        self._tracer = tracer
        self._chosen: dict[tuple[float, float], int] = {}

    def count(self, shutter: Shutter, clock: Clock) -> int:
        """Into how many segments shutters like this one are cut; ``auto`` is decided once for the whole animation."""
        settings = self._tracer.settings
        if settings.segments != "auto":
            return settings.segments
        if settings.estimator != "tpd":
            return 1
        key = (round(shutter.open - shutter.frame, 6), round(shutter.close - shutter.frame, 6))
        if key not in self._chosen:
            with clock.stage("plan"):
                self._chosen[key] = best_segment_count(self._tracer, shutter)
        return self._chosen[key]

    def load(self, shutter: Shutter, clock: Clock) -> list[LoadedScene]:
        """The scenes of the segments of ``shutter``; one where nothing moves."""
        return as_few_as_move(self.load_each(shutter, clock))

    def load_each(self, shutter: Shutter, clock: Clock) -> list[LoadedScene]:
        """The scenes of all segments of ``shutter``, whatever moves."""
        return self._tracer.load_each(shutter.segments(self.count(shutter, clock)), clock)


def as_few_as_move(scenes: list[LoadedScene]) -> list[LoadedScene]:
    """The scenes of the segments of a shutter, of which one stands for all where nothing moves or changes its light."""
    lights = scenes[0].scene.lights
    changes = any(lights_change(other.scene.lights, lights) for other in scenes[1:])
    return scenes if changes or any(scene.moves for scene in scenes) else scenes[:1]


@dataclass(frozen=True, eq=False)
class SegmentErrors:
    """Errors of the light of photons, as parts of it, for one segment; one row a photon.

    Attributes:
        weight: Of each photon's in their mean: its flux, times the root of how bright its light is.
        straight, curved: In time, for straight and for curved trajectories.
        disagreement: Of keyframes, as a part of D_t x; infinite where trajectories never curve.
        blur: In space.
        border: Where light ends beside a photon, or passes: jagged borders are blurred by whole cells.
        passing: In time, for light that begins or ends within the shutter or changes its flux.
        sagitta, miss: What straight ways, and curved ones, are off at the ends of the shutter, in footprints; zero of
            what is not traced again in parts of the shutter for it.
        torn: The most segments in which their cells are traced again in parts, as they ride apart from those beside
            them; 0 of those that never do.
    """

    weight: np.ndarray
    straight: np.ndarray
    curved: np.ndarray
    disagreement: np.ndarray
    blur: np.ndarray
    border: np.ndarray
    passing: np.ndarray
    sagitta: np.ndarray
    miss: np.ndarray
    torn: np.ndarray

    @classmethod
    def joined(cls, parts: Collection[SegmentErrors]) -> SegmentErrors:
        """The errors of several frames together."""
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))

    def total(self, segments: np.ndarray, breaks: Collection[float]) -> np.ndarray:
        """Their mean for numbers of segments, up to a factor; ``breaks`` of motion are parts of the shutter."""
        count = segments[:, None].astype(np.float64)
        follows = self.disagreement / count**2 <= LARGEST_DISAGREEMENT
        inside = np.array([[most_breaks_inside(breaks, k)] for k in segments])
        at_breaks = BREAK_ERROR * (inside > 0) / np.maximum(inside, 1) ** 2 * self.straight / count**2
        curved = np.where(follows, np.maximum(self.curved / count**4, at_breaks), self.straight / count**2)
        # Parts are PARTS times as short, and their D_tt x is known from those before and after: D_ttt x is left.
        curved = np.where(self._traced_in_parts(count), self.straight / count**2 / PARTS**3, curved)
        in_time = curved + self.passing / count
        in_space = count * self.blur + np.sqrt(count) * self.border
        return (self.weight * (in_time + in_space)).sum(axis=1)

    def _traced_in_parts(self, count: np.ndarray) -> np.ndarray:
        """Which photons' cells are traced again, since no curve leads where their light goes, for numbers of segments
        [k, 1]; shape [k, n]. Footprints grow by the root of these."""
        apart, sagitta = self.disagreement / count**2, self.sagitta / count**2.5
        lost = (count <= self.torn) | (apart > LARGEST_DISAGREEMENT) & (sagitta > LARGEST_SAGITTA)
        return lost | (apart > LEAST_DISAGREEMENT) & (np.minimum(self.miss / count**4.5, sagitta) > LARGEST_MISS)

    def over(self, parts: int) -> SegmentErrors:
        """The errors over a shutter of ``parts`` times the length, through which motion goes on alike."""
        longer = {"straight": self.straight * parts**2, "curved": self.curved * parts**4}
        longer |= {"passing": self.passing * parts, "torn": self.torn * parts}
        if parts > 1:
            # Keyframes of the whole shutter may not see what swings to and fro between them.
            longer |= {"sagitta": 0.0 * self.sagitta, "miss": 0.0 * self.miss}
        return replace(self, **longer, disagreement=self.disagreement * parts)

    def best(self, breaks: Collection[float], most: int = MOST_SEGMENTS, least: int = 1) -> int:
        """The number of segments, ``least`` to ``most``, that is nearly as good as the best."""
        least = min(least, most)
        totals = self.total(np.arange(least, most + 1), breaks)
        return least + int(np.argmax(totals <= (1.0 + LEAST_GAIN) * totals.min()))


def motion_breaks_within(source: SceneSource, shutter: Shutter) -> set[float]:
    """Where in ``shutter`` motion may change abruptly, as parts of it."""
    return {round((time - shutter.open) / shutter.exposure, 6) for time in source.motion_breaks(shutter)}


def most_breaks_inside(breaks: Collection[float], segments: int) -> int:
    """The most breaks, given as parts of the shutter, that one of so many equal segments has inside."""
    places = [place * segments for place in breaks]
    inside = [math.floor(place) for place in places if abs(place - round(place)) > AT_BREAK]
    return max(Counter(inside).values(), default=0)


def best_segment_count(tracer: PhotonTracer, shutter: Shutter) -> int:
    """The number of segments for shutters of this length and place in the frame.

    It is found at a few times spread over the animation and not at the frame itself, so that all frames have the same
    lattices and do not flicker.
    """
    photons = tracer.settings.photons
    if shutter.exposure <= 0 or photons < 2 * FEWEST_PHOTONS:
        return 1
    plan = tracer.plan(min(photons, PILOT_PHOTONS))
    stills = tracer.source.reference_shutters()
    chosen = stills[:: math.ceil(len(stills) / MOST_FRAMES)]
    found: list[SegmentErrors] = []
    least = 1
    breaks: set[float] = set()
    for still in chosen:
        # At whole frames, since it matters where in the shutter a stage's samples lie.
        frame = stills[0].middle + math.floor(still.middle - stills[0].middle)
        start = frame + shutter.open - shutter.frame
        breaks |= motion_breaks_within(tracer.source, Shutter(frame, start, start + shutter.exposure))
    # What swings to and fro within the shutter seems to be at rest as it opens and closes: looked at sample by sample,
    # or frame by frame, it does not.
    parts = max(math.ceil(shutter.exposure - AT_BREAK), min(len(breaks) + 1, MOST_PARTS))
    for number in range(max(len(chosen), min(parts, MOST_FRAMES))):
        still = chosen[number % len(chosen)]
        frame = stills[0].middle + math.floor(still.middle - stills[0].middle)
        start = frame + shutter.open - shutter.frame
        whole = Shutter(frame, start, start + shutter.exposure)
        shutter_part = whole.segments(parts)[number % parts]
        scenes = _keyframe_scenes(tracer, shutter_part)
        errors, rifts, lit = _errors_over(tracer, scenes, plan)
        turns = parts * segments_needed([loaded.scene for loaded in scenes], 2.0 * END, lit)
        # Rounding is no segment more.
        least = max(least, math.ceil(turns - 1e-3), math.ceil(parts * rifts / WIDEST_RIFT))
        if errors is not None:
            found.append(errors.over(parts))
    most = min(MOST_SEGMENTS, photons // FEWEST_PHOTONS)
    return SegmentErrors.joined(found).best(breaks, most, least) if found else min(least, most)


def _keyframe_scenes(tracer: PhotonTracer, shutter: Shutter) -> list[LoadedScene]:
    """The scenes at the keyframes of a shutter, in the order of time, lit as over all of it."""
    scenes = tracer.load_each(keyframe_shutters(shutter), Clock())
    if not any(lights_change(one.scene.lights, other.scene.lights) for one, other in itertools.pairwise(scenes)):
        return scenes
    return steadily_lit(tracer, scenes, (-END, 0.0, END), tracer.source.at(shutter).lights)[0]


def _errors_over(
    tracer: PhotonTracer, scenes: Sequence[LoadedScene], plan: EmissionPlan
) -> tuple[SegmentErrors | None, float, frozenset[str]]:
    """Errors of the photons that land over the shutter of a frame, None where none do that keyframes say anything of;
    how wide the rifts between them are, as a part of their lattice; and prim paths of what they fall on.

    Args:
        scenes: At the keyframes of that shutter, in the order of time.
    """
    clock, settings = Clock(), tracer.settings
    opening, middle, closing = scenes
    scenes = [middle, opening, closing]
    keyframes = ShutterKeyframes(tracer, plan, *scenes, PathTags(scenes[0].scene, plan.photons), clock)
    photons = _over_shutter(keyframes.photons(0.0))
    at_ends = [keyframes.photons(part) for part in (-END, END)]
    lit = _lit_receivers([photons, *at_ends], middle.scene)
    rifts = 0.0
    if sum(mesh.specular for mesh in middle.scene.meshes) > 1:
        rifts = _widest_rift([photons, *map(_over_shutter, at_ends)], plan)
    before, after = keyframes.around(photons, plan)
    known = before.valid & after.valid
    # At borders of the lattice keyframes say nothing even in the middle of the shutter.
    at_middle = keyframes.at_middle(photons, plan)
    begins = at_middle.valid & ~known
    curves = settings.path == "curved" and settings.kernel == "bspline" and settings.trace_at == "middle"
    if not known.any():
        # All light begins or ends within the shutter, and of its way no more is known than in the middle.
        known, before, after = begins, at_middle, at_middle
    rows = np.flatnonzero(known)
    if not len(rows):
        return None, rifts, lit
    known = photons.rows(rows)
    share = plan.photons / settings.photons
    passing = float(photons.flux[begins].sum() / photons.flux.sum())
    torn = np.zeros(len(photons))
    if curves and settings.emission == "lattice":
        torn = _torn(photons, plan, is_a_sheet_alone(keyframes))
    return _errors(known, before.rows(rows), after.rows(rows), plan, share, curves, passing, torn[rows]), rifts, lit


def _lit_receivers(maps: Sequence[PhotonMap], scene: SceneAtShutter) -> frozenset[str]:
    """Prim paths of the meshes on which as much of the light of some instants falls as matters."""
    receivers = np.concatenate([photons.receiver for photons in maps])
    flux = np.concatenate([photons.flux.sum(axis=1) for photons in maps])
    mesh_of = np.repeat(np.arange(len(scene.meshes)), [len(mesh.objects) for mesh in scene.meshes])
    light = np.bincount(mesh_of[receivers], flux, len(scene.meshes))
    return frozenset(
        mesh.path for mesh, share in zip(scene.meshes, light, strict=True) if share > LEAST_LIT * light.sum()
    )


def _over_shutter(photons: PhotonMap) -> PhotonMap:
    """Photons of a keyframe, traced over a short time, as over the whole shutter."""
    return replace(photons, dxdt=photons.dxdt / KEYFRAME_DURATION, shift=photons.shift / KEYFRAME_DURATION)


def _widest_rift(maps: Sequence[PhotonMap], plan: EmissionPlan) -> float:
    """How wide the rifts of any lattice are, as a part of what its light meets in the middle of the shutter.

    What turns over has none: its cells rest.

    Args:
        maps: Photons in the middle of the shutter, then at other times, which may show what is hidden there.
    """
    found = [CellsOfLattices(resting_where_turned_over(photons, plan)[0], plan) for photons in maps]
    widest = 0.0
    for number in found[0].numbers():
        size = Window.around(found[0].of(number)[1]).size
        for there in found:
            if number in there.numbers():
                field = shifts_over(there, number, Window.around(there.of(number)[1]))
                widest = max(widest, *(widths_of_rifts(field) / size))
    return widest


def _torn(photons: PhotonMap, plan: EmissionPlan, alone: bool) -> np.ndarray:
    """The most segments in which the cell of each photon is traced again, since it rests or lies around a rift, [n].

    Args:
        alone: Whether they are of one sheet, whose cells never rest.
    """
    torn = np.zeros(len(photons))
    for count in range(1, MOST_TORN + 1):
        riding, resting = replace(photons, shift=photons.shift / np.float32(count)), {}
        if not alone:
            riding, resting = resting_where_turned_over(riding, plan)
        found = CellsOfLattices(riding, plan)
        for number in found.numbers():
            rows, cells = found.of(number)
            window = Window.around(cells)
            shifts = shifts_over(found, number, window)
            around, field = rift_cells(shifts)
            if number in resting:
                around[window.at(resting[number])] = True
            if around.any():
                torn[rows[around[window.at(cells)]]] = count
            elif shifts.any() and not field.any():
                torn[rows] = count
        if not np.any(torn == count):
            break
    return torn


def _errors(
    photons: PhotonMap,
    before: KeyframeState,
    after: KeyframeState,
    plan: EmissionPlan,
    share: float,
    curves: bool,
    passing: float,
    torn: np.ndarray,
) -> SegmentErrors:
    """Errors of photons of mid shutter, of which keyframes know the states ``before`` and ``after`` it.

    Args:
        plan: Their lattices.
        share: Cell area of the full number of photons by that of the pilot's.
        curves: Whether trajectories curve.
        passing: Part of the light that begins or ends within the shutter.
        torn: As in :class:`SegmentErrors`.
    """
    flux = photons.flux.sum(axis=1).astype(np.float64)
    areas = np.linalg.norm(np.cross(photons.dxdu, photons.dxdv), axis=1)
    # Of the mean square error of irradiance, each photon's light has a part that goes with its flux and with how bright
    # it is; the root of that counts, since the brightest light is that of a few photons of a coarse trace.
    weight = flux * np.sqrt(flux / np.maximum(areas, max(np.quantile(areas, FINEST), np.finfo(float).tiny)))
    span = 1.0 - KEYFRAME_DURATION
    second = np.linalg.norm(after.dxdt - before.dxdt, axis=1) / span
    third = np.linalg.norm(before.dxdt + after.dxdt - 2.0 * photons.dxdt, axis=1) * (2.0 / span) ** 2
    apart = disagreement(photons, before.dxdt, after.dxdt) if curves else np.full(len(photons), np.inf)
    widths = [np.linalg.norm(column, axis=1) for column in (photons.dxdu, photons.dxdv)]
    typical = [math.sqrt(share) * float(np.median(width)) for width in widths]
    if not max(typical) > 0:
        return SegmentErrors(weight, *[0.0 * flux] * 2, apart, *[0.0 * flux] * 5, torn)
    sagitta = miss = np.zeros(len(photons))
    if curves:
        footprint = np.maximum(math.sqrt(share) * photons.size, np.finfo(float).tiny)
        again = matters(photons, typical_area(photons), LEAST_SHARE) / footprint
        sagitta = again * second * span / 8.0
        miss = again * np.divide(third**2, 384.0 * second, out=np.zeros_like(third), where=second > 0.0)
    # Areas vanish at folds; no footprint is finer than the typical one.
    least = np.maximum(typical[0] * widths[1], typical[1] * widths[0])
    logs = np.log(np.hypot(areas, least))
    # Cells are longer where light varies less, so each direction counts with its own.
    beside = neighbours(photons, plan)
    changes = [
        np.minimum(_slope(logs, photons.position, pairs, 0.3 * size), 1.0 / max(size, np.finfo(float).tiny))
        for pairs, size in zip(beside, typical, strict=True)
    ]
    blur = np.max(
        [
            np.minimum(math.sqrt(share) * width, size) * change
            for width, size, change in zip(widths, typical, changes, strict=True)
        ],
        axis=0,
    )
    change = np.max(changes, axis=0)
    first, second, third = (
        np.minimum(size, np.quantile(size, LARGEST_QUANTILE))
        for size in (np.linalg.norm(photons.dxdt, axis=1), second, third)
    )
    fourth = second * (third.sum() / max(first.sum(), np.finfo(float).tiny))
    in_time = change * second / 24.0, change * fourth / 1240.0
    border = BORDER_ERROR * math.sqrt(share) * _alone(photons, plan, beside)
    if curves:
        border += BORDER_ERROR * math.sqrt(share) * PASSING_BORDER * passing
    error = np.full(len(photons), passing * (PASSING_ERROR_IN_PARTS if curves else PASSING_ERROR))
    if not curves:
        # Cells that ride grow and shrink on the light by ∂_u s_u + ∂_v s_v, and so does their flux. Straight
        # trajectories keep theirs, which tells where light has moved on by the time.
        growth = growth_of(photons, beside)
        error += 0.25 * np.abs(growth) * np.minimum(1.0, change * first)
    return SegmentErrors(weight, *in_time, apart, blur**2 / 8.0, border, error, sagitta, miss, torn)


def _alone(photons: PhotonMap, plan: EmissionPlan, beside: Collection[Pairs]) -> np.ndarray:
    """Half for each side along u or v, whichever has more, on which photons have no neighbour, shape [n].

    Where a lattice ends, so does a sheet that fills it: its cells end just there.
    """
    _, lattice, _ = plan.paths_of(photons.ids)
    cell = np.floor(photons.emission).astype(np.int64)
    alone = np.zeros(len(photons))
    for axis, (a, b) in enumerate(beside):
        sides = np.zeros(len(photons))
        for rows in (a, b):
            sides[rows] += 0.5
        for number in np.unique(lattice):
            rows = lattice == number
            along = cell[rows, axis]
            sides[rows] += 0.5 * (along == along.min()) + 0.5 * (along == along.max())
        alone = np.maximum(alone, 1.0 - np.minimum(sides, 1.0))
    return alone


def _slope(values: np.ndarray, positions: np.ndarray, pairs: Pairs, closest: float) -> np.ndarray:
    """How fast ``values`` change from photon to photon, shape [n]; distances count as no less than ``closest``."""
    slope = np.zeros(len(values))
    a, b = pairs
    distance = np.maximum(np.linalg.norm(positions[b] - positions[a], axis=1), max(closest, np.finfo(float).tiny))
    np.maximum.at(slope, a, np.abs(values[b] - values[a]) / distance)
    return slope
