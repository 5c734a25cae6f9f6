"""glTF's material as MaterialX defines it: it refracts whatever its thickness, and its base colour tints the glass."""

from __future__ import annotations

import math
from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field
from tpdwarp.usd.read.materials.inputs import Inputs

OPAQUE, MASK = 0, 1


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    mode, alpha = int(inputs.number(("alpha_mode",), OPAQUE)), values["alpha"]
    cutoff = inputs.number(("alpha_cutoff",), 0.5)
    if mode == OPAQUE:
        values.pop("cutout", None)
    elif "cutout" in values:
        values["threshold"] = cutoff if mode == MASK else 0.0
    else:
        values["presence"] = float(alpha >= cutoff) if mode == MASK else alpha
    # KHR_materials_dispersion holds 20/V.
    values["abbe"] = 20.0 / values["dispersion"] if values["dispersion"] > 0 else 0.0
    distance = values["absorption_depth"]
    values["tint"] = values["base_color"]
    if "base_image" in values:
        values["images"] = {"tint": values["base_image"]}
    if math.isfinite(distance) and distance > 0 and min(values["attenuation_color"]) < 1:
        values["tint"] = values["attenuation_color"]
        values.pop("images", None)
    else:
        values["absorption_depth"] = 0.0


DIALECT = Dialect(
    ids=("gltf_pbr",),
    fields={
        "base_color": Field(("base_color",), (1.0, 1.0, 1.0)),
        "metalness": Field(("metallic",), 1.0),
        "roughness": Field(("roughness",), 1.0),
        "ior": Field(("ior",), 1.5),
        "transmission": Field(("transmission",), 0.0),
        "alpha": Field(("alpha",), 1.0),
        "attenuation_color": Field(("attenuation_color",), (1.0, 1.0, 1.0)),
        "absorption_depth": Field(("attenuation_distance",), 0.0),
        "dispersion": Field(("dispersion",), 0.0),
        "emission": Field(("emissive",), (0.0, 0.0, 0.0), ("emissive_strength", 1.0)),
    },
    ignored={"clearcoat": 0.0, "sheen_color": 0.0, "iridescence": 0.0},
    adjust=_adjust,
)
