"""Frames of lights and cameras: a position and unit axes over a shutter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pxr import Usd

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.jumps import settled
from tpdwarp.usd.read.motion import blur_scale, blur_scaled, over_shutter
from tpdwarp.usd.read.transforms import Transforms, union


def as_they_are(rows: np.ndarray) -> np.ndarray:
    """Rows [3, 3] of a transform: z keeps its direction, whatever shear makes of x and y."""
    return rows


def along_normal(rows: np.ndarray) -> np.ndarray:
    """Rows [3, 3] of a transform with z along the normal of what lies in x and y, on the side where z was.

    What is flat keeps its normal where z is flattened to nothing.
    """
    rows = rows / max(np.abs(rows).max(), np.finfo(float).tiny)
    normal = np.cross(rows[0], rows[1])
    if not normal.any():
        return rows
    return np.stack([rows[0], rows[1], -normal if normal @ rows[2] < 0.0 else normal])


def about_x(rows: np.ndarray) -> np.ndarray:
    """Rows [3, 3] of a transform with y and z across x."""
    x = rows[0] / max(float(np.linalg.norm(rows[0])), np.finfo(float).tiny)
    return rows - np.outer([0.0, 1.0, 1.0] * (rows @ x), x)


def frame_over(
    prim: Usd.Prim,
    shutter: Shutter,
    transforms: Transforms,
    animation: tuple[float, float],
    warnings: WarnOnce,
    unsheared: Callable[[np.ndarray], np.ndarray] = as_they_are,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position [3], axes [3, 3] (rows x, y, z), and the motions of both over a shutter.

    Scale and shear are left out: z keeps its direction, y its plane with z, and x completes a right-handed frame.

    Args:
        unsheared: Which directions are kept: gives the rows that count for those of a transform, shape [3, 3].

    Raises:
        InputError: A transform that has no z axis or is not finite.
    """

    def axes_of(rows: np.ndarray) -> np.ndarray:
        return _axes(unsheared(rows), prim, warnings.file)

    def state(time: float) -> tuple[np.ndarray, ...]:
        matrix = transforms.world(prim, time)
        return matrix[3, :3], axes_of(matrix[:3, :3])

    shutter, span = _window(prim, shutter, transforms, animation, warnings)
    with np.errstate(over="ignore", invalid="ignore"):
        if transforms.span(prim) is None:
            (position, axes), motions = state(shutter.middle), None
        else:
            (position, axes), motions = over_shutter(state, shutter, span, transforms.cubic)
    if not all(np.isfinite(values).all() for values in (position, axes, *(motions or ()))):
        raise InputError(
            f"its transform leaves the range of numbers within the shutter of frame {shutter.frame:g} (correct it)",
            warnings.file,
            str(prim.GetPath()),
        )
    position_motion, axes_motion = motions if motions is not None else (np.zeros(3), np.zeros((3, 3)))
    return position, _axes(axes, prim, warnings.file), position_motion, axes_motion


def rows_over(
    prim: Usd.Prim, shutter: Shutter, transforms: Transforms, animation: tuple[float, float], warnings: WarnOnce
) -> tuple[np.ndarray, np.ndarray]:
    """The linear part of a transform (rows are the images of x, y, z, with scale and shear) and its motion, [3, 3]."""

    def state(time: float) -> tuple[np.ndarray, ...]:
        return (transforms.world(prim, time)[:3, :3],)

    shutter, span = _window(prim, shutter, transforms, animation, warnings)
    with np.errstate(over="ignore", invalid="ignore"):
        (rows,), motions = over_shutter(state, shutter, span, transforms.cubic)
    return rows, np.zeros((3, 3)) if motions is None else motions[0]


def _window(
    prim: Usd.Prim, shutter: Shutter, transforms: Transforms, animation: tuple[float, float], warnings: WarnOnce
) -> tuple[Shutter, tuple[float, float]]:
    """The shutter of a prim, and first and last time of its animation."""
    shutter = settled(blur_scaled(shutter, blur_scale(prim, shutter.frame, warnings)), transforms.jumps(prim))
    return shutter, union(animation, transforms.span(prim))


def _axes(rows: np.ndarray, prim: Usd.Prim, file: str) -> np.ndarray:
    # Directions only: squares of very large or very small entries would leave the range of numbers.
    rows = rows / max(np.abs(rows).max(), np.finfo(float).tiny)
    z = rows[2]
    y = rows[1] - z * (rows[1] @ z) / max(z @ z, 1e-300)
    lengths = np.linalg.norm(z), np.linalg.norm(y)
    if min(lengths) == 0:
        raise InputError("its transform is flattened to nothing (author a scale above 0)", file, str(prim.GetPath()))
    z, y = z / lengths[0], y / lengths[1]
    return np.stack([np.cross(y, z), y, z])
