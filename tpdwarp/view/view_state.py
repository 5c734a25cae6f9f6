"""Where a camera path stands before it meets a surface, so that branches begin there and not at the camera again.

As for photons (:mod:`tpdwarp.photons.path_state`): all of a path before a branch is that of the path which reported it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from tpdwarp.photons.beam import Beam
from tpdwarp.photons.branching import reported_branches

# States that a path keeps for those that branch from it; where it reports more branches, the others start from the
# camera. Light that goes straight through a tumbler of water reports six.
KEPT_STATES = 8


@wp.struct
class ViewState:
    """A camera path on its way from one surface to the next.

    ``start`` and ``end`` are where along the beam the next surface is looked for, ``passed_by`` and ``travelled`` what
    lies behind it, without and with surfaces that act, ``depth_scale`` is the depth of a unit of the camera's ray and
    ``depth`` that of what was met first (−1: nothing yet), ``inside`` are the media that it is in, ``decision`` is the
    number of its next decision, ``bounce`` that of surfaces met; ``flags`` and random numbers go on.
    """

    beam: Beam
    throughput: wp.vec3
    stream: wp.uint32
    start: float
    end: float
    passed_by: float
    travelled: float
    depth_scale: float
    depth: float
    inside: int
    decision: int
    bounce: int
    flags: int


@wp.func
def view_state(
    beam: Beam,
    throughput: wp.vec3,
    stream: wp.uint32,
    start: float,
    end: float,
    passed_by: float,
    travelled: float,
    depth_scale: float,
    depth: float,
    inside: int,
    decision: int,
    bounce: int,
    flags: int,
) -> ViewState:
    """The state of these parts."""
    out = ViewState()
    out.beam = beam
    out.throughput = throughput
    out.stream = stream
    out.start = start
    out.end = end
    out.passed_by = passed_by
    out.travelled = travelled
    out.depth_scale = depth_scale
    out.depth = depth
    out.inside = inside
    out.decision = decision
    out.bounce = bounce
    out.flags = flags
    return out


@wp.func
def keep_state(states: wp.array(dtype=Any), row: int, kept: int, state: Any) -> int:
    """Keeps a ``state`` as that number ``kept`` of its row, where there is room.

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
