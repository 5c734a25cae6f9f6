"""Slots of the shutter: queries that see a part of it look among what footprints sweep over in that part.

Light that is bent by what moves may sweep over many times its own size while the shutter is open, and where it changes
fast, each footprint shines in a small part of it. A box around all of that meets many queries that look when the
footprint is elsewhere or not there. So for queries whose windows are parts of the shutter there is a tree for each
part, in which footprints that shine then reach no farther than they go then.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bounds import Sweeps
from tpdwarp.footprints.courses import Course
from tpdwarp.footprints.shaping import FootprintArrays

# Slots at most. Chosen, not derived.
MOST_SLOTS = 16
# Slots are halved where footprints in the halves reach so many times less far. Chosen, not derived.
LEAST_GAIN = 1.25
# Trees of slots are worth building where the pieces that queries look at, were each of them one of its own, would cover
# as much as the scene, which is of unit radius. Chosen by measurement: 5 000 queries among pieces of .015 lose a third,
# 1 500 among pieces of .1 win.
LEAST_COVERED = 4.0
# Windows that reach into the next slot by rounding lie in theirs.
ROUNDING = 1.0e-4


def slots_of(windows: np.ndarray, most: int) -> tuple[int, np.ndarray]:
    """Into how many equal slots the shutter can be cut so that each window lies in one, and which that is.

    Args:
        windows: Time, and middle and length of each window, which holds the time, shape [n, 3].
        most: A power of two.

    Returns:
        Their number, a power of two no larger than ``most``; that of each window, shape [n].
    """
    middle, half = windows[:, 1] + 0.5, 0.5 * windows[:, 2]
    count = most
    while count > 1:
        first = np.floor((middle - half) * count + ROUNDING)
        if (first >= 0).all() and (np.ceil((middle + half) * count - ROUNDING) - first <= 1).all():
            if (first < count).all():
                return count, first.astype(np.int64)
        count //= 2
    return 1, np.zeros(len(windows), np.int64)


def worth_trees(queries: int, size: float) -> bool:
    """Whether so many queries gain more by trees of slots than it takes to build these.

    Args:
        size: Diagonal of the boxes of footprints.
    """
    return queries * size * size >= LEAST_COVERED


def most_slots(footprints: FootprintArrays, courses: wp.array, rows: np.ndarray) -> int:
    """Into how many slots, a power of two, the shutter is worth cutting: twice as many have to leave out enough.

    Args:
        rows: Which footprints, shape [n].
    """
    known = courses.numpy()[rows]
    swept, own = footprints.half_extent.numpy()[rows, :2].max(axis=1), known["extent"].max(axis=1)
    opening, duration = known["time"] - 0.5 * known["duration"] + 0.5, known["duration"]
    best, count = swept.sum(dtype=np.float64), 1
    while count < MOST_SLOTS:
        # How far footprints reach in a slot, in the mean over all of them.
        finer = 2 * count
        first = np.floor(opening * finer + ROUNDING)
        there = np.ceil((opening + duration) * finer - ROUNDING) - first
        part = np.minimum(1.0, 1.0 / (finer * duration))
        reach = (there * (own + part * (swept - own))).sum(dtype=np.float64) / finer
        if not best >= LEAST_GAIN * reach:
            break
        best, count = reach, finer
    return count


@wp.kernel(enable_backward=False)
def find_sweeps(
    base: int,
    # In
    footprints: FootprintArrays,
    courses: wp.array(dtype=Course),
    rows: wp.array(dtype=wp.int32),
    opening: float,
    closing: float,
    # Out
    out: Sweeps,
):
    """What footprints sweep over between two times: where each goes straight then, and its own extent beside that."""
    i = rows[base + wp.tid()]
    course = courses[i]
    n = footprints.normal[i]
    begun = wp.max(opening, course.time - 0.5 * course.duration)
    ended = wp.min(closing, course.time + 0.5 * course.duration)
    along = wp.abs(wp.dot(course.first, course.velocity))
    across = wp.abs(wp.dot(course.second, course.velocity))
    half = 0.5 * wp.max(ended - begun, 0.0)
    extent = course.extent + half * wp.vec2(along, across)
    # Off its plane it reaches as far as it does over all of the shutter.
    within = course.velocity - wp.dot(course.velocity, n) * n
    out.center[i] = course.center + (0.5 * (begun + ended) - course.time) * within
    out.normal[i] = n
    height = footprints.half_extent[i][2]
    if extent[0] >= extent[1]:
        out.long_axis[i] = course.first
        out.half_extent[i] = wp.vec3(extent[0], extent[1], height)
    else:
        out.long_axis[i] = course.second
        out.half_extent[i] = wp.vec3(extent[1], extent[0], height)


def sweeps_in(
    footprints: FootprintArrays, courses: wp.array, rows: np.ndarray, slot: int, count: int, launcher: Launcher
) -> tuple[Sweeps, np.ndarray]:
    """What some footprints sweep over in slot ``slot`` of ``count``, and those of the ``rows`` that are there then."""
    opening, closing = slot / count - 0.5, (slot + 1) / count - 0.5
    known = courses.numpy()
    time, half = known["time"][rows], 0.5 * known["duration"][rows]
    rows = rows[(time - half < closing) & (time + half > opening)]
    out = launcher.rows(Sweeps, courses.shape[0], zeroed=False)
    inputs = [footprints, courses, launcher.array(rows.astype(np.int32), wp.int32), opening, closing, out]
    launcher(find_sweeps, len(rows), inputs)
    return out, rows
