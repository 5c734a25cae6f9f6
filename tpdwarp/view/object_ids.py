"""Numbers by which pictures name objects: the same for a prim in every frame."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

# Whole numbers below 2^24 are exact in single precision.
MOST = 2**24 - 1


def object_ids(paths: Sequence[str]) -> dict[str, int]:
    """A number of 1 … 2^24 − 1 for each path, from a hash of it; those that fall on a number that is taken go on."""
    taken: dict[int, str] = {}
    found: dict[str, int] = {}
    for path in sorted(set(paths)):
        number = zlib.crc32(path.encode()) % MOST
        while number in taken:
            number = (number + 1) % MOST
        taken[number] = path
        found[path] = number + 1
    return found
