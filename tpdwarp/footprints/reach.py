"""How far footprints reach, placed in a part of the shutter: what need not be weighed, and what bounds of them hold."""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.footprints.bspline import trajectory_extent
from tpdwarp.footprints.placing import PlacedFootprint
from tpdwarp.footprints.weights import GatherForm


@wp.struct
class Reach:
    """How far in filter space a placed footprint reaches over its part of the shutter, from where it is in the middle.

    ``u`` and ``v`` are along its axes, ``across`` is across its velocity, times the velocity's length.
    """

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
        reach.u = extent_u + 0.5 * wp.abs(velocity[0])
        reach.v = extent_v + 0.5 * wp.abs(velocity[1])
        reach.across = extent_u * wp.abs(velocity[1]) + extent_v * wp.abs(velocity[0])
        return reach

    return reach_of


@wp.func
def misses(placed: PlacedFootprint, reach: Reach, offset: wp.vec3, half: wp.vec3) -> bool:
    """Whether w of Eq. 8 is zero in all of a box, whose middle lies at ``offset`` from the footprint.

    Long oblique footprints miss most boxes that theirs meets. It is cautious: it may be false although w is zero.
    """
    velocity = placed.trajectory.velocity
    skew = velocity[1] * placed.row_u - velocity[0] * placed.row_v
    off_u = wp.abs(wp.dot(placed.row_u, offset)) - wp.dot(wp.abs(placed.row_u), half)
    off_v = wp.abs(wp.dot(placed.row_v, offset)) - wp.dot(wp.abs(placed.row_v), half)
    off_line = wp.abs(wp.dot(skew, offset)) - wp.dot(wp.abs(skew), half)
    return off_u > reach.u or off_v > reach.v or off_line > reach.across
