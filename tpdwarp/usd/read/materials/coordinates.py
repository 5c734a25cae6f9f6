"""Texture coordinates: the primvar that a texture is looked up by, and the affine map between the two."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Coordinates:
    """Where the coordinates (s, t) of a texture come from.

    Attributes:
        primvar: Name of the primvar.
        matrix: s = a x + b y + c and t = d x + e y + f for its values (x, y), as (a, b, c, d, e, f).
    """

    primvar: str = "st"
    matrix: tuple[float, ...] = IDENTITY

    def then(self, matrix: np.ndarray) -> Coordinates:
        """These coordinates, and then an affine map, shape [2, 3]."""
        own = np.vstack([np.reshape(self.matrix, (2, 3)), (0, 0, 1)])
        with np.errstate(all="ignore"):
            return Coordinates(self.primvar, tuple(map(float, (matrix @ own).ravel())))

    def of(self, values: np.ndarray) -> np.ndarray:
        """Coordinates for values of the primvar, shapes [n, 2]."""
        matrix = np.reshape(self.matrix, (2, 3))
        return values @ matrix[:, :2].T + matrix[:, 2]


def turned(degrees: float) -> np.ndarray:
    """The matrix that turns counter-clockwise, shape [2, 2]."""
    angle = math.radians(degrees)
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def scaled_turned_moved(scale: np.ndarray, degrees: float, translation: np.ndarray) -> np.ndarray:
    """UsdTransform2d: scaled, then turned, then moved, shape [2, 3]."""
    return np.column_stack([turned(degrees) @ np.diag(scale), translation])


def placed(pivot: np.ndarray, scale: np.ndarray, degrees: float, offset: np.ndarray, moved_first: bool) -> np.ndarray:
    """MaterialX's place2d, shape [2, 3]: about its pivot, and by the inverse of scale and offset.

    It turns the coordinates clockwise by ``degrees``, as its rotate2d does, so that the picture turns the other way.
    """
    with np.errstate(all="ignore"):
        shrink, turn = np.diag(1.0 / scale), turned(-degrees)
        if moved_first:
            # Operation order 1: moved, then turned, then scaled.
            linear = shrink @ turn
            return np.column_stack([linear, pivot - linear @ (pivot + offset)])
        linear = turn @ shrink
        return np.column_stack([linear, pivot - linear @ pivot - offset])
