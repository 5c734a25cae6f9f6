"""Measuring how far one channel group is from its baseline, and holding that against the limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tpdwarp.checks.findings import Finding, GroupMeasures, WorstPixel
from tpdwarp.checks.limits import FlipLimits, GroupLimits
from tpdwarp.images import PixelComparison, compare_pixels, flip_difference
from tpdwarp.reports.pictures import shrunk

WORST_COUNT = 5
COARSE_FACTOR = 8
_WORST_SPACING = 8

# Depths and positions of rays that hit nothing lie far beyond any scene; they are no lengths to take a mean of.
_BACKGROUND = 1e9


def measure(
    image: np.ndarray,
    baseline: np.ndarray,
    limits: GroupLimits,
    flip: FlipLimits,
    colors: bool,
    linear: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[GroupMeasures, np.ndarray | None]:
    """Measures one channel group.

    Args:
        image, baseline: Finite pixels, shape [h, w, channels].
        limits: What pixels are counted by, and whether FLIP is wanted.
        flip: How FLIP is measured.
        colors: Whether the channels are red, green and blue.
        linear: The same images in linear Rec.709, where the pixels are not.

    Returns:
        The measures, and the map of FLIP, shape [h, w], or None where it is not measured.
    """
    differing = np.zeros(image.shape[:2], bool)
    if not colors:
        far, far_baseline = np.abs(image) >= _BACKGROUND, np.abs(baseline) >= _BACKGROUND
        differing = (far != far_baseline).any(axis=-1)
        image, baseline = np.where(far | far_baseline, 0, image), np.where(far | far_baseline, 0, baseline)
    count = image.shape[0] * image.shape[1]
    if np.array_equal(image, baseline):
        found = PixelComparison(0.0, 0.0, (0, 0), 0, 0, 0)
    else:
        found = compare_pixels(
            image,
            baseline,
            (limits.fail_absolute, limits.fail_relative),
            (limits.warn_absolute, limits.warn_relative),
        )
    crossings = int(np.count_nonzero(differing))
    peak = float(np.abs(baseline).max(initial=0.0))
    level = root_mean_square(baseline)
    flip_map = None
    if colors and (math.isfinite(limits.flip_mean) or math.isfinite(limits.flip_high)):
        flip_map = _flip(*(linear or (image, baseline)), flip, same=found.maximum == 0)
    totals = [float(pixels.sum(dtype=np.float64)) for pixels in (image, baseline)] if colors else [None, None]
    measures = GroupMeasures(
        failed_percent=100 * (found.failed + crossings) / count,
        warned_percent=100 * (found.warned + crossings) / count,
        largest=found.maximum,
        rms=found.rms,
        hard=found.maximum / (peak or 1.0),
        rmse=found.rms / (level or 1.0),
        coarse=root_mean_square(_coarse(image) - _coarse(baseline)) / (level or 1.0) if found.maximum else 0.0,
        flip_mean=None if flip_map is None else float(flip_map.mean()),
        flip_high=None if flip_map is None else float(np.percentile(flip_map, flip.percentile)),
        energy=relative_difference(*totals) if colors else None,
        total=totals[0],
        baseline_total=totals[1],
        worst=_worst_pixels(image, baseline) if found.maximum > 0 else (),
    )
    return measures, flip_map


def judge(group: str, measures: GroupMeasures, limits: GroupLimits, percentile: float) -> Iterator[Finding]:
    """What of the measures is beyond the limits."""
    place = (measures.worst[0].column, measures.worst[0].row) if measures.worst else None
    at = f", worst at pixel {place}" if place else ""
    failed = measures.failed_percent > limits.fail_percent
    if failed:
        text = f"{measures.failed_percent:.3g} % of pixels fail, {limits.fail_percent:.3g} % may{at}"
        yield Finding("fail", "pixels", text, group, measures.failed_percent, limits.fail_percent, place)
    elif measures.warned_percent > limits.warn_percent:
        text = f"{measures.warned_percent:.3g} % of pixels warn, {limits.warn_percent:.3g} % may{at}"
        yield Finding("warn", "pixels", text, group, measures.warned_percent, limits.warn_percent, place)
    if measures.hard > limits.hard:
        text = f"a pixel is off by {measures.largest:.4g}, {measures.hard:.3g} of the baseline's largest value{at}"
        yield Finding("fail", "hard", text, group, measures.hard, limits.hard, place)
    names = {
        "rmse": "relative RMSE",
        "coarse": "relative RMSE of the shrunk image",
        "flip_mean": "mean FLIP",
        "flip_high": f"FLIP at {percentile:g} %",
        "energy": "relative energy difference",
        "flicker": "flicker",
    }
    for kind, name in names.items():
        value, limit = getattr(measures, kind), getattr(limits, kind)
        if value is not None and abs(value) > limit:
            text = f"{name} {value:.4g}, limit {limit:.4g}"
            yield Finding("fail", kind, text, group, value, limit)


def relative_difference(value: float, baseline: float) -> float:
    """``value`` less ``baseline``, as a part of the baseline's size; absolute where that is 0."""
    return (value - baseline) / (abs(baseline) or 1.0)


def root_mean_square(pixels: np.ndarray) -> float:
    """√ of the mean of the squares, in double precision."""
    return float(np.sqrt(np.mean(np.square(pixels, dtype=np.float64)))) if pixels.size else 0.0


def _coarse(pixels: np.ndarray) -> np.ndarray:
    return shrunk(pixels, -(-pixels.shape[1] // COARSE_FACTOR))


def _flip(image: np.ndarray, baseline: np.ndarray, flip: FlipLimits, same: bool) -> np.ndarray:
    small = shrunk(image, int(flip.width))
    if same:
        return np.zeros(small.shape[:2], np.float32)
    reference = shrunk(baseline, int(flip.width))
    return flip_difference(small, reference, flip.maximum_luminance, flip.median_luminance)


def _worst_pixels(image: np.ndarray, baseline: np.ndarray) -> tuple[WorstPixel, ...]:
    """The worst pixels, apart from one another, so that they show different places and not one five times."""
    errors = np.abs(image - baseline).max(axis=-1)
    worst = []
    while len(worst) < WORST_COUNT:
        row, column = (int(index) for index in np.unravel_index(np.argmax(errors), errors.shape))
        if errors[row, column] <= 0:
            break
        values = [tuple(float(value) for value in pixels[row, column]) for pixels in (image, baseline)]
        worst.append(WorstPixel(column, row, *values))
        spread = [slice(max(0, place - _WORST_SPACING), place + _WORST_SPACING + 1) for place in (row, column)]
        errors[spread[0], spread[1]] = 0
    return tuple(worst)
