"""Leaves: a few queries that follow each other, with the box that they lie in.

A run holds as many queries as one walk through the BVH pays for, and most footprints fall on a few of them only.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays, has_shading_normals
from tpdwarp.footprints.lane_counts import lane_func, lane_kernel, lane_struct
from tpdwarp.footprints.lanes import LANES, Lanes, LaneVectors
from tpdwarp.footprints.runs import FAR_AWAY

# Queries of a leaf: they are worked on at once.
LEAF = LANES


@lane_struct
class LeafArrays:
    """Leaves, one row each: the middle and half the sides of their boxes, and their queries by lanes.

    Where there is no query, the lane has no receiver (−1) and stands in the middle. Motions and shading normals are
    there where queries have them.
    """

    middle: wp.array(dtype=wp.vec3)
    half: wp.array(dtype=wp.vec3)
    position: wp.array(dtype=LaneVectors)
    normal: wp.array(dtype=LaneVectors)
    motion: wp.array(dtype=LaneVectors)
    shading_normal: wp.array(dtype=LaneVectors)
    receiver: wp.array(dtype=Lanes)


@lane_func
def vectors_of(values: wp.array(dtype=wp.vec3), first: int, last: int, other: wp.vec3) -> LaneVectors:
    """Rows ``first`` … ``last`` − 1 by lanes, ``other`` in those that are left: queries of Eq. 8."""
    out = LaneVectors()
    lane = int(0)
    while lane < LEAF:
        value = other
        if first + lane < last:
            value = values[first + lane]
        out.x[lane] = value[0]
        out.y[lane] = value[1]
        out.z[lane] = value[2]
        lane += 1
    return out


@lane_kernel
def fill_leaves(base: int, queries: QueryArrays, count: int, out: LeafArrays):
    """Boxes of the queries of each leaf (of one without any, of no size and far away), and the queries by lanes."""
    leaf = base + wp.tid()
    first = leaf * LEAF
    last = wp.min(first + LEAF, count)
    low = wp.vec3(FAR_AWAY, FAR_AWAY, FAR_AWAY)
    high = -low
    receivers = Lanes(-1.0)
    for i in range(first, last):
        if queries.receiver[i] >= 0:
            low = wp.min(low, queries.position[i])
            high = wp.max(high, queries.position[i])
            receivers[i - first] = float(queries.receiver[i])
    out.middle[leaf] = low
    if high[0] >= low[0]:
        out.middle[leaf] = 0.5 * (low + high)
        out.half[leaf] = 0.5 * (high - low)
    out.receiver[leaf] = receivers
    nothing = wp.vec3(0.0, 0.0, 0.0)
    out.normal[leaf] = vectors_of(queries.normal, first, last, nothing)
    if out.motion.shape[0] > 0:
        out.motion[leaf] = vectors_of(queries.motion, first, last, nothing)
    if out.shading_normal.shape[0] > 0:
        out.shading_normal[leaf] = vectors_of(queries.shading_normal, first, last, nothing)
    positions = vectors_of(queries.position, first, last, out.middle[leaf])
    for lane in range(LEAF):
        if receivers[lane] < 0.0:
            positions.x[lane] = out.middle[leaf][0]
            positions.y[lane] = out.middle[leaf][1]
            positions.z[lane] = out.middle[leaf][2]
    out.position[leaf] = positions


def leaves_of(queries: QueryArrays, count: int, lanes: int, query_moves: bool, launcher: Launcher) -> Any:
    """The leaves of ``count`` queries, ``LeafArrays`` of so many lanes."""
    leaf_count = -(-count // lanes)
    left_out = [*(() if query_moves else ("motion",)), *(() if has_shading_normals(queries) else ("shading_normal",))]
    out = launcher.rows(LeafArrays.of(lanes), leaf_count, but=left_out)
    for name in left_out:
        setattr(out, name, launcher.zeros(0, LaneVectors.of(lanes)))
    launcher(fill_leaves.of(lanes), leaf_count, [queries, count, out])
    return out
