"""OpenPBR Surface: MaterialX's and Arnold's."""

from __future__ import annotations

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field, tint_below_coat
from tpdwarp.usd.read.materials.inputs import Inputs


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    values["abbe"] = values["abbe"] / values["dispersion"] if values["dispersion"] > 0 else 0.0
    tint_below_coat(values)


DIALECT = Dialect(
    ids=("open_pbr_surface", "openpbr_surface"),
    fields={
        "base_color": Field(("base_color",), (0.8, 0.8, 0.8), ("base_weight", 1.0)),
        "metalness": Field(("base_metalness",), 0.0),
        "roughness": Field(("specular_roughness",), 0.3),
        "ior": Field(("specular_ior",), 1.5),
        "transmission": Field(("transmission_weight",), 0.0),
        "tint": Field(("transmission_color",), (1.0, 1.0, 1.0)),
        "absorption_depth": Field(("transmission_depth",), 0.0),
        "dispersion": Field(("transmission_dispersion_scale",), 0.0),
        "abbe": Field(("transmission_dispersion_abbe_number",), 20.0),
        "thin_walled": Field(("geometry_thin_walled",), False),
        "presence": Field(("geometry_opacity",), 1.0),
        "emission": Field(("emission_color",), (1.0, 1.0, 1.0), ("emission_luminance", 0.0)),
        "coat": Field(("coat_weight",), 0.0),
        "coat_color": Field(("coat_color",), (1.0, 1.0, 1.0)),
    },
    ignored={
        "coat_weight": 0.0,
        "fuzz_weight": 0.0,
        "subsurface_weight": 0.0,
        "thin_film_weight": 0.0,
        "transmission_scatter": 0.0,
        "specular_roughness_anisotropy": 0.0,
    },
    adjust=_adjust,
    untinted="transmission_color",
)
