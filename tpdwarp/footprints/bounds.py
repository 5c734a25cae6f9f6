"""Bounds of what footprints sweep over, cut into pieces that fill their boxes well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.morton import morton_codes
from tpdwarp.footprints.shaping import FootprintArrays

# Pieces that the longest footprints are cut into. Chosen: with 32 light of a blob takes as long to be looked up, and
# half as long again to be shaped.
MOST_PIECES = 8


@wp.struct
class Piece:
    """A part of a swept footprint, which is cut across its long axis: what is long and oblique fills its box badly.

    ``number`` counts the pieces of a footprint along the axis; ``low_before`` and ``high_before`` are the box of the
    one before. They are equal boxes on a line, so that those that meet another box follow each other.
    """

    footprint: int
    number: int
    low_before: wp.vec3
    high_before: wp.vec3


@wp.struct
class Sweeps:
    """What footprints sweep over: boxes about ``center``, with ``half_extent`` along ``long_axis``, across it and along
    ``normal``."""

    center: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    long_axis: wp.array(dtype=wp.vec3)
    half_extent: wp.array(dtype=wp.vec3)


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of footprints, neighbours side by side, as walks through a tree find them together.

    Attributes:
        rows: One for each.
        lower, upper: Their boxes.
        size: The typical diagonal of a box.
    """

    rows: wp.array
    lower: wp.array
    upper: wp.array
    size: float


@wp.kernel(enable_backward=False)
def bound_pieces(
    base: int,
    # In
    sweeps: Sweeps,
    counts: wp.array(dtype=wp.int32),
    owners: wp.array(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    chosen: wp.array(dtype=wp.int32),
    # Out
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
):
    """Bounds of the pieces of what a footprint sweeps over."""
    i = base + wp.tid()
    owner = owners[i]
    j = chosen[owner]
    count = counts[owner]
    extent = sweeps.half_extent[j]
    n = sweeps.normal[j]
    axis = sweeps.long_axis[j]
    other = wp.cross(n, axis)
    half = extent[0] / float(count)
    center = sweeps.center[j] + ((2.0 * float(i - first[owner]) + 1.0) * half - extent[0]) * axis
    for k in range(3):
        size = half * wp.abs(axis[k]) + extent[1] * wp.abs(other[k]) + extent[2] * wp.abs(n[k])
        lower[i][k] = center[k] - size
        upper[i][k] = center[k] + size


@wp.kernel(enable_backward=False)
def order_pieces(
    base: int,
    # In
    order: wp.array(dtype=wp.int32),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    owners: wp.array(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    chosen: wp.array(dtype=wp.int32),
    # Out
    rows: wp.array(dtype=Piece),
    low: wp.array(dtype=wp.vec3),
    high: wp.array(dtype=wp.vec3),
    sizes: wp.array(dtype=wp.float32),
):
    """Pieces in their order in space."""
    i = base + wp.tid()
    k = order[i]
    owner = owners[k]
    piece = Piece()
    piece.footprint = chosen[owner]
    piece.number = k - first[owner]
    if piece.number > 0:
        piece.low_before = lower[k - 1]
        piece.high_before = upper[k - 1]
    rows[i] = piece
    low[i] = lower[k]
    high[i] = upper[k]
    sizes[i] = wp.length(upper[k] - lower[k])


def whole_sweeps(footprints: FootprintArrays) -> Sweeps:
    """What footprints sweep over in the photons' own parts of the shutter."""
    out = Sweeps()
    for name in Sweeps.vars:
        setattr(out, name, getattr(footprints, name))
    return out


def pieces_of(sweeps: Sweeps, rows: np.ndarray, launcher: Launcher, most: int = MOST_PIECES) -> Pieces:
    """The pieces of some footprints: as many as a footprint is longer than wide, or than others are wide.

    Args:
        rows: Which of them, shape [n].
        most: How many a footprint has at most.
    """
    along, across = sweeps.half_extent.numpy()[rows, :2].T
    counts = np.ceil(along / np.maximum(across, np.median(across))).clip(1, most).astype(np.int32)
    ends = np.cumsum(counts, dtype=np.int32)
    count = int(ends[-1])
    owners, first, chosen = (
        launcher.array(values, wp.int32)
        for values in (np.repeat(np.arange(len(rows), dtype=np.int32), counts), ends - counts, rows.astype(np.int32))
    )
    lower, upper = (launcher.zeros(count, wp.vec3) for _ in range(2))
    launcher(bound_pieces, count, [sweeps, launcher.array(counts, wp.int32), owners, first, chosen, lower, upper])
    codes = morton_codes(0.5 * (lower.numpy() + upper.numpy()))
    order = launcher.array(np.argsort(codes, kind="stable").astype(np.int32), wp.int32)
    out = launcher.empty(count, Piece)
    low, high, sizes = (launcher.zeros(count, dtype) for dtype in (wp.vec3, wp.vec3, wp.float32))
    launcher(order_pieces, count, [order, lower, upper, owners, first, chosen, out, low, high, sizes])
    return Pieces(out, low, high, float(np.median(sizes.numpy())))
