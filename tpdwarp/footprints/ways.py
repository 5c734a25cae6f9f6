"""Ways of queries: where one passes many footprints within its window, it is looked up in pieces of its way.

A run of queries reaches as far as a footprint or so; what races past many of them would otherwise stand for no more
than what it passes in the middle of its window (:func:`tpdwarp.footprints.runs.window_of`), and the more photons there
are, the less that is.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import Lookup, QueryArrays, rows_of

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


def pieces_of(window: tuple[float, float], count: int) -> list[tuple[float, float]]:
    """Middles and lengths of ``count`` equal pieces of a window."""
    middle, length = window
    return [(middle + ((number + 0.5) / count - 0.5) * length, length / count) for number in range(count)]


def rows_at(queries: QueryArrays, rows: np.ndarray, later: np.ndarray, launcher: Launcher) -> QueryArrays:
    """Some of the queries, where each stands a part ``later`` of the shutter after its own time, shape [m]."""
    out = rows_of(queries, rows, launcher)
    moved = out.position.numpy() + later.astype(np.float32)[:, None] * out.motion.numpy()
    out.position = launcher.array(moved, wp.vec3)
    return out
