"""The converged accumulation that everything is measured against, in two halves that tell its own noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.settings import Settings
from tpdwarp.studies.measures import root_mean_square
from tpdwarp.studies.solutions import Solution

# Ten percent more cells a side: the lattices of the halves have no common phase.
_OTHER_LATTICE = 1.21


@dataclass(frozen=True)
class TruthSettings:
    """How well the truth is rendered.

    Attributes:
        photons: Photons of each instant.
        times: Instants of each half.
        samples: Camera samples a pixel of each half.
    """

    photons: int = 1 << 18
    times: int = 32
    samples: int = 16

    def halves(self, base: Settings, exposure: float | None) -> tuple[Settings, Settings]:
        """Settings of the halves: other instants, other lattices, other places in the pixels.

        Raises:
            InputError: A value is not usable.
        """
        first = replace(
            base,
            estimator="accumulation",
            kernel="bspline",
            footprint="shutter",
            time_filter="none",
            emission="lattice",
            smoothing=1.0,
            segments=1,
            exposure=exposure,
            photons=self.photons,
            accumulation_times=self.times,
            samples=self.samples,
        )
        second = replace(
            first,
            photons=round(_OTHER_LATTICE * self.photons),
            accumulation_times=self.times + 1,
            seed=(base.seed + 1) % 2**31,
        )
        return first, second


@dataclass(frozen=True, eq=False)
class Truth:
    """The mean of two halves.

    Attributes:
        solution: The frames.
        relative_noise: RMS error of the mean that the halves' difference tells, by its mean. What both have in common,
            as that footprints are averaged over half a pixel, it does not tell.
    """

    solution: Solution
    relative_noise: float


def truth_of(first: Solution, second: Solution, scene: str) -> Truth:
    """The truth that two halves make.

    Raises:
        InputError: No light comes from photons, so that there is nothing to measure.
    """
    caustic = 0.5 * (first.caustic.astype(np.float64) + second.caustic)
    level = float(caustic.mean())
    if not level > 0:
        raise InputError("no light comes from photons in these frames: there is nothing to measure", scene)
    beauty = 0.5 * (first.beauty.astype(np.float64) + second.beauty)
    mean = replace(first, caustic=caustic.astype(np.float32), beauty=beauty.astype(np.float32))
    return Truth(mean, 0.5 * root_mean_square(first.caustic.astype(np.float64) - second.caustic) / level)
