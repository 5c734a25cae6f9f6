"""OpenPBR Surface: MaterialX's and Arnold's."""

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field

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
        "thin_walled": Field(("geometry_thin_walled",), False),
        "presence": Field(("geometry_opacity",), 1.0),
        "emission": Field(("emission_color",), (1.0, 1.0, 1.0), ("emission_luminance", 0.0)),
    },
    ignored={
        "coat_weight": 0.0,
        "fuzz_weight": 0.0,
        "subsurface_weight": 0.0,
        "thin_film_weight": 0.0,
        "transmission_dispersion_scale": 0.0,
        "transmission_scatter": 0.0,
        "specular_roughness_anisotropy": 0.0,
    },
    untinted="transmission_color",
)
