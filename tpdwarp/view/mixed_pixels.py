"""Pixels that see several surfaces: how much of each is told by more rays than light is looked up for.

Light on a surface is averaged over the pixel at once (:mod:`.merging`), however few samples look at it. How much of the
pixel that surface fills is not: of four samples two or three meet what fills .6 of it. So where the samples of a pixel
do not lie on one surface, first paths are followed again, more of them at each sample's time of the shutter, and what
they see of one surface is looked up as few times as before. Where anything that they meet moves, more rays at the same
few times would tell no more.

Beyond the paper, which has no pixels.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.view.merging import on_one_plane

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
    # Out
    mixed: wp.array(dtype=wp.int32),
):
    """1 for pixels whose samples see several objects, or planes of one, at rest; else 0."""
    pixel = base + wp.tid()
    first = pixel * samples
    found = int(0)
    for i in range(first, first + samples):
        if queries.receiver[first] >= 0 or queries.receiver[i] >= 0:
            if not on_one_plane(queries, first, i, size):
                found = 1
    if queries.motion.shape[0] > 0:
        for i in range(first, first + samples):
            if queries.receiver[i] >= 0 and wp.length_sq(queries.motion[i]) > 0.0:
                found = 0
    mixed[pixel] = found


def mixed_pixels(queries: QueryArrays, samples: int, size: PixelSize, launcher: Launcher) -> wp.array:
    """Which pixels see several surfaces, none of which moves, int32 [pixels].

    Args:
        queries: Where first paths ended, as many of each pixel, pixel by pixel.
        samples: How many.
        size: What a query stands for.
        launcher: Where.
    """
    count = queries.receiver.shape[0] // samples
    mixed = launcher.zeros(count, wp.int32)
    launcher(find_mixed, count, [samples, size, queries, mixed])
    return mixed
