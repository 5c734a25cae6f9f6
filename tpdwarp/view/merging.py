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


@wp.func
def alike(queries: QueryArrays, spots: wp.array(dtype=wp.int32), i: int, j: int) -> bool:
    """Whether two rows are of the same spot on the same object; without ``spots``, all rows of a pixel are of one."""
    same = queries.receiver[i] == queries.receiver[j]
    if spots.shape[0] > 0:
        same = same and spots[i] == spots[j]
    return same


@wp.kernel(enable_backward=False)
def merge_rows(
    base: int,
    # In
    begins: wp.array(dtype=wp.int32),
    spots: wp.array(dtype=wp.int32),
    size: PixelSize,
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
                if alike(queries, spots, i, j):
                    position += wp.vec3d(queries.position[j])
                    normal += wp.vec3d(queries.normal[j])
                    if queries.shading_normal.shape[0] > 0:
                        shading_normal += wp.vec3d(queries.shading_normal[j])
                    weight += weights[j]
                    count += 1
            middle = wp.vec3(position / wp.float64(count))
            facing = wp.vec3(wp.normalize(normal))

            # ---- One query, or as many as there are rows
            together = bool(True)
            for j in range(i, last):
                if alike(queries, spots, i, j):
                    apart = in_sides(size, middle, queries.position[j] - middle)
                    if wp.max(wp.abs(apart)) > LARGEST_DISTANCE or wp.dot(queries.normal[j], facing) < SMALLEST_COSINE:
                        together = False
            for j in range(i, last):
                if alike(queries, spots, i, j):
                    counts[j] = 1
                    if together and j > i:
                        counts[j] = 0
                        queries.receiver[j] = -1
            if together:
                counts[i] = count
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

    Returns:
        How many points each row stands for, shape [n].
    """
    counts = launcher.zeros(queries.receiver.shape[0], wp.int32)
    parts = launcher.array(np.zeros(0) if spots is None else spots, wp.int32)
    inputs = [launcher.array(begins, wp.int32), parts, size, queries, weights, counts]
    launcher(merge_rows, len(begins) - 1, inputs)
    return counts.numpy()
