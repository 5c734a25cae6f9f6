"""MoonRay's BaseMaterial and DwaBaseMaterial."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs

WHITE = (1.0, 1.0, 1.0)


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    """What is metal reflects by a colour of its own."""
    if values["metalness"] >= 0.5:
        values["base_color"] = values["metallic_color"]
        values.pop("base_image", None)


BASE = Dialect(
    ids=("BaseMaterial",),
    fields={
        "base_color": Field(("diffuse_color",), WHITE, ("diffuse_factor", 1.0)),
        "presence": Field(("opacity_factor",), 1.0),
    },
)
DWA = Dialect(
    ids=("DwaBaseMaterial",),
    fields={
        "base_color": Field(("albedo",), WHITE),
        "metalness": Field(("metallic",), 0.0),
        "metallic_color": Field(("metallic_color",), WHITE),
        "roughness": Field(("roughness",), 0.5),
        "ior": Field(("refractive_index",), 1.5),
        "transmission": Field(("transmission",), 0.0),
        "tint": Field(("transmission_color",), WHITE),
        "thin_walled": Field(("thin_geometry",), False),
        "presence": Field(("presence",), 1.0),
        "emission": Field(("emission",), (0.0, 0.0, 0.0)),
    },
    ignored={"clearcoat": 0.0, "iridescence": 0.0},
    adjust=_adjust,
)
