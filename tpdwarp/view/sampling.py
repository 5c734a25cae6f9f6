"""Where on the film and when in the shutter camera samples are taken; the same for every frame, so nothing flickers."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tpdwarp.io.image_region import ImageRegion

# The golden ratio: steps by it, modulo one, are spread evenly however many there are.
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
# Times of the shutter at which the view is taken at least; the scene's BVH is refitted for each. Chosen, not derived.
LEAST_TIMES = 16
# By how many of the eight ways to mirror a lattice each part of a pixel is on from the last: odd, so that neighbours
# are mirrored differently, and some are transposed. Chosen, not derived.
MIRRORED_BY = 3
# Sides of the blocks, in pixels, in which pixels follow each other, and of the blocks within these: small, so that runs
# of queries and their leaves are compact. Chosen, not derived.
BLOCK, INNER_BLOCK = 8, 4


def film_positions(pixels: np.ndarray, width: int, samples: int, seed: int) -> np.ndarray:
    """Film coordinates [n · samples, 2], in pixels, of all samples of ``pixels`` [n], pixel by pixel.

    Samples of each part of a pixel (:func:`part_count`) are a golden-ratio lattice that is symmetric about its centre:
    their mean is exact where light varies linearly, as that of the centre alone is, and scattered positions' is not.
    All parts have as many, so that the queries that they are merged to cover the pixel evenly: no part of a focus
    within it counts more than another. Mirrored and ordered at random, lattices differ from part to part and from pixel
    to pixel.
    """
    across = part_count(samples)
    count = samples // across**2
    t = np.arange(count) - 0.5 * (count - 1)
    lattice = np.stack([t / count, (GOLDEN * t + 0.5) % 1.0 - 0.5], axis=1)
    signs = 1.0 - 2.0 * (np.arange(4)[:, None] >> np.array([0, 1]) & 1)
    # One row for each of the eight ways to mirror it.
    offsets = np.concatenate([signs[:, None] * lattice, signs[:, None] * lattice[:, ::-1]])
    order, part = np.divmod(np.arange(samples), across**2)
    mirrored = (np.arange(8)[:, None] + MIRRORED_BY * part) % 8
    within = (np.stack([part % across, part // across], axis=1) + 0.5 + offsets[mirrored, order]) / across
    # Twice, so that from whichever is first as many follow.
    within = np.concatenate([within, within], axis=1).reshape(-1, 2)
    first, mirror = ((_uniform(pixels, seed + k) * n).astype(np.int32) for k, n in enumerate((samples, 8)))
    rows = (2 * samples * mirror + first)[:, None] + np.arange(samples, dtype=np.int32)
    corners = np.stack([pixels % width, pixels // width], axis=1)
    return (within.take(rows, axis=0) + corners[:, None]).reshape(-1, 2)


def part_count(samples: int) -> int:
    """Into how many parts, along either side, a pixel is cut for its light: as many samples in each, four or more."""
    return max((n for n in range(1, math.isqrt(samples) // 2 + 1) if samples % n**2 == 0), default=1)


def parts_of(films: np.ndarray, pixels: np.ndarray, width: int, count: int) -> np.ndarray:
    """Which of the ``count``² parts of their pixel film positions [n, 2] lie in, shape [n]."""
    corner = np.stack([pixels % width, pixels // width], axis=1)
    x, y = ((films - corner) * count).astype(np.int64).clip(0, count - 1).T
    return y * count + x


def time_count(samples: int) -> int:
    """How many times of the shutter are looked at; a multiple of the samples a pixel."""
    return samples * max(1, -(-LEAST_TIMES // samples))


def block_order(width: int, height: int) -> np.ndarray:
    """All pixels, block by block, so that what follows each other in the list lies together in the image."""
    across, down = -(-width // BLOCK), -(-height // BLOCK)
    y, x = np.indices((down * BLOCK, across * BLOCK))
    numbers = np.where((x < width) & (y < height), y * width + x, -1)
    inner = BLOCK // INNER_BLOCK, INNER_BLOCK
    # Rows and columns of blocks, of blocks within these, of pixels within those.
    numbers = numbers.reshape(down, *inner, across, *inner).transpose(0, 3, 1, 4, 2, 5).ravel()
    return numbers[numbers >= 0]


def region_order(region: ImageRegion) -> tuple[np.ndarray, np.ndarray]:
    """The pixels of a part of an image, in the order of the whole: their numbers in the image, and in the part."""
    pixels = block_order(region.width, region.height)
    y, x = np.divmod(pixels, region.width)
    inside = (x >= region.first) & (x < region.end) & (y >= region.above) & (y < region.below)
    return pixels[inside], ((y - region.above) * region.size[0] + x - region.first)[inside]


def pixel_grid(width: int, height: int, most: int, seed: int) -> np.ndarray:
    """At most about ``most`` pixels, one in each of equal parts of the image, row by row."""
    stride = max(1.0, math.sqrt(width * height / most))
    across, down = math.ceil(width / stride), math.ceil(height / stride)
    part = np.arange(across * down)
    x = ((part % across + _uniform(part, seed)) * width / across).astype(np.int64)
    y = ((part // across + _uniform(part, seed + 1)) * height / down).astype(np.int64)
    return np.unique(y * width + x)


def samples_by_time(
    times: int, pixels: np.ndarray, samples: int, seed: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """For each of ``times`` slices of the shutter, places in ``pixels`` and sample numbers that look at it.

    Each pixel's samples are spread evenly over the slices, starting at a random one.
    """
    if times == 1:
        yield np.repeat(np.arange(len(pixels)), samples), np.tile(np.arange(samples), len(pixels))
        return
    stride = times // samples
    offset = (_uniform(pixels, seed + 2) * stride).astype(np.int32)
    starting = [np.flatnonzero(offset == start) for start in range(stride)]
    for number in range(times):
        chosen = starting[number % stride]
        yield chosen, np.full(len(chosen), number // stride)


def rays_by_time(times: int, count: int, samples: int, rays: int) -> Iterator[np.ndarray]:
    """For each of ``times`` slices of the shutter, which of so many rays a sample of ``count`` pixels look at it.

    Rays are numbered pixel by pixel and sample by sample, as :func:`film_positions` has them. Those of a sample are
    spread over all slices of its part of the shutter, so that those of any slice lie everywhere in the pixel.
    """
    stride = times // samples if times > 1 else 1
    ray = np.arange(rays)
    slices = (ray + ray // part_count(samples * rays)) % stride
    first = np.arange(count) * samples * rays
    for number in range(times):
        if times == 1:
            yield np.arange(count * samples * rays, dtype=np.int32)
            return
        sample, within = divmod(number, stride)
        yield (first[:, None] + sample * rays + np.flatnonzero(slices == within)).ravel().astype(np.int32)


def _uniform(index: np.ndarray, seed: int) -> np.ndarray:
    """A fixed pseudo-random number in [0, 1) for each index (PCG output hash, Jarzynski & Olano 2020)."""
    with np.errstate(over="ignore"):
        state = (index.astype(np.uint32) + np.uint32(seed * 2654435761 % 2**32)) * np.uint32(747796405)
        state += np.uint32(2891336453)
        word = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
        return ((word >> np.uint32(22)) ^ word) / 2.0**32
