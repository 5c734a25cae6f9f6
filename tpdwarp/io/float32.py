"""Single precision without infinity: what files and viewers take."""

from __future__ import annotations

import numpy as np

LARGEST = float(np.finfo(np.float32).max)


def to_float32(values: np.ndarray) -> np.ndarray:
    """``values`` as float32, limited to what it holds."""
    return np.clip(values, -LARGEST, LARGEST).astype(np.float32)
