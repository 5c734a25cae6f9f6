"""Emission lattices on the lights, aimed at the specular geometry and fixed for the whole animation.

Spacing and phase of a lattice come from a few stills spread over the animation, never from the frame at hand, so that
a photon keeps its lattice coordinates (and its id) from frame to frame; each frame emits the cells that can reach
something specular during its shutter.

Beyond the paper, whose photons start at random: with a lattice, the error of footprints falls with their number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp

from tpdwarp.photons.aiming import Bounds, Specular, area_of, bounds_of, cube_axes, spread_of
from tpdwarp.photons.emission import ChosenCells, Domain, Patch
from tpdwarp.photons.energy import FEWEST_OF_SEVERAL
from tpdwarp.photons.lattice_shape import OWN_AXES, LatticeShape, lattice_shape, turned
from tpdwarp.photons.portions import Portion
from tpdwarp.photons.strips import Strip, strips_of
from tpdwarp.scene.coordinate_range import require_within_range
from tpdwarp.scene.description import (
    ExtentShape,
    LightAtShutter,
    LightKind,
    SceneAtShutter,
    SceneSource,
    reference_scenes,
)
from tpdwarp.scene.device.shaping import ShapingValues, is_shaped, shaping_axis, shaping_values
from tpdwarp.scene.light_cuts import LightCuts
from tpdwarp.scene.light_places import phase_of, prim_of, split_lights, whole_of
from tpdwarp.scene.normalization import Normalization

# Rows of long cells that are kept at least: where light ends, such cells blur its edge by their length. Chosen, not
# derived: an eighth of the patch.
FEWEST_ROWS = 8
# Half the angle [rad] that one patch of directions may cover; beyond it a cube takes over. There, cells are cos 60°,
# half as wide as in the middle. (That they may be no narrower is chosen, not derived.)
WIDEST_SINGLE_PATCH = math.radians(60.0)
# Half the angle up to which it is kept where a body comes nearer than stills show it: cells are a quarter as wide
# there. Chosen, not derived. Photons of a lattice made for one frame have no keyframes.
WIDEST_KEPT_PATCH = math.radians(75.0)
# Half the angle that a face of the cube covers.
CUBE_FACE = math.pi / 4
# How many times the cells that the stills foresaw a frame may emit; a rod that turns takes some times as many. Chosen,
# not derived: it limits the time of such a frame.
LARGEST_CELL_GROWTH = 16
# Beams start near what is specular where that is smaller than this part of its distance from the light. At this size,
# rounding of the distance (6e-8 of it) is 6e-6 of the thing, as much as a hundred roundings of its own coordinates.
NEARBY = 1.0e-2
# Lights share photons by this power of theirs: what is ten times fainter gets three quarters of the photons of the
# brightest, what is a thousand times fainter 0.42 of them, and none less than a tenth. Chosen, not derived: errors of a
# light's caustic, as parts of it, fall with its photons.
SHARING_POWER = 1.0 / 8.0
LEAST_WEIGHT = 0.1
# Half floats hold 40 stops. A light fainter than that beside the brightest is in no picture with it, and takes no
# photons that others would miss.
FAINTEST = 2.0**-40
# Bounds of a patch whose cells are known.
NOWHERE: Bounds = (0.0, 0.0, 0.0, 0.0)
# Lattice coordinates are single precision, of 24 bits: beyond this cell they no longer resolve a quarter of one.
LARGEST_CELL_NUMBER = 2**22


@dataclass(frozen=True)
class Lattice:
    """One lattice of one light, fixed for the animation.

    Attributes:
        light: Prim path of the light.
        face: Face of the direction cube (0 for a plane or a single direction patch).
        axes: Rows are the patch's u, v, w axes; None for distant lights, whose patch turns with them.
        limit: Largest |u|, |v| of a direction patch [rad].
        origin, step: Lower corner of cell (0, 0) and the size of a cell, in patch coordinates.
        turn: Angle [rad] by which a distant light's patch is turned from the light's own axes.
        wrap: Cells per side after which ids repeat.
        first_id: Id of cell (0, 0).
    """

    light: str
    face: int
    axes: np.ndarray | None
    limit: float
    origin: tuple[float, float]
    step: tuple[float, float]
    wrap: tuple[int, int]
    first_id: int
    turn: float = 0.0

    def holds(self, cells: np.ndarray) -> np.ndarray:
        """Which of the cells [n, 2] lie on it, shape [n]: a face of the cube ends where the next one begins."""
        if self.limit != CUBE_FACE:
            return np.ones(len(cells), bool)
        counts = np.rint(2.0 * CUBE_FACE / np.array(self.step))
        return np.all((cells >= 0) & (cells < counts), axis=1)


@dataclass(frozen=True)
class EmissionPlan:
    """The lattices of all lights that the stills show.

    Attributes:
        lattices: One or more a light.
        planned_ids: Ids that these lattices use together.
        photons: Photons a frame.
        normalization: The tracer's units.
        candidates: What the stills showed, from which lattices for any number of photons are laid out.
        cuts: Parts that lights with extent are cut into; each of them has lattices of its own.
        gains: What the photons of some lights are brighter by, by the paths of their prims
            (:class:`tpdwarp.photons.tracer.LightSplits`).
        strip: The rows of cells that are emitted; None for all.
        portion: Which of these are; None for all.
    """

    lattices: tuple[Lattice, ...]
    planned_ids: int
    photons: int
    normalization: Normalization
    candidates: tuple[_Candidate, ...] = ()
    cuts: LightCuts = field(default_factory=LightCuts)
    gains: Mapping[str, float] = field(default_factory=dict, compare=False)
    strip: Strip | None = None
    portion: Portion | None = None
    # What scenes that are still in use emit is found once: it is asked for by each that traces or looks for edges.
    _found: WeakKeyDictionary[SceneAtShutter, _Emitted] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False, compare=False
    )
    # Where their lights see what is specular does not depend on how fine lattices are.
    _bounds: WeakKeyDictionary[SceneAtShutter, dict[_Sighted, Bounds | None]] = field(
        default_factory=WeakKeyDictionary, repr=False, compare=False
    )

    @property
    def splits(self) -> int:
        """Parts that each light with extent is cut into."""
        return self.cuts.count

    def with_photons(self, photons: int) -> EmissionPlan:
        """The lattices of another number of photons over the same stills, which are not read again."""
        plan = _planned(self.candidates, photons, self.normalization, self.cuts)
        return replace(plan, gains=self.gains, _bounds=self._bounds)

    def foreseeing(self, scene: SceneAtShutter) -> EmissionPlan:
        """The plan with lattices for those lights of ``scene`` that shine in none of the stills; just it where all do.

        Their photons have neighbours and trajectories then, as those of other lights; their ids do not last.
        """
        cuts = self.cuts.foreseeing(scene)
        scene = split_lights(scene, cuts)
        specular = Specular.of(scene, self.normalization)
        known = {lattice.light for lattice in self.lattices}
        new = [light for light in scene.lights if any(light.power) and light.path not in known]
        if not new or not len(specular):
            return self
        found = [c for light in new for c in _candidates(light.path, [(light, specular)], self.normalization)]
        made = _lattices([candidate for candidate in found if not candidate.spare], self.photons, self.planned_ids)
        used = max((lattice.first_id + math.prod(lattice.wrap) for lattice in made), default=self.planned_ids)
        return replace(self, lattices=(*self.lattices, *made), planned_ids=used, cuts=cuts)

    def finer(self, across: int, down: int) -> EmissionPlan:
        """The same lattices with ``across`` × ``down`` cells in each of theirs, along u and along v."""
        count = across * down
        lattices = [
            replace(
                entry,
                step=(entry.step[0] / across, entry.step[1] / down),
                wrap=(entry.wrap[0] * across, entry.wrap[1] * down),
                first_id=entry.first_id * count,
            )
            for entry in self.lattices
        ]
        return replace(
            self,
            lattices=tuple(lattices),
            planned_ids=self.planned_ids * count,
            photons=self.photons * count,
            strip=None,
            portion=None,
        )

    def in_strips(self, scenes: Sequence[SceneAtShutter], count: int) -> list[EmissionPlan]:
        """The plan cut into a number of strips of the light, as it is emitted in ``scenes``."""
        if count == 1:
            return [self]
        emitted = [(self.number_of(lattice), patch) for scene in scenes for lattice, patch in self.patches(scene)]
        return [replace(self, strip=strip) for strip in strips_of(len(self.lattices), emitted, count)]

    @property
    def photons_at_once(self) -> int:
        """Photons that are sent at once."""
        photons = self.photons if self.portion is None else round(self.portion.share * self.photons)
        return photons if self.strip is None else photons // self.strip.count

    def cells_of(self, lattice: Lattice, patch: Patch) -> ChosenCells:
        """The cells of a patch of a lattice (:meth:`patches`) that are emitted."""
        if self.portion is None:
            return ChosenCells.of_patch(patch)
        return self.portion.cells_of(self.number_of(lattice), patch)

    def number_of(self, lattice: Lattice) -> int:
        """Number of one of the lattices; −1 of one that was made for a frame alone."""
        return next((number for number, planned in enumerate(self.lattices) if planned is lattice), -1)

    def paths_of(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Path mask of each photon, index of its lattice in ``lattices``, and whether that one was planned."""
        mask, number = np.divmod(ids, self.id_count)
        lattice = np.searchsorted([entry.first_id for entry in self.lattices], number, side="right") - 1
        return mask, lattice, number < self.planned_ids

    def light_of(self, lattice: Lattice) -> str:
        """Prim path of the light that a lattice lies on, or on a part of."""
        return lattice.light if self.splits == 1 else whole_of(lattice.light)

    @property
    def starved_lights(self) -> int:
        """How many of several lights have so few photons that what they light is a few dozen cells across."""
        counts: dict[str, float] = {}
        spare = {(candidate.light, candidate.face) for candidate in self.candidates if candidate.spare}
        for lattice in self.lattices:
            if (lattice.light, lattice.face) in spare:
                continue
            light = self.light_of(lattice)
            # Ids repeat after twice as many cells along either side.
            counts[light] = counts.get(light, 0.0) + math.prod(lattice.wrap) / 4.0
        return sum(count < FEWEST_OF_SEVERAL for count in counts.values()) if len(counts) > 1 else 0

    @property
    def id_count(self) -> int:
        """Ids in all: room is kept for lattices of lights that no still shows."""
        return self.planned_ids + 8 * self.photons + 64

    def patches(
        self, scene: SceneAtShutter, *, aimed: bool = True, whole: bool = False
    ) -> list[tuple[Lattice, Patch]]:
        """The cells of each lattice that this shutter emits, towards all specular meshes.

        With ``whole`` they are those of all portions of the light.

        Without ``aimed`` each planned lattice is as the light stands, for cells that are known already: to aim many
        parts of a light takes longer than to trace a few cells of each.

        Lights that the stills show otherwise (a flash between two of them, a body that leaves the patch or turns a
        broader side to the light) get lattices of this shutter's own, and as many photons as all others together;
        their ids do not last.
        """
        found = self._found.get(scene) if aimed else None
        if found is None:
            split = split_lights(scene, self.cuts)
            found = self._emitted(_Sight(split, self.normalization, self._bounds.setdefault(scene, {})), aimed)
            if aimed:
                self._found[scene] = found
        pairs = [
            (lattice, _patch(lattice, self._as_seen(light), bounds, found.behind, found.magnitude, self.normalization))
            for lattice, light, bounds in found.parts
        ]
        if not aimed:
            return pairs
        cuts = [self.strip, None if whole else self.portion]
        for cut in filter(None, cuts):
            pairs = [(lattice, patch) for lattice, patch in pairs if cut.cut(self.number_of(lattice), patch)]
        return pairs

    def _as_seen(self, light: LightAtShutter) -> LightAtShutter:
        """A light or part of one with the power that its photons have."""
        gain = self.gains.get(prim_of(light.path), 1.0)
        return light if gain == 1.0 else replace(light, power=tuple(gain * channel for channel in light.power))

    def _emitted(self, sight: _Sight, aimed: bool) -> _Emitted:
        """What the lights of a scene emit; all of each planned lattice if it is not ``aimed``."""
        if not len(sight.specular):
            return _Emitted()
        if aimed:
            pairs = self._aimed(sight)
        else:
            pairs = [(lattice, NOWHERE) for lattice in self.lattices if lattice.light in sight.lights]
        parts = [(lattice, sight.lights[lattice.light], bounds) for lattice, bounds in pairs if bounds is not None]
        behind = 2.0 * _radius(sight.scene, self.normalization) + 1.0
        # Coordinate by coordinate, which is ten times as fast.
        return _Emitted(parts, behind, np.abs(np.ascontiguousarray(sight.specular.points.T)).max(axis=1))

    def _aimed(self, sight: _Sight) -> list[tuple[Lattice, Bounds | None]]:
        """The lattices that reach what is specular, planned or made for the scene, with their bounds."""
        foreseen: list[tuple[Lattice, Bounds | None]] = []
        unforeseen: list[_Candidate] = []
        of_light: dict[str, list[Lattice]] = {}
        for lattice in self.lattices:
            of_light.setdefault(lattice.light, []).append(lattice)
        for path, light in sight.lights.items():
            pairs = [(lattice, sight.bounds(lattice)) for lattice in of_light.get(path, [])]
            if pairs and self._hold(sight, pairs):
                foreseen += pairs
            else:
                found = _candidates(path, [(light, sight.specular)], self.normalization)
                unforeseen += [candidate for candidate in found if not candidate.spare]
        made = _lattices(unforeseen, self.photons, self.planned_ids)
        return [*foreseen, *((lattice, sight.bounds(lattice)) for lattice in made)]

    def _hold(self, sight: _Sight, pairs: Sequence[tuple[Lattice, Bounds | None]]) -> bool:
        """Whether lattices of a light suit what it sees: nothing outside of them, and not far more than was foreseen.

        That is counted over all faces of a cube: of one that stills graze, a part of the photons is many times as much.
        """
        emitted = 0
        for lattice, bounds in pairs:
            if lattice.limit == WIDEST_KEPT_PATCH and sight.spread(lattice) > WIDEST_KEPT_PATCH:
                return False
            if bounds is None:
                continue
            cells = _cells(lattice, bounds)
            if any(max(abs(first), abs(first + count)) > LARGEST_CELL_NUMBER for first, count in cells):
                return False
            emitted += math.prod(count for _, count in cells)
        foreseen = sum(lattice.wrap[0] * lattice.wrap[1] // 4 for lattice, _ in pairs)
        return emitted <= LARGEST_CELL_GROWTH * foreseen


# A lattice as its light sees it: the light's path, and the limit, turn and axes of the patch.
_Sighted = tuple[str, float, float, bytes]


class _Sight:
    """What the lights of a scene see of what is specular.

    Args:
        scene: Its lights are split already.
        normalization: The tracer's units.
        found: Bounds that were found before; what is found is added to them.
    """

    def __init__(
        self, scene: SceneAtShutter, normalization: Normalization, found: dict[_Sighted, Bounds | None]
    ) -> None:
        self.scene, self._normalization, self._found = scene, normalization, found
        self.lights = {light.path: light for light in scene.lights if any(light.power)}
        self.specular = Specular.of(scene, normalization)

    def bounds(self, lattice: Lattice) -> Bounds | None:
        """Where on a lattice photons start that reach what is specular; None if none do."""
        axes = lattice.axes
        key = lattice.light, lattice.limit, lattice.turn, b"" if axes is None else axes.tobytes()
        if key not in self._found:
            given = self.lights[lattice.light], axes, lattice.limit, self.specular, self._normalization, lattice.turn
            self._found[key] = bounds_of(*given)
        return self._found[key]

    def spread(self, lattice: Lattice) -> float:
        """The largest angle [rad] between the middle of a lattice of directions and what its light sees."""
        return spread_of(self.lights[lattice.light], self.specular.points, lattice.axes[2], self._normalization)


def plan_emission(
    source: SceneSource,
    photons: int,
    normalization: Normalization,
    *,
    square: bool = False,
    splits: int = 1,
    stills: Sequence[SceneAtShutter] | None = None,
) -> EmissionPlan:
    """Lays out the lattices for ``photons`` photons a frame, shared between lights (see :func:`light_shares`).

    Args:
        square: Whether cells are square also where light varies in one direction alone.
        splits: Parts that each light with extent is cut into.
        stills: The reference scenes of ``source``, where they have been read before.
    """
    stills = reference_scenes(source, lambda scene: require_within_range(scene, normalization, source.file), stills)
    cuts = LightCuts.of(splits, stills)
    stills = [split_lights(scene, cuts) for scene in stills]
    specular = [Specular.of(scene, normalization) for scene in stills]
    paths = list(dict.fromkeys(light.path for scene in stills for light in scene.lights))
    candidates = []
    shapes: dict[str, LatticeShape] = {}
    for path in paths:
        views = [
            (light, there)
            for scene, there in zip(stills, specular, strict=True)
            for light in scene.lights
            if light.path == path and len(there)
        ]
        if views:
            # Parts of a sun see nearly the same: one shape for all.
            whole = whole_of(path)
            if whole not in shapes:
                own = [(light, scene) for scene in stills for light in scene.lights if light.path == path]
                distant = views[0][0].kind == LightKind.DISTANT
                shapes[whole] = lattice_shape(own) if distant and not square else OWN_AXES
            candidates += _candidates(path, views, normalization, shapes[whole])
    return _planned(tuple(candidates), photons, normalization, cuts)


def _planned(
    candidates: tuple[_Candidate, ...], photons: int, normalization: Normalization, cuts: LightCuts
) -> EmissionPlan:
    lattices = _lattices(candidates, photons, 0)
    used = max((lattice.first_id + lattice.wrap[0] * lattice.wrap[1] for lattice in lattices), default=0)
    return EmissionPlan(tuple(lattices), used, photons, normalization, candidates, cuts)


def light_shares(candidates: Sequence[_Candidate]) -> dict[str, float]:
    """Power by photons of the lattices of each light, if there is one photon in all.

    Faces and parts of one light share its photons by the power that goes through them. Lights share them by a low
    power of theirs: wherever nothing brighter falls, a caustic is seen by itself, however faint it is.
    """
    totals: dict[str, float] = {}
    for candidate in candidates:
        if not candidate.spare:
            light = prim_of(candidate.light)
            totals[light] = totals.get(light, 0.0) + candidate.power
    strongest = max(totals.values(), default=0.0)
    parts = {light: power / strongest for light, power in totals.items()}
    weights = {
        light: max(part**SHARING_POWER, LEAST_WEIGHT) if part >= FAINTEST else part for light, part in parts.items()
    }
    whole = sum(weights.values())
    # A light alone keeps its power as it is, to the last bit.
    return {light: power / (weights[light] / whole) if len(totals) > 1 else power for light, power in totals.items()}


def _lattices(candidates: Sequence[_Candidate], photons: int, first_id: int) -> list[Lattice]:
    """Lattices with cells for ``photons`` photons, shared between candidates; spare ones are not counted."""
    shares = light_shares(candidates)
    lattices = []
    for candidate in candidates:
        # As many photons meet a sheet as if its rectangle lay along the lattice.
        count = max(1.0, photons * candidate.power / shares[prim_of(candidate.light)] * candidate.shape.excess)
        width, height = candidate.size
        # What light grazes is a strip: cells keep their shape until one side has but one row of them.
        aspect = candidate.shape.aspect
        for length, size in ((aspect, height / width), (1.0 / aspect, width / height)):
            if length > 1.0:
                # Long cells are wide where light ends, too: some rows of them are kept.
                aspect = aspect ** min(1.0, math.log(max(1.0, count * size / FEWEST_ROWS**2)) / math.log(length))
        across = max(1, round(min(math.sqrt(count * aspect * width / height), count)))
        down = max(1, round(count / across))
        step = (width / across, height / down)
        phase = phase_of(candidate.light)
        origin = tuple(float(low - part * size) for low, part, size in zip(candidate.origin, phase, step, strict=True))
        if candidate.limit == CUBE_FACE:
            # Cells end where the face ends, so that no two faces emit the same directions.
            origin = (-CUBE_FACE, -CUBE_FACE)
            step = tuple(2.0 * CUBE_FACE / math.ceil(2.0 * CUBE_FACE / size - 1e-6) for size in step)
        wrap = (2 * across, 2 * down)
        patch = candidate.light, candidate.face, candidate.axes, candidate.limit
        lattices.append(Lattice(*patch, origin, step, wrap, first_id, candidate.shape.turn))
        first_id += wrap[0] * wrap[1]
    return lattices


@dataclass(frozen=True, eq=False)
class _Emitted:
    """What a scene emits.

    Attributes:
        parts: Lattices, each with its light and the bounds of its cells.
        behind: How far before the origin light from afar starts.
        magnitude: How large the coordinates of what is specular are, shape [3].
    """

    parts: Sequence[tuple[Lattice, LightAtShutter, Bounds]] = ()
    behind: float = 0.0
    magnitude: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class _Candidate:
    """A patch that a light could use: where it lies, the largest domain seen there and the power through it.

    A ``spare`` one is a face of the cube that nothing was seen through yet, sized like the strongest of the others.
    """

    light: str
    face: int
    axes: np.ndarray | None
    limit: float
    origin: tuple[float, float]
    size: tuple[float, float]
    power: float
    spare: bool = False
    shape: LatticeShape = OWN_AXES


def _candidates(
    path: str,
    views: Sequence[tuple[LightAtShutter, Specular]],
    normalization: Normalization,
    shape: LatticeShape = OWN_AXES,
) -> list[_Candidate]:
    views = [(_as_wide_as_ever(light), there) for light, there in views]
    first, first_seen = views[0]
    if first.kind == LightKind.DISTANT:
        faces, limit = [None], math.inf
    else:
        centre = 0.5 * (first_seen.points.min(axis=0) + first_seen.points.max(axis=0))
        cube = cube_axes(centre - normalization.points(first.position[None])[0])
        spread = max(spread_of(light, there.points, cube[0][2], normalization) for light, there in views)
        faces, limit = (cube[:1], WIDEST_KEPT_PATCH) if spread < WIDEST_SINGLE_PATCH else (cube, CUBE_FACE)
    found = []
    for number, axes in enumerate(faces):
        bounds = [(light, bounds_of(light, axes, limit, there, normalization, shape.turn)) for light, there in views]
        seen = [(light, b) for light, b in bounds if b is not None]
        if not seen:
            continue
        largest = max((b for _, b in seen), key=area_of)
        size = (largest[1] - largest[0], largest[3] - largest[2])
        if min(size) <= 0.0:
            continue
        power = max(sum(light.power) * area_of(b) for light, b in seen)
        if first.kind == LightKind.DISTANT:
            power /= normalization.scale**2
        if power > 0.0:
            found.append(_Candidate(path, number, axes, limit, (largest[0], largest[2]), size, power, shape=shape))
    if found and len(faces) > 1:
        strongest, seen = max(found, key=lambda candidate: candidate.power), {candidate.face for candidate in found}
        found += [
            replace(strongest, face=number, axes=axes, spare=True)
            for number, axes in enumerate(faces)
            if number not in seen
        ]
    return found


def _as_wide_as_ever(light: LightAtShutter) -> LightAtShutter:
    """A light with its cone as wide as it is at any time: one that opens and closes between two stills would fill so
    many times the cells of its lattice that this has to be another one for a while, which has no keyframes."""
    if light.shaping is None or light.shaping.widest <= light.shaping.angle:
        return light
    return replace(light, shaping=replace(light.shaping, angle=light.shaping.widest))


def _radius(scene: SceneAtShutter, normalization: Normalization) -> float:
    """Radius of a sphere about the origin that holds the scene at mid shutter, in the tracer's units."""
    radius = normalization.radius
    if not scene.meshes:
        return radius
    # Thousands of meshes are asked at once, by the boxes of all their objects.
    boxes = np.abs(normalization.points(np.concatenate([mesh.boxes for mesh in scene.meshes]).reshape(-1, 3)))
    # By rounding, the farthest point may be a little farther than the corner of what holds all.
    reach = (1.0 + 1e-6) * np.linalg.norm(boxes.reshape(-1, 2, 3).max(axis=1), axis=1)
    begins = np.cumsum([0, *(len(mesh.boxes) for mesh in scene.meshes[:-1])])
    for number in np.flatnonzero(np.maximum.reduceat(reach, begins) >= radius):
        points = normalization.points(scene.meshes[number].points)
        radius = max(radius, float(np.sqrt(np.einsum("ij,ij->i", points, points).max(initial=0.0))))
    return radius


def _cells(lattice: Lattice, bounds: Bounds) -> list[tuple[int, int]]:
    """First cell and number of cells of ``lattice`` that cover ``bounds``, along u and along v."""
    cells = []
    for axis in (0, 1):
        low = (bounds[2 * axis] - lattice.origin[axis]) / lattice.step[axis]
        high = (bounds[2 * axis + 1] - lattice.origin[axis]) / lattice.step[axis]
        first = math.floor(low + 1e-4)
        cells.append((first, max(1, math.ceil(high - 1e-4) - first)))
    return cells


def _patch(
    lattice: Lattice,
    light: LightAtShutter,
    bounds: Bounds,
    behind: float,
    magnitude: np.ndarray,
    normalization: Normalization,
) -> Patch:
    """The cells of ``lattice`` that cover ``bounds``; light from afar starts ``behind`` before the origin.

    ``magnitude`` [3] is how large the coordinates of what is specular are.
    """
    patch = Patch()
    patch.magnitude = wp.vec3(*(magnitude + 1e-3 * magnitude.max()))
    (patch.first_u, patch.count_u), (patch.first_v, patch.count_v) = _cells(lattice, bounds)
    patch.origin, patch.step = wp.vec2(*lattice.origin), wp.vec2(*lattice.step)
    if light.kind == LightKind.DISTANT:
        axes, motions = turned(light.axes, lattice.turn), turned(light.axes_motion, lattice.turn)
        patch.domain = int(Domain.PLANE)
        patch.axis_u, patch.axis_v, patch.axis_w = wp.vec3(*axes[0]), wp.vec3(*axes[1]), wp.vec3(*-axes[2])
        patch.axis_u_motion, patch.axis_v_motion = wp.vec3(*motions[0]), wp.vec3(*motions[1])
        patch.axis_w_motion = wp.vec3(*-motions[2])
        patch.start, distance = -behind, behind
    else:
        axes = lattice.axes
        patch.domain = int(Domain.DIRECTIONS)
        patch.axis_u, patch.axis_v, patch.axis_w = wp.vec3(*axes[0]), wp.vec3(*axes[1]), wp.vec3(*axes[2])
        patch.position = wp.vec3(*normalization.points(light.position[None])[0].astype(float))
        patch.position_motion = wp.vec3(*(light.position_motion * normalization.scale))
        patch.start, distance = 0.0, float(np.linalg.norm(patch.position))
        if is_shaped(light):
            patch.is_shaped, patch.shaping = 1, ShapingValues(*shaping_values(light))
            patch.shaping_axis = wp.vec3(*map(float, shaping_axis(light)[0]))
    patch.extent_shape = -1
    if light.extent is not None:
        patch.extent_shape = int(light.extent.shape)
        distant = light.kind == LightKind.DISTANT
        radius, spans = light.extent.over_the_shutter
        patch.extent_radius = math.sin(radius) if distant else radius * normalization.scale
        if not distant:
            spans = normalization.scale * spans
        patch.span_a, patch.span_b = (wp.vec3(*map(float, span)) for span in spans[:2])
        if light.extent.shape == ExtentShape.ROUND and not distant:
            patch.ball_radius = patch.extent_radius
        if light.extent.shape == ExtentShape.ELLIPSOID:
            patch.span_c = wp.vec3(*map(float, spans[2]))
            _set_ellipsoid(patch, spans)
    if light.ball is not None and light.ball.spans is not None:
        patch.ball_place = wp.vec3(*map(float, normalization.scale * light.ball.place))
        _set_ellipsoid(patch, normalization.scale * light.ball.spans)
    elif light.ball is not None:
        patch.ball_place = wp.vec3(*map(float, normalization.scale * light.ball.place))
        patch.ball_radius = normalization.scale * light.ball.radius
    diameter = 2.0 * float(np.linalg.norm(magnitude))
    patch.near = patch.start + (distance - diameter if diameter < NEARBY * distance else 0.0)
    patch.power = wp.vec3(*normalization.light_power(light))
    return patch


def _set_ellipsoid(patch: Patch, spans: np.ndarray) -> None:
    """Light begins on the surface of an ellipsoid of these radii, shape [3, 3]."""
    patch.is_in_ellipsoid, patch.to_ball = 1, wp.mat33(*np.linalg.inv(spans).T.ravel().astype(float).tolist())
