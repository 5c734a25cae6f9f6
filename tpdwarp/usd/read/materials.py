"""Materials bound to meshes, read as one of three interactions: diffuse, smooth dielectric, mirror.

UsdPreviewSurface is read as documented; surfaces of other kinds (OpenPBR, Standard Surface) by the plain inputs that
mean the same. What has no counterpart here is warned about once, and the nearest thing is done.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdShade

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Interaction, Material
from tpdwarp.usd.read.values import text_at, value_at

# The names an optical property goes by: UsdPreviewSurface, OpenPBR, Standard Surface.
COLOR = ("diffuseColor", "base_color")
WEIGHT = ("base_weight", "base")
METALLIC = ("metallic", "base_metalness", "metalness")
ROUGHNESS = ("roughness", "specular_roughness")
IOR = ("ior", "specular_ior", "specular_IOR")
OPACITY = ("opacity", "geometry_opacity")
TRANSMISSION = ("transmission", "transmission_weight")
# Inputs that add something which is not rendered, with the value at which they add nothing.
IGNORED = {
    "emissiveColor": 0.0,
    "emission": 0.0,
    "emission_luminance": 0.0,
    "clearcoat": 0.0,
    "coat": 0.0,
    "coat_weight": 0.0,
    "sheen": 0.0,
    "fuzz_weight": 0.0,
    "subsurface": 0.0,
    "subsurface_weight": 0.0,
    "displacement": 0.0,
    "useSpecularWorkflow": 0.0,
    "opacityThreshold": 0.0,
    "transmission_color": 1.0,
    "thin_film_thickness": 0.0,
    "thin_film_weight": 0.0,
}
# Colours above one are art; above this, an accident.
BRIGHTEST = 1e6
CONNECTED_ONLY = ("normal", "geometry_normal", "occlusion")


@dataclass(frozen=True)
class Surface:
    """A material as bound to a mesh or a part of it.

    Attributes:
        material: Its optical behaviour at the frame asked for.
        by_display_color: Whether its albedo is the mesh's ``displayColor`` where there is one.
        varies: Whether any of its inputs may change with time.
    """

    material: Material
    by_display_color: bool
    varies: bool


UNBOUND = Surface(Material(), True, False)


class Materials:
    """Reads the materials of a stage.

    Args:
        warnings: Takes what is not supported, and names the file in errors.
        purpose: Material purpose that is looked for first (``full``, ``preview``), before the general one.
    """

    def __init__(self, warnings: WarnOnce, purpose: str = UsdShade.Tokens.full) -> None:
        self.warnings, self.purpose = warnings, purpose
        self._still: dict[str, Surface] = {}

    def bound(self, prim: Usd.Prim, frame: float) -> Surface:
        """The surface bound to a mesh or a GeomSubset at a time code.

        Raises:
            InputError: An index of refraction or a colour that means nothing.
        """
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(self.purpose)
        if not material:
            return UNBOUND
        path = str(material.GetPath())
        if path in self._still:
            return self._still[path]
        surface = self._surface(material, frame)
        if not surface.varies:
            self._still[path] = surface
        return surface

    def may_be_specular(self, prim: Usd.Prim, frame: float) -> bool:
        """Whether any part of a mesh reflects or refracts at a time code, or might if its material could be read."""
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        try:
            surfaces = [self.bound(part, frame) for part in (prim, *(subset.GetPrim() for subset in subsets))]
        except InputError:
            return True
        return any(surface.material.interaction != Interaction.DIFFUSE for surface in surfaces)

    def _surface(self, material: UsdShade.Material, frame: float) -> Surface:
        path = str(material.GetPath())
        universal, materialx = (material.ComputeSurfaceSource(context)[0] for context in ("", "mtlx"))
        shader = universal or materialx
        if not shader:
            self.warnings(path, "has no surface shader that can be read; displayColor or grey is used")
            return Surface(Material(path=path), True, False)
        inputs = _Inputs(shader, frame, self.warnings)
        preview = shader.GetShaderId() == "UsdPreviewSurface"
        if not preview and not any(inputs.present(names) for names in (COLOR, TRANSMISSION, METALLIC)):
            kind = shader.GetShaderId() or "the surface shader"
            self.warnings(str(shader.GetPath()), f"{kind} is of a kind that is not read; displayColor or grey is used")
            return Surface(Material(path=path), True, False)
        color, by_display_color = inputs.color(0.18 if preview else 0.8)
        ior = inputs.number(IOR, 1.5)
        roughness = inputs.number(ROUGHNESS, 0.5 if preview else 0.3)
        metallic = inputs.number(METALLIC, 0.0)
        opacity = inputs.number(OPACITY, 1.0)
        transmission = inputs.number(TRANSMISSION, 0.0)
        interaction = Interaction.DIFFUSE
        if opacity < 0.5 or transmission >= 0.5:
            interaction = Interaction.DIELECTRIC
            if not (math.isfinite(ior) and ior > 0):
                raise inputs.refusal(IOR, f"an index of refraction of {ior:g} (author one above 0, glass has 1.5)")
            if inputs.present(ROUGHNESS) and roughness > 0:
                inputs.warn(ROUGHNESS, "rough transmission is rendered as smooth")
        elif metallic >= 1 and roughness <= 0:
            interaction = Interaction.MIRROR
            if max(color) > 1:
                inputs.warn(COLOR, "a mirror reflects no more than it receives: its colour is limited to 1")
                color = tuple(min(channel, 1.0) for channel in color)
        elif metallic > 0:
            inputs.warn(METALLIC, "only metallic 1 with roughness 0 is a mirror; this surface is rendered as diffuse")
        if 0 < opacity < 1:
            nearest = "clear" if opacity < 0.5 else "opaque"
            inputs.warn(OPACITY, f"partial opacity is rendered as {nearest}")
        if 0 < transmission < 1:
            nearest = "clear" if transmission >= 0.5 else "opaque"
            inputs.warn(TRANSMISSION, f"partial transmission is rendered as {nearest}")
        if preview and interaction == Interaction.DIELECTRIC and inputs.token("opacityMode") == "presence":
            inputs.warn(("opacityMode",), "cut-outs are rendered as a transparent surface")
        inputs.warn_ignored()
        displacement = material.ComputeDisplacementSource()[0]
        if displacement and displacement.GetPrim() != shader.GetPrim():
            self.warnings(path, "displacement is not rendered")
        varies = inputs.varies
        return Surface(Material(interaction, color, ior, path), by_display_color, varies)


class _Inputs:
    """The inputs of one shader at one time code."""

    def __init__(self, shader: UsdShade.Shader, frame: float, warnings: WarnOnce) -> None:
        self._shader, self._frame, self._warnings = shader, frame, warnings
        self.varies = False

    def present(self, names: tuple[str, ...]) -> bool:
        return self._find(names) is not None

    def color(self, default: float) -> tuple[tuple[float, float, float], bool]:
        """The base colour, and whether it is left to ``displayColor``."""
        found = self._find(COLOR)
        if found is None:
            return (default,) * 3, True
        node = self._node(found)
        if node and self._reads_display_color(node):
            return (default,) * 3, True
        value = self._value(found)
        if value is None:
            return (default,) * 3, False
        weight = self.number(WEIGHT, 1.0)
        if value.shape not in ((), (1,), (3,)):
            raise self.refusal(COLOR, f"{value.size} numbers (author a colour)")
        color = tuple(float(c) * weight for c in np.broadcast_to(value, 3))
        if not all(0 <= c <= BRIGHTEST for c in color):
            raise self.refusal(COLOR, f"a colour of {color} (author values of 0 to {BRIGHTEST:g})")
        return color, False

    def number(self, names: tuple[str, ...], default: float) -> float:
        found = self._find(names)
        value = None if found is None else self._value(found)
        if value is None:
            return default
        if value.size == 0:
            raise self.refusal(names, "no number (author a finite value)")
        number = float(np.mean(value))
        if not math.isfinite(number) and names != IOR:
            raise self.refusal(names, "not a number (author a finite value)")
        return number

    def token(self, name: str) -> str:
        found = self._find((name,))
        attributes = [] if found is None else found.GetValueProducingAttributes()
        return text_at(attributes[0], self._frame) if attributes else ""

    def refusal(self, names: tuple[str, ...], why: str) -> InputError:
        return InputError(f"holds {why}", self._warnings.file, self._path(names))

    def warn(self, names: tuple[str, ...], message: str) -> None:
        self._warnings(self._path(names), message)

    def warn_ignored(self) -> None:
        for name, harmless in IGNORED.items():
            found = self._find((name,))
            if found is None:
                continue
            value = None if self._node(found) else self._value(found)
            if value is None or np.any(value != harmless):
                self.warn((name,), "is not rendered")
        for name in CONNECTED_ONLY:
            found = self._find((name,))
            if found is not None and self._node(found):
                self.warn((name,), "is not rendered")

    def _path(self, names: tuple[str, ...]) -> str:
        found = self._find(names)
        return f"{self._shader.GetPath()}.inputs:{names[0]}" if found is None else str(found.GetAttr().GetPath())

    def _find(self, names: tuple[str, ...]) -> UsdShade.Input | None:
        for name in names:
            found = self._shader.GetInput(name)
            if found and (found.HasConnectedSource() or found.GetAttr().HasAuthoredValue()):
                return found
        return None

    def _node(self, found: UsdShade.Input) -> UsdShade.Shader | None:
        """The shading node whose output an input is connected to, or None where a plain value arrives."""
        for attribute in found.GetValueProducingAttributes():
            if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Output:
                return UsdShade.Shader(attribute.GetPrim())
        return None

    def _value(self, found: UsdShade.Input) -> np.ndarray | None:
        node = self._node(found)
        if node is None:
            attributes = found.GetValueProducingAttributes()
            if not attributes:
                return None
            self.varies |= attributes[0].ValueMightBeTimeVarying()
            return value_at(attributes[0], self._frame)
        kind = node.GetShaderId() or "a shading node"
        fallback = node.GetInput("fallback")
        value = value_at(fallback.GetAttr(), self._frame) if fallback else None
        instead = "default" if value is None else "fallback"
        self._warnings(
            str(found.GetAttr().GetPath()), f"is connected to {kind}, which is not read; its {instead} is used"
        )
        if value is None:
            return None
        # A texture's fallback has four channels whatever it feeds.
        wide = np.atleast_1d(value)
        is_color = found.GetTypeName() in (Sdf.ValueTypeNames.Color3f, Sdf.ValueTypeNames.Float3)
        return wide[:3] if is_color and len(wide) >= 3 else wide[:1]

    def _reads_display_color(self, node: UsdShade.Shader) -> bool:
        if not str(node.GetShaderId()).startswith("UsdPrimvarReader"):
            return False
        name = node.GetInput("varname")
        attributes = name.GetValueProducingAttributes() if name else []
        return bool(attributes) and text_at(attributes[0], self._frame) == "displayColor"
