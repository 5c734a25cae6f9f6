"""Where a path stands before it meets a surface, so that branches begin there and not at the light again.

All of a path before a branch is that of the path which reported it (:mod:`tpdwarp.photons.branching`). Inside of
solids, where branches branch again, that is most of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from tpdwarp.photons.beam import Beam
from tpdwarp.photons.branching import reported_branches
from tpdwarp.photons.light_columns import LightColumns

# States that a path keeps for those that branch from it; where it reports more branches, the others start from the
# light. Light that goes straight through a tumbler of water reports six.
KEPT_STATES = 8


@wp.struct
class PathState:
    """A path on its way from one surface to the next, with all that its photon is made of where it lands.

    ``start`` is where along the beam the next surface is looked for, ``inside`` are the media that it is in,
    ``decision`` is the number of its next decision, ``count`` that of its interactions, ``bounce`` of surfaces met.
    """

    beam: Beam
    columns: LightColumns
    emitted: wp.vec3
    flux: wp.vec3
    shift: wp.vec2
    path: wp.uint32
    start: float
    inside: int
    decision: int
    count: int
    bounce: int


@wp.func
def path_state(
    beam: Beam,
    columns: LightColumns,
    emitted: wp.vec3,
    flux: wp.vec3,
    shift: wp.vec2,
    path: wp.uint32,
    start: float,
    inside: int,
    decision: int,
    count: int,
    bounce: int,
) -> PathState:
    """The state of these parts."""
    out = PathState()
    out.beam = beam
    out.columns = columns
    out.emitted = emitted
    out.flux = flux
    out.shift = shift
    out.path = path
    out.start = start
    out.inside = inside
    out.decision = decision
    out.count = count
    out.bounce = bounce
    return out


@wp.func
def keep_state(states: wp.array(dtype=Any), row: int, kept: int, state: Any) -> int:
    """Keeps a ``state``, of a photon or a view, as that number ``kept`` of its row, where there is room.

    Returns:
        How many the row has then.
    """
    if kept < wp.static(KEPT_STATES):
        states[kept * (states.shape[0] // wp.static(KEPT_STATES)) + row] = state
    return kept + 1


def kept_rows(reported: np.ndarray) -> np.ndarray:
    """Where the states of reported branches were kept, in the order of ``reported_paths``, shape [m] int32.

    Args:
        reported: Decisions of each path that it reported, as bits, shape [n] int32.

    Returns:
        Rows of the array of states; −1 where there was no room.
    """
    decision, rows = reported_branches(reported)
    # As many as it reported before.
    earlier = reported[rows] & ((np.int32(1) << decision) - np.int32(1))
    kept = np.unpackbits(earlier.view(np.uint8).reshape(-1, 4), axis=1).sum(axis=1, dtype=np.int32)
    return np.where(kept < KEPT_STATES, kept * len(reported) + rows, -1).astype(np.int32)
