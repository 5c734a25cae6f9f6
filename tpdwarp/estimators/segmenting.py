"""How many segments a shutter is worth for a given number of photons.

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
"""

from __future__ import annotations

import math
from dataclasses import replace
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
# Fractions above this are worth another segment; below it they do not pay for another scene.
ROUND_UP = 0.75
STIFFNESS = 1.0e-3

Pairs = tuple[np.ndarray, np.ndarray]


def segment_count(animation: Animation, shutter: Shutter) -> int:
    """The number of segments for shutters of this length and place in the frame.

    It is found at a few times spread over the animation and not at the frame itself, so that all frames have the same
    lattices and do not flicker.
    """
    photons = animation.settings.photons
    most = min(MOST_SEGMENTS, photons // FEWEST_PHOTONS)
    if shutter.exposure <= 0 or most < 2:
        return 1
    plan = animation.plan(min(photons, PILOT_PHOTONS))
    stills = animation.source.reference_shutters()
    errors = [
        _errors_around(animation, still.middle, shutter, plan)
        for still in stills[:: math.ceil(len(stills) / MOST_STILLS)]
    ]
    time_error, blur = np.sum(errors, axis=0)
    if blur <= 0:
        return 1
    best = (2.0 * GAIN * time_error / blur) ** (1.0 / 3.0)
    return int(np.clip(math.floor(best + 1.0 - ROUND_UP), 1, most))


def _errors_around(animation: Animation, frame: float, shutter: Shutter, plan: EmissionPlan) -> tuple[float, float]:
    """Flux-weighted sums of τ and β over the photons that land throughout the shutter of another frame."""
    riding = animation.settings.anchor == "surface"

    def traced(part: float, rides: bool) -> PhotonMap:
        time = frame + shutter.open - shutter.frame + part * shutter.exposure
        half = 0.5 * MOMENT * shutter.exposure
        loaded = animation.load(Shutter(frame, time - half, time + half))
        found, _ = trace_photons(
            loaded.scene, loaded.geometry, plan, loaded.requirements, animation.launcher, riding=rides
        )
        return found

    opening, middle, closing = (traced(part, riding) for part in (0.0, 0.5, 1.0))
    fixed = traced(0.5, False) if riding else middle
    ids = np.intersect1d(np.intersect1d(opening.ids, middle.ids), closing.ids)
    if not len(ids):
        return 0.0, 0.0
    opening, middle, closing, fixed = (_restricted(photons, ids) for photons in (opening, middle, closing, fixed))
    return _errors(opening, middle, closing, fixed, plan, plan.photons / animation.settings.photons)


def _restricted(photons: PhotonMap, ids: np.ndarray) -> PhotonMap:
    """The photons of the given ids, in their order."""
    order = np.argsort(photons.ids)
    rows = order[np.searchsorted(photons.ids, ids, sorter=order)]
    arrays = {name: value[rows] for name, value in vars(photons).items() if isinstance(value, np.ndarray)}
    return replace(photons, **arrays)


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
