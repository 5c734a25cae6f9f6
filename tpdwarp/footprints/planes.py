"""Flat receivers at rest: planes, on which light can be gathered on rasters (:mod:`.rasters`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpdwarp.footprints.placing import PLANE_ROUNDING

# Planes of one receiver that are tried, and the photons that make one worth a raster. Chosen, not derived.
MOST_PLANES = 8
FEWEST_PHOTONS = 128
# Normals of one plane differ by their rounding alone.
SAME_NORMAL = 1e-6


@dataclass(frozen=True)
class Plane:
    """A flat receiver at rest: the number of its object, the foot of the origin on it, and its unit normal."""

    receiver: int
    foot: np.ndarray
    normal: np.ndarray

    def holds(self, receiver: np.ndarray, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Which of the photons lie on it, shape [n]."""
        heights = np.abs((positions - self.foot) @ self.normal)
        same = (receiver == self.receiver) & (normals @ self.normal > 1.0 - SAME_NORMAL)
        return same & (heights <= float(PLANE_ROUNDING))


def planes_of(receiver: np.ndarray, positions: np.ndarray, normals: np.ndarray) -> list[Plane]:
    """The planes that photons landed on, of those that hold enough of them.

    Args:
        receiver: Object of each, shape [n].
        positions, normals: Shape [n, 3] each.
    """
    found: list[Plane] = []
    numbers, counts = np.unique(receiver, return_counts=True)
    for number in numbers[counts >= FEWEST_PHOTONS]:
        left = np.flatnonzero(receiver == number)
        for _ in range(MOST_PLANES):
            if len(left) < FEWEST_PHOTONS:
                break
            n = normals[left[0]].astype(np.float64)
            plane = Plane(int(number), n * (positions[left[0]] @ n), n)
            held = plane.holds(receiver[left], positions[left], normals[left])
            # Not one that rounding keeps from holding itself.
            held[0] = True
            if np.count_nonzero(held) >= FEWEST_PHOTONS:
                found.append(plane)
            left = left[~held]
    return found


def on_any(planes: list[Plane], receiver: np.ndarray, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Which of the photons lie on one of the ``planes``, shape [n]."""
    held = np.zeros(len(receiver), bool)
    for plane in planes:
        held |= plane.holds(receiver, positions, normals)
    return held
