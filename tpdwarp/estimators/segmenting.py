"""How many segments a shutter is worth for a given number of photons, and for which meshes.

Cutting the shutter into K segments divides the error in time by K² (that of straight ways; bent ones gain more, and
err less to begin with), since footprints stand right in the middle of each, and multiplies the area of footprints, and
what they blur, by K. Light whose irradiance changes over a length L, moved by s, errs by s/L of itself; blurred by a
kernel of variance σ², by σ²/(2L²). With D_tt x over the whole shutter, and footprints h wide (σ² = h²/4 for the
quadratic B-spline), that is on average

    τ = |D_tt x|/(24L),  β = h²/(8L²),  and τ/K² + βK is least at K³ = 2τ/β,

where τ and β are means over the photons of a coarse trace. L comes from the footprints themselves: irradiance goes with
the inverse of their area. D_tt x is the change of D_t x between the opening and the closing, of the same photon where
it is fixed on the light; where it rides on a surface, at (a, b) lattice steps over the shutter, of the photon that it
has become: a D_u D_t x + b D_v D_t x is added.

A fast lens beside still water wants many segments where the water wants one. So τ and β are summed for the photons that
meet each mesh first, and meshes whose best K differ by more than a factor are given segments of their own, by their
levels: light is a sum over the mesh that it meets first, whatever cells and times each part of it was traced with.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import PhotonMap, trace_photons
from tpdwarp.scene.description import Shutter

if TYPE_CHECKING:
    from tpdwarp.estimators.base import Animation

PILOT_PHOTONS = 4096
FEWEST_PHOTONS = 512
MOST_SEGMENTS = 64
MOST_STILLS = 4
# Part of the shutter over which D_t x is taken at its opening, middle and closing.
MOMENT = 0.125
# Beyond this quantile D_tt x belongs to light that appears and vanishes at edges, which no segments help.
LARGEST = 0.95
# The mean of τ sees little of folds, where light errs the most: fitted to waves with and without them.
GAIN = 1.25
# Meshes share segments where their best numbers differ by less: around the best one, errors are flat.
LARGEST_FACTOR = 2.0
# Meshes that fewer photons of the pilot's meet take the segments of the others.
FEWEST_SEEN = 64
# Fractions above this are worth another segment; below it they do not pay for another scene.
ROUND_UP = 0.75
STIFFNESS = 1.0e-3

Pairs = tuple[np.ndarray, np.ndarray]


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


@dataclass(frozen=True)
class _Group:
    """Meshes that share segments: summed errors in time and blur of their photons, and their part of all photons."""

    meshes: frozenset[str]
    time_error: float
    blur: float
    share: float

    def __add__(self, other: _Group) -> _Group:
        sums = self.time_error + other.time_error, self.blur + other.blur, self.share + other.share
        return _Group(self.meshes | other.meshes, *sums)

    @property
    def best(self) -> float:
        """The number of segments at which their error is least, as a real number."""
        return (2.0 * GAIN * self.time_error / self.blur) ** (1.0 / 3.0) if self.blur > 0 else 1.0

    def segments(self, photons: int) -> int:
        """The number of segments for ``photons`` photons in all."""
        most = min(MOST_SEGMENTS, int(self.share * photons) // FEWEST_PHOTONS)
        return int(np.clip(math.floor(self.best + 1.0 - ROUND_UP), 1, max(1, most)))


def levels(animation: Animation, shutter: Shutter) -> tuple[Level, ...]:
    """The levels for shutters of this length and place in the frame, that of most segments first.

    They are found at a few times spread over the animation and not at the frame itself, so that all frames have the
    same lattices and do not flicker.
    """
    photons = animation.settings.photons
    if shutter.exposure <= 0 or photons < 2 * FEWEST_PHOTONS:
        return (Level(1),)
    plan = animation.plan(min(photons, PILOT_PHOTONS))
    stills = animation.source.reference_shutters()
    found: Counter[str] = Counter()
    times: Counter[str] = Counter()
    blurs: Counter[str] = Counter()
    for still in stills[:: math.ceil(len(stills) / MOST_STILLS)]:
        for path, (count, time_error, blur) in _errors_around(animation, still.middle, shutter, plan).items():
            found[path] += count
            times[path] += time_error
            blurs[path] += blur
    if not found:
        return (Level(1),)
    total = found.total()
    # Those that few photons meet count alone where there are no others.
    paths = [path for path in found if path] or [""]
    groups = _joined([_Group(frozenset([path]), times[path], blurs[path], found[path] / total) for path in paths])
    # The level that most photons belong to takes what no photon of the pilot met.
    main = max(range(len(groups)), key=lambda number: groups[number].share)
    counts = [group.segments(photons) for group in groups]
    if len(set(counts)) == 1:
        return (Level(counts[0]),)
    others = frozenset().union(*(group.meshes for number, group in enumerate(groups) if number != main))
    return tuple(
        Level(count, others if number == main else group.meshes, number != main)
        for number, (count, group) in enumerate(zip(counts, groups, strict=True))
    )


def _joined(groups: list[_Group]) -> list[_Group]:
    """Groups of meshes whose best numbers of segments are alike, that of the most first."""
    result: list[_Group] = []
    most = math.inf
    for group in sorted(groups, key=lambda group: -group.best):
        if result and LARGEST_FACTOR * group.best >= most:
            result[-1] += group
        else:
            result.append(group)
            most = group.best
    return result


def _errors_around(
    animation: Animation, frame: float, shutter: Shutter, plan: EmissionPlan
) -> dict[str, tuple[int, float, float]]:
    """By the mesh that photons meet first: how many land throughout the shutter of another frame, their summed τ and β.

    Both are weighted by flux. Photons of meshes that few meet count with all others of the kind, under an empty path.
    """
    riding = animation.settings.anchor == "surface"

    def traced(part: float, rides: bool) -> tuple[PhotonMap, tuple[str, ...]]:
        time = frame + shutter.open - shutter.frame + part * shutter.exposure
        half = 0.5 * MOMENT * shutter.exposure
        loaded = animation.load(Shutter(frame, time - half, time + half))
        found, _ = trace_photons(
            loaded.scene, loaded.geometry, plan, loaded.requirements, animation.launcher, riding=rides
        )
        return found, loaded.geometry.paths

    (opening, _), (middle, paths), (closing, _) = (traced(part, riding) for part in (0.0, 0.5, 1.0))
    fixed = traced(0.5, False)[0] if riding else middle
    ids = np.intersect1d(np.intersect1d(opening.ids, middle.ids), closing.ids)
    maps = [_restricted(photons, ids) for photons in (opening, middle, closing, fixed)]
    share = plan.photons / animation.settings.photons
    entries, counts = np.unique(maps[1].entry, return_counts=True)
    few = np.isin(maps[1].entry, entries[counts < FEWEST_SEEN])
    parts = {paths[entry]: maps[1].entry == entry for entry in entries[counts >= FEWEST_SEEN]}
    if few.any():
        parts[""] = few
    return {
        path: (len(rows), *_errors(*(_rows(photons, rows) for photons in maps), plan, share))
        for path, rows in ((path, np.flatnonzero(chosen)) for path, chosen in parts.items())
    }


def _rows(photons: PhotonMap, rows: np.ndarray) -> PhotonMap:
    """Some of the photons."""
    arrays = {name: value[rows] for name, value in vars(photons).items() if isinstance(value, np.ndarray)}
    return replace(photons, **arrays)


def _restricted(photons: PhotonMap, ids: np.ndarray) -> PhotonMap:
    """The photons of the given ids, in their order."""
    order = np.argsort(photons.ids)
    return _rows(photons, order[np.searchsorted(photons.ids, ids, sorter=order)])


def _errors(
    opening: PhotonMap, middle: PhotonMap, closing: PhotonMap, fixed: PhotonMap, plan: EmissionPlan, share: float
) -> tuple[float, float]:
    """Flux-weighted sums of τ and β over photons, the same in all maps.

    Args:
        fixed: At the middle, without riding.
        plan: Their lattices.
        share: Cell area of the full number of photons by that of the pilot's.
    """
    widths = [np.linalg.norm(column, axis=1) for column in (middle.dxdu, middle.dxdv)]
    typical = [math.sqrt(share) * float(np.median(width)) for width in widths]
    if not max(typical) > 0:
        return 0.0, 0.0
    neighbours = _neighbours(middle, plan)
    bend = _velocity(closing) - _velocity(opening) + _advection(middle, fixed, neighbours)
    bends = np.linalg.norm(bend, axis=1)
    bends = np.minimum(bends, np.quantile(bends, LARGEST))
    # Areas vanish at folds; no footprint is finer than the typical one.
    least = np.maximum(typical[0] * widths[1], typical[1] * widths[0])
    logs = np.log(np.hypot(np.linalg.norm(np.cross(middle.dxdu, middle.dxdv), axis=1), least))
    # Cells are longer where light varies less, so each direction counts with its own.
    changes = [
        np.minimum(_slope(logs, middle.position, pairs, 0.3 * size), 1.0 / max(size, np.finfo(float).tiny))
        for pairs, size in zip(neighbours, typical, strict=True)
    ]
    blur = np.max([size * change for size, change in zip(typical, changes, strict=True)], axis=0)
    flux = middle.flux.sum(axis=1)
    return float(np.sum(flux * bends * np.max(changes, axis=0)) / 24.0), float(np.sum(flux * blur**2) / 8.0)


def _velocity(photons: PhotonMap) -> np.ndarray:
    """D_t x over the whole shutter, relative to the receiver, shape [n, 3]."""
    return (photons.dxdt - photons.receiver_motion).astype(np.float64) / MOMENT


def _advection(riding: PhotonMap, fixed: PhotonMap, neighbours: tuple[Pairs, Pairs]) -> np.ndarray:
    """a D_u v + b D_v v of v = D_t x, where riding photons move by (a, b) lattice steps, shape [n, 3]."""
    velocity = _velocity(riding)
    columns = np.stack([riding.dxdu, riding.dxdv], axis=2).astype(np.float64)
    # Least squares, held back where footprints have collapsed and the steps cannot be told.
    normal = np.einsum("nci,ncj->nij", columns, columns)
    normal += STIFFNESS * (np.trace(normal, axis1=1, axis2=2)[:, None, None] + np.finfo(float).tiny) * np.eye(2)
    steps = np.linalg.solve(normal, np.einsum("nci,nc->ni", columns, velocity - _velocity(fixed))[..., None])[..., 0]
    result = np.zeros_like(velocity)
    for axis, (a, b) in enumerate(neighbours):
        result[a] += steps[a, axis, None] * (velocity[b] - velocity[a])
    return result


def _neighbours(photons: PhotonMap, plan: EmissionPlan) -> tuple[Pairs, Pairs]:
    """Rows of photons and of those one cell on in u, and likewise in v, on the same path and receiver."""
    mask, lattice, _ = plan.paths_of(photons.ids)
    cell = np.floor(photons.emission).astype(np.int64)
    pairs = []
    for axis in (0, 1):
        order = np.lexsort((cell[:, axis], cell[:, 1 - axis], lattice, mask))
        a, b = order[:-1], order[1:]
        beside = (cell[b, axis] - cell[a, axis] == 1) & (cell[b, 1 - axis] == cell[a, 1 - axis])
        beside &= (lattice[a] == lattice[b]) & (mask[a] == mask[b]) & (photons.receiver[a] == photons.receiver[b])
        pairs.append((a[beside], b[beside]))
    return pairs[0], pairs[1]


def _slope(values: np.ndarray, positions: np.ndarray, pairs: Pairs, closest: float) -> np.ndarray:
    """How fast ``values`` change from photon to photon, shape [n]; distances count as no less than ``closest``."""
    slope = np.zeros(len(values))
    a, b = pairs
    distance = np.maximum(np.linalg.norm(positions[b] - positions[a], axis=1), max(closest, np.finfo(float).tiny))
    np.maximum.at(slope, a, np.abs(values[b] - values[a]) / distance)
    return slope
