"""Lanes: queries that are worked on at once, in vectors with one component for each of them.

A footprint falls on neighbouring queries alike, and to evaluate it at sixteen of them costs a CPU little more than at
one.
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
LANE_NUMBERS = PerLaneCount(lambda count: wp.constant(Lanes.of(count)(*map(float, range(count)))))


def lanes_of(launcher: Launcher) -> int:
    """How many queries a thread works on at once."""
    return GPU_LANES if launcher.device.is_cuda else CPU_LANES


@lane_struct
class LaneVectors:
    """A vector in each lane, or an RGB triple."""

    x: Lanes
    y: Lanes
    z: Lanes


def _by_lanes(value: str) -> str:
    """C++ of a function whose value in lane i is ``value``, in terms of a[i] and b[i]."""
    return f"auto out = a; for (int i = 0; i < {{count}}; ++i) out[i] = {value}; return out;"


@lane_counts.func_native(_by_lanes("a[i] < b[i] ? a[i] : b[i]"))
def lesser(a: Lanes, b: Lanes) -> Lanes:
    """The lesser of two values by lanes: ``wp.min``, which looks for NaN, is no vector instruction."""
    ...


@lane_counts.func_native(_by_lanes("a[i] > b[i] ? a[i] : b[i]"))
def greater(a: Lanes, b: Lanes) -> Lanes:
    """The greater of two values by lanes, likewise."""
    ...


@lane_func
def between(values: Lanes, low: Lanes, high: Lanes) -> Lanes:
    """The values by lanes, no lower than ``low`` and no higher than ``high``."""
    return lesser(greater(values, low), high)


@lane_counts.func_native(_by_lanes("sqrtf(a[i])"))
def roots(a: Lanes) -> Lanes:
    """√ by lanes."""
    ...


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


@lane_counts.func_native(_by_lanes("a[i] >= 0.0f ? 1.0f : 0.0f"))
def not_negative(a: Lanes) -> Lanes:
    """One in lanes whose value is no less than zero, nothing in others: terms of Eq. 8 that count."""
    ...


@lane_func
def equal(values: Lanes, other: float) -> Lanes:
    """One in lanes with the value ``other``, nothing in others: terms of Eq. 8 that count."""
    return not_negative(-wp.abs(values - Lanes(other)))


@lane_func
def products(vectors: LaneVectors, other: wp.vec3) -> Lanes:
    """Products of the vectors with another one, such as a row of M in Eq. 8."""
    return other[0] * vectors.x + other[1] * vectors.y + other[2] * vectors.z


@lane_func
def added(vectors: LaneVectors, factors: Lanes, other: wp.vec3) -> LaneVectors:
    """The vectors and, in each lane, ``factors`` times another one: a term of Eq. 8 is added so."""
    out = LaneVectors()
    out.x = vectors.x + other[0] * factors
    out.y = vectors.y + other[1] * factors
    out.z = vectors.z + other[2] * factors
    return out


@lane_func
def in_lane(vectors: LaneVectors, lane: int) -> wp.vec3:
    """The vector in one lane: the sum of Eq. 8 at a query."""
    return wp.vec3(vectors.x[lane], vectors.y[lane], vectors.z[lane])
