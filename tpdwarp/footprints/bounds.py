"""Bounds of what footprints sweep over, cut into pieces that fill their boxes well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.morton import morton_codes
from tpdwarp.footprints.shaping import FootprintArrays

# Pieces that the longest footprints are cut into; more of them fill boxes little better. Chosen, not derived.
MOST_PIECES = 32


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


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of all footprints, neighbours side by side, as walks through a tree find them together.

    Attributes:
        rows: One for each.
        lower, upper: Their boxes.
    """

    rows: wp.array
    lower: wp.array
    upper: wp.array


@wp.kernel(enable_backward=False)
def bound_pieces(
    base: int,
    # In
    footprints: FootprintArrays,
    counts: wp.array(dtype=wp.int32),
    owners: wp.array(dtype=wp.int32),
    numbers: wp.array(dtype=wp.int32),
    # Out
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
):
    """Bounds of the pieces of what a footprint sweeps over in the photon's own part of the shutter."""
    i = base + wp.tid()
    j = owners[i]
    count = counts[j]
    extent = footprints.half_extent[j]
    n = footprints.normal[j]
    axis = footprints.long_axis[j]
    other = wp.cross(n, axis)
    half = extent[0] / float(count)
    center = footprints.center[j] + ((2.0 * float(numbers[i]) + 1.0) * half - extent[0]) * axis
    for k in range(3):
        size = half * wp.abs(axis[k]) + extent[1] * wp.abs(other[k]) + extent[2] * wp.abs(n[k])
        lower[i][k] = center[k] - size
        upper[i][k] = center[k] + size


def pieces_of(footprints: FootprintArrays, launcher: Launcher) -> Pieces:
    """The pieces of all ``footprints``: as many as a footprint is longer than wide, or than others are wide."""
    along, across = footprints.half_extent.numpy().T[:2]
    counts = np.ceil(along / np.maximum(across, np.median(across))).clip(1, MOST_PIECES).astype(np.int32)
    owners = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    numbers = np.arange(len(owners), dtype=np.int32) - np.repeat(np.cumsum(counts, dtype=np.int32) - counts, counts)
    lower, upper = (launcher.zeros(len(owners), wp.vec3) for _ in range(2))
    inputs = [launcher.array(values, wp.int32) for values in (counts, owners, numbers)]
    launcher(bound_pieces, len(owners), [footprints, *inputs, lower, upper])
    low, high = lower.numpy(), upper.numpy()
    rows = np.zeros(len(owners), Piece.numpy_dtype())
    rows["footprint"], rows["number"] = owners, numbers
    rows["low_before"][1:], rows["high_before"][1:] = low[:-1], high[:-1]
    order = np.argsort(morton_codes(0.5 * (low + high)), kind="stable")
    return Pieces(
        wp.array(rows[order], dtype=Piece, device=launcher.device),
        launcher.array(low[order], wp.vec3),
        launcher.array(high[order], wp.vec3),
    )
