"""The dialects materials are authored in, a file each."""

from __future__ import annotations

import re
from collections.abc import Callable

from pxr import UsdShade

from tpdwarp.usd.read.materials.dialects import (
    adobe,
    bsdf_nodes,
    diffuse,
    gltf_pbr,
    mdl_core,
    moonray,
    omniverse,
    open_pbr,
    plain,
    preview_surface,
    reality_kit,
    redshift,
    renderman,
    standard_surface,
    unlit,
)
from tpdwarp.usd.read.materials.dialects.names import name_of
from tpdwarp.usd.read.materials.dialects.terminals import MIXED, handed_on, read_mixture
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.nodes import operation_of
from tpdwarp.usd.read.materials.patterns import draws
from tpdwarp.usd.read.materials.physical import Physical

__all__ = ["handed_on", "name_of", "reader_of"]

TABLES = (
    preview_surface.DIALECT,
    standard_surface.DIALECT,
    standard_surface.STANDARD,
    open_pbr.DIALECT,
    gltf_pbr.DIALECT,
    moonray.BASE,
    moonray.DWA,
    renderman.SURFACE,
    renderman.DISNEY,
    omniverse.GLASS,
    omniverse.PBR,
    omniverse.SURFACE,
    redshift.STANDARD,
    adobe.DIALECT,
    mdl_core.THICK_GLASS,
    mdl_core.THIN_GLASS,
    mdl_core.FLEXIBLE,
    reality_kit.PBR,
    reality_kit.UNLIT,
    diffuse.ARNOLD,
    diffuse.RENDERMAN,
    unlit.MATERIALX,
    unlit.ARNOLD,
    unlit.RENDERMAN,
)
READERS: dict[str, Callable[[Inputs], Physical]] = {
    **{name: dialect.read for dialect in TABLES for name in dialect.ids},
    **{name: bsdf_nodes.read for name in bsdf_nodes.IDS},
    **{name: bsdf_nodes.read_node for name in bsdf_nodes.DIRECT},
}


def reader_of(shader: UsdShade.Shader) -> Callable[[Inputs], Physical] | None:
    """What reads a surface shader; None for one that has no inputs which could be understood."""
    if name_of(shader) in MIXED:
        return lambda inputs: read_mixture(inputs, reader_of)
    name = re.sub(r"^(ND_|arnold:)|_surfaceshader(_\d+)?$", "", name_of(shader))
    if name in READERS:
        return READERS[name]
    if (kind := name_of(shader)).startswith("arnold:") and (name == "image" or operation_of(kind) or draws(kind)):
        return unlit.color
    telling = any((found := shader.GetInput(name)) and found.GetAttr().IsAuthored() for name in plain.TELLING)
    return plain.DIALECT.read if telling else None
