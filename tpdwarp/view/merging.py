"""Merging visible points side by side: footprints are averaged over a pixel, so that one query serves them all."""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.view.camera import in_sides

# How far samples may lie from their middle, in sides of what they stand for together: on a plane half a side is the
# most, and half as much again is allowed for perspective and curvature. On what curves more, or is seen through glass,
# they spread over more, and each is looked up on its own.
LARGEST_DISTANCE = wp.constant(0.75)
# Normals of points that are put together lie within some 18° of their mean. Chosen, not derived.
SMALLEST_COSINE = wp.constant(0.95)
# So that no two of them face farther apart than twice that.
SMALLEST_BETWEEN = wp.constant(2.0 * 0.95**2 - 1.0)


@wp.func
def side_at(size: PixelSize, x: wp.vec3) -> float:
    """How wide what a query stands for is at x, across the view (beyond the paper)."""
    side = wp.max(wp.length(size.right), wp.length(size.up))
    if size.orthographic == 0:
        side *= wp.abs(wp.dot(x - size.eye, size.back))
    return side


@wp.func
def on_one_plane(queries: QueryArrays, i: int, j: int, size: PixelSize) -> bool:
    """Whether two rows lie on one object and face one way, neither far above the other (beyond the paper)."""
    if queries.receiver[i] != queries.receiver[j]:
        return False
    if wp.dot(queries.normal[i], queries.normal[j]) < SMALLEST_BETWEEN:
        return False
    x = queries.position[i]
    return wp.abs(wp.dot(queries.position[j] - x, queries.normal[i])) <= LARGEST_DISTANCE * side_at(size, x)


@wp.func
def alike(queries: QueryArrays, spots: wp.array(dtype=wp.int32), i: int, j: int, size: PixelSize) -> bool:
    """Whether two rows are of the same spot on the same surface; without ``spots``, all rows of a pixel are of one."""
    if spots.shape[0] > 0:
        if spots[i] != spots[j]:
            return False
    return on_one_plane(queries, i, j, size)


@wp.kernel(enable_backward=False)
def merge_rows(
    base: int,
    # In
    begins: wp.array(dtype=wp.int32),
    spots: wp.array(dtype=wp.int32),
    size: PixelSize,
    rays: int,
    # In and out
    queries: QueryArrays,
    weights: wp.array(dtype=wp.vec3),
    # Out
    counts: wp.array(dtype=wp.int32),
):
    """Puts rows of a pixel together where they lie close together and face one way; the first takes the others in."""
    pixel = base + wp.tid()
    last = begins[pixel + 1]
    for i in range(begins[pixel], last):
        if queries.receiver[i] >= 0 and counts[i] == 0:
            # ---- The middle of the rows that are of one spot
            position = wp.vec3d()
            normal = wp.vec3d()
            shading_normal = wp.vec3d()
            weight = wp.vec3()
            count = int(0)
            for j in range(i, last):
                if alike(queries, spots, i, j, size):
                    position += wp.vec3d(queries.position[j])
                    normal += wp.vec3d(queries.normal[j])
                    if queries.shading_normal.shape[0] > 0:
                        shading_normal += wp.vec3d(queries.shading_normal[j])
                    weight += weights[j]
                    count += 1
            middle = wp.vec3(position / wp.float64(count))
            facing = wp.vec3(wp.normalize(normal))

            # ---- One query, or one for each so many rows
            together = bool(True)
            for j in range(i, last):
                if alike(queries, spots, i, j, size):
                    apart = in_sides(size, middle, queries.position[j] - middle)
                    if wp.max(wp.abs(apart)) > LARGEST_DISTANCE or wp.dot(queries.normal[j], facing) < SMALLEST_COSINE:
                        together = False
            taker = int(i)
            found = int(0)
            for j in range(i, last):
                if alike(queries, spots, i, j, size):
                    if not together and found % rays == 0:
                        taker = j
                    found += 1
                    if j == taker:
                        counts[j] = 1
                    else:
                        counts[taker] = counts[taker] + 1
                        weights[taker] = weights[taker] + weights[j]
                        queries.receiver[j] = -1
            if together:
                weights[i] = weight
                queries.position[i] = middle
                queries.normal[i] = facing
                if queries.shading_normal.shape[0] > 0:
                    # Not of unit length: irradiance goes with the mean of cosines.
                    queries.shading_normal[i] = wp.vec3(shading_normal / wp.float64(count))


def merge(
    queries: QueryArrays,
    weights: wp.array,
    begins: np.ndarray,
    spots: np.ndarray | None,
    size: PixelSize,
    launcher: Launcher,
    rays: int = 1,
) -> np.ndarray:
    """Puts visible points of the same spot on the same object together, in place, as far as they are close and alike.

    Args:
        queries: The points, pixel by pixel, in one piece for each; rows whose receiver is −1 are none. Of those that
            are put together the first becomes their middle, and the receiver of the others becomes −1.
        weights: Their weights, which add up, vec3.
        begins: Where the rows of each pixel begin, and where the last ones end, shape [pixels + 1].
        spots: The part of its pixel that each point lies in, shape [n]; None where pixels have one part.
        size: What a spot stands for.
        launcher: Where.
        rays: So many points of a spot on an object that are not put together are looked up as one of them.

    Returns:
        How many points each row stands for, shape [n].
    """
    counts = launcher.zeros(queries.receiver.shape[0], wp.int32)
    parts = launcher.array(np.zeros(0) if spots is None else spots, wp.int32)
    inputs = [launcher.array(begins, wp.int32), parts, size, rays, queries, weights, counts]
    launcher(merge_rows, len(begins) - 1, inputs)
    return counts.numpy()
