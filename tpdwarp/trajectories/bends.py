"""Bends: where the light of a cell lies on average, beside where its photon does.

A footprint stands for a cell, and for what a B-spline reaches over besides, as if D_u x and D_v x were the same all
over it. With D_uu x = ∂_u D_u x they are not: light from the place (a, b) of the lattice lands

    ½ (a² D_uu x + b² D_vv x) + a b D_uv x

beside where first order has it. On average over a kernel of variance κ cells² along u and v that is κ times the bend,

    ½ (D_uu x + D_vv x)

by which a footprint is moved, so that beside folds its light does not fall on the dark side. Second derivatives are the
differences of D_u x and D_v x between neighbours, where these lie as far apart as their columns say.

Beyond the paper.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.neighbours import differences, neighbours

# Neighbours are of one smooth sheet where the way between them is the mean of their columns, up to this part of the
# longer one: at a fold it is, across the edge of a facet it is not. Chosen, not derived.
LARGEST_MISFIT = 0.5


def with_bends(photons: PhotonMap, plan: EmissionPlan) -> PhotonMap:
    """The photons of a lattice with their bends, which lie in the plane of their receivers."""
    bend = np.zeros_like(photons.position)
    for column, (a, b) in zip((photons.dxdu, photons.dxdv), neighbours(photons, plan), strict=True):
        mean = 0.5 * (column[a] + column[b])
        misfit = np.linalg.norm(photons.position[b] - photons.position[a] - mean, axis=1)
        longer = np.maximum(*(np.linalg.norm(column[rows], axis=1) for rows in (a, b)))
        beside = (misfit <= LARGEST_MISFIT * longer) & (photons.receiver[a] == photons.receiver[b])
        bend += 0.5 * differences(column, (a[beside], b[beside]))
    bend -= photons.normal * np.sum(photons.normal * bend, axis=1, keepdims=True)
    return replace(photons, bend=bend)
