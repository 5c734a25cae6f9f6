"""Ways of queries: where one passes many footprints within its window, it is looked up in pieces of its way.

A run of queries reaches as far as a footprint or so; what races past many of them would otherwise stand for no more
than what it passes in the middle of its window (:func:`tpdwarp.footprints.runs.window_of`), and the more photons there
are, the less that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import Lookup, QueryArrays, rows_of
from tpdwarp.footprints.morton import morton_codes

# Pieces of a way at most: of a longer one, parts of each piece are looked at. Chosen, not derived.
MOST_PIECES = 16
# A way that is longer than a run by rounding is still looked up at once.
ROUNDING = 1.0e-3


def piece_counts(queries: QueryArrays, lookup: Lookup, longest: float) -> np.ndarray:
    """Into how many pieces, a power of two, the way of each query is cut so that none is longer than ``longest``; [n].

    Queries that do not move are looked up at once, and so are all where ``longest`` is 0.
    """
    count = queries.position.shape[0]
    if not lookup.query_moves or not longest > 0.0:
        return np.ones(count, np.int64)
    ways = lookup.window[1] * np.linalg.norm(queries.motion.numpy(), axis=1)
    return 1 << np.ceil(np.log2(np.clip(ways / longest, 1.0, MOST_PIECES)) - ROUNDING).astype(np.int64)


@dataclass(frozen=True, eq=False)
class WayPieces:
    """Pieces of the ways of queries, side by side in space, those of one time together.

    Attributes:
        rows: The query of each, shape [m].
        windows: Time, and middle and length of its window, which is in the middle, shape [m, 3].
        place: Where those of a query follow each other, query by query, shape [m].
        starts: Where in ``place`` those of each query begin, shape [n].
    """

    rows: np.ndarray
    windows: np.ndarray
    place: np.ndarray
    starts: np.ndarray

    @classmethod
    def of(cls, queries: QueryArrays, lookup: Lookup, counts: np.ndarray, side: float) -> WayPieces:
        """``counts`` equal pieces of the window of each query [n], by cubes of ``side``."""
        starts = np.cumsum(counts) - counts
        rows = np.repeat(np.arange(len(counts)), counts)
        number = np.arange(len(rows)) - starts[rows]
        time, middle, length = np.broadcast_to(lookup.windows(), (len(counts), 3))[rows].T
        middle = middle + ((number + 0.5) / counts[rows] - 0.5) * length
        places = queries.position.numpy()[rows]
        if lookup.query_moves:
            places = places + (middle - time).astype(np.float32)[:, None] * queries.motion.numpy()[rows]
        # One key of both, for two take twice as long to sort: times of the shutter to 2⁻³¹ of it.
        order = np.argsort(
            morton_codes(places, side).astype(np.uint64) << np.uint64(32)
            | np.clip((middle + 0.5) * 2.0**31, 0.0, 2.0**32 - 1.0).astype(np.uint64),
            kind="stable",
        )
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        windows = np.column_stack([middle, middle, length / counts[rows]])[order]
        return cls(rows[order], windows, place, starts)


def rows_at(queries: QueryArrays, rows: np.ndarray, later: np.ndarray, launcher: Launcher) -> QueryArrays:
    """Some of the queries, where each stands a part ``later`` of the shutter after its own time, shape [m]."""
    out = rows_of(queries, rows, launcher)
    moved = out.position.numpy() + later.astype(np.float32)[:, None] * out.motion.numpy()
    out.position = launcher.array(moved, wp.vec3)
    return out
