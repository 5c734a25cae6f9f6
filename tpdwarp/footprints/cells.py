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

from tpdwarp.footprints.lanes import LANES, Lanes

# Edges that lean by less than this beside the square are as good as upright: the mean of what they bound is off by no
# more than an eighth of it, and by their rounding over it where they lean more.
NEARLY_UPRIGHT = wp.constant(1.0e-4)
# Half a side of the unit square.
HALF = wp.constant(0.5)


@wp.func
def _bounded(x: float) -> float:
    """x within the square: −½ … ½ (beyond the paper)."""
    return wp.clamp(x, -HALF, HALF)


@wp.func
def _integral(x: float) -> float:
    """∫ of the bounded coordinate from 0 to x (beyond the paper)."""
    bounded = _bounded(x)
    return bounded * (x - 0.5 * bounded)


@wp.func
def _along_edge(a: wp.vec2, b: wp.vec2, slope: float) -> float:
    """∫ of the bounded x dy from a to b, where −½ < y < ½ (beyond the paper): by Green, what an edge adds to an area.

    Args:
        slope: dx/dy.
    """
    low = _bounded(a[1])
    high = _bounded(b[1])
    start = a[0] + slope * (low - a[1])
    end = a[0] + slope * (high - a[1])
    first = _bounded(start)
    last = _bounded(end)
    mean = 0.5 * (first + last)
    outside = first != start or last != end
    if outside and wp.abs(end - start) > NEARLY_UPRIGHT:
        mean = (_integral(end) - _integral(start)) / (end - start)
        mean = wp.clamp(mean, wp.min(first, last), wp.max(first, last))
    return mean * (high - low)


@wp.func
def cell_weight(y: wp.vec2, pixel: wp.mat22) -> float:
    """The mean over a pixel around y of the unit square in filter space, a cell of the lattice (beyond the paper).

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
    a = y - 0.5 * (p + q)
    b = a + p
    c = b + q
    d = a + q
    area = _along_edge(a, b, slope_p) + _along_edge(b, c, slope_q)
    area += _along_edge(c, d, slope_p) + _along_edge(d, a, slope_q)
    return wp.abs(area / (p[0] * q[1] - p[1] * q[0]))


@wp.func
def cell_weights(u: Lanes, v: Lanes, pixel: wp.mat22) -> Lanes:
    """The same by lanes (beyond the paper): most of them are those of pixels beside the cell."""
    reach_u = HALF + pixel_extent(pixel, 0)
    reach_v = HALF + pixel_extent(pixel, 1)
    out = Lanes(0.0)
    for lane in range(LANES):
        if wp.abs(u[lane]) < reach_u and wp.abs(v[lane]) < reach_v:
            out[lane] = cell_weight(wp.vec2(u[lane], v[lane]), pixel)
    return out


@wp.func
def pixel_extent(pixel: wp.mat22, axis: int) -> float:
    """Half of what a pixel spans along an axis of filter space (beyond the paper)."""
    return 0.5 * (wp.abs(pixel[axis, 0]) + wp.abs(pixel[axis, 1]))
