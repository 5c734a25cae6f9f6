"""Bounds of what footprints sweep over, cut into pieces that fill their boxes well."""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.shaping import FootprintArrays

# Pieces that the longest footprints are cut into; more of them fill boxes little better. Chosen, not derived.
MOST_PIECES = 32


@wp.struct
class PieceArrays:
    """Swept footprints cut across their long axis, one row a piece: what is long and oblique fills its box badly.

    Pieces of a footprint follow each other, ``number`` counts them. They are equal boxes on a line, so that those
    that meet another box follow each other, too.
    """

    footprint: wp.array(dtype=wp.int32)
    number: wp.array(dtype=wp.int32)
    lower: wp.array(dtype=wp.vec3)
    upper: wp.array(dtype=wp.vec3)


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
    extent = footprints.half_extent[j]
    n = footprints.normal[j]
    axis = footprints.long_axis[j]
    other = wp.cross(n, axis)
    half = extent[0] / float(count)
    center = footprints.center[j] + ((2.0 * float(out.number[i]) + 1.0) * half - extent[0]) * axis
    for k in range(3):
        size = half * wp.abs(axis[k]) + extent[1] * wp.abs(other[k]) + extent[2] * wp.abs(n[k])
        out.lower[i][k] = center[k] - size
        out.upper[i][k] = center[k] + size


def pieces_of(footprints: FootprintArrays, launcher: Launcher) -> PieceArrays:
    """The pieces of all ``footprints``: as many as a footprint is longer than wide, or than others are wide."""
    along, across = footprints.half_extent.numpy().T[:2]
    counts = np.ceil(along / np.maximum(across, np.median(across))).clip(1, MOST_PIECES).astype(np.int32)
    owners = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    numbers = np.arange(len(owners), dtype=np.int32) - np.repeat(np.cumsum(counts, dtype=np.int32) - counts, counts)
    pieces = launcher.rows(PieceArrays, len(owners), but=("footprint", "number"))
    pieces.footprint, pieces.number = launcher.array(owners, wp.int32), launcher.array(numbers, wp.int32)
    launcher(bound_pieces, len(owners), [footprints, launcher.array(counts, wp.int32), pieces])
    return pieces
