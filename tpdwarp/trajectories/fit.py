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
mean over the shutter (:mod:`.mean_flux`).

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
from tpdwarp.trajectories.keyframes import (
    END,
    LARGEST_DISAGREEMENT,
    LARGEST_DRIFT,
    KeyframeState,
    ShutterKeyframes,
    disagreement,
)
from tpdwarp.trajectories.mean_flux import CellGrowth, over_mean
from tpdwarp.trajectories.neighbours import differences, neighbours

# Beside what lights themselves do, flux grows by no more than half of this part to either end, as axes do. Chosen, not
# derived: with 2 a ball that rolls by 57 degrees within a segment errs by .137, with 1 by .123.
LARGEST_GROWTH = 1.0
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
        rates, cells = [np.zeros_like(photons.dxdt)] * 2, CellGrowth.none(len(photons))
        if keyframes.tracer.settings.emission == "lattice":
            beside = neighbours(photons, plan)
            rates = [differences(photons.dxdt, pairs) for pairs in beside]
            cells = CellGrowth.of(photons, before, after, follows, beside)
        # Of flux that goes along a line, over its mean.
        change = 2.0 * np.tanh(0.5 * (after.log_flux - before.log_flux)) / (2.0 * END)
        change = np.where(follows, change, 0.0)
        gain = np.clip(cells.first + change, -LARGEST_GROWTH, LARGEST_GROWTH).astype(np.float32)
        mean = over_mean(before, middle, after, cells, change, follows)
        account = EnergyAccount(counts={"keyframes": keyframes.emitted})
        if shortened:
            account.counts["ways shortened for want of keyframes"] = shortened
        if not follows.all():
            account.counts["straight for want of keyframes"] = int(np.sum(~follows))
        flux = photons.flux * mean[:, None].astype(np.float32)
        over_middle = float((flux - photons.flux).sum(dtype=np.float64))
        photons = replace(photons, flux=flux, trajectory=TrajectoryColumns(*changes, *rates, gain))
        photons = replace(photons, power_curves=keyframes.power_curves(photons.light_paths))
        gained = plan.normalization.power * (gained_flux(photons) + over_middle)
        account.add(EnergyAccount(sent=gained, deposited=gained))
        return photons, account


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
    place_is_known = (np.maximum(before.drift, after.drift) < LARGEST_DRIFT)[:, None]
    second, third = (
        np.where(follows[:, None], np.where(place_is_known, place, velocity), 0.0).astype(np.float32)
        for place, velocity in zip(by_place, by_velocity, strict=True)
    )
    return second, third
