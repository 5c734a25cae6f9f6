"""Lanes: queries that are worked on at once, in vectors with one component for each of them.

A footprint falls on neighbouring queries alike, and to evaluate it at sixteen of them costs little more than at one.
"""

from __future__ import annotations

import warp as wp

# Queries that are worked on at once: a square of pixels of this area (tpdwarp.view.sampling). Chosen, not derived: a
# few vector registers.
LANE_COUNT = 16
LANES = wp.constant(LANE_COUNT)
Lanes = wp.types.vector(LANE_COUNT, wp.float32)
LANE_NUMBERS = wp.constant(Lanes(*map(float, range(LANE_COUNT))))


@wp.struct
class LaneVectors:
    """A vector in each lane, or an RGB triple."""

    x: Lanes
    y: Lanes
    z: Lanes


def _by_lanes(value: str) -> str:
    """C++ of a function whose value in lane i is ``value``, in terms of a[i] and b[i]."""
    return f"auto out = a; for (int i = 0; i < {LANE_COUNT}; ++i) out[i] = {value}; return out;"


@wp.func_native(_by_lanes("a[i] < b[i] ? a[i] : b[i]"))
def lesser(a: Lanes, b: Lanes) -> Lanes:
    """The lesser of two values by lanes: ``wp.min``, which looks for NaN, is no vector instruction."""
    ...


@wp.func_native(_by_lanes("a[i] > b[i] ? a[i] : b[i]"))
def greater(a: Lanes, b: Lanes) -> Lanes:
    """The greater of two values by lanes, likewise."""
    ...


@wp.func
def between(values: Lanes, low: Lanes, high: Lanes) -> Lanes:
    """The values by lanes, no lower than ``low`` and no higher than ``high``."""
    return lesser(greater(values, low), high)


@wp.func_native(_by_lanes("sqrtf(a[i])"))
def roots(a: Lanes) -> Lanes:
    """√ by lanes."""
    ...


@wp.func_native(
    "auto out = a;"
    f"for (int step = {LANE_COUNT // 2}; step > 0; step /= 2)"
    "    for (int i = 0; i < step; ++i) out[i] = out[i] < out[i + step] ? out[i] : out[i + step];"
    "return out[0];"
)
def least(a: Lanes) -> float:
    """The least value of all lanes, found by halves."""
    ...


@wp.func
def greatest(a: Lanes) -> float:
    """The greatest value of all lanes."""
    return -least(-a)


@wp.func_native(_by_lanes("a[i] >= 0.0f ? 1.0f : 0.0f"))
def not_negative(a: Lanes) -> Lanes:
    """One in lanes whose value is no less than zero, nothing in others: terms of Eq. 8 that count."""
    ...


@wp.func
def equal(values: Lanes, other: float) -> Lanes:
    """One in lanes with the value ``other``, nothing in others: terms of Eq. 8 that count."""
    return not_negative(-wp.abs(values - Lanes(other)))


@wp.func
def products(vectors: LaneVectors, other: wp.vec3) -> Lanes:
    """Products of the vectors with another one, such as a row of M in Eq. 8."""
    return other[0] * vectors.x + other[1] * vectors.y + other[2] * vectors.z


@wp.func
def added(vectors: LaneVectors, factors: Lanes, other: wp.vec3) -> LaneVectors:
    """The vectors and, in each lane, ``factors`` times another one: a term of Eq. 8 is added so."""
    out = LaneVectors()
    out.x = vectors.x + other[0] * factors
    out.y = vectors.y + other[1] * factors
    out.z = vectors.z + other[2] * factors
    return out


@wp.func
def in_lane(vectors: LaneVectors, lane: int) -> wp.vec3:
    """The vector in one lane: the sum of Eq. 8 at a query."""
    return wp.vec3(vectors.x[lane], vectors.y[lane], vectors.z[lane])
