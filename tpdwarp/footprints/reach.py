"""How far footprints reach, placed in a part of the shutter: what need not be weighed, and what bounds of them hold.

Of footprints whose boxes along the axes of the scene meet a run of queries, on solids up to two in three do not reach
into it. Queries that see the whole shutter ask how far each reaches then before they place it, of numbers that lie
together in memory.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.compiler_flags import own_module
from tpdwarp.device import Launcher
from tpdwarp.footprints.bspline import trajectory_extent
from tpdwarp.footprints.placing import PlacedFootprint, TimeWindow, place_footprint
from tpdwarp.footprints.shaping import FootprintArrays
from tpdwarp.footprints.weights import GatherForm


@wp.struct
class Reach:
    """How far a placed footprint reaches over its part of the shutter, from ``center``, where it is in the middle.

    ``u`` and ``v`` are along its axes ``row_u`` and ``row_v``, in filter space; ``across`` is along ``skew``, across
    its velocity, times the velocity's length.
    """

    center: wp.vec3
    row_u: wp.vec3
    row_v: wp.vec3
    skew: wp.vec3
    u: float
    v: float
    across: float


@cache
def reach_of(form: GatherForm) -> wp.Function:
    """Bounds of where w of Eq. 8 is not zero."""
    smooth, support = form.smooth, wp.constant(form.support)

    @wp.func
    def reach_of(placed: PlacedFootprint) -> Reach:
        velocity = placed.trajectory.velocity
        extent_u = float(support)
        extent_v = float(support)
        if wp.static(smooth):
            extent_u = trajectory_extent(placed.trajectory, 0)
            extent_v = trajectory_extent(placed.trajectory, 1)
        reach = Reach()
        reach.center = placed.center
        reach.row_u = placed.row_u
        reach.row_v = placed.row_v
        reach.skew = velocity[1] * placed.row_u - velocity[0] * placed.row_v
        reach.u = extent_u + 0.5 * wp.abs(velocity[0])
        reach.v = extent_v + 0.5 * wp.abs(velocity[1])
        reach.across = extent_u * wp.abs(velocity[1]) + extent_v * wp.abs(velocity[0])
        return reach

    return reach_of


@wp.func
def misses(reach: Reach, offset: wp.vec3, half: wp.vec3) -> bool:
    """Whether w of Eq. 8 is zero in all of a box, whose middle lies at ``offset`` from where the footprint is.

    Long oblique footprints miss most boxes that theirs meets. It is cautious: it may be false although w is zero.
    """
    off_u = wp.abs(wp.dot(reach.row_u, offset)) - wp.dot(wp.abs(reach.row_u), half)
    off_v = wp.abs(wp.dot(reach.row_v, offset)) - wp.dot(wp.abs(reach.row_v), half)
    off_line = wp.abs(wp.dot(reach.skew, offset)) - wp.dot(wp.abs(reach.skew), half)
    return off_u > reach.u or off_v > reach.v or off_line > reach.across


@cache
def _reach_kernel(form: GatherForm, moves: bool, curved: bool) -> wp.Kernel:
    place = place_footprint(form.smooth, moves, curved, False)
    reach = reach_of(form)

    @wp.kernel(**own_module())
    def find_reaches(
        base: int,
        in_turn: int,
        footprints: FootprintArrays,
        durations: wp.array(dtype=wp.float32),
        window: TimeWindow,
        out: wp.array(dtype=Reach),
    ):
        first = base + wp.tid() * in_turn
        for i in range(first, first + in_turn):
            out[i] = reach(place(footprints, durations, i, window))

    return find_reaches


def whole_reaches(
    footprints: FootprintArrays, durations: wp.array, form: GatherForm, moves: bool, curved: bool, launcher: Launcher
) -> wp.array:
    """Where footprints of ``form`` reach over the whole shutter, in the same order."""
    window = TimeWindow()
    window.length = 1.0
    out = launcher.empty(durations.shape[0], Reach)
    kernel = _reach_kernel(form, moves, curved)
    launcher(kernel, durations.shape[0], [footprints, durations, window, out], in_turn=True)
    return out
