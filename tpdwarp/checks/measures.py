"""Measuring how far one channel group is from its baseline, and holding that against the limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tpdwarp.checks.findings import Finding, GroupMeasures, WorstPixel
from tpdwarp.checks.limits import FlipLimits, GroupLimits
from tpdwarp.checks.pixels import compare_pixels, largest_channel, root_mean_square
from tpdwarp.html.pictures import shrunk
from tpdwarp.io.images import flip_difference

WORST_COUNT = 5
COARSE_FACTOR = 8
_WORST_SPACING = 8

# Depths and positions of rays that hit nothing lie far beyond any scene; they are no lengths to take a mean of.
_BACKGROUND = 1e9


@dataclass(frozen=True, eq=False)
class Measured:
    """One channel group, measured.

    Attributes:
        measures: The numbers.
        difference: Largest difference over the channels, shape [h, w]; where one image alone has background, the
            baseline's largest value. None where the images are equal.
        flip: Map of FLIP; None where it is not measured, or the images are equal.
    """

    measures: GroupMeasures
    difference: np.ndarray | None = None
    flip: np.ndarray | None = None


def measure(
    image: np.ndarray,
    baseline: np.ndarray,
    limits: GroupLimits,
    flip: FlipLimits,
    colors: bool,
    linear: tuple[np.ndarray, np.ndarray] | None = None,
) -> Measured:
    """Measures one channel group.

    Args:
        image, baseline: Finite pixels, shape [h, w, channels].
        limits: What pixels are counted by, and whether FLIP is wanted.
        flip: How FLIP is measured.
        colors: Whether the channels are red, green and blue.
        linear: The same images in linear Rec.709, where the pixels are not.
    """
    with_flip = colors and (math.isfinite(limits.flip_mean) or math.isfinite(limits.flip_high))
    if image is baseline or np.array_equal(image, baseline):
        return Measured(_equal(baseline, colors, with_flip))
    stored = image, baseline
    crossing = None
    if not colors:
        far, far_baseline = background(image), background(baseline)
        crossing = largest_channel(far != far_baseline)
        image, baseline = np.where(far | far_baseline, 0, image), np.where(far | far_baseline, 0, baseline)
    found = compare_pixels(
        image,
        baseline,
        (limits.fail_absolute, limits.fail_relative),
        (limits.warn_absolute, limits.warn_relative),
    )
    largest, count = found.largest, max(1, found.difference.size)
    peak = max(float(baseline.max(initial=0.0)), -float(baseline.min(initial=0.0)))
    level = root_mean_square(baseline)
    crossings = 0
    if crossing is not None and (crossings := int(np.count_nonzero(crossing))):
        found.difference[crossing] = peak or 1.0
    flip_map = _flip(*(linear or (image, baseline)), flip) if with_flip else None
    totals = [float(pixels.sum(dtype=np.float64)) for pixels in (image, baseline)] if colors else [None, None]
    measures = GroupMeasures(
        failed_percent=100 * (found.failed + crossings) / count,
        warned_percent=100 * (found.warned + crossings) / count,
        largest=largest,
        rms=found.rms,
        hard=largest / (peak or 1.0),
        rmse=found.rms / (level or 1.0),
        coarse=root_mean_square(_coarse(image) - _coarse(baseline)) / (level or 1.0) if largest else 0.0,
        flip_mean=None if flip_map is None else float(flip_map.mean()),
        flip_high=None if flip_map is None else float(np.percentile(flip_map, flip.percentile)),
        energy=relative_difference(*totals) if colors else None,
        total=totals[0],
        baseline_total=totals[1],
        worst=_worst_pixels(*stored, found.difference),
    )
    return Measured(measures, found.difference, flip_map)


def _equal(pixels: np.ndarray, colors: bool, with_flip: bool) -> GroupMeasures:
    total = float(pixels.sum(dtype=np.float64)) if colors else None
    flip = 0.0 if with_flip else None
    energy = 0.0 if colors else None
    return GroupMeasures(flip_mean=flip, flip_high=flip, energy=energy, total=total, baseline_total=total)


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


def background(pixels: np.ndarray) -> np.ndarray:
    """Where rays hit nothing: depths and positions there are none."""
    return np.abs(pixels) >= _BACKGROUND


def relative_difference(value: float, baseline: float) -> float:
    """``value`` less ``baseline``, as a part of the baseline's size; absolute where that is 0."""
    return (value - baseline) / (abs(baseline) or 1.0)


def _coarse(pixels: np.ndarray) -> np.ndarray:
    return shrunk(pixels, -(-pixels.shape[1] // COARSE_FACTOR))


def _flip(image: np.ndarray, baseline: np.ndarray, flip: FlipLimits) -> np.ndarray:
    small, reference = (shrunk(pixels, int(flip.width)) for pixels in (image, baseline))
    return flip_difference(small, reference, flip.maximum_luminance, flip.median_luminance)


def _worst_pixels(image: np.ndarray, baseline: np.ndarray, difference: np.ndarray) -> tuple[WorstPixel, ...]:
    """The worst pixels, apart from one another, so that they show different places and not one five times."""
    errors = difference.copy()
    worst = []
    while len(worst) < WORST_COUNT and errors.size:
        row, column = (int(index) for index in np.unravel_index(np.argmax(errors), errors.shape))
        if errors[row, column] <= 0:
            break
        values = [tuple(float(value) for value in pixels[row, column]) for pixels in (image, baseline)]
        worst.append(WorstPixel(column, row, *values))
        spread = [slice(max(0, place - _WORST_SPACING), place + _WORST_SPACING + 1) for place in (row, column)]
        errors[spread[0], spread[1]] = 0
    return tuple(worst)
