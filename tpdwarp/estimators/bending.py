"""Bent ways: how D_t x and the footprint of a photon change while the shutter is open.

A footprint that goes straight along D_t x with the axes it has at mid shutter is exact to first order in time. Guides
tell D_t x at the ends of the shutter, too: with s from −½ to ½ over it, the parabola through the three is the change of

    s D_t x + ½ s² D_tt x + ⅙ s³ D_ttt x

so that the place is of third order. Axes follow to first order by the order of derivatives, D_t D_u x = D_u D_t x: the
difference of D_t x between photons side by side is how the footprint between them grows, turns and shears.

Beyond the paper, whose footprints go straight and keep their shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.estimators.guides import LARGEST_DISAGREEMENT, MOMENT, Guides, disagreement, moments
from tpdwarp.estimators.neighbours import differences, neighbours
from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import Curve, PhotonMap
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
    """``photons`` with how their ways are bent.

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
        changes = _changes(photons, *guides.around(photons, plan))
        if animation.settings.emission == "lattice":
            axes = [differences(photons.dxdt, beside) for beside in neighbours(photons, plan)]
        else:
            axes = [np.zeros_like(photons.dxdt)] * 2
        return replace(photons, curve=Curve(*changes, *axes)), guides.emitted


def _changes(
    photons: PhotonMap, before: np.ndarray, after: np.ndarray, told: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """D_tt x and D_ttt x over the shutter, shape [n, 3]; zero where guides do not tell, or disagree."""
    follows = (told & (disagreement(photons, before, after) <= LARGEST_DISAGREEMENT))[:, None]
    # Guides take D_t x over a moment each, so that the middles of those lie within the ends of the shutter.
    span = 1.0 - MOMENT
    second = np.where(follows, (after - before) / span, 0.0)
    third = np.where(follows, (before + after - 2.0 * photons.dxdt) / (0.5 * span) ** 2, 0.0)
    return second.astype(np.float32), third.astype(np.float32)
