"""Omniverse's materials in MDL, known by the names of their definitions: OmniGlass, OmniPBR, OmniSurface."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs


def _adjust_glass(inputs: Inputs, values: dict[str, Any]) -> None:
    values["transmission"] = 1.0
    if inputs.flag("enable_opacity"):
        values["presence"] = values["opacity"]


def _adjust_pbr(inputs: Inputs, values: dict[str, Any]) -> None:
    tint = inputs.color(("diffuse_tint",), (1.0, 1.0, 1.0))
    values["base_color"] = tuple(c * t for c, t in zip(values["base_color"], tint, strict=True))
    threshold = inputs.number(("opacity_threshold",), 0.0)
    if not inputs.flag("enable_opacity"):
        values.pop("cutout", None)
    elif "cutout" in values:
        values["threshold"] = threshold
    else:
        values["presence"] = values["opacity"] if threshold <= 0 else float(values["opacity"] >= threshold)
    if inputs.flag("enable_emission"):
        inputs.warn("enable_emission", "is not rendered")


def _adjust_surface(inputs: Inputs, values: dict[str, Any]) -> None:
    if not inputs.flag("enable_specular_transmission"):
        values["transmission"] = 0.0
    if inputs.flag("enable_opacity"):
        values["presence"] = values["opacity"]
    else:
        values.pop("cutout", None)


GLASS = Dialect(
    ids=("OmniGlass", "OmniGlass_Opacity"),
    fields={
        "base_color": Field(("glass_color",), (1.0, 1.0, 1.0)),
        "tint": Field(("glass_color",), (1.0, 1.0, 1.0)),
        "ior": Field(("glass_ior",), 1.491),
        "roughness": Field(("frosting_roughness",), 0.0),
        "thin_walled": Field(("thin_walled",), False),
        "opacity": Field(("cutout_opacity",), 1.0),
    },
    adjust=_adjust_glass,
)
PBR = Dialect(
    ids=("OmniPBR", "OmniPBR_Opacity", "OmniPBR_ClearCoat"),
    fields={
        "base_color": Field(("diffuse_texture", "diffuse_color_constant"), (0.2, 0.2, 0.2)),
        "metalness": Field(("metallic_constant",), 0.0),
        "roughness": Field(("reflection_roughness_constant",), 0.5),
        "opacity": Field(("opacity_constant",), 1.0),
    },
    ignored={"enable_clearcoat": 0.0},
    adjust=_adjust_pbr,
)
SURFACE = Dialect(
    ids=("OmniSurface", "OmniSurfaceLite"),
    fields={
        "base_color": Field(("diffuse_reflection_color",), (1.0, 1.0, 1.0), ("diffuse_reflection_weight", 0.8)),
        "metalness": Field(("metalness",), 0.0),
        "roughness": Field(("specular_reflection_roughness",), 0.2),
        "ior": Field(("specular_reflection_ior",), 1.5),
        "transmission": Field(("specular_transmission_weight",), 0.0),
        "tint": Field(("specular_transmission_color",), (1.0, 1.0, 1.0)),
        "absorption_depth": Field(("specular_transmission_scattering_depth",), 0.0),
        "thin_walled": Field(("thin_walled",), False),
        "opacity": Field(("geometry_opacity",), 1.0),
    },
    ignored={"coat_weight": 0.0, "emission_weight": 0.0, "subsurface_weight": 0.0, "thin_film_thickness": 0.0},
    adjust=_adjust_surface,
    untinted="specular_transmission_color",
)
