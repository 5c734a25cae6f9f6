"""Wide footprints: where they are much larger than pixels, their light is so smooth that few places tell all of it.

A B-spline is a parabola between the edges of its cells, and cubic convolution is exact for parabolas. So the light of
footprints on flat receivers at rest is gathered at the corners of squares (:mod:`.rasters`) that are smaller than a
third of a cell, and interpolated: their number goes with the number of footprints, not with footprints times pixels.

Beyond the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined
from tpdwarp.device import Launcher
from tpdwarp.footprints.background import COARSEST_SQUARE, FEWEST_PIXELS, FINEST_SQUARE
from tpdwarp.footprints.footprint_map import Footprints
from tpdwarp.footprints.planes import FEWEST_PHOTONS, Plane, on_any, planes_of
from tpdwarp.footprints.shaping import FootprintArrays, PixelSize, pixel_on_plane, tangent_frame

wp.set_module_options(calls_inlined())

# Squares of a cell: interpolated from the corners of squares of a third of one, light that changes from cell to cell by
# as much as half of its mean at random errs by .002 of the mean, of a quarter by .0009 (light whose waves are seven
# cells long by .0004 and .0002); powers of two are two thirds of that on average.
SQUARES_OF_CELL = wp.constant(3.0)
# The edge of a disc, in a box or two 4 q wide, has the variance 4/3 q², as that of a B-spline of cells 2.3 q wide.
CELLS_OF_SOFTNESS = wp.constant(2.3)


@dataclass(frozen=True)
class WideFootprints:
    """Which footprints are wide, by index.

    Attributes:
        others: Those that are not, shape [m].
        still: Those whose light is the same all the time, by the side of their squares.
        moving: Those that move, likewise.
        planes: Where they lie.
    """

    others: np.ndarray
    still: dict[float, np.ndarray] = field(default_factory=dict)
    moving: dict[float, np.ndarray] = field(default_factory=dict)
    planes: list[Plane] = field(default_factory=list)


@wp.kernel(enable_backward=False)
def measure_widths(
    base: int,
    in_turn: int,
    # In
    footprints: FootprintArrays,
    durations: wp.array(dtype=wp.float32),
    pixel: PixelSize,
    # Out
    squares: wp.array(dtype=wp.float32),
    still: wp.array(dtype=wp.int32),
):
    """The largest squares that tell all of a footprint's light, 0 where none gain anything; whether it stands still."""
    first = base + wp.tid() * in_turn
    for i in range(first, first + in_turn):
        cell = 1.0 / wp.max(wp.length(footprints.row_u[i]), wp.length(footprints.row_v[i]))
        softness = -footprints.filter_width[i][2]
        if softness > 0.0:
            cell *= wp.min(CELLS_OF_SOFTNESS * softness, 1.0)
        at_rest = wp.length_sq(footprints.dxdt[i]) == 0.0 and durations[i] >= 1.0
        if footprints.acceleration.shape[0] > 0:
            rate = footprints.jacobian_rate[i]
            cell *= 1.0 - 0.5 * wp.sqrt(wp.ddot(rate, rate))
            bend = wp.length_sq(footprints.acceleration[i]) + wp.length_sq(footprints.jerk[i])
            at_rest = at_rest and bend + wp.ddot(rate, rate) + wp.abs(footprints.gain[i]) == 0.0
        still[i] = wp.where(at_rest, 1, 0)
        n = footprints.normal[i]
        on_plane = pixel_on_plane(pixel, footprints.center[i], n, tangent_frame(n))
        pixel_area = wp.abs(on_plane.p[0] * on_plane.q[1] - on_plane.p[1] * on_plane.q[0])
        side = wp.pow(2.0, wp.floor(wp.log2(wp.max(cell / SQUARES_OF_CELL, 1.0e-15))))
        on_ground = wp.length_sq(footprints.dxdt[i] - footprints.dxdt_relative[i]) == 0.0
        squares[i] = 0.0
        if footprints.is_cell[i] == 0 and on_ground and side >= FINEST_SQUARE:
            if side * side >= FEWEST_PIXELS * FEWEST_PIXELS * pixel_area:
                squares[i] = wp.min(side, COARSEST_SQUARE)


def wide_footprints(footprints: Footprints, pixel: PixelSize, launcher: Launcher) -> WideFootprints:
    """Tells wide B-splines on flat receivers at rest from other footprints.

    Args:
        pixel: What a query stands for.
    """
    sides, still = launcher.zeros(footprints.count, wp.float32), launcher.zeros(footprints.count, wp.int32)
    arrays = footprints.arrays
    launcher(measure_widths, footprints.count, [arrays, footprints.durations, pixel, sides, still], in_turn=True)
    squares, stands = sides.numpy(), still.numpy() == 1
    rows = np.flatnonzero(squares > 0.0)
    if len(rows) < FEWEST_PHOTONS:
        return WideFootprints(np.arange(footprints.count))
    lying = [column.numpy()[rows] for column in (arrays.receiver, arrays.center, arrays.normal)]
    planes = planes_of(*lying)
    wide = np.zeros(footprints.count, bool)
    wide[rows] = on_any(planes, *lying)
    by_motion = [
        {float(side): np.flatnonzero(chosen & (squares == side)) for side in np.unique(squares[chosen])}
        for chosen in (wide & stands, wide & ~stands)
    ]
    return WideFootprints(np.flatnonzero(~wide), *by_motion, planes)
