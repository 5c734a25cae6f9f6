"""Pictures of one compared channel group, for the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpdwarp.checks.findings import WorstPixel
from tpdwarp.reports.pictures import exposable, heat, shrunk

ZOOM = 15
_PASSING_WIDTH = 240


def group_pictures(
    group: str,
    image: np.ndarray,
    baseline: np.ndarray,
    flip: np.ndarray | None,
    worst: Sequence[WorstPixel],
    width: int,
    failing: bool,
) -> tuple[dict[str, bytes], dict[str, float]]:
    """Encoded pictures by name, and what their codes stand for.

    ``a``, ``b`` (:func:`tpdwarp.reports.pictures.exposable`), ``difference``, ``flip`` (heat maps) and ``zoom`` (the
    surroundings of the worst pixels, image above baseline, side by side). Equal images are stored once, as ``b``.

    Args:
        group: Channel group; names begin with it.
        image, baseline: Linear, shape [h, w, channels].
        flip: Map of FLIP, or None.
        worst: The worst pixels.
        width: Of pictures of failing groups; others are smaller.
        failing: Whether the group is beyond its limits.
    """
    width = width if failing else min(width, _PASSING_WIDTH)
    colors = [_three_channels(pixels) for pixels in (image, baseline)]
    # Beyond the brightest thousandth values are clipped: one firefly must not take all codes.
    largest = max(float(np.percentile(pixels, 99.9)) for pixels in colors) or 1.0
    pictures = {"b": exposable(shrunk(colors[1], width), largest)}
    scales = {"b": largest}
    if worst:
        pictures["a"] = exposable(shrunk(colors[0], width), largest)
        scales["a"] = largest
        difference = np.abs(image - baseline).max(axis=-1)
        scales["difference"] = float(difference.max())
        pictures["difference"] = heat(shrunk(difference, width, keep_peaks=True), scales["difference"])
        if flip is not None:
            scales["flip"] = max(float(flip.max()), 1e-3)
            pictures["flip"] = heat(shrunk(flip, width, keep_peaks=True), scales["flip"])
        if failing:
            brightest = max(float(pixels.max()) for pixels in colors) or 1.0
            strips = [np.concatenate([_surroundings(pixels, pixel) for pixel in worst], axis=1) for pixels in colors]
            pictures["zoom"] = exposable(np.concatenate(strips), brightest, exact=True)
            scales["zoom"] = brightest
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
