"""UsdPreviewSurface, by its own name and by MaterialX's."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field, reflect_by
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.interactions import MOST_DIELECTRIC_REFLECTANCE


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    opacity, threshold = values["opacity"], inputs.number(("opacityThreshold",), 0.0)
    if "cutout" in values:
        values["threshold"] = threshold
    elif (found := inputs.value("opacity")) is not None and found.spread:
        # Without its file, a texture that cuts out shapes makes no glass, whatever its fallback.
        inputs.warn("opacity", "is a texture that cannot be read, whose cut-outs are rendered as if they were filled")
        opacity = 1.0
    if threshold > 0:
        values["presence"] = float(opacity >= threshold)
    elif inputs.text("opacityMode") == "presence" or opacity >= 0.5:
        # What is more opaque than clear is a surface that light passes in part, rather than glass.
        values["presence"] = opacity
    else:
        values["transmission"] = max(values["transmission"], 1.0 - opacity)
    if inputs.find("roughness") is None and values["transmission"] >= 0.5:
        # The default of .5 describes the highlight; nobody who authors clear glass without it means frosted glass.
        values["roughness"] = 0.0
    if inputs.flag("useSpecularWorkflow"):
        reflectance = values["specular_color"]
        values["metalness"] = 0.0
        if max(reflectance) > max(MOST_DIELECTRIC_REFLECTANCE, max(values["base_color"])):
            reflect_by(inputs, values, "specularColor", reflectance)


DIALECT = Dialect(
    ids=("UsdPreviewSurface",),
    fields={
        "base_color": Field(("diffuseColor",), (0.18, 0.18, 0.18)),
        "metalness": Field(("metallic",), 0.0),
        "roughness": Field(("roughness",), 0.5),
        "ior": Field(("ior",), 1.5),
        "opacity": Field(("opacity",), 1.0),
        "transmission": Field(("transmission",), 0.0),
        "specular_color": Field(("specularColor",), (0.0, 0.0, 0.0)),
        "emission": Field(("emissiveColor",), (0.0, 0.0, 0.0)),
    },
    ignored={"clearcoat": 0.0, "displacement": 0.0},
    adjust=_adjust,
    untinted="no input of UsdPreviewSurface",
)
