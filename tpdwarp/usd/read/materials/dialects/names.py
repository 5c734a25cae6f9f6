"""What surface shaders call themselves."""

from pxr import UsdShade

from tpdwarp.usd.read.values import text_at


def name_of(shader: UsdShade.Shader) -> str:
    """Its identifier, or the name of its definition in MDL; empty for nothing."""
    definition = shader.GetPrim().GetAttribute("info:mdl:sourceAsset:subIdentifier")
    return str(shader.GetShaderId() or "") or (text_at(definition) if definition else "")
