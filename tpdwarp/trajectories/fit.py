"""Bent ways: how D_t x and the footprint of a photon change while the shutter is open.

A footprint that goes straight along D_t x with the axes it has at mid shutter is exact to first order in time. Guides
tell x and D_t x at the ends of the shutter, too, and bend its way to third order:

    s D_t x + ½ s² D_tt x + ⅙ s³ D_ttt x  at the part s (−½ … ½) of the shutter

so that it passes where they say, even where motion has a kink between two of a stage's samples. A photon that rides on
its surface over many of the guides' cells is told less exactly where its light is than how it moves; there the way
follows D_t x at its ends. Guides at mid shutter are compared with these, not the photon itself, since between guides
all three err alike.

Axes follow to first order by the order of derivatives, D_t D_u x = D_u D_t x: the difference of D_t x between photons
side by side is how the footprint between them grows.

Beyond the paper, whose footprints go straight and keep their shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.tracing import Curve, PhotonMap
from tpdwarp.trajectories.keyframes import (
    FARTHEST_ASIDE,
    LARGEST_DISAGREEMENT,
    MOMENT,
    Guides,
    Moment,
    disagreement,
    moments,
)
from tpdwarp.trajectories.neighbours import differences, neighbours

if TYPE_CHECKING:
    from tpdwarp.estimators.base import Animation, Clock, LoadedScene

FEWEST_GUIDES = 1024
PHOTONS_PER_GUIDE = 16


def bent(
    photons: PhotonMap,
    plan: EmissionPlan,
    animation: Animation,
    loaded: LoadedScene,
    clock: Clock,
    taken: Callable[[str], bool] | None = None,
) -> tuple[PhotonMap, int]:
    """``photons`` with how their ways are bent.

    Args:
        photons: Traced through ``loaded``.
        plan: Their lattices.
        animation: Where guides are traced.
        loaded: The scene over the (sub-)shutter that ``photons.dxdt`` spans.
        clock: Where the time goes.
        taken: Tells which meshes they met first; None where that was any.

    Returns:
        The photons, and the number of guides emitted.
    """
    sparse = animation.plan(min(plan.photons, max(FEWEST_GUIDES, plan.photons // PHOTONS_PER_GUIDE)), clock)
    opening, _, closing = moments(loaded.scene.shutter)
    guides = Guides(animation, sparse, opening, closing, clock, taken)
    before, after = guides.around(photons, plan)
    middle = guides.amid(photons, plan, loaded)
    with clock.stage("trace"):
        changes = _changes(photons, before, middle, after)
        if animation.settings.emission == "lattice":
            axes = [differences(photons.dxdt, beside) for beside in neighbours(photons, plan)]
        else:
            axes = [np.zeros_like(photons.dxdt)] * 2
        return replace(photons, curve=Curve(*changes, *axes)), guides.emitted


def _changes(photons: PhotonMap, before: Moment, middle: Moment, after: Moment) -> tuple[np.ndarray, np.ndarray]:
    """D_tt x and D_ttt x over the shutter, shape [n, 3]; zero where guides do not tell, or disagree."""
    # Guides take D_t x over a moment each, so that the middles of those lie within the ends of the shutter.
    reach = 0.5 * (1.0 - MOMENT)
    back, ahead = before.position - middle.position, after.position - middle.position
    by_place = (ahead + back) / reach**2, 3.0 * (ahead - back - 2.0 * reach * middle.dxdt) / reach**3
    by_speed = (after.dxdt - before.dxdt) / (2.0 * reach), (before.dxdt + after.dxdt - 2.0 * middle.dxdt) / reach**2
    in_place = (np.maximum(before.aside, after.aside) < FARTHEST_ASIDE)[:, None]
    follows = before.told & middle.told & after.told
    follows &= disagreement(photons, before.dxdt, after.dxdt) <= LARGEST_DISAGREEMENT
    second, third = (
        np.where(follows[:, None], np.where(in_place, place, speed), 0.0).astype(np.float32)
        for place, speed in zip(by_place, by_speed, strict=True)
    )
    return second, third
