"""NURBS patches: meshes made anew for each frame, with the normals of the surface itself."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pxr import UsdGeom

from tpdwarp.errors import InputError
from tpdwarp.usd.read.blobs import KNOTS, MOST_TRIANGLES, Blobs, blob_topology
from tpdwarp.usd.read.nurbs import Span, fitting_knots, patch_grid, spans
from tpdwarp.usd.read.shapes import ShapeAtShutter
from tpdwarp.usd.read.values import number_at, text_at

# Pieces of a span along either axis where there are few: a bicubic patch leaves them by a hundredth of a radian.
PIECES = 16


class Patch(Blobs):
    """A NurbsPatch prim over time, as :class:`tpdwarp.usd.read.shapes.Shape`. Its trim curves are not read."""

    def _made(self, points: Callable[[float], np.ndarray], first: np.ndarray, frame: float) -> ShapeAtShutter | None:
        patch, count = UsdGeom.NurbsPatch(self._prim), len(first)
        trimmed = patch.GetTrimCurveCountsAttr()
        if trimmed and trimmed.HasAuthoredValue():
            self._warnings(self.path, "the patch is rendered without its trim curves")
        size = int(number_at(patch.GetUVertexCountAttr(), frame)), int(number_at(patch.GetVVertexCountAttr(), frame))
        if math.prod(size) != count:
            raise InputError(
                f"is a patch of {size[0]} × {size[1]} vertices, with {count} points (correct the counts)",
                self._warnings.file,
                f"{self.path}.uVertexCount",
            )
        pieces = int(np.clip(math.sqrt(MOST_TRIANGLES / (2 * count)), 1, PIECES))
        along_u, along_v = (self._along(axis, of, pieces, frame) for axis, of in zip("uv", size, strict=True))
        grid = patch_grid(along_u, along_v, size, self.own_weights(frame, count))
        flipped = text_at(UsdGeom.Gprim(self._prim).GetOrientationAttr()) == UsdGeom.Tokens.leftHanded
        triangles = grid.triangles[:, [0, 2, 1]] if flipped else grid.triangles
        nearest, one = grid.strongest[triangles], np.zeros_like(triangles)
        owners = {"vertex": (count, nearest), "varying": (count, nearest), "uniform": (1, one)}
        side = -1.0 if flipped else 1.0
        return ShapeAtShutter(
            blob_topology(triangles, owners),
            count,
            lambda time: grid.place(points(time))[0],
            lambda time: side * grid.place(points(time))[1],
            lambda faces: faces.triangles,
        )

    def _along(self, axis: str, count: int, pieces: int, frame: float) -> list[Span]:
        """The spans along an axis of ``count`` vertices.

        Raises:
            InputError: An order that these do not have.
        """
        attribute = self._prim.GetAttribute(f"{axis}Order")
        order = int(number_at(attribute, frame))
        if not 2 <= order <= count:
            raise InputError(
                f"is {order}, of {count} vertices (author 2 or more, at most one a vertex)",
                self._warnings.file,
                str(attribute.GetPath()),
            )
        knots, limits = (
            self.numbers(self._prim.GetAttribute(f"{axis}{name}"), frame).reshape(-1) for name in ("Knots", "Range")
        )
        along, between, fits = fitting_knots(order, count, knots, limits)
        if not fits:
            self._warnings(f"{self.path}.{axis}Knots", KNOTS)
        return spans(order, along, between, pieces)
