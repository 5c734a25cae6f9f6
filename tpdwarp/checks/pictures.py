"""Pictures of one compared channel group, for the report."""

from __future__ import annotations

import numpy as np

from tpdwarp.checks.findings import WorstPixel
from tpdwarp.checks.measures import Measured, background
from tpdwarp.html.pictures import exposable, heat, shrunk

ZOOM = 15
_PASSING_WIDTH = 240


def group_pictures(
    group: str, image: np.ndarray, baseline: np.ndarray, measured: Measured, width: int, failing: bool, colors: bool
) -> tuple[dict[str, bytes], dict[str, float]]:
    """Encoded pictures by name, and what their codes stand for.

    ``a``, ``b`` (:func:`tpdwarp.html.pictures.exposable`), ``difference``, ``flip`` (heat maps) and ``zoom`` (the
    surroundings of the worst pixels, image above baseline, side by side). Equal images are stored once, as ``b``.

    Args:
        group: Channel group; names begin with it.
        image, baseline: Linear, shape [h, w, channels].
        measured: What was measured on them.
        width: Of pictures of failing groups; others are smaller.
        failing: Whether the group is beyond its limits.
        colors: Whether the channels are red, green and blue.
    """
    width = width if failing else min(width, _PASSING_WIDTH)
    if not colors:
        image, baseline = (np.where(background(pixels), 0, pixels) for pixels in (image, baseline))
    difference, worst = measured.difference, measured.measures.worst
    shown = {"b": _three_channels(shrunk(baseline, width))}
    if worst:
        shown["a"] = _three_channels(shrunk(image, width))
    # Beyond the brightest thousandth values are clipped: one firefly must not take all codes.
    largest = max(float(np.percentile(pixels, 99.9)) for pixels in shown.values()) or 1.0
    pictures = {name: exposable(pixels, largest) for name, pixels in shown.items()}
    scales = dict.fromkeys(shown, largest)
    if worst and difference is not None:
        scales["difference"] = float(difference.max())
        pictures["difference"] = heat(shrunk(difference, width, keep_peaks=True), scales["difference"])
        if measured.flip is not None:
            scales["flip"] = max(float(measured.flip.max()), 1e-3)
            pictures["flip"] = heat(shrunk(measured.flip, width, keep_peaks=True), scales["flip"])
        if failing:
            around = [[_surroundings(pixels, pixel) for pixel in worst] for pixels in (image, baseline)]
            strips = _three_channels(np.concatenate([np.concatenate(side, axis=1) for side in around]))
            scales["zoom"] = float(strips.max()) or 1.0
            pictures["zoom"] = exposable(strips, scales["zoom"], exact=True)
    named = [{f"{group}.{name}": value for name, value in found.items()} for found in (pictures, scales)]
    return named[0], named[1]


def _three_channels(pixels: np.ndarray) -> np.ndarray:
    """Colours as they are; other groups' absolute values in the first three channels."""
    channels = min(3, pixels.shape[-1])
    return np.abs(np.repeat(pixels[..., :1], 3, axis=-1) if channels < 3 else pixels[..., :3])


def _surroundings(pixels: np.ndarray, place: WorstPixel) -> np.ndarray:
    half = ZOOM // 2
    rows, columns = (
        np.clip(np.arange(middle - half, middle + half + 1), 0, size - 1)
        for middle, size in zip((place.row, place.column), pixels.shape[:2], strict=True)
    )
    return pixels[np.ix_(rows, columns)]
