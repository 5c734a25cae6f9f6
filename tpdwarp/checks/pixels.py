"""Comparing two images pixel by pixel, in one pass.

OpenImageIO's ``ImageBufAlgo.compare`` counts the same pixels, which a test holds this against, but it is not used. It
gives no map of the differences, which the worst pixels and the report need, so that a second pass is needed beside it;
it compares a pixel at a time and wants a copy of each image. On two noisy 1080p images of three floats a pixel it takes
nearly five times the CPU time of what is here, with the map five to seven times, and a check of a frame compares three
such groups. ``scripts/benchmarks/run.py check_frames`` prints both times.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

# Rows that are worked on together, so that all of a pass stays in a core's cache.
_BAND_VALUES = 2**17
# Stands for infinite limits, whose product with black is no number.
_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, eq=False)
class PixelComparison:
    """How far two images are apart, pixel by pixel.

    Attributes:
        rms: Root of the mean squared difference, over pixels and channels.
        failed, warned: Pixels beyond the limits.
        difference: Largest difference over the channels of each pixel, shape [h, w].
    """

    rms: float
    failed: int
    warned: int
    difference: np.ndarray

    @property
    def largest(self) -> float:
        return float(self.difference.max(initial=0.0))


def compare_pixels(
    image: np.ndarray,
    baseline: np.ndarray,
    fail: tuple[float, float] = (0.0, 0.0),
    warn: tuple[float, float] = (0.0, 0.0),
) -> PixelComparison:
    """Compares two images of finite pixels, shape [h, w, channels] each.

    Args:
        image, baseline: The images.
        fail, warn: Limits, absolute and relative to the mean of the two values' sizes. A pixel is beyond one where
            a channel exceeds both, as for ``idiff``.
    """
    squares, beyond = 0.0, [0, 0]
    limits = [[np.float32(min(limit, _LARGEST)) for limit in pair] for pair in (fail, warn)]
    difference = np.empty(image.shape[:2], np.float32)
    for rows in bands(image):
        mine, theirs = image[rows], baseline[rows]
        apart = np.abs(mine - theirs)
        difference[rows] = largest_channel(apart)
        squares += sum_of_squares(apart)
        if not difference[rows].any():
            continue
        size = 0.5 * np.abs(mine) + 0.5 * np.abs(theirs)
        for index, (absolute, relative) in enumerate(limits):
            with np.errstate(over="ignore"):
                exceeding = (apart > absolute) & (apart > relative * size)
            beyond[index] += int(np.count_nonzero(largest_channel(exceeding)))
    return PixelComparison(math.sqrt(squares / image.size) if image.size else 0.0, *beyond, difference)


def root_mean_square(pixels: np.ndarray) -> float:
    """√ of the mean of the squares, in double precision."""
    return math.sqrt(sum(sum_of_squares(pixels[rows]) for rows in bands(pixels)) / pixels.size) if pixels.size else 0.0


def sum_of_squares(pixels: np.ndarray) -> float:
    """In double precision."""
    flat = pixels.astype(np.float64).ravel()
    # Not the dot product of a BLAS, which has threads of its own; frames have theirs.
    return float(np.einsum("i,i", flat, flat))


def largest_channel(pixels: np.ndarray) -> np.ndarray:
    """The largest value over the channels, shape [h, w] of [h, w, channels]."""
    found = pixels[..., 0].copy()
    for channel in range(1, pixels.shape[-1]):
        np.maximum(found, pixels[..., channel], out=found)
    return found


def bands(pixels: np.ndarray) -> Iterator[slice]:
    """Rows of an image in parts that fit a core's cache."""
    step = max(1, _BAND_VALUES * len(pixels) // max(1, pixels.size))
    return (slice(start, start + step) for start in range(0, len(pixels), step))
