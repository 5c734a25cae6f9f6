"""Models drawn as cards (``model:drawMode``): pictures on the sides of their box stand in for what is in them.

As UsdImaging has it: the mode is inherited, and applied to components and to models that say ``model:applyDrawMode``;
nothing below such a model is drawn. The cards are laid into the stage's session layer, as a mesh with materials. What
stands for a model in viewports alone, bounds and axes, is rendered as the model itself, and said.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade, Vt

from tpdwarp.errors import WarnOnce
from tpdwarp.usd.read.values import text_at

NAME = "tpdwarp_cards"
# Of a model's box: cards back to back in its middle are this far apart, so that each covers the other. Chosen, not
# derived: far above what positions are rounded to.
GAP = 1e-4
# UsdImaging's: what is less there than this is cut out.
THRESHOLD = 0.1
# Sizes of the box along which s and t grow on the three pairs of sides, and whether s and t run backwards on each of
# a pair: as one sees a side from outside with its texture upright.
ALONG = ((1, 2), (0, 2), (0, 1))
BACKWARDS = {
    (0, 1): (False, False), (0, -1): (True, False),
    (1, 1): (True, False), (1, -1): (False, False),
    (2, 1): (False, False), (2, -1): (False, True),
}  # fmt: skip
SIDES = tuple(BACKWARDS)

Side = tuple[int, int]


@dataclass(frozen=True)
class _Card:
    """A card: the side it faces, how far along its axis it lies (0 … 1 of the box), and the side whose texture it has;
    None for the colour of the draw mode."""

    side: Side
    place: float
    textured: Side | None


def draws_models_otherwise(stage: Usd.Stage) -> bool:
    """Whether any model of a stage is drawn as cards."""
    return any(mode == UsdGeom.Tokens.cards for _, mode in _drawn_otherwise(stage))


def lay_cards(stage: Usd.Stage, warnings: WarnOnce) -> None:
    """Puts cards in the place of the models that are drawn so, through the stage's session layer.

    Args:
        stage: The stage, whose session layer may be written to where :func:`draws_models_otherwise`.
        warnings: Takes what is drawn as the model itself.
    """
    models = list(_drawn_otherwise(stage))
    if not models:
        return
    boxes = UsdGeom.BBoxCache(Usd.TimeCode(stage.GetStartTimeCode()), _purposes(), useExtentsHint=True)
    laid = []
    for prim, mode in models:
        path, geometry = str(prim.GetPath()), text_at(UsdGeom.ModelAPI(prim).GetModelCardGeometryAttr())
        if mode != UsdGeom.Tokens.cards or geometry == UsdGeom.Tokens.fromTexture:
            what = f"{mode} {geometry}" if mode == UsdGeom.Tokens.cards else mode
            warnings(f"{path}.model:drawMode", f"is {what}, in the place of which the model itself is rendered")
            continue
        box = boxes.ComputeUntransformedBound(prim).ComputeAlignedRange()
        corners = np.array([box.GetMin(), box.GetMax()])
        if box.IsEmpty() or not np.isfinite(corners).all():
            warnings(f"{path}.model:drawMode", "is cards, of a model that has no extent: it is rendered itself")
            continue
        laid.append((prim, corners, geometry))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path in {ancestor.GetPath() for prim, *_ in laid for ancestor in _instances_above(prim)}:
            Sdf.CreatePrimInLayer(stage.GetSessionLayer(), path).instanceable = False
        for prim, corners, geometry in laid:
            _replace(stage, prim.GetPath(), corners, geometry)


def _purposes() -> list[str]:
    return [UsdGeom.Tokens.default_, UsdGeom.Tokens.proxy, UsdGeom.Tokens.render]


def _drawn_otherwise(stage: Usd.Stage) -> Iterator[tuple[Usd.Prim, str]]:
    """The outermost models that are not drawn as they are, and their modes."""
    # Few stages say anything of this: prims of instances are looked at one by one in these alone.
    roots = stage.GetPseudoRoot(), *stage.GetPrototypes()
    if not any(map(_own_mode, (prim for root in roots for prim in Usd.PrimRange(root)))):
        return
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    for prim in prims:
        if prim.IsPseudoRoot() or not _is_applied(prim):
            continue
        mode = _mode(prim)
        if mode not in ("", UsdGeom.Tokens.default_):
            yield prim, mode
            prims.PruneChildren()


def _own_mode(prim: Usd.Prim) -> str:
    """The mode that a prim itself says; empty for none, or that of what it lies below."""
    attribute = prim.GetAttribute("model:drawMode")
    mode = text_at(attribute) if attribute and attribute.HasAuthoredValue() else ""
    return "" if mode == UsdGeom.Tokens.inherited else mode


def _mode(prim: Usd.Prim) -> str:
    while prim and not prim.IsPseudoRoot():
        if mode := _own_mode(prim):
            return mode
        prim = prim.GetParent()
    return ""


def _is_applied(prim: Usd.Prim) -> bool:
    """Whether a mode counts for a prim: for components among models, and for what says so."""
    applied = prim.GetAttribute("model:applyDrawMode")
    if applied and applied.HasAuthoredValue() and applied.Get() is True:
        return True
    return prim.IsModel() and Kind.Registry.IsA(Usd.ModelAPI(prim).GetKind(), Kind.Tokens.component)


def _instances_above(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """A prim and its ancestors, those that are instances: what lies in these cannot be replaced."""
    while prim and not prim.IsPseudoRoot():
        if prim.IsInstance() or prim.IsInstanceable():
            yield prim
        prim = prim.GetParent()


def _replace(stage: Usd.Stage, path: Sdf.Path, corners: np.ndarray, geometry: str) -> None:
    """Draws the model at ``path`` as cards on or across the box of two corners [2, 3]."""
    prim = stage.GetPrimAtPath(path)
    for child in prim.GetAllChildren():
        # What is referenced from a model of this stage has its cards by then.
        if child.GetName() != NAME:
            child.SetActive(False)
    if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer):
        prim.SetTypeName("Xform")
    model = UsdGeom.ModelAPI(prim)
    files = _textures(model)
    cards = _cards(frozenset(files), geometry == UsdGeom.Tokens.box)
    mesh = UsdGeom.Mesh.Define(stage, path.AppendChild(NAME))
    places = [_corners(card) for card in cards]
    points = np.concatenate([corners[0] + place * (corners[1] - corners[0]) for place, _ in places])
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([4] * len(cards))
    mesh.CreateFaceVertexIndicesAttr(list(range(4 * len(cards))))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    color = model.GetModelDrawModeColorAttr().Get() or Gf.Vec3f(0.18)
    mesh.CreateDisplayColorAttr([color])
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec2fArray.FromNumpy(np.concatenate([st for _, st in places]).astype(np.float32)))
    for side, file in files.items():
        material = _material(stage, mesh.GetPath().AppendChild(f"Material{SIDES.index(side)}"), file, color)
        faces = [number for number, card in enumerate(cards) if card.textured == side]
        binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
        subset = binding.CreateMaterialBindSubset(f"Side{SIDES.index(side)}", faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)


def _textures(model: UsdGeom.ModelAPI) -> dict[Side, Sdf.AssetPath]:
    """The textures of the sides that have one, with paths that mean the same in any layer."""
    found = {}
    for axis, axis_name in enumerate("XYZ"):
        for sign, sign_name in ((1, "Pos"), (-1, "Neg")):
            attribute = model.GetPrim().GetAttribute(f"model:cardTexture{axis_name}{sign_name}")
            asset = attribute.Get() if attribute else None
            if isinstance(asset, Sdf.AssetPath) and asset.path:
                found[axis, sign] = Sdf.AssetPath(asset.resolvedPath or asset.path)
    return found


def _cards(textured: frozenset[Side], box: bool) -> list[_Card]:
    """The cards of a model with these textures: on its box, or across it.

    Both sides of a pair are drawn where either has a texture, the other by the same texture seen through from behind;
    and all where none has any.
    """
    cards = []
    for axis in range(3):
        own = [side for side in ((axis, 1), (axis, -1)) if side in textured]
        if textured and not own:
            continue
        if box:
            for side in ((axis, 1), (axis, -1)):
                cards.append(_Card(side, 0.5 + 0.5 * side[1], side if side in own else (own[0] if own else None)))
        elif len(own) == 2:
            cards += [_Card(side, 0.5 + 0.5 * GAP * side[1], side) for side in own]
        else:
            cards.append(_Card((axis, 1), 0.5, own[0] if own else None))
    return cards


def _corners(card: _Card) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a card in the unit box [4, 3], counterclockwise as seen from its side, and their (s, t) [4, 2]."""
    axis, sign = card.side
    along = ALONG[axis]
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    places = np.full((4, 3), card.place)
    places[:, along] = square
    # x over z goes round y the other way than x over y round z, and y over z round x.
    order = slice(None) if (sign > 0) != (axis == 1) else slice(None, None, -1)
    backwards = np.array(BACKWARDS[card.textured or card.side])
    return places[order], np.where(backwards, 1.0 - square, square)[order]


def _material(stage: Usd.Stage, path: Sdf.Path, file: Sdf.AssetPath, color: Gf.Vec3f) -> UsdShade.Material:
    material = UsdShade.Material.Define(stage, path)
    surface, texture, reader = (
        UsdShade.Shader.Define(stage, path.AppendChild(name)) for name in ("Surface", "Texture", "Coordinates")
    )
    surface.CreateIdAttr("UsdPreviewSurface")
    texture.CreateIdAttr("UsdUVTexture")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*color, 1.0))
    for name in ("wrapS", "wrapT"):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set("clamp")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "a")
    surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(THRESHOLD)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material
