"""Glass and the flexible material of MDL's core definitions; lengths are in metres."""

from __future__ import annotations

from typing import Any

from pxr import UsdGeom

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import WHITE
from tpdwarp.usd.read.values import positive

NEARLY_WHITE = (0.95, 0.95, 0.95)


def _absorb(inputs: Inputs, values: dict[str, Any]) -> None:
    """The volume's colour is reached at a distance; what colours the surface alone counts where that is white."""
    volume, surface = values.pop("volume"), values["tint"]
    meters = UsdGeom.GetStageMetersPerUnit(inputs.shader.GetPrim().GetStage())
    if min(volume) >= 1 or not positive(meters):
        values["absorption_depth"] = 0.0
        return
    if min(surface) < 1:
        inputs.warn("transmission_color", "is not rendered beside the colour of the volume")
    values["tint"], values["absorption_depth"] = volume, values["absorption_depth"] / meters


def _thick(inputs: Inputs, values: dict[str, Any]) -> None:
    values["transmission"] = 1.0
    _absorb(inputs, values)


def _thin(inputs: Inputs, values: dict[str, Any]) -> None:
    values["transmission"], values["thin_walled"] = 1.0, True


ROUGHNESS = ("roughness", "diffuse_roughness")
THICK_GLASS = Dialect(
    ids=("thick_glass_v2", "thick_glass"),
    fields={
        "base_color": Field(("transmission_color",), WHITE),
        "tint": Field(("transmission_color",), WHITE),
        "volume": Field(("glass_color",), NEARLY_WHITE),
        "absorption_depth": Field(("base_thickness",), 0.1),
        "roughness": Field(ROUGHNESS, 0.0),
        "ior": Field(("ior",), 1.4),
        "abbe": Field(("abbe_number",), 0.0),
    },
    adjust=_thick,
)
THIN_GLASS = Dialect(
    ids=("thin_glass_v2", "thin_glass"),
    fields={
        "base_color": Field(("base_color",), NEARLY_WHITE),
        "tint": Field(("base_color",), NEARLY_WHITE),
        "roughness": Field(ROUGHNESS, 0.0),
        "ior": Field(("ior",), 1.4),
    },
    adjust=_thin,
)
FLEXIBLE = Dialect(
    ids=("flex_material_v2", "flex_material"),
    fields={
        "base_color": Field(("base_color",), (0.5, 0.5, 0.5)),
        "metalness": Field(("is_metal",), 0.0),
        "roughness": Field(("reflection_roughness",), 0.3),
        "ior": Field(("ior",), 1.4),
        "transmission": Field(("transparency",), 0.0),
        "tint": Field(("transmission_color",), WHITE),
        "volume": Field(("volume_color",), WHITE),
        "absorption_depth": Field(("base_thickness",), 0.1),
        "abbe": Field(("abbe_number",), 0.0),
        "thin_walled": Field(("thin_walled",), False),
    },
    adjust=_absorb,
    untinted="transmission_color",
)
