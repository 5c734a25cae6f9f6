"""Spheres and cylinders that a transform makes ellipsoids and oval tubes: what stands in their place.

An ellipsoid is one light, which shines by the area that it shows. An oval tube is a few flat lights that cover it: the
image of a flat piece is flat under any transform, and so is that of its area as a vector, so that faces that look as
wide as a tube from all sides look as wide as an oval one, within the same part.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tpdwarp.scene.description import EmissionProfile, Extent, ExtentShape, LightAtShutter

# A sphere that is stretched by no more than this part stays one.
UNEVEN_SPHERE = 1e-3
# A cylinder that is stretched by no more than this part stays one: it looks as wide as that within two thirds of this,
# and its faces within .7 %. They are many lights, which take many times as long as one.
UNEVEN_TUBE = 0.08
# A cylinder whose ends lean by more than this part of its width does not. Chosen, not derived.
ASKEW = 0.02
# Faces around a tube: a prism of an odd number is as wide from all sides as one of twice as many, an edge of it
# standing opposite a face, within 1 − cos(π/26), .7 %. Chosen, not derived.
AROUND = 13
# What is flattened is still so thick, by its width: which side of it is which stays known. Chosen, not derived.
THINNEST = 1.0e-4
# Normals of a sphere, and of the side of a cylinder along x, with their shares of the area: of what has an edge where
# it is flattened altogether, sums of them are known within .1 %.
_HEIGHTS, _SHARES = np.polynomial.legendre.leggauss(32)
_TURNS = 2.0 * math.pi * np.arange(64) / 64
_CIRCLE = np.stack([np.zeros(64), np.cos(_TURNS), np.sin(_TURNS)], axis=1)
SPHERE_NORMALS = (
    np.concatenate([math.sqrt(1.0 - height**2) * _CIRCLE + [height, 0.0, 0.0] for height in _HEIGHTS]),
    np.repeat(_SHARES / 128.0, 64),
)
TUBE_NORMALS = _CIRCLE, np.full(64, 1.0 / 64)


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
    if shape == ExtentShape.ROUND:
        scales = np.linalg.svd(rows, compute_uv=False)
        return bool(scales[0] > (1.0 + UNEVEN_SPHERE) * scales[-1])
    scales = np.linalg.svd(rows[1:], compute_uv=False)
    if scales[0] > (1.0 + UNEVEN_TUBE) * scales[-1]:
        return True
    x = rows[0] / max(float(np.linalg.norm(rows[0])), np.finfo(float).tiny)
    return bool(np.linalg.norm(rows[1:] @ x) > ASKEW * scales[0])


def ellipsoid_of(
    light: LightAtShutter, radius: float, rows: np.ndarray, rows_motion: np.ndarray, radius_motion: float = 0.0
) -> LightAtShutter:
    """The light that a sphere is under a transform; arguments as those of :func:`faces_of`.

    Where the transform carries u to u · M and turns ω' on the sphere to ω, it shows π |det M| |M⁻ᵀ ω| of its area along
    ω, a quarter of its area on average (Cauchy).
    """
    opened, there, closed = (
        (radius + part * radius_motion) * _thick(rows + part * rows_motion) for part in (-0.5, 0.0, 0.5)
    )
    # Which radii of the sphere are followed does not matter: those that are across each other at mid shutter.
    across = np.linalg.svd(there)[0].T
    inverse = np.linalg.inv(there).T
    area = area_stretched(*SPHERE_NORMALS, there)
    before, after = (math.sqrt(area_stretched(*SPHERE_NORMALS, at)) for at in (opened, closed))
    spans, motions = across @ there, across @ (closed - opened)
    extent = Extent(ExtentShape.ELLIPSOID, math.sqrt(area), spans, motions, after - before)
    shown = abs(float(np.linalg.det(there))) / area * inverse
    return replace(light, profile=EmissionProfile.SHOWN, extent=extent, shown=shown)


def faces_of(
    light: LightAtShutter,
    radius: float,
    length: float,
    rows: np.ndarray,
    rows_motion: np.ndarray,
    sizes_motion: Sequence[float] = (0.0, 0.0),
) -> list[LightAtShutter]:
    """Flat lights in the place of a cylinder under a transform; their paths are its own with a number.

    Args:
        light: The light, of all their power.
        radius: In its own space.
        length: In its own space.
        rows: The linear part of its transform at mid shutter, shape [3, 3]: rows are the images of x, y and z.
        rows_motion: Change of that over the shutter, shape [3, 3].
        sizes_motion: Changes of radius and length over the shutter.
    """
    middles, spans = _faces_of_tube(radius, length)
    wider, longer = (motion / size for motion, size in zip(sizes_motion, (radius, length), strict=True))
    opened, there, closed = (
        np.diag([1.0 + part * longer, 1.0 + part * wider, 1.0 + part * wider]) @ _thick(rows + part * rows_motion)
        for part in (-0.5, 0.0, 0.5)
    )
    areas = np.linalg.norm(np.cross(*np.moveaxis(spans @ there, 1, 0)), axis=1)
    faces = []
    for number, (middle, sides, share) in enumerate(zip(middles, spans, areas / areas.sum(), strict=True)):
        before, axes, after = (_axes(middle @ at, sides @ at) for at in (opened, there, closed))
        face = replace(
            light,
            path=f"{light.path}[{number}]",
            power=tuple(math.pi * float(share) * channel for channel in light.power),
            position=light.position + middle @ there,
            position_motion=light.position_motion + middle @ (closed - opened),
            axes=axes,
            axes_motion=after - before,
            shaped_about=None if light.shaping is None else light.cone_axis,
            profile=EmissionProfile.COSINE,
            extent=Extent(ExtentShape.RECT, 0.0, sides @ there, sides @ (closed - opened)),
        )
        faces.append(face)
    return faces


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


def _axes(middle: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Axes of a face that shines along −z, away from the middle of the light, shape [3, 3]."""
    inward = -np.cross(*sides)
    if inward @ middle > 0.0:
        inward = -inward
    x, z = (v / max(float(np.linalg.norm(v)), np.finfo(float).tiny) for v in (sides[0], inward))
    return np.stack([x, np.cross(z, x), z])
