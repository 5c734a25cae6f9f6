"""Runs of queries: neighbours whose footprints are looked up together, so that one walk through the BVH serves many."""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.placing import TimeWindow

# How much the motions of queries that are gathered together may differ, as a part of the motion itself: their boxes are
# grown by it. Chosen, not derived.
LARGEST_DEVIATION = wp.constant(0.25)
# Queries are gathered together within so many times ``run_size``, and one that moves is looked up at once along as long
# a way. Chosen: with 1 the gather of a turning cylinder takes 1.4 times as long, with 3 as long; with half of that way
# light past a turning torus, seen by a camera that moves, takes 1.2 times as long, with 1.5 of it as long.
LARGEST_RUN = wp.constant(2.0)
# One that goes so many times ``run_size`` races: farther than that by more than ways are rounded by as they are cut.
RACING = wp.constant(1.01 * float(LARGEST_RUN))
# The receiver of runs that lie on several ones.
SEVERAL = wp.constant(-2)
# Corners of a box that holds nothing yet.
FAR_AWAY = wp.constant(1.0e30)


@wp.struct
class Run:
    """Queries ``start`` … ``stop`` − 1 that are gathered together.

    Attributes:
        low, high: The box that they stay in over their window of the shutter.
        middle, half: The middle of the box that they stand in at their own time, and half its sides, grown by how much
            their motions differ.
        receiver: The object that all of them lie on, or ``SEVERAL``.
        normal: Normal of the first one; ``narrowest`` is the least cosine between it and any other.
        window: The window and motion of the first one, which stand for all of them.
        empty: Whether there is no query in it at all.
    """

    stop: int
    low: wp.vec3
    high: wp.vec3
    middle: wp.vec3
    half: wp.vec3
    receiver: int
    normal: wp.vec3
    narrowest: float
    window: TimeWindow
    empty: bool


@wp.func
def window_of(window: TimeWindow, motion: wp.vec3, fastest: float, run_size: float) -> TimeWindow:
    """The window of a query that goes by ``motion``.

    A query that races out of the box of a run stands for less of the shutter: for what it passes within ``run_size``.
    """
    way = window.length * fastest
    share = wp.where(way > RACING * run_size, run_size / wp.max(way, 1.0e-20), 1.0)
    out = TimeWindow()
    out.time = window.time
    out.length = share * window.length
    out.center = window.time + share * (window.center - window.time)
    out.motion = motion
    return out


@cache
def next_run(query_moves: bool) -> wp.Function:
    """The function that collects queries from ``start`` on that stay within a box over the shutter."""

    @wp.func
    def collect(
        queries: QueryArrays, start: int, end: int, run_size: float, windows: wp.array(dtype=TimeWindow)
    ) -> Run:
        window = windows[wp.min(start, windows.shape[0] - 1)]
        stand_low = wp.vec3(FAR_AWAY, FAR_AWAY, FAR_AWAY)
        stand_high = -stand_low
        low = wp.vec3(FAR_AWAY, FAR_AWAY, FAR_AWAY)
        high = -low
        receiver = int(-1)
        normal = wp.vec3(0.0, 0.0, 0.0)
        narrowest = float(1.0)
        fastest = float(0.0)
        shared = TimeWindow()
        shared.time = window.time
        shared.center = window.center
        shared.length = window.length
        stop = int(start)
        while stop < end:
            if windows.shape[0] > 1:
                other = windows[stop]
                if other.time != window.time or other.center != window.center or other.length != window.length:
                    break
            if queries.receiver[stop] >= 0:
                a = queries.position[stop]
                b = queries.position[stop]
                if wp.static(query_moves):
                    motion = queries.motion[stop]
                    if low[0] == FAR_AWAY:
                        fastest = (1.0 + LARGEST_DEVIATION) * wp.length(motion)
                        shared = window_of(window, motion, fastest, run_size)
                    elif wp.length(motion - shared.motion) > LARGEST_DEVIATION * wp.length(shared.motion):
                        break
                    half = 0.5 * shared.length * motion
                    x = queries.position[stop] + (shared.center - shared.time) * motion
                    a = wp.min(x - half, x + half)
                    b = wp.max(x - half, x + half)
                grown_low = wp.min(low, a)
                grown_high = wp.max(high, b)
                if stop > start and wp.length(grown_high - grown_low) > LARGEST_RUN * run_size and low[0] < FAR_AWAY:
                    break
                if low[0] == FAR_AWAY:
                    receiver = queries.receiver[stop]
                    normal = queries.normal[stop]
                elif queries.receiver[stop] != receiver:
                    receiver = SEVERAL
                narrowest = wp.min(narrowest, wp.dot(normal, queries.normal[stop]))
                stand_low = wp.min(stand_low, queries.position[stop])
                stand_high = wp.max(stand_high, queries.position[stop])
                low = grown_low
                high = grown_high
            stop += 1
        run = Run()
        run.stop = stop
        run.low = low
        run.high = high
        run.receiver = receiver
        run.normal = normal
        run.narrowest = narrowest
        run.window = shared
        run.middle = 0.5 * (stand_low + stand_high)
        run.half = 0.5 * (stand_high - stand_low)
        if wp.static(query_moves):
            if stop - start > 1:
                apart = wp.abs(shared.center - shared.time) + 0.5 * shared.length
                grown = apart * LARGEST_DEVIATION * wp.length(shared.motion)
                run.half += wp.vec3(grown, grown, grown)
        run.empty = low[0] == FAR_AWAY
        return run

    return collect
