"""Adobe's Standard Material (ASM), as Substance and Adobe's file formats write it."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field, tint_below_coat
from tpdwarp.usd.read.materials.inputs import Inputs

# Its dispersion is a share of that of an Abbe number of 20.
STRONGEST_DISPERSION = 20.0


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    values["abbe"] = STRONGEST_DISPERSION / values["dispersion"] if values["dispersion"] > 0 else 0.0
    tint_below_coat(values)


DIALECT = Dialect(
    ids=("AdobeStandardMaterial_4_0", "AdobeStandardMaterial"),
    fields={
        "base_color": Field(("baseColor",), (0.5, 0.5, 0.5)),
        "metalness": Field(("metallic",), 0.0),
        "roughness": Field(("roughness",), 0.5),
        "ior": Field(("IOR",), 1.5),
        "transmission": Field(("translucency",), 0.0),
        "tint": Field(("absorptionColor",), (1.0, 1.0, 1.0)),
        "absorption_depth": Field(("absorptionDistance",), 0.0),
        "dispersion": Field(("dispersion",), 0.0),
        "presence": Field(("opacity",), 1.0),
        "emission": Field(("emissive",), (0.0, 0.0, 0.0), ("emissiveIntensity", 1.0)),
        "coat": Field(("coatOpacity",), 0.0),
        "coat_color": Field(("coatColor",), (1.0, 1.0, 1.0)),
    },
    ignored={"coatOpacity": 0.0, "sheenOpacity": 0.0, "scatter": 0.0, "height": 0.0},
    adjust=_adjust,
    untinted="absorptionColor",
)
