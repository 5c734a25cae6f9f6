"""The light layer: textures of baked light as the emission of their receivers, over the scene.

    caustic.light.usda      sublayer: the scene; a material for each receiver below /TPDLight, bound to it

A receiver keeps the look it has where that is a UsdPreviewSurface whose emission is free; elsewhere it is diffuse with
its mean albedo. Emission is albedo/π × irradiance [W/(m² sr)], which UsdPreviewSurface takes for nits as UsdLux does.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdUtils, Vt

from tpdwarp.errors import FrameError, shortened
from tpdwarp.io.files import check_writable, complete_or_absent
from tpdwarp.usd.write.debug_layer import relative_asset

ROOT = Sdf.Path("/TPDLight")
# The primvar that holds projected coordinates.
PROJECTED = "tpd_st"


@dataclass(frozen=True, eq=False)
class BoundTexture:
    """A sequence of textures and the mesh it belongs to.

    Attributes:
        path: The mesh.
        files: Its texture's file by frame; NaN stands for the default time.
        uv: The primvar of its coordinates.
        projected: Coordinates of its own points where it has no such primvar, shape [v, 2]; else None.
        albedo: Its mean albedo.
        scale: Emission is the texture times this.
    """

    path: str
    files: Mapping[float, str]
    uv: str
    projected: np.ndarray | None
    albedo: tuple[float, float, float]
    scale: tuple[float, float, float]


def write_light_layer(path: Path, stage: Usd.Stage, textures: Sequence[BoundTexture]) -> list[str]:
    """Writes the layer; it appears under its name only when complete.

    Args:
        path: The layer.
        stage: The scene, opened from a file.
        textures: What is bound.

    Returns:
        What could not be bound, a line each.

    Raises:
        FrameError: It cannot be written.
        InputError: Its folder cannot be written.
    """
    scene = stage.GetRootLayer()
    if not scene.realPath:
        return [f"{path}: is not written: the scene is in memory, and a layer lies over files (save the scene)"]
    check_writable(path)
    unbound: list[str] = []
    folder = os.path.realpath(path.parent)
    with complete_or_absent(path) as temporary:
        try:
            layer = Sdf.Layer.CreateAnonymous(".usda")
            # Stage metadata does not compose from sublayers.
            UsdUtils.CopyLayerMetadata(scene, layer, skipSublayers=True)
            over = Usd.Stage.Open(layer)
            # The scene is looked at where it lies; the path to it from this layer is written at the end.
            layer.subLayerPaths = [scene.realPath]
            UsdGeom.Scope.Define(over, ROOT)
            for number, texture in enumerate(textures):
                why = _bind(over, number, texture, folder)
                if why:
                    unbound.append(f"{path}: {texture.path}: {why}")
            written = Sdf.Layer.CreateAnonymous(".usda")
            written.TransferContent(layer)
            written.subLayerPaths = [relative_asset(scene.realPath, folder)]
            written.Export(temporary)
        except Tf.ErrorException as error:
            raise FrameError(f"{path}: cannot be written: {shortened(str(error))}") from error
    return unbound


def _bind(over: Usd.Stage, number: int, texture: BoundTexture, folder: str) -> str:
    """Binds one texture; why it cannot be bound, or nothing."""
    prim = over.GetPrimAtPath(texture.path) if Sdf.Path.IsValidPathString(texture.path) else None
    if not prim or prim.IsInstanceProxy():
        return "is an instance, which no layer can give a material of its own (bind its texture in your renderer)"
    name = texture.uv
    if texture.projected is not None:
        if not len(texture.projected):
            return "has no points that could take texture coordinates (make it a mesh with them)"
        name = PROJECTED
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
            PROJECTED, Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
        )
        primvar.Set(Vt.Vec2fArray.FromNumpy(texture.projected.astype(np.float32)))
    place = ROOT.AppendChild(prim.GetName())
    if over.GetPrimAtPath(place):
        place = ROOT.AppendChild(f"{prim.GetName()}_{number}")
    material, surface = _look(over, prim, place, texture)
    emission = surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f)
    emission.ConnectToSource(_texture(over, material.GetPath(), texture, name, folder))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, UsdShade.Tokens.strongerThanDescendants)
    return ""


def _look(
    over: Usd.Stage, prim: Usd.Prim, place: Sdf.Path, texture: BoundTexture
) -> tuple[UsdShade.Material, UsdShade.Shader]:
    """A material of the receiver's own with the look it has, and its surface."""
    bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    material = UsdShade.Material.Define(over, place)
    if bound and not bound.GetPrim().IsInstanceProxy():
        source = bound.ComputeSurfaceSource()[0]
        below = source and source.GetPath().HasPrefix(bound.GetPath())
        if below and source.GetIdAttr().Get() == "UsdPreviewSurface" and not _emits(source):
            material.GetPrim().GetReferences().AddInternalReference(bound.GetPath())
            within = source.GetPath().MakeRelativePath(bound.GetPath())
            return material, UsdShade.Shader(over.OverridePrim(place.AppendPath(within)))
    surface = UsdShade.Shader.Define(over, place.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*texture.albedo))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material, surface


def _emits(surface: UsdShade.Shader) -> bool:
    """Whether a surface has an emission already."""
    emission = surface.GetInput("emissiveColor")
    if not emission:
        return False
    return emission.HasConnectedSource() or emission.GetAttr().GetNumTimeSamples() > 0 or any(emission.Get() or ())


def _texture(
    over: Usd.Stage, material: Sdf.Path, texture: BoundTexture, uv: str, folder: str
) -> UsdShade.Output:
    """The nodes that look up the textures by the receiver's coordinates."""
    reader = UsdShade.Shader.Define(over, material.AppendChild("CausticCoordinates"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(uv)
    coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    node = UsdShade.Shader.Define(over, material.AppendChild("Caustic"))
    node.CreateIdAttr("UsdUVTexture")
    file = node.CreateInput("file", Sdf.ValueTypeNames.Asset)
    for frame, path in texture.files.items():
        asset = Sdf.AssetPath(relative_asset(os.path.abspath(path), folder))
        if math.isnan(frame) or len(texture.files) == 1:
            file.Set(asset)
        else:
            file.Set(asset, frame)
    node.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    for name in ("wrapS", "wrapT"):
        node.CreateInput(name, Sdf.ValueTypeNames.Token).Set("clamp")
    node.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
    node.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*texture.scale, 1.0))
    return node.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
