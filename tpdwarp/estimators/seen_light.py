"""Finer cells where light is looked at.

A camera often sees a part of what a light lights: a corner of a pool, one of many glasses. A few photons show which
cells of the light that part comes from. These are cut into finer ones, and others stay as coarse as they are: light
that nobody sees is counted, and takes few photons.

Beyond the paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.errors import InputError
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.path_tags import PathTags
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.portions import Marks, Portion
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.photons.vectors import areas
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.settings import LightSettings
from tpdwarp.trajectories.changing import shifts_over
from tpdwarp.trajectories.keyframes import END, KeyframeScenes, ShutterKeyframes, shift_over_shutter
from tpdwarp.trajectories.neighbours import neighbours, second_differences
from tpdwarp.trajectories.retraced import CellsOfLattices, Window, grown
from tpdwarp.trajectories.rifts import widths_of_rifts

# Photons that show whether much of the light lies out of the picture at all: where it does not, that is all it takes.
FIRST_PHOTONS = 100
# Light is parted where so much of it at most lies in the picture. Chosen, not derived: else cells would be hardly
# narrower.
MOST_SEEN = 0.5
# Cells that are told apart: one for so many photons, within these limits. Chosen, not derived: where a third of the
# light is seen, those that are not take a twelfth of the photons.
PHOTONS_PER_COARSE_CELL = 8
FEWEST_COARSE_CELLS = 256
MOST_COARSE_CELLS = 1 << 14
# How many times as many cells there are at least where light is looked at, and how far one is cut along either side at
# most. Chosen, not derived.
LEAST_GAIN = 1.5
MOST_FINER = 64
# Where a frame shows more of the light than those looked at before, it takes up to so many times the photons asked for.
# Beyond, cells are less fine, and their photons' ids do not last. Chosen, not derived.
MOST_MORE = 1.25
# How many times as many parts a cell is cut into along one side as along the other at most. Chosen, not derived: the
# longer side of a cell blurs edges.
LONGEST = 2.0
# Photons of coarse cells are keyframes of cells that are cut into so many at most, along either side: as many as there
# are cells for one of the keyframes' otherwise, and half as many again.
FINER_THAN_KEYFRAMES = 6
# When light is looked for in the shutter: as keyframes see it, and as it first and last is.
TIMES = (0.0, -0.5, -END, END, 0.5)
# Cells are no narrower than so many images of a light with extent. Chosen: waves under a sun of .53° (65 k photons)
# take half as long again as under parallel light with cells of 1.5 images, .8 times as long with these, and err by
# .0003.
NARROWEST = 2.0
# How far beside it the footprint of a coarse cell reaches, in steps: a B-spline is three cells wide.
REACH = 1.5


class Sight(Protocol):
    """What is looked at."""

    def frames(self, photons: PhotonMap) -> np.ndarray:
        """Which photons lie in the picture, whether or not anything hides them there, shape [n]."""
        ...

    def sees(self, photons: PhotonMap, reach: float) -> np.ndarray:
        """Which photons light anything that is seen, up to ``reach`` of their steps beside them, shape [n]."""
        ...


def has_finer_cells(settings: LightSettings) -> bool:
    """Whether footprints are a lattice's own cells, so that those of finer cells fit in."""
    own = settings.emission == "lattice" and settings.kernel == "bspline" and settings.smoothing == 1.0
    return own and settings.path == "curved" and settings.estimator == "tpd"


# Lattices of a portion of the light, and keyframes for its photons where these are known already.
PortionPlan = tuple[EmissionPlan, ShutterKeyframes | None]


# By photons, parts of each light with extent, and exposure: into how many cells along u and along v one that is looked
# at is cut; None where light is spread evenly.
Known = dict[tuple[int, int, float], tuple[int, int] | None]


class SeenLight:
    """What of the light of an animation is looked at, and how much finer its cells are: as much in all frames, so that
    photons keep their ids.

    Args:
        tracer: Traces photons.
        load: Gives the scene over a shutter, with what looks at it.
        sight_of: What is looked at in the scenes of the segments of a shutter.
        known: How much finer cells are, as far as that was found out; what is found is added.
    """

    def __init__(
        self,
        tracer: PhotonTracer,
        load: Callable[[Shutter, Clock], LoadedScene],
        sight_of: Callable[[Sequence[LoadedScene], Clock], Sight],
        known: Known,
    ) -> None:
        self._tracer, self._load, self._sight_of, self._known = tracer, load, sight_of, known

    def tells_apart(self, scenes: Sequence[LoadedScene], clock: Clock) -> bool:
        """Whether photons in the scenes of the segments of a shutter go where they are looked at."""
        tracer = self._tracer
        plan = tracer.plan(max(1, tracer.settings.photons // len(scenes)), clock)
        return self._planned(plan, scenes[0].scene.shutter.exposure, clock) is not None

    def portions(
        self, plan: EmissionPlan, seen: LoadedScene, weight: float, scenes: Sequence[LoadedScene], clock: Clock
    ) -> list[PortionPlan] | None:
        """The photons of ``plan`` shared anew: lattices of cells that are looked at, and of all others; None where most
        of the light is.

        Args:
            plan: All of the light.
            seen: The scene of a segment of a shutter.
            weight: The segment's part of the exposure.
            scenes: Those of all segments.
        """
        planned = self._planned(plan, seen.scene.shutter.exposure, clock)
        if planned is None:
            return None
        tracer = self._tracer
        coarse, keyframes = self._coarse(plan, seen, clock), None
        with clock.stage("plan"):
            tags = PathTags(seen.scene, plan.photons)
        if seen.requirements.photon_motion:
            ends = KeyframeScenes.of(tracer, seen, clock)
            given = coarse, seen, ends.opening, ends.closing, tags, clock, ends.lights_change, weight
            keyframes = ShutterKeyframes(tracer, *given)
            maps = {part: keyframes.photons(part) for part in TIMES}
        else:
            maps = {0.0: tracer.trace(seen, coarse, clock, tags=tags.of(seen.scene))[0]}
        sight = self._sight_of(scenes, clock)
        with clock.stage("plan"):
            looked = _looked_at(coarse, seen, maps, partial(sight.sees, reach=REACH))
            finer = planned
            if looked.photons(planned) > MOST_MORE * plan.photons:
                finer = looked.finest(plan.photons, maps[0.0], coarse)
            if not looked.is_part or not _gains(looked, finer, coarse, plan) or _rides_apart(maps[0.0], coarse, looked):
                return None
            fine = replace(coarse.finer(*finer), portion=Portion(looked.marks, True, looked.share, finer))
            rest = replace(coarse, portion=Portion(looked.marks, False, 1.0 - looked.share))
        if keyframes is not None and max(finer) > FINER_THAN_KEYFRAMES:
            keyframes = ShutterKeyframes.over(tracer, fine, seen, clock, weight, ends)
        return [(fine, keyframes), (rest, None)]

    def _coarse(self, plan: EmissionPlan, seen: LoadedScene, clock: Clock) -> EmissionPlan:
        count = int(np.clip(plan.photons // PHOTONS_PER_COARSE_CELL, FEWEST_COARSE_CELLS, MOST_COARSE_CELLS))
        return self._tracer.plan(count, clock, shared=False).foreseeing(seen.scene)

    def _planned(self, plan: EmissionPlan, exposure: float, clock: Clock) -> tuple[int, int] | None:
        """Into how many cells along u and along v one that is looked at is cut, by a few frames of the animation; None
        where most of the light is looked at in one of them, or in all of them none."""
        if not plan.lattices or not has_finer_cells(self._tracer.settings):
            return None
        key = plan.photons, plan.splits, exposure
        if key not in self._known:
            with clock.stage("plan"):
                self._known[key] = self._by_stills(plan, exposure, Clock())
        return self._known[key]

    def _by_stills(self, plan: EmissionPlan, exposure: float, clock: Clock) -> tuple[int, int] | None:
        tracer, stills = self._tracer, self._tracer.source.reference_shutters()
        # Most often that in the middle tells, and no other is loaded.
        numbers = dict.fromkeys([len(stills) // 2, 0, len(stills) - 1])
        finest = None
        for number in numbers:
            middle = stills[number].middle
            shutter = Shutter(stills[number].frame, middle - 0.5 * exposure, middle + 0.5 * exposure)
            try:
                seen = self._load(shutter, clock)
            except InputError:
                # What cannot be used there may be elsewhere.
                continue
            sight = self._sight_of([seen], clock)
            few = tracer.plan(FIRST_PHOTONS, clock, shared=False).foreseeing(seen.scene)
            if _looked_at(few, seen, {0.0: tracer.trace(seen, few, clock)[0]}, sight.frames).is_most:
                return None
            coarse = self._coarse(plan, seen, clock)
            tags = PathTags(seen.scene, plan.photons).of(seen.scene)
            photons, _ = tracer.trace(seen, coarse, clock, tags=tags)
            looked = _looked_at(coarse, seen, {0.0: photons}, partial(sight.sees, reach=REACH))
            if looked.is_most:
                return None
            if looked.is_part:
                finer = looked.finest(plan.photons, photons, coarse)
                if not _gains(looked, finer, coarse, plan):
                    return None
                finest = min(finest or finer, finer, key=math.prod)
        return finest


def _gains(looked: _Looked, finer: tuple[int, int], coarse: EmissionPlan, plan: EmissionPlan) -> bool:
    """Whether cells that are cut like that out of ``coarse`` ones are enough more than those of ``plan``, with no more
    photons in all."""
    enough = math.prod(finer) * coarse.photons >= LEAST_GAIN * plan.photons
    return enough and looked.photons(finer) <= MOST_MORE * plan.photons


@dataclass(frozen=True, eq=False)
class _Looked:
    """Cells that are looked at.

    Attributes:
        marks: Which, of each lattice by its number.
        cells, others: How many they are, and how many others are emitted.
    """

    marks: dict[int, Marks]
    cells: int
    others: int

    @property
    def share(self) -> float:
        """How many cells are looked at, as a part of all."""
        return self.cells / max(1, self.cells + self.others)

    @property
    def is_part(self) -> bool:
        """Whether some cells are looked at, and not most."""
        return 0.0 < self.share <= MOST_SEEN

    @property
    def is_most(self) -> bool:
        """Whether most are looked at."""
        return self.share > MOST_SEEN

    def photons(self, finer: tuple[int, int]) -> int:
        """Photons in all, if cells that are looked at are cut into so many along u and along v."""
        return self.others + math.prod(finer) * self.cells

    def finest(self, photons: int, shown: PhotonMap, plan: EmissionPlan) -> tuple[int, int]:
        """Into how many cells along u and along v those that are looked at are cut, with so many photons in all.

        Args:
            shown: Photons of the cells of ``plan``.
        """
        most = min((photons - self.others) // max(self.cells, 1), _most_of_images(shown), MOST_FINER**2)
        return _finest(max(1, int(most)), _blur(shown, plan))


def _looked_at(
    plan: EmissionPlan,
    seen: LoadedScene,
    maps: Mapping[float, PhotonMap],
    chooses: Callable[[PhotonMap], np.ndarray],
) -> _Looked:
    """Cells of ``plan`` of which any photon in any of ``maps`` is chosen.

    Cells ride on what their light meets first: those that are seen at some time are told by where they are in the
    middle of the shutter, and on the way there. Where a light needs lattices of this shutter alone, there are none.

    Args:
        maps: Photons by when in the shutter (−½ … ½) they were traced.
        chooses: Which of them count.
    """
    patches = [(plan.number_of(lattice), patch) for lattice, patch in plan.patches(seen.scene)]
    if any(number < 0 for number, _ in patches):
        return _Looked({}, 0, 0)
    emitted = {number: Window.of_patch(patch) for number, patch in patches}
    whole: dict[int, list[np.ndarray]] = {}
    at_edges: dict[int, list[np.ndarray]] = {}
    for part, photons in maps.items():
        chosen = chooses(photons)
        for among, cells_of in ((chosen, whole), (chosen & _is_at_edge(photons, plan), at_edges)):
            found = CellsOfLattices(photons, plan, among)
            for number in found.numbers():
                rows, cells = found.of(number)
                cells_of.setdefault(number, []).append(cells)
                if part != 0.0 and number in emitted:
                    way = part * shift_over_shutter(photons.shift[rows], part)
                    for share in (0.5, 1.0):
                        there = np.rint(cells - share * way)
                        # Where light grazes, shifts grow without bound.
                        cells_of[number].append(there[emitted[number].holds(there)].astype(np.int64))
    marks = {}
    for number, parts in whole.items():
        window = Window.around(np.concatenate(parts), margin=1)
        marked, edges = window.grid(dtype=bool), window.grid(dtype=bool)
        marked[window.at(np.concatenate(parts))] = True
        for cells in at_edges.get(number, []):
            edges[window.at(cells)] = True
        marks[number] = Marks(plan.lattices[number], window.first, marked | grown(edges))
    within = {number: Portion(marks, True, 1.0).cells_of(number, patch) for number, patch in patches}
    count = sum(map(len, within.values()))
    return _Looked(marks, count, sum(patch.count_u * patch.count_v for _, patch in patches) - count)


def _rides_apart(photons: PhotonMap, plan: EmissionPlan, looked: _Looked) -> bool:
    """Whether cells that are looked at ride so far apart (:mod:`tpdwarp.trajectories.rifts`) that others beside these
    have to be known."""
    found = CellsOfLattices(photons, plan)
    for number, marks in looked.marks.items():
        size = np.array(marks.marked.shape)
        widths = widths_of_rifts(shifts_over(found, number, Window(marks.first, size)))
        if np.any(widths > 0.0) and 2.0 * np.ceil(widths.max()) + 1.0 > size.min():
            return True
    return False


def _blur(photons: PhotonMap, plan: EmissionPlan) -> np.ndarray:
    """How far light is from where first derivatives have it, along u and along v, by the photons' flux, shape [2]."""
    found = []
    for pairs in neighbours(photons, plan):
        second = [second_differences(photons.position[:, axis], pairs) for axis in range(3)]
        found.append(np.average(np.linalg.norm(second, axis=0), weights=photons.flux.sum(axis=1)))
    return np.maximum(found, np.finfo(np.float32).tiny)


def _is_at_edge(photons: PhotonMap, plan: EmissionPlan) -> np.ndarray:
    """Of which photons a cell beside theirs has none on the same path, so that part of it may have, shape [n]."""
    beside = np.zeros(len(photons), np.int64)
    for a, b in neighbours(photons, plan):
        beside[a] += 1
        beside[b] += 1
    return beside < 4


def _most_of_images(photons: PhotonMap) -> float:
    """How many times as many cells there are use for: those hardly wider than what their light is blurred by, as it
    comes from a light with extent, show nothing more."""
    if not len(photons.dxda) or not len(photons):
        return math.inf
    images = 4.0 * NARROWEST**2 * areas(photons.dxda, photons.dxdb)
    cells = areas(photons.dxdu, photons.dxdv)
    with np.errstate(divide="ignore"):
        return float(np.median(np.where(images > 0.0, cells / images, np.inf)))


def _finest(most: int, blur: np.ndarray) -> tuple[int, int]:
    """Into how many cells along u and along v one is cut, with no more than ``most`` in all, for the least blur: along
    either side it falls as the square of their number."""
    across = np.arange(1, most + 1)
    down = most // across
    near = np.maximum(across, down) <= LONGEST * np.minimum(across, down)
    across, down = across[near], down[near]
    best = np.argmin(blur[0] / across**2 + blur[1] / down**2)
    return int(across[best]), int(down[best])
