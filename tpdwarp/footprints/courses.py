"""Courses of footprints: whether one meets queries that move, told by a few numbers that lie together in memory.

What crosses the way of a query in space is mostly elsewhere at the time. Over a part of the shutter both go straight
but for how trajectories bend, so that the way between them along an axis lies between its ends.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.placing import TimeWindow
from tpdwarp.footprints.shaping import FootprintArrays


@wp.struct
class Course:
    """A footprint as one of two boxes that pass each other.

    It stands at ``center`` at ``time`` and goes by ``velocity`` a shutter, as long as its own part of the shutter
    lasts. Along ``first`` and ``second`` in its plane it reaches ``extent`` to either side of that straight line.
    """

    center: wp.vec3
    velocity: wp.vec3
    first: wp.vec3
    second: wp.vec3
    extent: wp.vec2
    time: float
    duration: float


@wp.kernel(enable_backward=False)
def find_courses(
    base: int,
    # In
    footprints: FootprintArrays,
    durations: wp.array(dtype=wp.float32),
    # Out
    out: wp.array(dtype=Course),
):
    """The course of each footprint: its bounds without how far it goes straight on."""
    i = base + wp.tid()
    dxdt = footprints.dxdt[i]
    half = footprints.half_extent[i]
    course = Course()
    course.center = footprints.center[i]
    course.velocity = dxdt / durations[i]
    course.first = footprints.long_axis[i]
    course.second = wp.cross(footprints.normal[i], course.first)
    course.extent = wp.vec2(
        half[0] - 0.5 * wp.abs(wp.dot(course.first, dxdt)), half[1] - 0.5 * wp.abs(wp.dot(course.second, dxdt))
    )
    course.time = footprints.time[i]
    course.duration = durations[i]
    out[i] = course


@wp.func
def passes_by(course: Course, window: TimeWindow, middle: wp.vec3, half: wp.vec3) -> bool:
    """Whether w of Eq. 8 is zero all the while for queries in a box that moves with ``window``.

    Args:
        middle, half: The box at the window's own time.
    """
    opening = wp.max(window.center - 0.5 * window.length, course.time - 0.5 * course.duration)
    closing = wp.min(window.center + 0.5 * window.length, course.time + 0.5 * course.duration)
    d = middle - course.center
    begun = d + (opening - window.time) * window.motion - (opening - course.time) * course.velocity
    ended = d + (closing - window.time) * window.motion - (closing - course.time) * course.velocity
    apart = bool(closing <= opening)
    for axis in range(2):
        along = course.first
        if axis == 1:
            along = course.second
        reach = course.extent[axis] + wp.dot(wp.abs(along), half)
        a = wp.dot(along, begun)
        b = wp.dot(along, ended)
        apart = apart or wp.min(a, b) > reach or wp.max(a, b) < -reach
    return apart


def courses_of(footprints: FootprintArrays, durations: wp.array, launcher: Launcher) -> wp.array:
    """The courses of ``footprints``, which move over ``durations`` of the shutter, in the same order."""
    out = launcher.zeros(durations.shape[0], Course)
    launcher(find_courses, durations.shape[0], [footprints, durations, out])
    return out
