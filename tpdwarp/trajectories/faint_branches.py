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

import numpy as np

from tpdwarp.photons.energy import BELOW_CUTOFF, EnergyAccount
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.changing import LEAST_DISAGREEMENT
from tpdwarp.trajectories.keyframes import KeyframeState, disagreement
from tpdwarp.trajectories.retraced import FAINT_BRANCH, RetracedCells

# Of the light of cells so much has to be where curves lead from the opening to the closing of the shutter for mid
# shutter to speak for their faint branches. Chosen: between a prism that turns through the end of total reflection, of
# which none is (it errs by .073 then, not by .055, with 4 096 photons), and a blob, of which a quarter is.
LEAST_GOING_ON = 0.1


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


def count_faint_branches(account: EnergyAccount, at_middle: EnergyAccount, in_parts: EnergyAccount) -> None:
    """Counts faint branches as they shine: what they would have in parts of the shutter more or less than at its middle
    is neither sent nor lost.

    Args:
        account: Of all photons; those of faint branches as of mid shutter.
        at_middle, in_parts: Of what was traced without faint branches, which count as lost.
    """
    more = in_parts.lost.get(BELOW_CUTOFF, 0.0) - at_middle.lost.get(BELOW_CUTOFF, 0.0)
    if more:
        account.lost[BELOW_CUTOFF] = account.lost.get(BELOW_CUTOFF, 0.0) - more
        account.sent -= more
