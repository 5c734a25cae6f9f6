"""Pixels that see several surfaces: how much of each is told by more rays than light is looked up for.

Light on a surface is averaged over the pixel at once (:mod:`.merging`), however few samples look at it. How much of the
pixel that surface fills is not: of four samples two or three meet what fills .6 of it. So where the samples of a pixel
do not lie on one surface, or see it both directly and otherwise, they are taken again, more rays for each at times all
over its part of the shutter, and what these see of one surface in one way is looked up as few times as before.

Beyond the paper, which has no pixels.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.view.merging import SMALLEST_BETWEEN, on_one_plane
from tpdwarp.view.visibility import TURNED

# Rays that tell how much of a pixel each surface fills, those of its samples included. Chosen by measurement: under a
# lens the edges of a box on the floor err by .25 with four, by .056 with 64 and by .031 with 256.
RAYS_OF_PIXEL = 64


def rays_of_sample(samples: int) -> int:
    """How many rays stand for each sample of a pixel that sees several surfaces; 1 where more tell nothing.

    Args:
        samples: Samples a pixel; of a single one nobody knows what else the pixel sees.
    """
    return max(1, RAYS_OF_PIXEL // samples) if samples > 1 else 1


@wp.kernel(enable_backward=False)
def find_mixed(
    base: int,
    # In
    samples: int,
    size: PixelSize,
    queries: QueryArrays,
    flags: wp.array(dtype=wp.int32),
    # Out
    mixed: wp.array(dtype=wp.int32),
):
    """1 for pixels whose samples see several objects or faces of one, or one both directly and otherwise; else 0."""
    pixel = base + wp.tid()
    first = pixel * samples
    moves = bool(False)
    if queries.motion.shape[0] > 0:
        for i in range(first, first + samples):
            if queries.receiver[i] >= 0 and wp.length_sq(queries.motion[i]) > 0.0:
                moves = True
    found = int(0)
    for i in range(first + 1, first + samples):
        if ((flags[i] ^ flags[first]) & TURNED) != 0:
            # Even where neither ends on anything: what is behind glass is not what is beside it, nor is alpha.
            found = 1
        elif queries.receiver[i] != queries.receiver[first]:
            found = 1
        elif queries.receiver[i] >= 0:
            if moves:
                # Samples of other times lie elsewhere.
                if wp.dot(queries.normal[i], queries.normal[first]) < SMALLEST_BETWEEN:
                    found = 1
            elif not on_one_plane(queries, first, i, size):
                found = 1
    mixed[pixel] = found


def mixed_pixels(
    queries: QueryArrays, flags: wp.array, samples: int, size: PixelSize, launcher: Launcher
) -> wp.array:
    """Which pixels see several surfaces, or one in several ways, int32 [pixels].

    Args:
        queries: Where first paths ended, as many of each pixel, pixel by pixel.
        flags: What is known of their paths (:class:`~tpdwarp.view.visibility.PathFlag`), int32 [n].
        samples: How many.
        size: What a query stands for.
        launcher: Where.
    """
    count = queries.receiver.shape[0] // samples
    mixed = launcher.zeros(count, wp.int32)
    launcher(find_mixed, count, [samples, size, queries, flags, mixed])
    return mixed
