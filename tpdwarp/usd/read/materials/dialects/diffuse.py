"""Shaders that are diffuse and nothing else."""

from tpdwarp.usd.read.materials.dialects.table import Dialect, Field

ARNOLD = Dialect(
    ids=("lambert",),
    fields={
        "base_color": Field(("Kd_color",), (1.0, 1.0, 1.0), ("Kd", 0.8)),
        "presence": Field(("opacity",), 1.0),
    },
)
RENDERMAN = Dialect(
    ids=("PxrDiffuse",),
    fields={"base_color": Field(("diffuseColor",), (0.18, 0.18, 0.18)), "presence": Field(("presence",), 1.0)},
)
