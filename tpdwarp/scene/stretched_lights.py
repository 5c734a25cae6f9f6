"""Spheres and cylinders that a transform makes ellipsoids and oval tubes: a few flat lights that cover them.

The image of a flat piece is flat under any transform, and so is that of its area as a vector: faces that look as wide
as a sphere from all sides look as wide as an ellipsoid, within the same part.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tpdwarp.scene.description import EmissionProfile, Extent, ExtentShape, LightAtShutter

# What is stretched by no more than this part stays what it was: it looks as wide as that within two thirds of this, as
# its faces do within 5.5 %. They are many lights, which take many times as long as one.
UNEVEN = 0.08
# A cylinder whose ends lean by more than this part of its width does not. Chosen, not derived.
ASKEW = 0.02
# Faces around a tube, which they leave as wide within 1 − cos 15°, 3 %. Chosen, not derived.
AROUND = 12
# What is flattened is still so thick, by its width: which side of it is which stays known. Chosen, not derived.
THINNEST = 1.0e-4
# Directions of the faces of an icosahedron, and how far from its middle they lie where its area is a unit sphere's.
GOLDEN_RATIO = 0.5 * (1.0 + math.sqrt(5.0))
FACE_DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    + [
        np.roll((0.0, side / GOLDEN_RATIO, other * GOLDEN_RATIO), turn)
        for turn in range(3)
        for side in (-1, 1)
        for other in (-1, 1)
    ]
) / math.sqrt(3.0)
FACE_DISTANCE = 0.9105


def area_stretched(normals: np.ndarray, weights: np.ndarray, rows: np.ndarray) -> float:
    """By how much a transform enlarges a surface.

    Args:
        normals: Unit normals of its parts, shape [n, 3].
        weights: Their shares of its area, shape [n].
        rows: The linear part of the transform, shape [3, 3]: rows are the images of x, y and z.
    """
    x, y, z = rows
    vectors = normals @ np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
    return float(weights @ np.linalg.norm(vectors, axis=1))


def is_stretched(shape: ExtentShape, rows: np.ndarray) -> bool:
    """Whether a sphere is an ellipsoid under a transform, or a cylinder oval or askew; ``rows`` as above."""
    scales = np.linalg.svd(rows if shape == ExtentShape.ROUND else rows[1:], compute_uv=False)
    uneven = scales[0] > (1.0 + UNEVEN) * scales[-1]
    if shape == ExtentShape.ROUND or uneven:
        return bool(uneven)
    x = rows[0] / max(float(np.linalg.norm(rows[0])), np.finfo(float).tiny)
    return bool(np.linalg.norm(rows[1:] @ x) > ASKEW * scales[0])


def faces_of(
    light: LightAtShutter, radius: float, length: float, rows: np.ndarray, rows_motion: np.ndarray
) -> list[LightAtShutter]:
    """Flat lights in the place of a sphere or cylinder under a transform; their paths are its own with a number.

    Args:
        light: The light, of all their power.
        radius: In its own space.
        length: Of a cylinder, in its own space.
        rows: The linear part of its transform at mid shutter, shape [3, 3]: rows are the images of x, y and z.
        rows_motion: Change of that over the shutter, shape [3, 3].
    """
    round_one = light.extent.shape == ExtentShape.ROUND
    middles, spans = _faces_of_sphere(radius) if round_one else _faces_of_tube(radius, length)
    shape, of_all = (ExtentShape.DISK, 4.0) if round_one else (ExtentShape.RECT, math.pi)
    opened, there, closed = (_thick(rows + part * rows_motion) for part in (-0.5, 0.0, 0.5))
    areas = np.linalg.norm(np.cross(*np.moveaxis(spans @ there, 1, 0)), axis=1)
    faces = []
    for number, (middle, sides, share) in enumerate(zip(middles, spans, areas / areas.sum(), strict=True)):
        before, axes, after = (_axes(middle @ at, sides @ at) for at in (opened, there, closed))
        face = replace(
            light,
            path=f"{light.path}[{number}]",
            power=tuple(of_all * float(share) * channel for channel in light.power),
            position=light.position + middle @ there,
            position_motion=light.position_motion + middle @ (closed - opened),
            axes=axes,
            axes_motion=after - before,
            shaped_about=None if light.shaping is None else light.cone_axis,
            profile=EmissionProfile.COSINE,
            extent=Extent(shape, 0.0, sides @ there, sides @ (closed - opened)),
        )
        faces.append(face)
    return faces


def _faces_of_sphere(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Middles [n, 3] and half axes [n, 2, 3] of discs that together have the area of a sphere."""
    size = radius * math.sqrt(4.0 / len(FACE_DIRECTIONS))
    return radius * FACE_DISTANCE * FACE_DIRECTIONS, size * np.array([_across(face) for face in FACE_DIRECTIONS])


def _faces_of_tube(radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Middles [n, 3] and half sides [n, 2, 3] of the faces of a prism that is as far around as a cylinder."""
    half = math.pi / AROUND
    turns = 2.0 * half * np.arange(AROUND)
    off, along = np.zeros(AROUND), np.tile([0.5 * length, 0.0, 0.0], (AROUND, 1))
    outward = np.stack([off, np.cos(turns), np.sin(turns)], axis=1)
    around = np.stack([off, -np.sin(turns), np.cos(turns)], axis=1)
    return radius * half / math.tan(half) * outward, np.stack([along, radius * half * around], axis=1)


def _thick(rows: np.ndarray) -> np.ndarray:
    """A transform that flattens nothing altogether."""
    u, scales, v = np.linalg.svd(rows)
    return (u * np.maximum(scales, THINNEST * scales[0])) @ v


def _across(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors across a unit direction and each other, shape [2, 3]."""
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _axes(middle: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Axes of a face that shines along −z, away from the middle of the light, shape [3, 3]."""
    inward = -np.cross(*sides)
    if inward @ middle > 0.0:
        inward = -inward
    x, z = (v / max(float(np.linalg.norm(v)), np.finfo(float).tiny) for v in (sides[0], inward))
    return np.stack([x, np.cross(z, x), z])
