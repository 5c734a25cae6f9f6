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

from tpdwarp.footprints.lanes import between, greater, lesser

# Areas are sums of parts of the unit square, of which rounding is a few 1e-8: what is less than this is none.
LEAST_AREA = wp.constant(1.0e-6)
# Half a side of the unit square.
HALF = wp.constant(0.5)


@wp.func
def _bounded(x: float) -> float:
    """x within the square: −½ … ½ (beyond the paper)."""
    return between(x, -HALF, HALF)


@wp.func
def _integral(x: float) -> float:
    """∫ of the bounded coordinate from 0 to x (beyond the paper)."""
    bounded = _bounded(x)
    return bounded * (x - 0.5 * bounded)


@wp.func
def _along_edge(a_x: float, a_y: float, b_y: float, slope: float) -> float:
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
    mean = (_integral(end) - _integral(start)) / wp.where(run == 0.0, 1.0, run)
    return between(mean, lesser(first, last), greater(first, last)) * (high - low)


@wp.func
def cell_weight(u: float, v: float, pixel: wp.mat22) -> float:
    """The mean over a pixel around (u, v) of the unit square in filter space, a cell of the lattice (beyond the paper).

    Args:
        pixel: The sides of the pixel, as columns.
    """
    p = wp.vec2(pixel[0, 0], pixel[1, 0])
    q = wp.vec2(pixel[0, 1], pixel[1, 1])
    slope_p = wp.where(p[1] == 0.0, 0.0, p[0] / p[1])
    slope_q = wp.where(q[1] == 0.0, 0.0, q[0] / q[1])
    a_x = u - 0.5 * (p[0] + q[0])
    a_y = v - 0.5 * (p[1] + q[1])
    b_y = a_y + p[1]
    c_x = a_x + (p[0] + q[0])
    c_y = b_y + q[1]
    d_y = a_y + q[1]
    area = _along_edge(a_x, a_y, b_y, slope_p) + _along_edge(a_x + p[0], b_y, c_y, slope_q)
    area += _along_edge(c_x, c_y, d_y, slope_p) + _along_edge(a_x + q[0], d_y, a_y, slope_q)
    # Elsewhere it is rounding, and so is what is smaller than that.
    within = wp.abs(u) <= HALF + pixel_extent(pixel, 0) and wp.abs(v) <= HALF + pixel_extent(pixel, 1)
    within = within and wp.abs(area) >= LEAST_AREA
    return wp.where(within, wp.abs(area), 0.0) / wp.abs(p[0] * q[1] - p[1] * q[0])


@wp.func
def pixel_extent(pixel: wp.mat22, axis: int) -> float:
    """Half of what a pixel spans along an axis of filter space (beyond the paper)."""
    return 0.5 * (wp.abs(pixel[axis, 0]) + wp.abs(pixel[axis, 1]))
