"""The dialects materials are authored in, a file each."""

from __future__ import annotations

import re
from collections.abc import Callable

from pxr import UsdShade

from tpdwarp.usd.read.materials.dialects import (
    bsdf_nodes,
    diffuse,
    gltf_pbr,
    moonray,
    omniverse,
    open_pbr,
    plain,
    preview_surface,
    redshift,
    renderman,
    standard_surface,
    unlit,
)
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.nodes import operation_of
from tpdwarp.usd.read.materials.patterns import draws
from tpdwarp.usd.read.materials.physical import Physical
from tpdwarp.usd.read.values import text_at

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
    diffuse.ARNOLD,
    diffuse.RENDERMAN,
    unlit.MATERIALX,
    unlit.ARNOLD,
    unlit.RENDERMAN,
)
READERS: dict[str, Callable[[Inputs], Physical]] = {
    **{name: dialect.read for dialect in TABLES for name in dialect.ids},
    bsdf_nodes.ID: bsdf_nodes.read,
}


def name_of(shader: UsdShade.Shader) -> str:
    """What a surface shader calls itself: its identifier, or the name of its definition in MDL; empty for nothing."""
    definition = shader.GetPrim().GetAttribute("info:mdl:sourceAsset:subIdentifier")
    return str(shader.GetShaderId() or "") or (text_at(definition) if definition else "")


def reader_of(shader: UsdShade.Shader) -> Callable[[Inputs], Physical] | None:
    """What reads a surface shader; None for one that has no inputs which could be understood."""
    name = re.sub(r"^(ND_|arnold:)|_surfaceshader(_\d+)?$", "", name_of(shader))
    if name in READERS:
        return READERS[name]
    if (kind := name_of(shader)).startswith("arnold:") and (name == "image" or operation_of(kind) or draws(kind)):
        return unlit.color
    telling = any((found := shader.GetInput(name)) and found.GetAttr().IsAuthored() for name in plain.TELLING)
    return plain.DIALECT.read if telling else None
