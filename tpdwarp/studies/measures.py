"""How far a solution is from the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpdwarp.io.images import flip_difference
from tpdwarp.studies.solutions import Solution

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Errors:
    """Errors of the light from photons, over all pixels, channels and frames.

    Attributes:
        rmse: Root of the mean squared error [radiance].
        relative_rmse: That, by the mean of the truth.
        bias: Mean error, by the mean of the truth.
        flip: Mean of HDR-ꟻLIP of the whole image, exposures laid out over the truth.
        flicker: Root of the mean squared error of the difference from frame to frame, by the mean of the truth; None
            for a single frame.
    """

    rmse: float
    relative_rmse: float
    bias: float
    flip: float
    flicker: float | None


def root_mean_square(values: np.ndarray) -> float:
    """√ of the mean of the squares, in double precision."""
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


def errors_of(found: Solution, truth: Solution) -> Errors:
    """The errors of ``found``; both have the same frames and pixels, and the truth has light from photons."""
    difference = found.caustic.astype(np.float64) - truth.caustic
    level = float(truth.caustic.mean(dtype=np.float64))
    rmse = root_mean_square(difference)
    flicker = root_mean_square(np.diff(difference, axis=0)) / level if len(difference) > 1 else None
    return Errors(rmse, rmse / level, float(difference.mean()) / level, _flip(found, truth), flicker)


def _flip(found: Solution, truth: Solution) -> float:
    luminance = truth.beauty @ LUMINANCE
    lit = luminance[luminance > 0]
    brightest, median = (float(lit.max()), float(np.median(lit))) if len(lit) else (1.0, 1.0)
    maps = [
        flip_difference(image, reference, brightest, median)
        for image, reference in zip(found.beauty, truth.beauty, strict=True)
    ]
    return float(np.mean(maps))
