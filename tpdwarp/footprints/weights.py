"""The weight of a footprint at a query, by kernel: what the gather evaluates, fast or plain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import warp as wp

from tpdwarp.footprints import bspline
from tpdwarp.footprints.bspline import Trajectory, bspline_weight
from tpdwarp.footprints.kernels import SUPPORT, moving_weight, static_weight
from tpdwarp.footprints.lane_counts import func_of_lanes
from tpdwarp.footprints.lanes import LANES, Lanes
from tpdwarp.footprints.lines import line_weights


@dataclass(frozen=True)
class GatherForm:
    """How footprints are evaluated: kernel of Table 1 or B-spline, shutter or swept, time filter of Eq. 9.

    ``extended`` says whether they may be images of lights with extent.
    """

    kernel: str = "bspline"
    form: str = "shutter"
    time_filter: str = "none"
    extended: bool = False

    @property
    def smooth(self) -> bool:
        """Whether footprints are B-splines: they may curve and have a filter width, and are parabolas from afar."""
        return self.kernel == "bspline"

    @property
    def support(self) -> float:
        """Half the width of the kernel in filter space."""
        return bspline.SUPPORT if self.smooth else SUPPORT


@cache
def footprint_weight(form: GatherForm, lanes: int, moves: bool, curved: bool) -> wp.Function:
    """w(u, v, trajectory) of Eq. 8 at queries, by so many lanes.

    Queries (u, v) are relative to where the footprint stands in the middle of its trajectory.
    """
    if form.smooth:
        along = bspline_weight(lanes, moves, curved, form.extended)

        @func_of_lanes(lanes)
        def smooth(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
            if trajectory.passes:
                return line_weights(u, v, trajectory)
            return along(u, v, trajectory)

        return smooth if moves else along
    support = wp.constant(SUPPORT)
    still = static_weight(form.kernel)
    moving = moving_weight(form.kernel, form.form, form.time_filter)

    @wp.func
    def one(y: wp.vec2, trajectory: Trajectory) -> float:
        if wp.static(not moves):
            return still(y)
        v = trajectory.velocity
        if wp.abs(y[0]) >= support + 0.5 * wp.abs(v[0]) or wp.abs(y[1]) >= support + 0.5 * wp.abs(v[1]):
            return 0.0
        if v[0] == 0.0 and v[1] == 0.0:
            return still(y)
        return moving(y + 0.5 * v, v)

    @func_of_lanes(lanes)
    def weight(u: Lanes, v: Lanes, trajectory: Trajectory) -> Lanes:
        out = Lanes(0.0)
        lane = int(0)
        while lane < LANES:
            out[lane] = one(wp.vec2(u[lane], v[lane]), trajectory)
            lane += 1
        return out

    return weight
