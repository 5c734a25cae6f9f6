"""Colours that show a quantity of photons."""

from __future__ import annotations

import numpy as np

# sRGB, slow to fast: lightness rises evenly, so that it reads on grey prints and by colour-blind eyes as well.
SPEED_RAMP = np.array([[38, 26, 120], [126, 30, 148], [205, 44, 96], [245, 128, 36], [255, 218, 84]]) / 255
# Steps of the ramp where colours are chosen from a table: as many as a display has of a channel.
STEPS = 256


def speed_colors(speeds: np.ndarray, fastest: float) -> np.ndarray:
    """Colours for speeds, from 0 to ``fastest`` and beyond, shape [n, 3], linear Rec.709."""
    place = np.clip(speeds / fastest, 0, 1) if fastest > 0 else np.zeros_like(speeds)
    stops = np.linspace(0, 1, len(SPEED_RAMP))
    encoded = np.stack([np.interp(place, stops, channel) for channel in SPEED_RAMP.T], axis=-1)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def palette() -> np.ndarray:
    """The ramp in ``STEPS`` steps, shape [STEPS, 3], linear Rec.709."""
    return speed_colors(np.linspace(0.0, 1.0, STEPS), 1.0)


def palette_places(values: np.ndarray, end: float) -> np.ndarray:
    """Places in :func:`palette` of values from 0 to ``end`` and beyond, shape [n] int32."""
    place = np.clip(values / end, 0.0, 1.0) if end > 0 else np.zeros_like(values)
    return np.rint(place * (STEPS - 1)).astype(np.int32)
