"""Materials bound to meshes, read as one of three interactions: diffuse, smooth dielectric, mirror."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

from pxr import Sdf, Usd, UsdShade

from tpdwarp.errors import WarnOnce
from tpdwarp.scene.description import Interaction, Material
from tpdwarp.usd.read.materials.constants import Asked, Constants
from tpdwarp.usd.read.materials.coordinates import Coordinates
from tpdwarp.usd.read.materials.copies import Heard, Said, content_of
from tpdwarp.usd.read.materials.dialects import handed_on, name_of, reader_of
from tpdwarp.usd.read.materials.dialects.table import BRIGHTEST
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.interactions import interaction_of
from tpdwarp.usd.read.materials.physical import Physical
from tpdwarp.usd.read.materials.textures import Textures

__all__ = ["BRIGHTEST", "DISPLAY_COLOR", "Materials", "Surface"]

# Render contexts in the order in which their surfaces are chosen: this renderer's own, MaterialX, and what is for all.
CONTEXTS = ("tpdwarp", "mtlx", UsdShade.Tokens.universalRenderContext)

DISPLAY_COLOR = "displayColor"


@dataclass(frozen=True)
class Surface:
    """A material as bound to a mesh or a part of it.

    Attributes:
        material: Its optical behaviour at the frame asked for.
        color_primvar: The mesh's primvar that is its albedo where there is one; empty for none.
        varies: Whether any of its inputs may change with time.
        absent: Whether the surface is cut out: there is nothing there.
        coordinates: Where the coordinates of its textures come from; None where it has none.
        tiles: Unit squares of (s, t) that all of its textures have files for; None where they are not cut into tiles.
        physical: What was read, before it was brought to an interaction; None where nothing could be read.
    """

    material: Material
    color_primvar: str
    varies: bool
    absent: bool = False
    coordinates: Coordinates | None = None
    tiles: frozenset[tuple[int, int]] | None = None
    physical: Physical | None = None

    def __hash__(self) -> int:
        return hash((self.material, self.color_primvar, self.absent))

    def of_copy(self, original: str, copy: str) -> Surface:
        """The surface of a material that is a copy of its own, by their paths."""
        if self.physical is None:
            return replace(self, material=replace(self.material, path=copy))
        sources = {name: source.replace(original, copy) for name, source in self.physical.sources.items()}
        physical = replace(self.physical, sources=sources)
        return replace(self, material=replace(self.material, path=copy), physical=physical)


UNBOUND = Surface(Material(), DISPLAY_COLOR, False)


@dataclass(frozen=True)
class _Original:
    """A material that others may be copies of: its path, its surface, what was said of it, and whether it was asked for
    primvars."""

    path: str
    surface: Surface
    said: list[Said]
    asked: bool


class _Originals:
    """Materials by their contents; those that change with time for the latest time alone."""

    def __init__(self) -> None:
        self._lasting: dict[Hashable, _Original] = {}
        self._latest: tuple[float, dict[Hashable, _Original]] = (0.0, {})

    def get(self, content: Hashable, frame: float) -> _Original | None:
        if content in self._lasting:
            return self._lasting[content]
        return self._latest[1].get(content) if self._latest[0] == frame else None

    def add(self, content: Hashable, frame: float, original: _Original) -> None:
        if not original.surface.varies:
            self._lasting[content] = original
            return
        if self._latest[0] != frame:
            self._latest = frame, {}
        self._latest[1][content] = original


class Materials:
    """Reads the materials of a stage.

    Args:
        warnings: Takes what is not supported, and names the file in errors.
        purpose: Material purpose that is looked for first (``full``, ``preview``), before the general one.
    """

    def __init__(self, warnings: WarnOnce, purpose: str = UsdShade.Tokens.full) -> None:
        self.warnings, self.purpose = warnings, purpose
        self._textures = Textures()
        # By path, by the primvars that were asked for, and by their values.
        self._known: dict[str, dict[tuple[Asked, ...], dict[Hashable, tuple[float, Surface]]]] = {}
        self._originals = _Originals()
        self._unbound: set[str] = set()

    def bound(self, prim: Usd.Prim, frame: float) -> Surface:
        """The surface bound to a mesh or a GeomSubset at a time code."""
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(self.purpose)
        if not material and self.purpose == UsdShade.Tokens.full:
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.preview)
            if material:
                self.warnings(str(prim.GetPath()), "has a material for previews alone, which is rendered")
        if not material:
            self._warn_lost(prim)
            return UNBOUND
        path, constants = str(material.GetPath()), Constants(prim, frame)
        known = self._known.setdefault(path, {})
        for asked, surfaces in known.items():
            time, surface = surfaces.get(constants.values(asked), (frame, None))
            if surface is not None and (time == frame or not surface.varies):
                return _of_prim(surface, constants)
        surface = self._shared(material, frame, constants)
        asked = tuple(constants.asked)
        known.setdefault(asked, {})[constants.values(asked)] = frame, surface
        return _of_prim(surface, constants)

    def _shared(self, material: UsdShade.Material, frame: float, constants: Constants) -> Surface:
        """The surface of a material, that of its original where it is a copy of one: they share their textures."""
        path, content = str(material.GetPath()), content_of(material, frame)
        original = None if content is None else self._originals.get(content, frame)
        # What depends on primvars differs from mesh to mesh.
        if original is not None and not original.asked:
            for warning in original.said:
                self.warnings(*warning.of(original.path, path))
            return original.surface.of_copy(original.path, path)
        heard = Heard(self.warnings)
        constants.asked.clear()
        surface = self._surface(material, frame, heard, constants)
        if content is not None:
            self._originals.add(content, frame, _Original(path, surface, heard.said, bool(constants.asked)))
        return surface

    def _warn_lost(self, prim: Usd.Prim) -> None:
        """Says where a prim without a material, or what it inherits from, is bound to none that is there."""
        if str(prim.GetPath()) in self._unbound:
            return
        self._unbound.add(str(prim.GetPath()))
        stage = prim.GetStage()
        while prim and not prim.IsPseudoRoot():
            binding = UsdShade.MaterialBindingAPI(prim)
            for purpose in dict.fromkeys((self.purpose, UsdShade.Tokens.allPurpose)):
                relationship = binding.GetDirectBindingRel(purpose)
                for path in relationship.GetForwardedTargets() if relationship else ():
                    if not UsdShade.Material(stage.GetPrimAtPath(path)) and not _is_elsewhere(stage, path):
                        self.warnings(
                            str(relationship.GetPath()),
                            f"names {path}, which is no material; displayColor or grey is used",
                            "binds no material",
                        )
                        return
            prim = prim.GetParent()

    def may_be_specular(self, prim: Usd.Prim, frame: float) -> bool:
        """Whether any part of a mesh reflects or refracts at a time code."""
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        surfaces = [self.bound(part, frame) for part in (prim, *(subset.GetPrim() for subset in subsets))]
        return any(surface.material.interaction != Interaction.DIFFUSE for surface in surfaces)

    def _surface(
        self, material: UsdShade.Material, frame: float, warnings: WarnOnce, constants: Constants
    ) -> Surface:
        path = str(material.GetPath())
        shaders = _surface_shaders(material)
        if not shaders:
            named = any(output.HasConnectedSource() for output in material.GetSurfaceOutputs())
            found = "has no surface shader that can be read;" if named else "names no surface: as in viewers,"
            warnings(path, f"{found} displayColor or grey is used")
            return Surface(Material(path=path), DISPLAY_COLOR, False)
        readers = [(shader, reader) for shader in shaders if (reader := reader_of(shader)) is not None]
        if not readers:
            kind = name_of(shaders[0]) or "the surface shader"
            warnings(
                str(shaders[0].GetPath()), f"{kind} is of a kind that is not read; displayColor or grey is used"
            )
            return Surface(Material(path=path), DISPLAY_COLOR, False)
        shader, reader = readers[0]
        inputs = Inputs(shader, frame, self._textures, warnings, constants)
        physical = reader(inputs)
        found = interaction_of(physical, path, warnings)
        if any(source.GetPrim() != shader.GetPrim() for source in _displacements(material)):
            warnings(path, "displacement is not rendered")
        images = [] if found is None else [
            physical.base_image if found.texture else None,
            physical.cutout,
            physical.normal_image if found.normal_map else None,
            *(physical.images.values() if found.has_maps else ()),
        ]
        lie = [image.coordinates for image in images if image is not None]
        tiled = [frozenset(image.tiles) for image in images if image is not None and image.tiled]
        if len(set(lie)) > 1:
            warnings(path, "its textures lie differently: all lie as the first that colours, cuts out or bends")
        return Surface(
            found or Material(path=path),
            physical.color_primvar,
            inputs.varies,
            found is None,
            lie[0] if lie else None,
            frozenset.intersection(*tiled) if tiled else None,
            physical,
        )


def _of_prim(surface: Surface, constants: Constants) -> Surface:
    """The surface of a prim whose primvars may change it with time."""
    return replace(surface, varies=True) if constants.varies and not surface.varies else surface


def _is_elsewhere(stage: Usd.Stage, path: Sdf.Path) -> bool:
    """Whether a prim that is not there would come with a reference or payload, whose absence is said already."""
    while not stage.GetPrimAtPath(path) and not path.isEmpty:
        path = path.GetParentPath()
    prim = stage.GetPrimAtPath(path)
    return bool(prim) and (prim.HasAuthoredReferences() or prim.HasAuthoredPayloads())


def _displacements(material: UsdShade.Material) -> list[UsdShade.Shader]:
    """The shaders that displace a material's surfaces, in any renderer."""
    contexts = {output.GetBaseName().rpartition(":")[0] for output in material.GetDisplacementOutputs()}
    found = (material.ComputeDisplacementSource(context)[0] for context in contexts)
    return [shader for shader in found if shader]


def _surface_shaders(material: UsdShade.Material) -> list[UsdShade.Shader]:
    """The surface shaders of a material, in the order in which they are chosen.

    What is authored for another renderer alone is better than nothing: such contexts come last, by name.
    """
    outputs = {context: material.GetSurfaceOutput(context) for context in CONTEXTS}
    contexts = [context for context, output in outputs.items() if output]
    others = (output.GetBaseName().split(":") for output in material.GetSurfaceOutputs())
    contexts += sorted({name[0] for name in others if len(name) == 2} - set(CONTEXTS))
    found: dict[str, UsdShade.Shader] = {}
    for context in contexts:
        shader = material.ComputeSurfaceSource(context)[0]
        if shader := handed_on(shader):
            found.setdefault(str(shader.GetPath()), shader)
    return list(found.values())
