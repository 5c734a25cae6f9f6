"""Smaller versions of pictures, by averages over areas."""

from __future__ import annotations

import numpy as np


def area_averaged(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """A picture [h, w, c] brought down to ``height`` × ``width``: each pixel is the mean over its area, float32."""
    return _along(_along(pixels, height, 0), width, 1)


def pyramid(pixels: np.ndarray) -> list[np.ndarray]:
    """A picture [h, w, c] and its halves, down to a single pixel; the mean of each is that of the picture."""
    levels = [pixels]
    while max(levels[-1].shape[:2]) > 1:
        height, width = (max(1, side // 2) for side in levels[-1].shape[:2])
        levels.append(area_averaged(levels[-1], height, width))
    return levels


def part_reaching(pixels: np.ndarray, threshold: float) -> np.ndarray:
    """The part of each pixel [h, w, c] in which a picture is at least ``threshold``, if it goes on straight about it.

    That of a half-plane whose edge lies across the gradient g: 1/2 + (v − threshold)/(|g_x| + |g_y|) within 0 … 1,
    which is exact where the edge is upright or level.
    """
    values = pixels.astype(np.float32)
    slope = np.zeros_like(values)
    for axis in (0, 1):
        if values.shape[axis] > 1:
            slope += np.abs(np.gradient(values, axis=axis))
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.clip(0.5 + (values - threshold) / slope, 0.0, 1.0)
    return np.where(slope > 0, part, values >= threshold).astype(np.float32)


def _along(pixels: np.ndarray, count: int, axis: int) -> np.ndarray:
    size = pixels.shape[axis]
    if count == size:
        return pixels.astype(np.float32)
    if size % count == 0:
        parts = np.moveaxis(pixels, axis, 0).reshape(count, size // count, *np.delete(pixels.shape, axis))
        return np.moveaxis(parts.mean(axis=1, dtype=np.float32), 0, axis)
    # Where areas end within a pixel, the sum up to there is interpolated.
    sums = np.cumsum(np.moveaxis(pixels, axis, 0), axis=0, dtype=np.float64)
    sums = np.concatenate([np.zeros_like(sums[:1]), sums])
    edges = np.arange(count + 1) * (size / count)
    low = np.minimum(edges.astype(int), size - 1)
    share = (edges - low).reshape(-1, *[1] * (sums.ndim - 1))
    at_edges = sums[low] + share * (sums[low + 1] - sums[low])
    return np.moveaxis(np.diff(at_edges, axis=0) * (count / size), 0, axis).astype(np.float32)
