"""Orders in space: what follows each other lies side by side, and finds in caches what was looked at before."""

from __future__ import annotations

import numpy as np


def morton_codes(places: np.ndarray, side: float = 0.0) -> np.ndarray:
    """Morton's codes (1966) of places [n, 3] by cubes of ``side``, or 1/1023 of what they span if that is more; [n]."""
    low = places.min(axis=0)
    span = float((places.max(axis=0) - low).max())
    scaled = (places - low) * np.float32(1.0 / max(side, span / 1023.0, 1e-30))
    codes = np.zeros(len(places), np.uint32)
    for axis, code in enumerate(scaled.astype(np.uint32).T):
        # Two zeros between any two bits.
        for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
            code = (code | (code << np.uint32(shift))) & np.uint32(mask)
        codes |= code << np.uint32(axis)
    return codes
