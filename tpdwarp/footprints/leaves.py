"""Leaves: a few queries that follow each other, with the box that they lie in.

A run holds as many queries as one walk through the BVH pays for, and most footprints fall on a few of them only.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.runs import FAR_AWAY

# Queries of a leaf: a square of pixels of this area (tpdwarp.view.sampling). Chosen, not derived.
LEAF = wp.constant(16)


@wp.struct
class LeafArrays:
    """Boxes of leaves, one row each: the middle and half the sides."""

    middle: wp.array(dtype=wp.vec3)
    half: wp.array(dtype=wp.vec3)


@wp.kernel(enable_backward=False)
def bound_leaves(base: int, queries: QueryArrays, count: int, out: LeafArrays):
    """Boxes of the queries of each leaf; of one without any, a box of no size that lies far away."""
    leaf = base + wp.tid()
    low = wp.vec3(FAR_AWAY, FAR_AWAY, FAR_AWAY)
    high = -low
    for i in range(leaf * LEAF, wp.min((leaf + 1) * LEAF, count)):
        if queries.receiver[i] >= 0:
            low = wp.min(low, queries.position[i])
            high = wp.max(high, queries.position[i])
    out.middle[leaf] = low
    if high[0] >= low[0]:
        out.middle[leaf] = 0.5 * (low + high)
        out.half[leaf] = 0.5 * (high - low)


def leaves_of(queries: QueryArrays, count: int, launcher: Launcher) -> LeafArrays:
    """The leaves of ``count`` queries."""
    leaf_count = -(-count // int(LEAF))
    out = launcher.rows(LeafArrays, leaf_count)
    launcher(bound_leaves, leaf_count, [queries, count, out])
    return out
