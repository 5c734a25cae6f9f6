"""RenderMan's PxrSurface, and Disney's materials."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field, reflect_by
from tpdwarp.usd.read.materials.inputs import Inputs


def _adjust_surface(inputs: Inputs, values: dict[str, Any]) -> None:
    glass = max(values["refraction"], values["reflection"])
    values["transmission"] = glass
    if glass < 0.5:
        values["roughness"] = values["specular_roughness"]
        face = values["specular_color"]
        # Its metals are a bright colour of the specular lobe over no diffuse one.
        if min(face) > 0.2 and max(values["base_color"]) < 0.1:
            reflect_by(inputs, values, "specularFaceColor", face)


SURFACE = Dialect(
    ids=("PxrSurface",),
    fields={
        "base_color": Field(("diffuseColor",), (0.18, 0.18, 0.18), ("diffuseGain", 1.0)),
        "specular_color": Field(("specularFaceColor",), (0.0, 0.0, 0.0)),
        "specular_roughness": Field(("specularRoughness",), 0.2),
        "refraction": Field(("refractionGain",), 0.0),
        "reflection": Field(("reflectionGain",), 0.0),
        "roughness": Field(("glassRoughness",), 0.1),
        "ior": Field(("glassIor",), 1.5),
        "tint": Field(("refractionColor",), (1.0, 1.0, 1.0)),
        "thin_walled": Field(("thinGlass",), False),
        "presence": Field(("presence",), 1.0),
    },
    ignored={"glowGain": 0.0, "clearcoatFaceColor": 0.0, "subsurfaceGain": 0.0, "fuzzGain": 0.0},
    adjust=_adjust_surface,
    untinted="refractionColor",
)
DISNEY = Dialect(
    ids=("PxrDisneyBsdf", "PxrDisney", "disney_principled", "DisneyBsdf"),
    fields={
        "base_color": Field(("baseColor",), (0.5, 0.5, 0.5)),
        "metalness": Field(("metallic",), 0.0),
        "roughness": Field(("roughness",), 0.25),
        "ior": Field(("ior",), 1.5),
        "transmission": Field(("specTrans", "specularTransmission", "refraction"), 0.0),
        "tint": Field(("transColor",), (1.0, 1.0, 1.0)),
        "thin_walled": Field(("thin", "thinSurface"), False),
        "presence": Field(("presence",), 1.0),
    },
    ignored={"emitColor": 0.0, "clearcoat": 0.0, "sheen": 0.0, "subsurface": 0.0, "anisotropic": 0.0},
)
