"""Autodesk's Standard Surface, MaterialX's and Arnold's, and the Standard that Arnold had before."""

from typing import Any

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field, tint_below_coat
from tpdwarp.usd.read.materials.inputs import Inputs


def _adjust(inputs: Inputs, values: dict[str, Any]) -> None:
    """What mirrors by Kr is a mirror, what passes light by Kt is glass."""
    values["metalness"] = 1.0 if values["mirror"] >= 0.5 and values["transmission"] < 0.5 else 0.0
    if values["metalness"]:
        values["base_color"] = tuple(values["mirror"] * channel for channel in values["mirror_color"])
        values.pop("base_image", None)
    # Its roughness is that of the highlight: mirrors and glass have none but their own.
    values["roughness"] = values["transmission_roughness"] if values["transmission"] >= 0.5 else 0.0


def _tint(inputs: Inputs, values: dict[str, Any]) -> None:
    tint_below_coat(values)


STANDARD = Dialect(
    ids=("standard",),
    fields={
        "base_color": Field(("Kd_color",), (1.0, 1.0, 1.0), ("Kd", 0.7)),
        "mirror": Field(("Kr",), 0.0),
        "mirror_color": Field(("Kr_color",), (1.0, 1.0, 1.0)),
        "transmission": Field(("Kt",), 0.0),
        "tint": Field(("Kt_color",), (1.0, 1.0, 1.0)),
        "transmission_roughness": Field(("refraction_roughness",), 0.0),
        "ior": Field(("IOR",), 1.0),
        "presence": Field(("opacity",), 1.0),
        "emission": Field(("emission_color",), (1.0, 1.0, 1.0), ("emission", 0.0)),
    },
    adjust=_adjust,
)
DIALECT = Dialect(
    ids=("standard_surface", "aiStandardSurface"),
    fields={
        "base_color": Field(("base_color",), (0.8, 0.8, 0.8), ("base", 1.0)),
        "metalness": Field(("metalness",), 0.0),
        "roughness": Field(("specular_roughness",), 0.2),
        "ior": Field(("specular_IOR",), 1.5),
        "transmission": Field(("transmission",), 0.0),
        "tint": Field(("transmission_color",), (1.0, 1.0, 1.0)),
        "absorption_depth": Field(("transmission_depth",), 0.0),
        "abbe": Field(("transmission_dispersion",), 0.0),
        "thin_walled": Field(("thin_walled",), False),
        "presence": Field(("opacity",), 1.0),
        "emission": Field(("emission_color",), (1.0, 1.0, 1.0), ("emission", 0.0)),
        "coat": Field(("coat",), 0.0),
        "coat_color": Field(("coat_color",), (1.0, 1.0, 1.0)),
    },
    adjust=_tint,
    ignored={
        "coat": 0.0,
        "sheen": 0.0,
        "subsurface": 0.0,
        "thin_film_thickness": 0.0,
        "transmission_scatter": 0.0,
        "transmission_extra_roughness": 0.0,
        "specular_anisotropy": 0.0,
    },
    untinted="transmission_color",
)
