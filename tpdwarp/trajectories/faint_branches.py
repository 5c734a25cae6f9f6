"""Faint branches of cells that are traced in parts of the shutter: they shine on as they do at its middle.

Most paths through glass carry a few hundredths of their cell's light each, over everything. What begins and ends of
them is no reason to trace a cell again (:data:`tpdwarp.trajectories.retraced.LEAST_SHARE`), and where it is traced for
its bright paths the faint ones would be most of what is traced: of a blob's cells half of the photons carry a
twentieth of the light. So in parts of the shutter only branches are entered that carry more than ``FAINT_BRANCH`` of
their cell's light; the photons of others are those of mid shutter, along their trajectories.

Mid shutter does not speak for them where it does not speak for the cells either: of light that leaves a prism in its
last nineteenth nothing is there in the middle, and what no curve follows is elsewhere. There all branches are followed
in all parts.

Beyond the paper, which traces once a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tpdwarp.photons.energy import BELOW_CUTOFF, EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.changing import LEAST_DISAGREEMENT
from tpdwarp.trajectories.edges import FINER, coarse_paths
from tpdwarp.trajectories.keyframes import KeyframeState, disagreement
from tpdwarp.trajectories.retraced import FAINT_BRANCH, RetracedCells

# Of the light of cells so much has to be where curves lead from the opening to the closing of the shutter for mid
# shutter to speak for their faint branches. Chosen: between a prism that turns through the end of total reflection, of
# which none is (it errs by .073 then, not by .055, with 4 096 photons), and a blob, of which a quarter is.
LEAST_GOING_ON = 0.1
# What faint photons of mid shutter grow by at most, that others which are not faint there may be so in parts. Chosen,
# not derived.
MOST_GROWTH = 2.0


def cutoff_in_parts(
    photons: PhotonMap, changing: RetracedCells, states: Sequence[KeyframeState], cutoff: float
) -> float:
    """Part of their cell's flux below which branches of ``changing`` cells are not entered in parts of the shutter.

    Args:
        photons: Of mid shutter.
        states: What keyframes say of them.
        cutoff: That below which none are followed at all.
    """
    flux = np.where(changing.holds(photons), photons.flux.sum(axis=1, dtype=np.float64), 0.0)
    before, _, after = states
    goes_on = np.all([state.valid for state in states], axis=0)
    goes_on &= disagreement(photons, before.dxdt, after.dxdt) <= LEAST_DISAGREEMENT
    return max(FAINT_BRANCH, cutoff) if flux[goes_on].sum() > LEAST_GOING_ON * flux.sum() else cutoff


def shining_on(
    photons: PhotonMap,
    faint: np.ndarray,
    plan: EmissionPlan,
    parts: Sequence[tuple[PhotonMap, EmissionPlan]],
    times: Sequence[np.ndarray],
    at_middle: EnergyAccount,
    in_parts: EnergyAccount,
    account: EnergyAccount,
) -> PhotonMap:
    """The photons of mid shutter, whose ``faint`` ones have as much light together as faint branches have in parts.

    A path that is faint in the middle may not be before and after, as where light grazes a side that turns: each shines
    for the time in which its path is entered in no part.

    Args:
        photons: Of ``plan``.
        faint: Which of them are faint branches of cells that are traced in parts, shape [n].
        parts: Photons of parts of the shutter, and the lattices of each: those of ``plan`` or finer ones.
        times: For how much of the shutter each of them shines, shape [n] each.
        at_middle, in_parts: Of what was traced without faint branches, which count as lost there.
        account: Of all photons; is told where the light of faint branches goes. What does not land escapes; what would
            and has no photon that may stand for it is lost.
    """
    ids = [part.ids if of is plan else coarse_paths(part.ids, of, plan)[0] for part, of in parts]
    shares = [1.0 if of is plan else 1.0 / FINER**2 for _, of in parts]
    entered, number = np.unique(np.concatenate(ids), return_inverse=True)
    left = np.ones(len(photons))
    if len(entered):
        time = np.bincount(number, np.concatenate([share * time for share, time in zip(shares, times, strict=True)]))
        at = np.searchsorted(entered, photons.ids).clip(0, len(entered) - 1)
        left = np.where(faint & (entered[at] == photons.ids), 1.0 - time[at].clip(0.0, 1.0), 1.0)
    power = plan.normalization.power
    flux = photons.flux.sum(axis=1, dtype=np.float64) * faint
    landed, goes_on = (power * float(light.sum()) for light in (flux, flux * left))
    before, wanted = (given.lost.get(BELOW_CUTOFF, 0.0) for given in (at_middle, in_parts))
    # As much of it lands as in the middle.
    lands = landed * wanted / before if before > 0.0 else landed
    scale = min(lands / goes_on, MOST_GROWTH) if goes_on > 0.0 else 1.0
    unshown = lands - scale * goes_on
    account.lost[BELOW_CUTOFF] = account.lost.get(BELOW_CUTOFF, 0.0) + before - wanted + unshown
    account.deposited += scale * goes_on - landed
    account.escaped += (wanted - lands) - (before - landed)
    return replace(photons, flux=(photons.flux * np.where(faint, scale * left, 1.0)[:, None]).astype(np.float32))
