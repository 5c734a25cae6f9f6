"""RealityKit's surfaces, as Reality Composer Pro writes them: opacity is presence, and nothing refracts."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import BLACK, WHITE


def _mask(inputs: Inputs, values: dict[str, Any]) -> None:
    """What lies below the threshold is not there, and what lies above it is there as far as its opacity says."""
    threshold = inputs.number(("opacityThreshold",), 0.0)
    if threshold <= 0:
        return
    if "cutout" in values:
        values["threshold"] = threshold
    elif values["presence"] <= threshold:
        values["presence"] = 0.0


def _unlit(inputs: Inputs, values: dict[str, Any]) -> None:
    _mask(inputs, values)
    values["base_color"], values["unlit"] = BLACK, True


PBR = Dialect(
    ids=("realitykit_pbr",),
    fields={
        "base_color": Field(("baseColor",), WHITE),
        "metalness": Field(("metallic",), 0.0),
        "roughness": Field(("roughness",), 0.5),
        "presence": Field(("opacity",), 1.0),
        "emission": Field(("emissiveColor",), BLACK),
    },
    ignored={"clearcoat": 0.0},
    adjust=_mask,
)
UNLIT = Dialect(
    ids=("realitykit_unlit",),
    fields={"emission": Field(("color",), WHITE), "presence": Field(("opacity",), 1.0)},
    adjust=_unlit,
)
