"""The mean of the flux of photons over the shutter, which differs from that in its middle.

Flux at mid shutter is the mean where it goes along a line. As total reflection ends it grows as the root of the time,
and what passes a lamp has most of its light as it is nearest. At the part s of the shutter a photon that rides has the
flux Φ(s) of a cell at the place where it is by then, times the area A(s) of its own cell:

    Φ (1 + s Φ' + ½ s² Φ'')(1 + s A' + ½ s² A'')          of which the mean is          Φ (1 + (Φ'' + 2 Φ' A' + A'')/24)

Beyond the paper, whose photons keep their flux.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.keyframes import END, KeyframeState
from tpdwarp.trajectories.neighbours import Pairs, differences

# The mean is within half of what it is in the middle: flux that is far fainter before and after follows no parabola.
# Chosen, not derived.
LARGEST_BULGE = 0.5


@dataclass(frozen=True, eq=False)
class CellGrowth:
    """Area of the cells of photons at the part s of the shutter: 1 + s · first + ½ s² · second, each [n].

    With S the shift, and A its change over the shutter, a place u of the light has moved to u + s S + ½ s² A by then:
    so ``first`` is ∇·S and ``second`` 2 det ∇S + ∇·A.
    """

    first: np.ndarray
    second: np.ndarray

    @classmethod
    def none(cls, count: int) -> CellGrowth:
        return cls(np.zeros(count), np.zeros(count))

    @classmethod
    def of(
        cls,
        photons: PhotonMap,
        before: KeyframeState,
        after: KeyframeState,
        follows: np.ndarray,
        beside: Sequence[Pairs],
    ) -> CellGrowth:
        """Those of photons, of which keyframes say how the shift changes of those that follow them."""
        (uu, uv), (vu, vv) = (differences(photons.shift.astype(np.float64), pairs).T for pairs in beside)
        change = (after.shift - before.shift) / (2.0 * END)
        told = [(a[both], b[both]) for a, b in beside for both in [follows[a] & follows[b]]]
        changes = sum(differences(change, pairs)[:, axis] for axis, pairs in enumerate(told))
        return cls(uu + vv, 2.0 * (uu * vv - uv * vu) + changes)


def over_mean(
    before: KeyframeState,
    middle: KeyframeState,
    after: KeyframeState,
    cells: CellGrowth,
    change: np.ndarray,
    follows: np.ndarray,
) -> np.ndarray:
    """The mean flux of photons over the shutter, as a part of that in its middle, shape [n].

    Args:
        before, middle, after: What keyframes say of them, in the order of time.
        cells: How their cells grow.
        change: D_t ln Φ.
        follows: Which follow keyframes, shape [n].
    """
    ends = [np.exp(np.where(follows, end.log_flux - middle.log_flux, 0.0)) for end in (before, after)]
    second = (ends[0] + ends[1] - 2.0) / END**2
    bulge = (second + 2.0 * change * cells.first + cells.second) / 24.0
    return 1.0 + np.clip(bulge, -LARGEST_BULGE, LARGEST_BULGE)
