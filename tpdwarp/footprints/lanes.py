"""Lanes: queries that are worked on at once, in loops of which compilers make vector instructions.

A footprint falls on neighbouring queries alike, and to evaluate it at sixteen of them costs a CPU little more than at
one, as long as no lane goes another way than the others. So what a footprint weighs at one query is written for one,
without branches that depend on the query, and is called in such a loop.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints import lane_counts
from tpdwarp.footprints.lane_counts import PerLaneCount, lane_func, lane_struct

# Queries that a thread of a CPU works on at once: a square of pixels of this area (tpdwarp.view.sampling). Chosen, not
# derived: a few vector registers.
CPU_LANES = 16
# One of a GPU works on one query, as its neighbours work on others beside it: with sixteen it takes 24 times as long.
GPU_LANES = 1
LANES = PerLaneCount(wp.constant)
Lanes = PerLaneCount(lambda count: wp.types.vector(count, wp.float32))


def lanes_of(launcher: Launcher) -> int:
    """How many queries a thread works on at once."""
    return GPU_LANES if launcher.device.is_cuda else CPU_LANES


@lane_struct
class LaneVectors:
    """A vector in each lane, or an RGB triple."""

    x: Lanes
    y: Lanes
    z: Lanes


@wp.func
def lesser(a: float, b: float) -> float:
    """The lesser of two values: ``wp.min``, which looks for NaN, is no vector instruction."""
    return wp.where(a < b, a, b)


@wp.func
def greater(a: float, b: float) -> float:
    """The greater of two values, likewise."""
    return wp.where(a > b, a, b)


@wp.func
def between(value: float, low: float, high: float) -> float:
    """The value, no lower than ``low`` and no higher than ``high``."""
    return lesser(greater(value, low), high)


# Compilers keep the order of a loop that looks for the least value, and take one lane after the other.
@lane_counts.func_native(
    "auto out = a;"
    "for (int step = {count} / 2; step > 0; step /= 2)"
    "    for (int i = 0; i < step; ++i) out[i] = out[i] < out[i + step] ? out[i] : out[i + step];"
    "return out[0];"
)
def least(a: Lanes) -> float:
    """The least value of all lanes, found by halves."""
    ...


@lane_func
def greatest(a: Lanes) -> float:
    """The greatest value of all lanes."""
    return -least(-a)


@lane_func
def in_lane(vectors: LaneVectors, lane: int) -> wp.vec3:
    """The vector in one lane: the sum of Eq. 8 at a query."""
    return wp.vec3(vectors.x[lane], vectors.y[lane], vectors.z[lane])
