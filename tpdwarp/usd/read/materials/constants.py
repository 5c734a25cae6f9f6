"""Primvars that are one value over a whole surface, by which meshes with the same material differ."""

from __future__ import annotations

import re

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import InputError
from tpdwarp.usd.read.values import numbers

# How many numbers the readers of primvars give, by how their names end; others give what there is.
SIZES = {"float": 1, "int": 1, "float2": 2, "float3": 3, "float4": 4, "point": 3, "normal": 3, "vector": 3}
SIZES |= {"vector2": 2, "vector3": 3, "vector4": 4, "color3": 3, "color4": 4, "rgb": 3, "rgba": 4}

# A primvar, and how many numbers are wanted of it.
Asked = tuple[str, int]


def size_of(kind: str) -> int:
    """How many numbers a reader of this kind gives; 0 where that is not known."""
    return SIZES.get(re.split(r"[_:]", kind)[-1], 0)


class Constants:
    """The constant primvars of a prim at a time code, those that it inherits included.

    Args:
        prim: A mesh, or a part of one.
        frame: Time code.

    Attributes:
        asked: What was asked for so far, and found: meshes that have the same there look the same.
        varies: Whether any of it may change with time.
    """

    def __init__(self, prim: Usd.Prim, frame: float) -> None:
        self._prim, self._frame = prim, frame
        self.asked: dict[Asked, tuple[float, ...] | None] = {}
        self.varies = False

    def of(self, name: str, size: int) -> np.ndarray | None:
        """A primvar's value, shape [n], which is [0] where there is none; None where it is not one value of ``size``
        numbers.

        Args:
            name: The primvar.
            size: How many numbers are wanted; 0 for any.
        """
        key = name, size
        if key not in self.asked:
            found = self._find(name)
            fits = found is not None and (size == 0 or found.size in (0, size))
            self.asked[key] = tuple(found.tolist()) if fits else None
        value = self.asked[key]
        return None if value is None else np.array(value)

    def values(self, asked: tuple[Asked, ...]) -> tuple[tuple[float, ...] | None, ...]:
        """What is found of primvars that were asked for elsewhere."""
        for key in asked:
            self.of(*key)
        return tuple(self.asked[key] for key in asked)

    def _find(self, name: str) -> np.ndarray | None:
        primvar = UsdGeom.PrimvarsAPI(self._prim).FindPrimvarWithInheritance(name) if name else None
        if not primvar or not primvar.HasValue():
            return np.zeros(0)
        if primvar.GetInterpolation() != UsdGeom.Tokens.constant:
            return None
        self.varies |= primvar.ValueMightBeTimeVarying()
        try:
            value = numbers(primvar.ComputeFlattened(self._frame), primvar.GetAttr())
        except InputError:
            return None
        listed = str(primvar.GetTypeName()).endswith("[]")
        if not np.isfinite(value).all() or (listed and len(value) != 1):
            return None
        return value.ravel()
