"""What a binary layer declares of itself, read from its tables without the arrays and before USD builds anything.

    PXR-USDC header     where the table of contents is
    FIELDS              a word a value: its type, whether it is an array, and where it lies
    PATHS               how prims and properties are nested

Follows OpenUSD's ``crateFile.h`` of versions 0.4 to 0.13. A file that is not as it says is left to USD, which says what
is wrong with it.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator

import numpy as np

MAGIC = b"PXR-USDC"
# The types of whole numbers of 32 and 64 bits: counts of faces, indices, ids.
WHOLE_NUMBERS = frozenset({3, 4, 5, 6})
_TIME_SAMPLES = 46
# Bytes of an element by type: numbers, then vectors, quaternions and matrices; others are references to tables.
_BYTES = {1: 1, 2: 1, 3: 4, 4: 4, 5: 8, 6: 8, 7: 2, 8: 4, 9: 8, 13: 32, 14: 72, 15: 128, 16: 32, 17: 16, 18: 8}
_BYTES |= {19: 16, 20: 8, 21: 4, 22: 8, 23: 24, 24: 12, 25: 6, 26: 12, 27: 32, 28: 16, 29: 8, 30: 16}
_REFERENCE_BYTES = 8
_IS_ARRAY, _IS_INLINED = 1 << 63, 1 << 62
# Tables are compressed; a hundred million words would be a layer of many gigabytes.
_MOST_WORDS = 10**8


class CrateTables:
    """The tables of a binary layer.

    Args:
        data: The file's bytes.

    Raises:
        ValueError: It is no such layer, or not as it says.
        struct.error: It ends too early.
    """

    def __init__(self, data: bytes | mmap.mmap) -> None:
        if data[: len(MAGIC)] != MAGIC:
            raise ValueError("no binary layer")
        self._data = data
        self._version = (data[8], data[9])
        if self._version < (0, 4):
            raise ValueError("of a version without compressed tables")
        (toc,) = struct.unpack_from("<q", data, 16)
        (count,) = struct.unpack_from("<Q", data, toc)
        self._sections = {}
        for index in range(min(count, 64)):
            name, start, _ = struct.unpack_from("<16sqq", data, toc + 8 + 32 * index)
            self._sections[name.rstrip(b"\0")] = start

    def arrays(self) -> Iterator[tuple[int, int, bool]]:
        """Elements and bytes of each array that is stored, and whether its elements are whole numbers."""
        for word in self._words():
            yield from self._arrays_of(word, 0)

    def depth(self, most: int) -> int:
        """How deep prims are nested; exact where that is more than ``most``."""
        jumps = self._jumps()
        # As many as have something below them bound the depth.
        parents = int(np.count_nonzero((jumps > 0) | (jumps == -1)))
        if parents <= most:
            return parents
        deepest = depth = 0
        above: list[tuple[int, int]] = []
        for place, jump in enumerate(jumps.tolist()):
            while above and above[-1][0] <= place:
                depth = above.pop()[1]
            deepest = max(deepest, depth)
            if jump > 0:
                above.append((place + jump, depth))
            if jump > 0 or jump == -1:
                depth += 1
        return deepest

    def _words(self) -> list[int]:
        place = self._sections[b"FIELDS"]
        (count,) = struct.unpack_from("<Q", self._data, place)
        (size,) = struct.unpack_from("<Q", self._data, place + 8)
        place += 16 + size
        (size,) = struct.unpack_from("<Q", self._data, place)
        unpacked = _unpacked(self._data[place + 8 : place + 8 + size], 8 * min(count, _MOST_WORDS))
        return np.frombuffer(unpacked, "<u8").tolist()

    def _arrays_of(self, word: int, level: int) -> Iterator[tuple[int, int, bool]]:
        kind, place = word >> 48 & 0xFF, word & (1 << 48) - 1
        if word & _IS_ARRAY and not word & _IS_INLINED and place:
            count = self._count_at(place)
            yield count, count * _BYTES.get(kind, _REFERENCE_BYTES), kind in WHOLE_NUMBERS
        elif kind == _TIME_SAMPLES and level == 0 and place:
            # Two jumps, each from where it stands: to the times, and to a count that values follow.
            (to_times,) = struct.unpack_from("<q", self._data, place)
            after = place + to_times + 8
            (to_values,) = struct.unpack_from("<q", self._data, after)
            after += to_values
            (count,) = struct.unpack_from("<Q", self._data, after)
            for index in range(min(count, (len(self._data) - after) // 8 - 1)):
                (value,) = struct.unpack_from("<Q", self._data, after + 8 + 8 * index)
                yield from self._arrays_of(value, level + 1)

    def _count_at(self, place: int) -> int:
        if self._version < (0, 5):
            place += 4
        return struct.unpack_from("<I" if self._version < (0, 7) else "<Q", self._data, place)[0]

    def _jumps(self) -> np.ndarray:
        place = self._sections[b"PATHS"] + 8
        (count,) = struct.unpack_from("<Q", self._data, place)
        place += 8
        for _ in range(2):
            (size,) = struct.unpack_from("<Q", self._data, place)
            place += 8 + size
        (size,) = struct.unpack_from("<Q", self._data, place)
        return _whole_numbers(self._data[place + 8 : place + 8 + size], min(count, _MOST_WORDS))


def _whole_numbers(packed: bytes, count: int) -> np.ndarray:
    """USD's compressed integers: differences of 0, 1, 2 or 4 bytes each, by a code of two bits."""
    if count == 0:
        return np.zeros(0, np.int64)
    codes_size = (2 * count + 7) // 8
    data = np.frombuffer(_unpacked(packed, 4 + codes_size + 4 * count), np.uint8)
    common = data[:4].view("<i4")[0]
    codes = (data[4 : 4 + codes_size, None] >> np.array([0, 2, 4, 6], np.uint8) & 3).reshape(-1)[:count]
    sizes = np.array([0, 1, 2, 4])[codes]
    places = 4 + codes_size + np.concatenate([[0], np.cumsum(sizes)[:-1]])
    differences = np.full(count, common, np.int64)
    for code, kind in ((1, "<i1"), (2, "<i2"), (3, "<i4")):
        chosen = np.flatnonzero(codes == code)
        width = np.dtype(kind).itemsize
        rows = data[places[chosen, None] + np.arange(width)]
        differences[chosen] = np.ascontiguousarray(rows).view(kind).reshape(-1)
    return np.cumsum(differences)


def _unpacked(packed: bytes, most: int) -> bytes:
    """Bytes that USD has compressed in chunks of LZ4 blocks; at most so many."""
    chunks = packed[0]
    if chunks == 0:
        return _lz4_block(packed[1:], most)
    found, place = b"", 1
    for _ in range(chunks):
        (size,) = struct.unpack_from("<i", packed, place)
        found += _lz4_block(packed[place + 4 : place + 4 + size], most - len(found))
        place += 4 + size
    return found


def _lz4_block(packed: bytes, most: int) -> bytes:
    """A block of LZ4: literals and copies of what came before, in turn."""
    out, place, end = bytearray(), 0, len(packed)
    while place < end:
        token = packed[place]
        place += 1
        length = token >> 4
        if length == 15:
            while (more := packed[place]) == 255:
                length, place = length + 255, place + 1
            length, place = length + more, place + 1
        out += packed[place : place + length]
        place += length
        if place >= end:
            break
        offset = packed[place] | packed[place + 1] << 8
        place += 2
        length = token & 15
        if length == 15:
            while (more := packed[place]) == 255:
                length, place = length + 255, place + 1
            length, place = length + more, place + 1
        length += 4
        start = len(out) - offset
        if offset == 0 or start < 0 or len(out) + length > most:
            raise ValueError("damaged tables")
        piece = bytes(out[start : start + length])
        # A copy may reach into what it makes.
        out += (piece * (length // offset + 1))[:length] if length > offset else piece
    if len(out) > most:
        raise ValueError("damaged tables")
    return bytes(out)
