"""Any channel group as a picture to look at: what PNG, JPEG and TIFF show in the place of the beauty."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np

from tpdwarp.view.cryptomatte import LAYER, RANKS
from tpdwarp.view.film import BACKGROUND_DEPTH


def picture_of(channels: Mapping[str, np.ndarray], aov: str, stops: float) -> dict[str, np.ndarray]:
    """``R``, ``G``, ``B`` and ``A``, linear, of a channel group.

    Light and albedo are shown as they are; normals as ½ + ½N, and positions and motions around a middle grey of ½;
    depths nearer than one scene unit are light and far ones dark; objects have colours of their own.

    Args:
        channels: Those of a frame.
        aov: The group; empty for the beauty.
        stops: Stops by which it is brighter, or motions and depths larger.
    """
    gain = np.float32(2.0**stops)
    alpha = channels["A"]
    if not aov:
        shown = [channels[name] * gain for name in "RGB"]
    elif f"{aov}.R" in channels:
        shown = [channels[f"{aov}.{name}"] * gain for name in "RGB"]
    elif aov == "N":
        shown = [(0.5 + 0.5 * channels[f"N.{axis}"]) * gain for axis in "XYZ"]
    elif f"{aov}.X" in channels:
        blank = np.zeros_like(alpha)
        shown = [0.5 + 0.5 * gain * channels.get(f"{aov}.{axis}", blank) for axis in "XYZ"]
    elif aov == "Z":
        depth = channels["Z"]
        shown = [np.where(depth < BACKGROUND_DEPTH, 1.0 / (1.0 + gain * np.maximum(depth, 0.0)), 0.0)] * 3
    elif aov == "cryptomatte":
        shown = _matte_colors(channels, gain)
    elif aov == "id":
        numbers, where = np.unique(channels["id"], return_inverse=True)
        colors = np.array([_color_of(int(number)) for number in numbers], np.float32)[where.ravel()]
        shown = [colors[:, k].reshape(alpha.shape) * gain for k in range(3)]
    else:
        shown = [channels[aov] * gain] * 3
    return {name: np.asarray(value, np.float32) for name, value in zip("RGBA", (*shown, alpha), strict=True)}


def _matte_colors(channels: Mapping[str, np.ndarray], gain: np.float32) -> list[np.ndarray]:
    shown = [np.zeros(channels["A"].shape, np.float32) for _ in "RGB"]
    for layer in range(RANKS // 2):
        for hashed, covered in ("rg", "ba"):
            bits = channels[f"{LAYER}{layer:02d}.{hashed}"].view(np.uint32)
            numbers, where = np.unique(bits, return_inverse=True)
            colors = np.array([_color_of(int(number)) for number in numbers], np.float32)[where.reshape(bits.shape)]
            for k, plane in enumerate(shown):
                plane += gain * channels[f"{LAYER}{layer:02d}.{covered}"] * colors[..., k]
    return shown


def _color_of(number: int) -> tuple[float, float, float]:
    """A colour for an object's number; black for none."""
    if not number:
        return 0.0, 0.0, 0.0
    mixed = zlib.crc32(str(number).encode())
    return tuple(0.1 + 0.9 * (mixed >> shift & 255) / 255.0 for shift in (0, 8, 16))
