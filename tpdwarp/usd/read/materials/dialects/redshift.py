"""Redshift's standard material, and the diffuse shaders that need no more than a colour."""

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field

STANDARD = Dialect(
    ids=("redshift::StandardMaterial",),
    fields={
        "base_color": Field(("base_color",), (0.5, 0.5, 0.5), ("base_color_weight", 1.0)),
        "metalness": Field(("metalness",), 0.0),
        "roughness": Field(("refl_roughness",), 0.2),
        "ior": Field(("refl_ior",), 1.5),
        "transmission": Field(("refr_weight",), 0.0),
        "tint": Field(("refr_color",), (1.0, 1.0, 1.0)),
        "abbe": Field(("refr_abbe",), 0.0),
        "thin_walled": Field(("refr_thin_walled",), False),
        "presence": Field(("opacity_color",), 1.0),
        "emission": Field(("emission_color",), (1.0, 1.0, 1.0), ("emission_weight", 0.0)),
    },
    ignored={"coat_weight": 0.0, "sheen_weight": 0.0, "ms_amount": 0.0},
    untinted="refr_color",
)
