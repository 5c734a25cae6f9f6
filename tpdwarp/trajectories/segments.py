"""How many segments a shutter is worth for a given number of photons, and for which meshes.

Cutting the shutter into K segments lets footprints stand right in the middle of each, and multiplies the area of
footprints, and what they blur, by K. Light whose irradiance changes over a length L, moved by s, errs by s/L of itself;
blurred by a kernel of variance σ², by σ²/(2L²). With derivatives over the whole shutter, and footprints h wide (σ² =
h²/4 for the quadratic B-spline), that is on average

    |D_tt x|/(24 L K²) for footprints that go straight,  |D_tttt x|/(1240 L K⁴) for bent ones,  h² K/(8L²) for the blur

as means over the photons of a coarse trace, weighted by flux. L comes from the footprints themselves: irradiance goes
with the inverse of their area; h is each photon's own width, which vanishes with L at folds. D_t x is told by guides as
the shutter opens and closes, as it is for the ways of footprints, which go straight where guides disagree: so a few
segments more may be far better. Bent ways that are told D_t x at the times ±σ miss (s⁴ − 2σ² s²)/24 of D_tttt x at
the part s of the shutter, and that is as large as D_tt x by the ratio of D_ttt x to D_t x, as in a swing. (Those that
are told where they pass miss less, but axes that follow to first order only err more.)

Where motion turns a corner between two time samples of a stage, a bent way that leads past it errs by 0.03 of the
change of D_t x there, as

    0.72 |D_tt x|/(24 L K²)

since that change is D_tt x. So numbers of segments that begin where samples do are far better than others, often better
than larger ones.

A fast lens beside still water wants many segments where the water wants one. So errors are summed for the photons that
meet each mesh first, and meshes whose best K differ by more than a factor are given segments of their own, by their
levels: light is a sum over the mesh that it meets first, whatever cells and times each part of it was traced with.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.trajectories.keyframes import LARGEST_DISAGREEMENT, MOMENT, Guides, Moment, disagreement, moments
from tpdwarp.trajectories.neighbours import Pairs, neighbours

if TYPE_CHECKING:
    from tpdwarp.estimators.base import Animation, Clock

PILOT_PHOTONS = 4096
FEWEST_PHOTONS = 256
MOST_SEGMENTS = 64
MOST_STILLS = 4
# Beyond this quantile D_tt x belongs to light that appears and vanishes at edges, which no segments help.
LARGEST = 0.95
# Meshes share segments where their best numbers differ by less: around the best one, errors are flat.
LARGEST_FACTOR = 2.0
# Meshes that fewer photons of the pilot's meet take the segments of the others.
FEWEST_SEEN = 64
# What bent ways that turn corners err by, as a part of what straight ones of a smooth motion do.
CORNER = 0.72
# How near, in segments, the end of one counts as a corner.
AT_CORNER = 1e-4
# Another segment has to lessen the error by more than this part to pay for another scene.
LEAST_GAIN = 0.1


@dataclass(frozen=True)
class Level:
    """Meshes for which the shutter is cut into as many segments.

    Attributes:
        segments: Segments of the shutter.
        listed: Paths of meshes.
        takes_listed: Whether these make up the level, or all but these: meshes may appear that were not foreseen.
    """

    segments: int
    listed: frozenset[str] = frozenset()
    takes_listed: bool = False

    @property
    def taken(self) -> Callable[[str], bool] | None:
        """Tells by a mesh's path whether photons that meet it first are of this level; None where all are."""
        if not self.listed:
            return None
        return lambda path: (path in self.listed) == self.takes_listed


@dataclass(frozen=True, eq=False)
class _Errors:
    """Errors of the light of photons that meet some meshes first, as parts of it, for one segment.

    Attributes:
        meshes: Paths of the meshes.
        weight: Of each photon's in their mean, its flux, shape [n].
        straight, bent: In time where footprints go straight and where their ways are bent, shape [n].
        disagreement: Of guides, as a part of D_t x, shape [n]; infinite where ways are never bent.
        blur: In space, shape [n].
        untold: Part of the light beside them, alike but for that guides do not tell of it, so that it goes straight;
            shape [n].
    """

    meshes: frozenset[str]
    weight: np.ndarray
    straight: np.ndarray
    bent: np.ndarray
    disagreement: np.ndarray
    blur: np.ndarray
    untold: np.ndarray

    def __add__(self, other: _Errors) -> _Errors:
        names = ("weight", "straight", "bent", "disagreement", "blur", "untold")
        joined = [np.concatenate([getattr(self, name), getattr(other, name)]) for name in names]
        return _Errors(self.meshes | other.meshes, *joined)

    def total(self, segments: np.ndarray, corners: Collection[float]) -> np.ndarray:
        """Their mean for numbers of segments, but for a factor; ``corners`` of motion are parts of the shutter."""
        count = segments[:, None].astype(np.float64)
        follows = self.disagreement / count**2 <= LARGEST_DISAGREEMENT
        turned = np.array([[most_corners(corners, k)] for k in segments])
        corner = CORNER * (turned > 0) / np.maximum(turned, 1) ** 2 * self.straight / count**2
        bent = np.where(follows, np.maximum(self.bent / count**4, corner), self.straight / count**2)
        in_time = (1.0 - self.untold) * bent + self.untold * self.straight / count**2
        return (self.weight * (in_time + count * self.blur)).sum(axis=1)

    def best(self, corners: Collection[float], most: int = MOST_SEGMENTS) -> int:
        """The number of segments up to ``most`` that is nearly as good as the best."""
        totals = self.total(np.arange(1, most + 1), corners)
        return 1 + int(np.argmax(totals <= (1.0 + LEAST_GAIN) * totals.min()))


def corners_within(source: SceneSource, shutter: Shutter) -> set[float]:
    """Where in ``shutter`` motion may turn corners, as parts of it."""
    return {round((time - shutter.open) / shutter.exposure, 6) for time in source.corners(shutter)}


def most_corners(corners: Collection[float], segments: int) -> int:
    """The most corners, given as parts of the shutter, that one of so many equal segments has inside."""
    places = [corner * segments for corner in corners]
    inside = [math.floor(place) for place in places if abs(place - round(place)) > AT_CORNER]
    return max(Counter(inside).values(), default=0)


def levels(animation: Animation, shutter: Shutter, clock: Clock) -> tuple[Level, ...]:
    """The levels for shutters of this length and place in the frame, that of most segments first.

    They are found at a few times spread over the animation and not at the frame itself, so that all frames have the
    same lattices and do not flicker.
    """
    photons = animation.settings.photons
    if shutter.exposure <= 0 or photons < 2 * FEWEST_PHOTONS:
        return (Level(1),)
    plan = animation.plan(min(photons, PILOT_PHOTONS))
    stills = animation.source.reference_shutters()
    found: dict[str, _Errors] = {}
    corners: set[float] = set()
    for still in stills[:: math.ceil(len(stills) / MOST_STILLS)]:
        # At whole frames, since it matters where in the shutter a stage's samples lie.
        frame = stills[0].middle + math.floor(still.middle - stills[0].middle)
        start = frame + shutter.open - shutter.frame
        whole = Shutter(frame, start, start + shutter.exposure)
        corners |= corners_within(animation.source, whole)
        for errors in _errors_around(animation, whole, plan, clock):
            (path,) = errors.meshes
            found[path] = found[path] + errors if path in found else errors
    # Meshes that few photons meet count alone where there are no others.
    groups = _joined([errors for path, errors in found.items() if path or len(found) == 1], corners)
    if not groups:
        return (Level(1),)
    total = sum(len(group.bent) for group in groups)
    mosts = [photons * len(group.bent) // total // FEWEST_PHOTONS for group in groups]
    counts = [group.best(corners, min(MOST_SEGMENTS, max(1, most))) for group, most in zip(groups, mosts, strict=True)]
    if len(set(counts)) == 1:
        return (Level(counts[0]),)
    # The level that most photons belong to takes what no photon of the pilot met.
    main = max(range(len(groups)), key=lambda number: len(groups[number].bent))
    others = frozenset().union(*(group.meshes for number, group in enumerate(groups) if number != main))
    found_levels = [
        Level(count, others if number == main else group.meshes, number != main)
        for number, (count, group) in enumerate(zip(counts, groups, strict=True))
    ]
    return tuple(sorted(found_levels, key=lambda level: -level.segments))


def _joined(parts: list[_Errors], corners: Collection[float]) -> list[_Errors]:
    """Meshes whose best numbers of segments are alike, put together."""
    result: list[_Errors] = []
    most = math.inf
    ordered = sorted(((part.best(corners), part) for part in parts), key=lambda pair: -pair[0])
    for best, part in ordered:
        if result and LARGEST_FACTOR * best >= most:
            result[-1] += part
        else:
            result.append(part)
            most = best
    return result


def _errors_around(animation: Animation, whole: Shutter, plan: EmissionPlan, clock: Clock) -> Iterator[_Errors]:
    """Errors of the photons that land over the shutter of a frame, for each mesh that they meet first.

    Meshes that few photons meet are put together under an empty path.
    """
    opening, middle, closing = moments(whole)
    loaded = animation.load(middle, clock)
    riding = animation.settings.anchor == "surface"
    photons, _ = animation.trace(loaded, plan, clock, riding=riding, jittered=False)
    # Traced over a moment, told over the shutter.
    photons = replace(photons, dxdt=photons.dxdt / MOMENT, shift=photons.shift / MOMENT)
    before, after = Guides(animation, plan, opening, closing, clock).around(photons, plan)
    told = before.told & after.told
    paths = loaded.geometry.paths
    entries, counts = np.unique(photons.entry, return_counts=True)
    parts = {paths[entry]: photons.entry == entry for entry in entries[counts >= FEWEST_SEEN]}
    few = np.isin(photons.entry, entries[counts < FEWEST_SEEN])
    if few.any():
        parts[""] = few
    share = plan.photons / animation.settings.photons
    settings = animation.settings
    bends = settings.path == "curved" and settings.kernel == "bspline" and settings.trace_at == "middle"
    for path, chosen in parts.items():
        rows = np.flatnonzero(chosen & told)
        if len(rows):
            part = _rows(photons, rows)
            untold = 1.0 - part.flux.sum() / photons.flux[chosen].sum()
            yield _errors(path, part, before.at(rows), after.at(rows), plan, share, bends, untold)


def _rows(photons: PhotonMap, rows: np.ndarray) -> PhotonMap:
    """Some of the photons."""
    arrays = {name: value[rows] for name, value in vars(photons).items() if isinstance(value, np.ndarray)}
    return replace(photons, **arrays)


def _errors(
    path: str,
    photons: PhotonMap,
    before: Moment,
    after: Moment,
    plan: EmissionPlan,
    share: float,
    bends: bool,
    untold: float,
) -> _Errors:
    """Errors of photons at mid shutter, of which guides tell ``before`` and ``after`` at its ends.

    Args:
        path: The mesh that they meet first.
        plan: Their lattices.
        share: Cell area of the full number of photons by that of the pilot's.
        bends: Whether footprints follow bent ways.
        untold: Part of the light of that mesh that these photons stand for only.
    """
    flux = photons.flux.sum(axis=1).astype(np.float64)
    span = 1.0 - MOMENT
    second = np.linalg.norm(after.dxdt - before.dxdt, axis=1) / span
    third = np.linalg.norm(before.dxdt + after.dxdt - 2.0 * photons.dxdt, axis=1) * (2.0 / span) ** 2
    apart = disagreement(photons, before.dxdt, after.dxdt) if bends else np.full(len(photons), np.inf)
    widths = [np.linalg.norm(column, axis=1) for column in (photons.dxdu, photons.dxdv)]
    typical = [math.sqrt(share) * float(np.median(width)) for width in widths]
    if not max(typical) > 0:
        return _Errors(frozenset([path]), flux, 0.0 * flux, 0.0 * flux, apart, 0.0 * flux, 0.0 * flux)
    # Areas vanish at folds; no footprint is finer than the typical one.
    least = np.maximum(typical[0] * widths[1], typical[1] * widths[0])
    logs = np.log(np.hypot(np.linalg.norm(np.cross(photons.dxdu, photons.dxdv), axis=1), least))
    # Cells are longer where light varies less, so each direction counts with its own.
    changes = [
        np.minimum(_slope(logs, photons.position, pairs, 0.3 * size), 1.0 / max(size, np.finfo(float).tiny))
        for pairs, size in zip(neighbours(photons, plan), typical, strict=True)
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
        np.minimum(size, np.quantile(size, LARGEST)) for size in (np.linalg.norm(photons.dxdt, axis=1), second, third)
    )
    fourth = second * (third.sum() / max(first.sum(), np.finfo(float).tiny))
    in_time = change * second / 24.0, change * fourth / 1240.0
    return _Errors(frozenset([path]), flux, *in_time, apart, blur**2 / 8.0, np.full(len(photons), untold))


def _slope(values: np.ndarray, positions: np.ndarray, pairs: Pairs, closest: float) -> np.ndarray:
    """How fast ``values`` change from photon to photon, shape [n]; distances count as no less than ``closest``."""
    slope = np.zeros(len(values))
    a, b = pairs
    distance = np.maximum(np.linalg.norm(positions[b] - positions[a], axis=1), max(closest, np.finfo(float).tiny))
    np.maximum.at(slope, a, np.abs(values[b] - values[a]) / distance)
    return slope
