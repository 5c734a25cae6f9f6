"""Cells of a lattice as footprints: their light is shared between pixels as their images lie over them.

At first order a cell of the lattice lights a parallelogram with the sides D_u x and D_v x evenly, and those of all
cells fill the receiver side by side. What a pixel takes of it is the part that lies within the pixel, whatever the
angles between the two: the pixel's average is exact, and nothing is blurred that the cell does not blur. Footprints
that are larger than pixels are B-splines all the same (:mod:`tpdwarp.footprints.bspline`), since the steps between
cells would show.

Beyond the paper.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.footprints.lane_counts import lane_func
from tpdwarp.footprints.lanes import Lanes, between, equal, greater, lesser, not_negative

# Areas are sums of parts of the unit square, of which rounding is a few 1e-8: what is less than this is none.
LEAST_AREA = wp.constant(1.0e-6)
# Half a side of the unit square.
HALF = wp.constant(0.5)


@lane_func
def _bounded(x: Lanes) -> Lanes:
    """x within the square: −½ … ½ (beyond the paper)."""
    return between(x, Lanes(-HALF), Lanes(HALF))


@lane_func
def _integral(x: Lanes) -> Lanes:
    """∫ of the bounded coordinate from 0 to x (beyond the paper)."""
    bounded = _bounded(x)
    return wp.cw_mul(bounded, x - 0.5 * bounded)


@lane_func
def _along_edge(a_x: Lanes, a_y: Lanes, b_y: Lanes, slope: float) -> Lanes:
    """∫ of the bounded x dy from a to b, where −½ < y < ½ (beyond the paper): by Green, what an edge adds to an area.

    Args:
        slope: dx/dy.
    """
    low = _bounded(a_y)
    high = _bounded(b_y)
    start = a_x + slope * (low - a_y)
    end = a_x + slope * (high - a_y)
    first = _bounded(start)
    last = _bounded(end)
    # Where it is upright the quotient is rounding, and the limits are next to each other.
    run = end - start
    mean = wp.cw_div(_integral(end) - _integral(start), run + equal(run, 0.0))
    return wp.cw_mul(between(mean, lesser(first, last), greater(first, last)), high - low)


@lane_func
def cell_weights(u: Lanes, v: Lanes, pixel: wp.mat22) -> Lanes:
    """The means over pixels around (u, v) of the unit square in filter space, a cell of the lattice (beyond the paper).

    Args:
        pixel: The sides of the pixel, as columns.
    """
    p = wp.vec2(pixel[0, 0], pixel[1, 0])
    q = wp.vec2(pixel[0, 1], pixel[1, 1])
    slope_p = float(0.0)
    if wp.abs(p[1]) > 0.0:
        slope_p = p[0] / p[1]
    slope_q = float(0.0)
    if wp.abs(q[1]) > 0.0:
        slope_q = q[0] / q[1]
    a_x = u - Lanes(0.5 * (p[0] + q[0]))
    a_y = v - Lanes(0.5 * (p[1] + q[1]))
    b_y = a_y + Lanes(p[1])
    c_x = a_x + Lanes(p[0] + q[0])
    c_y = b_y + Lanes(q[1])
    d_y = a_y + Lanes(q[1])
    area = _along_edge(a_x, a_y, b_y, slope_p) + _along_edge(a_x + Lanes(p[0]), b_y, c_y, slope_q)
    area += _along_edge(c_x, c_y, d_y, slope_p) + _along_edge(a_x + Lanes(q[0]), d_y, a_y, slope_q)
    # Elsewhere it is rounding, and so is what is smaller than that.
    within = not_negative(Lanes(HALF + pixel_extent(pixel, 0)) - wp.abs(u))
    within = wp.cw_mul(within, not_negative(Lanes(HALF + pixel_extent(pixel, 1)) - wp.abs(v)))
    within = wp.cw_mul(within, not_negative(wp.abs(area) - Lanes(LEAST_AREA)))
    return wp.cw_mul(within, wp.abs(area)) / wp.abs(p[0] * q[1] - p[1] * q[0])


@wp.func
def pixel_extent(pixel: wp.mat22, axis: int) -> float:
    """Half of what a pixel spans along an axis of filter space (beyond the paper)."""
    return 0.5 * (wp.abs(pixel[axis, 0]) + wp.abs(pixel[axis, 1]))
