"""The fit of trajectories: how D_t x and the footprint of a photon change while the shutter is open.

A footprint that goes straight along D_t x with the axes it has at mid shutter is exact to first order in time.
Keyframes know x and D_t x at the ends of the shutter, too, and give acceleration and jerk:

    s D_t x + ½ s² D_tt x + ⅙ s³ D_ttt x  at the part s (−½ … ½) of the shutter

so that the trajectory passes where they say, even where motion has a kink between two of a stage's samples. A photon
that rides on its surface over many of the keyframes' cells is known less exactly by its place than by its velocity;
there the trajectory follows D_t x at its ends. Keyframes at mid shutter are compared with these, not the photon itself,
since interpolation between keyframes errs alike at all three times.

Axes follow to first order, since derivatives commute, D_t D_u x = D_u D_t x: the difference of D_t x between
neighbouring photons is the rate at which the footprint between them grows.

Flux follows, too. A cell that rides on its surface takes the light of another place of the lattice at each time, by
s · shift, and that of another area: if the shift grows from cell to cell, so does the cell. So a photon's flux is

    Φ (1 + s (∂_u shift_u + ∂_v shift_v + D_t ln Φ))

where D_t ln Φ is what keyframes say of the flux at the place where it rides: solid angle, Fresnel and all. Φ is the
mean over the shutter, not what there is in its middle: what nears a lamp takes more light by second order. It is that
of a parabola through the middle and the keyframes at either end, where cells have the integral of their growth.

Beyond the paper, whose footprints go straight and keep their shape and flux.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap, TrajectoryColumns
from tpdwarp.photons.vectors import lengths
from tpdwarp.trajectories.brightening import gained_flux
from tpdwarp.trajectories.flux_pieces import needs_pieces
from tpdwarp.trajectories.keyframes import (
    END,
    LARGEST_DISAGREEMENT,
    LARGEST_DRIFT,
    KeyframeState,
    ShutterKeyframes,
    disagreement,
)
from tpdwarp.trajectories.neighbours import differences, growth_of, neighbours

# Beside what lights themselves do, flux grows by no more than half of this part to either end, as axes do. Chosen, not
# derived: with 2 a ball that rolls by 57 degrees within a segment errs by .137, with 1 by .123.
LARGEST_GROWTH = 1.0
# The mean flux of a photon by what it is at mid shutter, at least and at most. Chosen, not derived: what is beyond is
# no parabola.
LEAST_MEAN, MOST_MEAN = 0.5, 1.5
# Where ln Φ bends by more than this from one of the keyframes' cells to the next, as near rims, its changes are what
# the grid misses of it. Chosen, not derived.
LARGEST_ROUGHNESS = 0.1
# What flux may be at either end by what it is in the middle, as a logarithm. Chosen, not derived.
LARGEST_LOGARITHM = 1.0
# Of the ways of light that keyframes follow, this quantile is as far as any other may go. Chosen, not derived: the last
# hundredth may be as far off as those others.
LONGEST_QUANTILE = 0.99


def fit_trajectories(
    photons: PhotonMap,
    plan: EmissionPlan,
    keyframes: ShutterKeyframes,
    clock: Clock,
    states: Sequence[KeyframeState] | None = None,
) -> tuple[PhotonMap, EnergyAccount]:
    """``photons`` with their trajectories.

    Args:
        photons: Traced at mid shutter; ``photons.dxdt`` spans the shutter of ``keyframes``.
        plan: Their lattices.
        keyframes: What they are fitted to.
        clock: Where the time goes.
        states: What they say of the photons, in the order of time, where that has been asked before.

    Returns:
        The photons, and an account that counts the keyframes' photons and those that go straight all the same.
    """
    before, middle, after = states or keyframes.states(photons, plan)
    with clock.stage("trace"):
        follows = before.valid & middle.valid & after.valid
        follows &= disagreement(photons, before.dxdt, after.dxdt) <= LARGEST_DISAGREEMENT
        photons, shortened = _shortened(photons, follows)
        changes = _acceleration_and_jerk(before, middle, after, follows)
        rates, growth = [np.zeros_like(photons.dxdt)] * 2, np.zeros(len(photons))
        if keyframes.tracer.settings.emission == "lattice":
            beside = neighbours(photons, plan)
            rates = [differences(photons.dxdt, pairs) for pairs in beside]
            growth = growth_of(photons, beside)
        curves = keyframes.power_curves(photons.light_paths)
        # Light that changes by itself is in pieces for that.
        steady = np.array([curve is None for curve in curves])[photons.light] if any(curves) else follows
        gain, mean, bend = _flux_over_the_shutter(before, middle, after, follows, growth, steady)
        account = EnergyAccount(counts={"keyframes": keyframes.emitted})
        if shortened:
            account.counts["ways shortened for want of keyframes"] = shortened
        if not follows.all():
            account.counts["straight for want of keyframes"] = int(np.sum(~follows))
        gained = float(((mean - 1.0) * photons.flux.sum(axis=1, dtype=np.float64)).sum())
        photons = replace(photons, flux=photons.flux * mean[:, None].astype(np.float32))
        photons = replace(photons, trajectory=TrajectoryColumns(*changes, *rates, gain, bend))
        photons = replace(photons, power_curves=curves)
        gained = plan.normalization.power * (gained + gained_flux(photons))
        account.add(EnergyAccount(sent=gained, deposited=gained))
        return photons, account


def _flux_over_the_shutter(
    before: KeyframeState,
    middle: KeyframeState,
    after: KeyframeState,
    follows: np.ndarray,
    growth: np.ndarray,
    steady: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How the flux of photons grows over the shutter, by its mean, that by what it is in the middle, and how it bends
    where it is cut into pieces for it, by its mean, all [n]; the last one without rows where none is.

    Args:
        before, middle, after: Keyframes.
        follows: Photons that follow them, shape [n].
        growth: How fast cells grow that ride, in the middle, shape [n].
        steady: Photons that may be cut into pieces, shape [n].
    """
    # Of flux that goes along a line, over its mean.
    change = 2.0 * np.tanh(0.5 * (after.log_flux - before.log_flux)) / (2.0 * END)
    gain = np.clip(growth + np.where(follows, change, 0.0), -LARGEST_GROWTH, LARGEST_GROWTH).astype(np.float32)
    # ---- The size of a cell is the integral of its growth
    faster = 0.25 * END * (after.growth - before.growth)
    bend = END / 6.0 * (before.growth + after.growth - 2.0 * middle.growth)
    known = np.maximum(np.maximum(before.rough, after.rough), middle.rough) < LARGEST_ROUGHNESS
    ends, within = [], follows & steady & known
    for state, side in ((before, -1.0), (after, 1.0)):
        size = side * END * growth + faster + side * bend
        light = np.where(known, state.log_flux - middle.log_flux, 0.0)
        within &= np.abs(size + light) < LARGEST_LOGARITHM
        ends.append(np.exp(np.minimum(size + light, LARGEST_LOGARITHM)))
    # ---- Of the parabola through them
    second = (ends[0] + ends[1] - 2.0) / END**2
    mean = 1.0 + second / 24.0
    curved = within & (mean > LEAST_MEAN) & (mean < MOST_MEAN)
    slope, second = (ends[1] - ends[0]) / (2.0 * END) / mean, second / mean
    cut = curved & needs_pieces(slope, second)
    gain = np.where(cut, slope, gain).astype(np.float32)
    mean = np.where(follows, np.clip(mean, LEAST_MEAN, MOST_MEAN), 1.0)
    return gain, mean, np.where(cut, second, 0.0).astype(np.float32)[: None if cut.any() else 0]


def _shortened(photons: PhotonMap, follows: np.ndarray) -> tuple[PhotonMap, int]:
    """The photons, of which none that keyframes do not follow goes farther than those that they do; how many would.

    Where light grazes or is nearly totally reflected, D_t x grows without bound, and paths begin and end within the
    shutter: light would leave the picture that is in it whenever it exists.
    """
    way = photons.dxdt - photons.receiver_motion
    length = lengths(way)
    if follows.all() or not follows.any():
        return photons, 0
    longest = float(np.quantile(length[follows], LONGEST_QUANTILE))
    too_far = ~follows & (length > longest)
    part = np.where(too_far, longest / np.maximum(length, np.finfo(np.float32).tiny), 1.0).astype(np.float32)
    return replace(photons, dxdt=photons.receiver_motion + part[:, None] * way), int(np.sum(too_far))


def _acceleration_and_jerk(
    before: KeyframeState, middle: KeyframeState, after: KeyframeState, follows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """D_tt x and D_ttt x over the shutter, shape [n, 3]; zero for photons that do not follow them."""
    # Keyframes take D_t x over some time each, so that the middles of those lie within the ends of the shutter.
    back, ahead = before.position - middle.position, after.position - middle.position
    by_place = (ahead + back) / END**2, 3.0 * (ahead - back - 2.0 * END * middle.dxdt) / END**3
    by_velocity = (after.dxdt - before.dxdt) / (2.0 * END), (before.dxdt + after.dxdt - 2.0 * middle.dxdt) / END**2
    # Between three of four cells light lies elsewhere than between all four: it would seem to move.
    alike = before.seen_as(middle) & after.seen_as(middle)
    place_is_known = (alike & (np.maximum(before.drift, after.drift) < LARGEST_DRIFT))[:, None]
    second, third = (
        np.where(follows[:, None], np.where(place_is_known, place, velocity), 0.0).astype(np.float32)
        for place, velocity in zip(by_place, by_velocity, strict=True)
    )
    return second, third
