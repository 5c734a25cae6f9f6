"""Surfaces that shine by themselves and answer to no light, in MaterialX, Arnold and RenderMan."""

from __future__ import annotations

from typing import Any

import numpy as np

from tpdwarp.usd.read.materials.dialects.table import BRIGHTEST, Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import BLACK, WHITE, Physical


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    values["base_color"], values["unlit"] = BLACK, True


def color(inputs: Inputs) -> Physical:
    """A node that gives a colour in the place of a surface, which Arnold shows as it is."""
    found = inputs.output()
    numbers = found.numbers
    shown = BLACK if numbers is None else tuple(map(float, np.resize(numbers, 3)))
    shown = tuple(min(max(channel, 0.0), BRIGHTEST) if np.isfinite(channel) else 0.0 for channel in shown)
    images = {}
    if found.image is not None:
        images["emission"] = found.image.mapped(lambda pixels: np.clip(pixels, 0.0, BRIGHTEST))
    return Physical(BLACK, emission=shown, unlit=True, images=images)


MATERIALX = Dialect(
    ids=("surface_unlit",),
    fields={
        "emission": Field(("emission_color",), WHITE, ("emission", 1.0)),
        "presence": Field(("opacity",), 1.0),
    },
    ignored={"transmission": 0.0},
    adjust=_adjust,
)
ARNOLD = Dialect(ids=("flat",), fields={"emission": Field(("color",), WHITE)}, adjust=_adjust)
RENDERMAN = Dialect(
    ids=("PxrConstant",),
    fields={
        "emission": Field(("emitColor",), WHITE),
        "presence": Field(("presence",), 1.0),
    },
    adjust=_adjust,
)
