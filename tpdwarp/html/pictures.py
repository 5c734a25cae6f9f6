"""Small pictures that a page can re-expose: high dynamic range in eight bits, and heat maps."""

from __future__ import annotations

import numpy as np

from tpdwarp.io.images import encoded_picture

# Codes are log(1 + KNEE·x) over the range: linear below 1/KNEE, an even number of codes a stop above. The page's script
# knows the same number.
KNEE = 64.0


def shrunk(pixels: np.ndarray, width: int, keep_peaks: bool = False) -> np.ndarray:
    """An image at most ``width`` wide, by whole factors.

    Args:
        pixels: Shape [h, w] or [h, w, channels].
        width: In pixels.
        keep_peaks: Take the largest value of each block, so that one bad pixel stays visible, in place of the mean.
    """
    factor = -(-pixels.shape[1] // width)
    if factor == 1:
        return pixels
    padding = [(0, -size % factor) for size in pixels.shape[:2]] + [(0, 0)] * (pixels.ndim - 2)
    padded = np.pad(pixels, padding, mode="edge") if np.any(padding) else pixels
    height, wide = padded.shape[0] // factor, padded.shape[1] // factor
    # Whole rows first, then columns: many times faster than reducing both axes of the blocks at once.
    combine = np.maximum if keep_peaks else np.add
    rows = _combined(padded.reshape(height, factor, -1), combine)
    blocks = _combined(rows.reshape(height * wide, factor, -1), combine).reshape(height, wide, *pixels.shape[2:])
    return blocks if keep_peaks else blocks / factor**2


def _combined(parts: np.ndarray, combine: np.ufunc) -> np.ndarray:
    """All of axis 1 combined, in the order in which it stands."""
    found = parts[:, 0].copy()
    for index in range(1, parts.shape[1]):
        combine(found, parts[:, index], out=found)
    return found


def log_codes(pixels: np.ndarray, largest: float) -> np.ndarray:
    """Linear values as codes 0 … 255 that stand for 0 … ``largest``, uint8, of the same shape."""
    values = np.log1p(KNEE * np.maximum(pixels, 0)) / np.log1p(KNEE * max(largest, 1e-12))
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


def exposable(pixels: np.ndarray, largest: float, exact: bool = False) -> bytes:
    """A linear image, shape [h, w, 3], as a picture of :func:`log_codes`: JPEG, or PNG where it must be ``exact``."""
    return encoded_picture(log_codes(pixels, largest), ".png" if exact else ".jpg", quality=88)


def heat(values: np.ndarray, largest: float) -> bytes:
    """A map of values, shape [h, w], as a grey JPEG whose code 255 stands for ``largest``; the page colours it.

    Codes go with the square root, so that small differences are seen beside large ones.
    """
    scaled = np.sqrt(np.clip(values / max(largest, 1e-12), 0, 1))
    return encoded_picture(np.rint(255 * scaled).astype(np.uint8), ".jpg", quality=80)
