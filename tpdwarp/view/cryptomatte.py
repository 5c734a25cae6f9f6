"""Cryptomatte: whose each pixel is, and in what part (Friedman & Jones 2015, specification 1.2.0).

Names of objects are their prim paths. Each pixel has up to ``RANKS`` of them, those that cover most first, in channels
of 32-bit floats: ``CryptoObject00.r`` is the first name's hash, ``.g`` its coverage, ``.b`` and ``.a`` those of the
second, and so on.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

LAYER = "CryptoObject"
RANKS = 6
# Sums that wait to be put together, which limits memory to some 100 MB.
MOST_WAITING = 1 << 22


def murmur3(text: str) -> int:
    """MurmurHash3_x86_32 of a text in UTF-8, with seed 0 (Appleby, public domain)."""
    data, mask = text.encode("utf-8", "surrogateescape"), 0xFFFFFFFF

    def mixed(block: int) -> int:
        block = block * 0xCC9E2D51 & mask
        return (block << 15 | block >> 17) * 0x1B873593 & mask

    value, whole = 0, len(data) // 4 * 4
    for start in range(0, whole, 4):
        value ^= mixed(int.from_bytes(data[start : start + 4], "little"))
        value = ((value << 13 | value >> 19) & mask) * 5 + 0xE6546B64 & mask
    if data[whole:]:
        value ^= mixed(int.from_bytes(data[whole:], "little"))
    value ^= len(data)
    value = (value ^ value >> 16) * 0x85EBCA6B & mask
    value = (value ^ value >> 13) * 0xC2B2AE35 & mask
    return value ^ value >> 16


def id_bits(text: str) -> int:
    """The hash of a name, such that its bits are a float that is neither denormal, infinite nor NaN."""
    value = murmur3(text)
    return value ^ 1 << 23 if value >> 23 & 0xFF in (0, 0xFF) else value


def metadata_of(paths: Sequence[str]) -> dict[str, str]:
    """Attributes of a file with the mattes of these objects, their manifest among them."""
    key = f"cryptomatte/{murmur3(LAYER):08x}"[: len("cryptomatte/") + 7]
    manifest = {path: f"{id_bits(path):08x}" for path in sorted(set(paths))}
    return {
        f"{key}/name": LAYER,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False),
    }


class Mattes:
    """Sums of what objects cover of pixels.

    Args:
        pixels: How many there are.
        paths: Prim path of each object.
    """

    def __init__(self, pixels: int, paths: Sequence[str]) -> None:
        self._pixels, self._objects = pixels, max(len(paths), 1)
        self._ids = np.array([id_bits(path) for path in paths], np.uint32).view(np.float32)
        self._keys: list[np.ndarray] = [np.zeros(0, np.int64)]
        self._sums: list[np.ndarray] = [np.zeros(0)]

    def add(self, pixels: np.ndarray, objects: np.ndarray, weights: np.ndarray | float) -> None:
        """Adds samples: their pixels, the objects that they met first, and their weights (or one), each shape [n]."""
        weights = np.broadcast_to(weights, pixels.shape)
        # Of samples that count nothing no object is named.
        there = weights > 0.0
        keys, rows = np.unique(pixels[there].astype(np.int64) * self._objects + objects[there], return_inverse=True)
        self._keys.append(keys)
        self._sums.append(np.bincount(rows.ravel(), weights[there], minlength=len(keys)))
        if sum(map(len, self._keys[1:])) > MOST_WAITING:
            self._put_together()

    def channels(self, scale: float) -> dict[str, np.ndarray]:
        """The channels, each shape [pixels] float32; ``scale`` makes sums coverage."""
        self._put_together()
        keys, sums = self._keys[0], self._sums[0] * scale
        pixels, objects = np.divmod(keys, self._objects)
        order = np.lexsort((objects, -sums, pixels))
        pixels, objects, sums = pixels[order], objects[order], sums[order]
        firsts = np.flatnonzero(np.diff(pixels, prepend=-1))
        ranks = np.arange(len(pixels)) - np.repeat(firsts, np.diff(firsts, append=len(pixels)))
        found: dict[str, np.ndarray] = {}
        for rank in range(RANKS):
            rows = ranks == rank
            for channel, values in zip("rgba"[rank % 2 * 2 :][:2], (self._ids[objects[rows]], sums[rows]), strict=True):
                plane = found[f"{LAYER}{rank // 2:02d}.{channel}"] = np.zeros(self._pixels, np.float32)
                plane[pixels[rows]] = values
        return found

    def _put_together(self) -> None:
        keys, places = np.unique(np.concatenate(self._keys), return_inverse=True)
        sums = np.bincount(places.ravel(), weights=np.concatenate(self._sums), minlength=len(keys))
        self._keys, self._sums = [keys], [sums]
