"""Surfaces that shine by themselves and answer to no light, in MaterialX, Arnold and RenderMan."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import BLACK, WHITE


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    values["base_color"], values["unlit"] = BLACK, True


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
