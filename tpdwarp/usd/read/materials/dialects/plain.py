"""Shaders of no known dialect, read by inputs whose names mean the same in several."""

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field

COLOR = ("base_color", "baseColor", "diffuseColor", "basecolor", "diffuse_color")
METALNESS = ("metalness", "metallic", "base_metalness")
TRANSMISSION = ("transmission", "transmission_weight", "specTrans", "transparency")
TELLING = (*COLOR, *METALNESS, *TRANSMISSION)

DIALECT = Dialect(
    ids=(),
    fields={
        "base_color": Field(COLOR, (0.8, 0.8, 0.8)),
        "metalness": Field(METALNESS, 0.0),
        "roughness": Field(("roughness", "specular_roughness", "rough"), 0.3),
        "ior": Field(("ior", "specular_ior", "specular_IOR", "refractive_index"), 1.5),
        "transmission": Field(TRANSMISSION, 0.0),
        # Of Houdini's principled shader, the last.
        "tint": Field(("transmission_color", "transmissionColor", "transcolor"), (1.0, 1.0, 1.0)),
        "absorption_depth": Field(("transmission_depth", "transdist"), 0.0),
        "presence": Field(("opacity", "presence", "opac"), 1.0),
    },
)
