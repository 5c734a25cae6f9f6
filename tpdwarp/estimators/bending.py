"""Curved ways of footprints: how D_t x changes while the shutter is open.

A footprint that goes straight along D_t x is exact to first order in time; what is left is ½ s² D_tt x at the part s of
the shutter, the difference of the D_t x that guides tell at its ends.

Beyond the paper, whose footprints go straight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.estimators.guides import LARGEST_DISAGREEMENT, MOMENT, Guides, disagreement, moments
from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import PhotonMap
from tpdwarp.scene.description import Shutter

if TYPE_CHECKING:
    from tpdwarp.estimators.base import Animation, Clock

FEWEST_GUIDES = 1024
PHOTONS_PER_GUIDE = 16


def bent(
    photons: PhotonMap,
    plan: EmissionPlan,
    animation: Animation,
    shutter: Shutter,
    clock: Clock,
    taken: Callable[[str], bool] | None = None,
) -> tuple[PhotonMap, int]:
    """``photons`` with the bend of their ways.

    Args:
        photons: Traced at the middle of ``shutter``.
        plan: Their lattices.
        animation: Where guides are traced.
        shutter: The (sub-)shutter that ``photons.dxdt`` spans.
        clock: Where the time goes.
        taken: Tells which meshes they met first; None where that was any.

    Returns:
        The photons, and the number of guides emitted.
    """
    sparse = animation.plan(min(plan.photons, max(FEWEST_GUIDES, plan.photons // PHOTONS_PER_GUIDE)), clock)
    opening, _, closing = moments(shutter)
    guides = Guides(animation, sparse, opening, closing, clock, taken)
    with clock.stage("trace"):
        return replace(photons, bend=_bends(photons, *guides.around(photons, plan))), guides.emitted


def _bends(photons: PhotonMap, before: np.ndarray, after: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Change of D_t x over the shutter, shape [n, 3]; zero where guides do not tell, or disagree."""
    follows = told & (disagreement(photons, before, after) <= LARGEST_DISAGREEMENT)
    return np.where(follows[:, None], (after - before) / (1.0 - MOMENT), 0.0).astype(np.float32)
