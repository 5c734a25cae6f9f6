"""Autodesk's Standard Surface: MaterialX's and Arnold's."""

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field

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
    },
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
