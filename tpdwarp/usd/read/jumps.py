"""Jumps of an animation: held values are authored as pairs of samples a hair apart, and looped clips end so.

Between the two samples of a pair nothing moves on purpose: what comes before a jump ends there, and what comes after
begins there. A shutter that closes on a jump sees none of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

from tpdwarp.scene.description import Shutter

# Pairs are at most this far apart, in time codes, and at most this share of what lies before and after them.
WIDEST, SHARE = 0.01, 0.1

Jump = tuple[float, float]


def jumps_of(times: Sequence[float]) -> list[Jump]:
    """The pairs of sample times, in increasing order, between which a quantity jumps."""
    gaps = [after - before for before, after in itertools.pairwise(times)]
    found = []
    for i, gap in enumerate(gaps):
        beside = [gaps[k] for k in (i - 1, i + 1) if 0 <= k < len(gaps)]
        if gap <= WIDEST and beside and gap <= SHARE * min(beside):
            found.append((times[i], times[i + 1]))
    return found


def settled(shutter: Shutter, jumps: Iterable[Jump]) -> Shutter:
    """The shutter without the jump that it closes on or opens in; a still is left as it is."""
    opening, closing = shutter.open, shutter.close
    if shutter.exposure <= 0:
        return shutter
    for before, after in jumps:
        if opening < before < closing <= after:
            closing = before
        elif before <= opening < after < closing:
            opening = after
    return shutter if (opening, closing) == (shutter.open, shutter.close) else Shutter(shutter.frame, opening, closing)
