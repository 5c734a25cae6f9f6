"""Between instants: how the light of cells goes on that are traced at several instants of the shutter.

Cells that change are traced in parts of the shutter (:mod:`.parts`), each at its middle. At first order light goes
straight through a part and shines alike all the time. Where total reflection has just ended it does neither: it slows
down, and grows as the root of the time. But what it does then is known from the parts before and after. With d the
length of a part, and v = D_t x/d and Φ' = Φ/d of a photon of the same cell on the same path at the three middles,

    D_tt x = d² ∂v      D_t Φ = d² ∂Φ'      Φ = d (Φ' + d²/24 ∂²Φ')

with ∂ the difference from the part before to that after over the time between, and ∂² the second difference: the last
is the mean of a parabola. Where a path begins or ends there is one side only, and no second difference.

Beyond the paper, which traces once a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap, TrajectoryColumns
from tpdwarp.photons.vectors import lengths
from tpdwarp.trajectories.fit import LARGEST_GROWTH

# Parts follow each other where one begins as the other ends, up to rounding [shutters].
SAME_TIME = 1e-6
# The mean of a part is within half of what it has in the middle: what is far fainter than before and after follows no
# parabola. Chosen, not derived.
LARGEST_BULGE = 0.5
# Of D_tt x to either side: where it is even it is twice as much as their mean at most (van Leer 1974).
MOST_OF_A_SIDE = 2.0


def joined_in_time(maps: Sequence[PhotonMap]) -> list[PhotonMap]:
    """The photons of cells traced in parts of the shutter with their D_tt x, and with flux as it is over their part.

    Args:
        maps: Photons of each part, in any order.
    """
    counts = [len(photons) for photons in maps]
    time, length = (
        np.concatenate([np.full(count, value, np.float64) for count, value in zip(counts, values, strict=True)])
        for values in ([photons.time for photons in maps], [photons.duration for photons in maps])
    )

    def column(name: str) -> np.ndarray:
        return np.concatenate([getattr(photons, name) for photons in maps])

    names = [column(name) for name in ("receiver", "path", "ids")]
    order = np.lexsort([time, *names])
    a, b = order[:-1], order[1:]
    follows = np.abs(time[b] - time[a] - 0.5 * (length[a] + length[b])) < SAME_TIME
    for name in names:
        follows &= name[a] == name[b]
    before = after = np.arange(len(time))
    before, after = before.copy(), after.copy()
    before[b[follows]], after[a[follows]] = a[follows], b[follows]

    def change(values: np.ndarray) -> np.ndarray:
        """∂ of values [n, k]."""
        apart = (time[after] - time[before])[:, None]
        return np.divide(values[after] - values[before], apart, out=np.zeros_like(values), where=apart > 0.0)

    speed = column("dxdt") / length[:, None]
    acceleration = change(speed) * length[:, None] ** 2
    acceleration *= _kept(acceleration, speed, time, length, before, after)[:, None]
    power = column("flux").sum(axis=1, dtype=np.float64)[:, None] / length[:, None]
    least = np.finfo(np.float64).tiny
    gain = change(power) * length[:, None] / np.maximum(power, least)
    gain = np.clip(gain[:, 0], -LARGEST_GROWTH, LARGEST_GROWTH)
    both = np.flatnonzero((before != np.arange(len(time))) & (after != np.arange(len(time))))
    mean = np.ones(len(time))
    ahead, behind = (time[after] - time)[both], (time - time[before])[both]
    here, rises = power[both, 0], (power[after] - power)[both, 0] / ahead
    second = 2.0 * (rises - (power - power[before])[both, 0] / behind) / (ahead + behind)
    bulge = length[both] ** 2 / 24.0 * second / np.maximum(here, least)
    mean[both] += np.clip(bulge, -LARGEST_BULGE, LARGEST_BULGE)
    found = []
    ends = np.cumsum(counts)[:-1]
    for photons, *mine in zip(maps, *(np.split(part, ends) for part in (acceleration, gain, mean)), strict=True):
        curve, growth, over = (part.astype(np.float32) for part in mine)
        still = np.zeros_like(curve)
        trajectory = TrajectoryColumns(curve, still, still, still, growth)
        found.append(replace(photons, flux=photons.flux * over[:, None], trajectory=trajectory))
    return found


def _kept(
    acceleration: np.ndarray,
    speed: np.ndarray,
    time: np.ndarray,
    length: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> np.ndarray:
    """The part of D_tt x that is kept, shape [n]: no more than twice that to either side (van Leer's limiter), nor, of
    what has one side only, than turns it back within its part.

    Args:
        acceleration: D_tt x over each part, shape [n, 3].
        speed: v of the photons, shape [n, 3].
        time, length: Of their parts, shape [n].
        before, after: Which photons those before and after are, themselves where there are none.
    """
    own = np.arange(len(time))

    def to(other: np.ndarray) -> np.ndarray:
        """Length of D_tt x as told by one side; infinite where there is none."""
        apart = np.abs(time[other] - time)
        found = lengths(speed[other] - speed) * length**2
        return np.divide(found, apart, out=np.full(len(time), np.inf), where=other != own)

    most = MOST_OF_A_SIDE * np.minimum(to(before), to(after))
    alone = (before == own) | (after == own)
    most[alone] = np.minimum(most, 2.0 * lengths(speed) * length)[alone]
    return np.minimum(most / np.maximum(lengths(acceleration), np.finfo(np.float32).tiny), 1.0)
