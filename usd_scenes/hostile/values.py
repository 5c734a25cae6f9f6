"""Values that no one should author: of the right type, of another, or of the right type and the wrong length."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np
from pxr import Gf, Sdf

NUMBERS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 1e-3, 1e3, -1e3, 1e-6, 1e6, 1e-12, 1e12, -1e12, 1e-30, 1e30, 1e-38, 3e38,
    -3e38, 1e-45, 1e300, math.nan, math.inf, -math.inf,
)  # fmt: skip
INTEGERS = (0, 1, -1, 2, 3, 7, 100, -100, 2**15, 2**31 - 1, -(2**31))
TEXTS = (
    "none", "inherited", "invisible", "face", "vertex", "uniform", "faceVarying", "rightHanded", "leftHanded",
    "perspective", "orthographic", "catmullClark", "loop", "guide", "proxy", "UsdPreviewSurface", "UsdUVTexture",
    "UsdPrimvarReader_float3", "nonsense", "/World", "../..", "%s%n", "é", "", " ", "a b", "x" * 5000,
)  # fmt: skip
TYPES = (
    "bool", "int", "int64", "float", "double", "half", "string", "token", "asset", "float2", "float3", "double3",
    "float4", "color3f", "point3f", "quatf", "matrix4d", "int2", "int[]", "float[]", "double[]", "token[]",
    "string[]", "float2[]", "point3f[]", "color3f[]", "quath[]", "matrix4d[]", "int64[]", "vector3f[]", "normal3f[]",
    "bool[]", "timecode",
)  # fmt: skip


def number(random: Random) -> float:
    """A number, seldom a harmless one."""
    chosen = random.choice(NUMBERS)
    return chosen if random.random() < 0.8 else chosen * random.uniform(-2, 2)


def hostile(random: Random, kind: Sdf.ValueTypeName, was: Any) -> Any:
    """A value of type ``kind`` to put where ``was`` was (None where nothing was)."""
    if kind.isArray:
        return _array(random, kind, was)
    return _scalar(random, kind.type.pythonClass, kind.defaultValue)


def _scalar(random: Random, cls: type | None, default: Any) -> Any:
    if isinstance(default, bool):
        return not default
    if isinstance(default, int):
        return random.choice(INTEGERS)
    if isinstance(default, float):
        return number(random)
    if isinstance(default, str):
        return random.choice(TEXTS)
    if isinstance(default, Sdf.AssetPath):
        return Sdf.AssetPath(random.choice(("", "no_such.usda", "x" * 300)))
    if cls is None or default is None:
        return default
    return _compound(random, cls, default)


def _compound(random: Random, cls: type, default: Any) -> Any:
    """A vector, quaternion or matrix: all of one number, or one number wrong."""
    if isinstance(default, Gf.Quath | Gf.Quatf | Gf.Quatd):
        return cls(number(random), number(random), number(random), number(random))
    try:
        values = np.array(default, dtype=np.float64)
        whole = isinstance(np.array(default).flat[0].item(), int)
    except (TypeError, ValueError):
        return default
    def draw() -> Any:
        return random.choice(INTEGERS) if whole else number(random)

    if random.random() < 0.4:
        values[...] = draw()
    else:
        values = values + (1.0 if random.random() < 0.5 else 0.0)
        values[tuple(random.randrange(size) for size in values.shape)] = draw()
    if values.ndim == 2:
        return cls(*(float(v) for v in values.ravel()))
    return cls(*((int(v) if whole else float(v)) for v in values))


def _array(random: Random, kind: Sdf.ValueTypeName, was: Any) -> Any:
    element = kind.scalarType
    items = list(was) if was is not None else []
    choice = random.randrange(7)
    if choice == 0 or (choice != 6 and not items):
        items = []
    elif choice == 1:
        items = items[: random.randrange(len(items))]
    elif choice == 2:
        items = items * random.choice((2, 3))
    elif choice == 3:
        random.shuffle(items)
    elif choice == 6:
        items = [_scalar(random, element.type.pythonClass, element.defaultValue) for _ in range(random.randrange(9))]
    else:
        # One wrong, or all.
        chosen = range(len(items)) if choice == 5 else [random.randrange(len(items))]
        wrong = _scalar(random, element.type.pythonClass, element.defaultValue)
        for index in chosen:
            items[index] = wrong
    return _vt(kind, items)


def _vt(kind: Sdf.ValueTypeName, items: list[Any]) -> Any:
    cls = kind.type.pythonClass
    return items if cls is None else cls(items)


