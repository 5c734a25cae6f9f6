"""Footprints: the metric that maps a photon's tangent plane to filter space, regularised, with bounds for the gather.

A query stands for a square of side a, about a pixel, and footprints are as wide as what they are on average over it.
Let J = [D_u x, D_v x] in the tangent plane. Where the wavefront folds |Du×Dv| → 0, where light grazes it grows without
bound; so the singular values of J are widened to √(S² + 4ε²), which adds ε²I to the footprint's covariance
C = ¼(DuDuᵀ + DvDvᵀ), with ε² = a²/12, and limited in length and aspect. The singular vectors stay.

The B-spline, whose translates sum to one over the cells of its lattice only, is averaged over a box along its own axes
instead. Where these lie askew, by γ = √|cos ∠(Du, Dv)|, a box does not widen them all around: it then takes the part
1 − γ of a², and singular values are widened by γ of it. They are no less than ε: a bare box would have hard edges.

The metric, its determinant and the bounds all follow from the widened J, so that every footprint keeps its flux.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.bspline import SUPPORT
from tpdwarp.photons.tracing import PhotonMap, joined

LONGEST_AXIS = wp.constant(1.0)
# Boxes along axes of which they are a smaller part are left out: they would widen these by less than 1 %.
SMALLEST_BOX = wp.constant(0.25)
LARGEST_ASPECT = wp.constant(1000.0)
BOX_DEVIATION = wp.constant(12.0**-0.5)
# A part of the coordinates where the footprint lies, ten or so units in their last place; and a part of the scene.
SMALLEST_AXIS = wp.constant(1.0e-6)
SMALLEST_OF_ALL = wp.constant(1.0e-9)
# How far a query may lie off the footprint's plane, as a part of the footprint's own reach.
SLACK = wp.constant(0.25)
# How much axes may grow or shrink from mid shutter to either end: what shrinks to nothing passes a fold.
MOST_GROWTH = wp.constant(0.5)
MOST_PIECES = 32


@wp.struct
class PixelSize:
    """Side of the square on a receiver that a query stands for: ``base + slope · distance`` from ``eye``."""

    eye: wp.vec3
    base: float
    slope: float


@wp.struct
class FootprintArrays:
    """One row a photon, in the tracer's units. Filter coordinates of a displacement d are (row_u·d, row_v·d).

    At the part s (−½ … ½) of the photon's own shutter the footprint stands at center + s dxdt + ½ s² bend + ⅙ s³ jerk,
    and its axes are those of the middle times 1 + s stretch, in filter coordinates. Where no way is bent, ``bend``,
    ``jerk`` and ``stretch`` have no rows. ``box`` holds the sides of what a B-spline is averaged over, in cells.
    """

    center: wp.array(dtype=wp.vec3)
    row_u: wp.array(dtype=wp.vec3)
    row_v: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdt: wp.array(dtype=wp.vec3)
    bend: wp.array(dtype=wp.vec3)
    jerk: wp.array(dtype=wp.vec3)
    stretch: wp.array(dtype=wp.mat22)
    box: wp.array(dtype=wp.vec2)
    relative: wp.array(dtype=wp.vec3)
    density: wp.array(dtype=wp.vec3)
    slack: wp.array(dtype=wp.float32)
    receiver: wp.array(dtype=wp.int32)
    time: wp.array(dtype=wp.float32)
    long_axis: wp.array(dtype=wp.vec3)
    reach: wp.array(dtype=wp.vec3)
    clamped: wp.array(dtype=wp.int32)


@wp.struct
class PieceArrays:
    """Swept footprints cut across their long axis, one row a piece: what is long and lies askew fills its box badly.

    Pieces of a footprint follow each other, ``number`` counts them. They are equal boxes on a line, so that those
    that meet another box follow each other, too.
    """

    footprint: wp.array(dtype=wp.int32)
    number: wp.array(dtype=wp.int32)
    lower: wp.array(dtype=wp.vec3)
    upper: wp.array(dtype=wp.vec3)


@wp.func
def _along(a: wp.vec3, b: wp.vec3, c: wp.vec3, way: wp.vec3) -> wp.vec3:
    """How far ``way`` goes along each of three axes."""
    return wp.vec3(wp.abs(wp.dot(a, way)), wp.abs(wp.dot(b, way)), wp.abs(wp.dot(c, way)))


@cache
def footprint_kernel(radial: bool, curved: bool) -> wp.Kernel:
    """The kernel that shapes footprints, for radial kernels or the B-spline, which may go bent ways."""
    scale = 2.0 if radial else 1.0

    @wp.kernel(module="unique", enable_backward=False)
    def shape_footprints(
        base: int,
        # In
        dxdu: wp.array(dtype=wp.vec3),
        dxdv: wp.array(dtype=wp.vec3),
        dxdudt: wp.array(dtype=wp.vec3),
        dxdvdt: wp.array(dtype=wp.vec3),
        receiver_motion: wp.array(dtype=wp.vec3),
        flux: wp.array(dtype=wp.vec3),
        smoothing: float,
        pixel: PixelSize,
        # In (center, normal, dxdt, bend, jerk) and out (all else)
        out: FootprintArrays,
    ):
        i = base + wp.tid()
        n = out.normal[i]
        x = out.center[i]
        dxdt = out.dxdt[i]
        e1 = wp.vec3(0.0, -n[2], n[1])
        if wp.abs(n[0]) > 0.5:
            e1 = wp.vec3(n[2], 0.0, -n[0])
        e1 = wp.normalize(e1)
        e2 = wp.cross(n, e1)
        a = wp.dot(e1, dxdu[i]) * smoothing
        b = wp.dot(e1, dxdv[i]) * smoothing
        c = wp.dot(e2, dxdu[i]) * smoothing
        d = wp.dot(e2, dxdv[i]) * smoothing

        # J = R(left) diag(s1, s2) R(right)ᵀ, the singular value decomposition of a 2×2 matrix; s2 carries the sign.
        sum_angle = wp.atan2(c - b, a + d)
        difference_angle = wp.atan2(c + b, a - d)
        q = 0.5 * wp.sqrt((a + d) * (a + d) + (c - b) * (c - b))
        r = 0.5 * wp.sqrt((a - d) * (a - d) + (c + b) * (c + b))
        s1 = q + r
        s2 = q - r
        left = 0.5 * (sum_angle + difference_angle)
        right = 0.5 * (difference_angle - sum_angle)

        side = pixel.base + pixel.slope * wp.length(x - pixel.eye)
        askew = float(1.0)
        if wp.static(not radial):
            lengths = wp.sqrt((a * a + c * c) * (b * b + d * d))
            if lengths > 0.0:
                askew = wp.sqrt(wp.min(wp.abs(a * b + c * d) / lengths, 1.0))
            else:
                askew = 0.0
        boxed = side * wp.sqrt(1.0 - askew)
        widening = (askew / 3.0) * side * side
        clamped = int(0)
        t1 = wp.max(wp.sqrt(s1 * s1 + widening), BOX_DEVIATION * boxed)
        t2 = wp.max(wp.sqrt(s2 * s2 + widening), BOX_DEVIATION * boxed)
        if t1 > LONGEST_AXIS:
            t1 = LONGEST_AXIS
            t2 = wp.min(t2, LONGEST_AXIS)
            clamped = 1
        smallest = wp.max(t1 / LARGEST_ASPECT, wp.max(SMALLEST_AXIS * wp.length(x), SMALLEST_OF_ALL))
        if t2 < smallest:
            t2 = smallest
            clamped = 1
        t1 = wp.max(t1, t2)
        sign = float(1.0)
        if s2 < 0.0:
            sign = -1.0

        cl = wp.cos(left)
        sl = wp.sin(left)
        cr = wp.cos(right)
        sr = wp.sin(right)
        left1 = cl * e1 + sl * e2
        left2 = cl * e2 - sl * e1
        row_u = (cr / t1) * left1 - (sign * sr / t2) * left2
        row_v = (sr / t1) * left1 + (sign * cr / t2) * left2

        out.row_u[i] = wp.static(scale) * row_u
        out.row_v[i] = wp.static(scale) * row_v
        out.relative[i] = dxdt - receiver_motion[i]
        out.density[i] = flux[i] * (wp.static(scale * scale) / (t1 * t2))
        out.clamped[i] = clamped
        along = 0.5 * t1
        across = 0.5 * t2
        if wp.static(not radial):
            length_u = wp.sqrt(cr * cr * t1 * t1 + sr * sr * t2 * t2)
            length_v = wp.sqrt(sr * sr * t1 * t1 + cr * cr * t2 * t2)
            box = wp.vec2(boxed / length_u, boxed / length_v)
            if box[0] < SMALLEST_BOX:
                box[0] = 0.0
            if box[1] < SMALLEST_BOX:
                box[1] = 0.0
            out.box[i] = box
            reach_u = wp.static(SUPPORT) + 0.5 * box[0]
            reach_v = wp.static(SUPPORT) + 0.5 * box[1]
            along = t1 * (wp.abs(cr) * reach_u + wp.abs(sr) * reach_v)
            across = t2 * (wp.abs(sr) * reach_u + wp.abs(cr) * reach_v)
        # How far the footprint goes to either side along these axes and off its plane.
        aside = 0.5 * _along(left1, left2, n, dxdt)
        stray = 0.5 * wp.length(out.relative[i])
        if wp.static(curved):
            bend = out.bend[i]
            jerk = out.jerk[i]
            aside += 0.125 * _along(left1, left2, n, bend) + _along(left1, left2, n, jerk) / 48.0
            stray += 0.125 * wp.length(bend) + wp.length(jerk) / 48.0
            # How singular values change up to either end of the shutter, by their own size. What they were widened by
            # stays; what axes turn by does, too: to follow that costs time and gains nothing.
            right1 = (0.5 * smoothing) * (cr * dxdudt[i] + sr * dxdvdt[i])
            right2 = (0.5 * smoothing) * (cr * dxdvdt[i] - sr * dxdudt[i])
            grown1 = wp.min(s1 / t1, 1.0) * wp.dot(left1, right1) / t1
            grown2 = wp.clamp(s2 / t2, -1.0, 1.0) * wp.dot(left2, right2) / t2
            grown1 = wp.clamp(grown1, -MOST_GROWTH, MOST_GROWTH)
            grown2 = wp.clamp(grown2, -MOST_GROWTH, MOST_GROWTH)
            turn = wp.mat22(cr, -sr, sr, cr)
            out.stretch[i] = 2.0 * (turn * wp.mat22(grown1, 0.0, 0.0, grown2) * wp.transpose(turn))
            along *= 1.0 + wp.abs(grown1)
            across *= 1.0 + wp.abs(grown2)
        out.slack[i] = SLACK * (along + across + stray)
        along += aside[0]
        across += aside[1]
        if along >= across:
            out.long_axis[i] = left1
            out.reach[i] = wp.vec3(along, across, out.slack[i] + aside[2])
        else:
            out.long_axis[i] = left2
            out.reach[i] = wp.vec3(across, along, out.slack[i] + aside[2])

    return shape_footprints


@wp.kernel(enable_backward=False)
def bound_pieces(
    base: int,
    # In
    footprints: FootprintArrays,
    counts: wp.array(dtype=wp.int32),
    # Out
    out: PieceArrays,
):
    """Bounds of the pieces of what a footprint sweeps over in the photon's own part of the shutter."""
    i = base + wp.tid()
    j = out.footprint[i]
    count = counts[j]
    reach = footprints.reach[j]
    n = footprints.normal[j]
    axis = footprints.long_axis[j]
    other = wp.cross(n, axis)
    half = reach[0] / float(count)
    center = footprints.center[j] + ((2.0 * float(out.number[i]) + 1.0) * half - reach[0]) * axis
    for k in range(3):
        extent = half * wp.abs(axis[k]) + reach[1] * wp.abs(other[k]) + reach[2] * wp.abs(n[k])
        out.lower[i][k] = center[k] - extent
        out.upper[i][k] = center[k] + extent


@dataclass
class FootprintMap:
    """Footprints of one or more (sub-)shutters with the BVH over their swept bounds.

    Attributes:
        arrays: Device arrays, one row a footprint.
        pieces: The parts that ``bvh`` is built over.
        bvh: Bounds of the pieces, swept over their own part of the shutter.
        duration: Part of the shutter that each footprint's ``dxdt`` spans.
        moves: Whether any footprint moves.
        curved: Whether any goes a bent way.
        reach: Half the typical size of a piece: queries this close together are gathered together.
        clamped: Footprints whose length or aspect was limited.
        count: Number of footprints.
    """

    arrays: FootprintArrays
    pieces: PieceArrays
    bvh: wp.Bvh | None
    duration: float
    moves: bool
    curved: bool
    reach: float
    clamped: int
    count: int


def shape_footprints(
    maps: list[PhotonMap], kernel: str, smoothing: float, pixel: PixelSize, moves: bool, launcher: Launcher
) -> FootprintMap:
    """Shapes the footprints of all photons in ``maps`` (equal durations) and builds the BVH over their bounds."""
    count = sum(len(photons) for photons in maps)
    duration = maps[0].duration if maps else 1.0
    curved = any(photons.curve is not None for photons in maps)
    if not count:
        arrays = launcher.rows(FootprintArrays, 0)
        return FootprintMap(arrays, PieceArrays(), None, duration, moves, curved, 0.0, 0, 0)

    def column(name: str) -> wp.array:
        return launcher.array(joined([getattr(photons, name) for photons in maps]), wp.vec3)

    # Columns that footprints share with photons are not copied: ten million of either fill memory.
    shared = {"center": "position", "normal": "normal", "dxdt": "dxdt"}
    out = launcher.rows(FootprintArrays, count, but=(*shared, "receiver", "time", "bend", "jerk", "stretch", "box"))
    for name, source in shared.items():
        setattr(out, name, column(source))
    rows = count if curved else 0
    out.bend, out.jerk, changes_u, changes_v = (
        launcher.array(joined([_change(photons, name) for photons in maps]), wp.vec3)
        if curved
        else launcher.zeros(0, wp.vec3)
        for name in ("dxdtt", "dxdttt", "dxdut", "dxdvt")
    )
    out.stretch = launcher.zeros(rows, wp.mat22)
    out.box = launcher.zeros(count if kernel == "bspline" else 0, wp.vec2)
    columns = [column("dxdu"), column("dxdv"), changes_u, changes_v, column("receiver_motion"), column("flux")]
    out.receiver = launcher.array(joined([m.receiver for m in maps]), wp.int32)
    times = np.concatenate([np.full(len(m), m.time, np.float32) for m in maps])
    out.time = launcher.array(times, wp.float32)
    shape = footprint_kernel(kernel != "bspline", curved)
    launcher(shape, count, [*columns, float(smoothing), pixel, out])
    along, across = out.reach.numpy().T[:2]
    counts = np.ceil(along / np.maximum(across, np.median(across))).clip(1, MOST_PIECES).astype(np.int32)
    owners = np.repeat(np.arange(count, dtype=np.int32), counts)
    numbers = np.arange(len(owners), dtype=np.int32) - np.repeat(np.cumsum(counts, dtype=np.int32) - counts, counts)
    pieces = launcher.rows(PieceArrays, len(owners))
    pieces.footprint, pieces.number = launcher.array(owners, wp.int32), launcher.array(numbers, wp.int32)
    launcher(bound_pieces, len(owners), [out, launcher.array(counts, wp.int32), pieces])
    reach = float(np.median(np.linalg.norm(pieces.upper.numpy() - pieces.lower.numpy(), axis=1)))
    clamped = int(out.clamped.numpy().sum(dtype=np.int64))
    return FootprintMap(
        out, pieces, wp.Bvh(pieces.lower, pieces.upper), duration, moves, curved, 0.5 * reach, clamped, count
    )


def _change(photons: PhotonMap, name: str) -> np.ndarray:
    """A column of what bends the ways of photons, zero where they go straight."""
    return np.zeros_like(photons.position) if photons.curve is None else getattr(photons.curve, name)
