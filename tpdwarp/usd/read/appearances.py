"""What a mesh looks like at a frame: a material for each triangle, and its display colours."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Interaction, Material
from tpdwarp.usd.read.materials import BRIGHTEST, DISPLAY_COLOR, Materials, Surface
from tpdwarp.usd.read.primvars import flattened
from tpdwarp.usd.read.topology import Topology
from tpdwarp.usd.read.values import indices_or_none, text_at, value_at

# Of nested dielectrics; see tpdwarp.scene.nesting.
PRIORITY = "tpdwarp:priority"


@dataclass(frozen=True, eq=False)
class Appearance:
    """Materials and colours of a mesh's triangles, as in ``MeshAtShutter``.

    Attributes:
        kept: Whether each triangle is there, shape [m]; None where all are.
        varies: Whether any of this may change with time.
        given_at: Row of the given colour among its colours; −1 where it is not among them.
    """

    materials: tuple[Material, ...]
    triangle_materials: np.ndarray
    colors: np.ndarray | None
    color_indices: np.ndarray | None
    coordinates: np.ndarray | None
    coordinate_indices: np.ndarray | None
    kept: np.ndarray | None
    varies: bool
    given_at: int = -1


class Appearances:
    """What meshes look like, found once for all instances of one.

    Args:
        materials: Reads the bound materials.
        warnings: Takes what is not supported, and names the file in errors.
    """

    def __init__(self, materials: Materials, warnings: WarnOnce) -> None:
        self._materials, self._warnings = materials, warnings
        self._known: dict[str, tuple[float, Topology, Appearance]] = {}
        self._priorities: dict[str, int] = {}

    def of(
        self,
        prim: Usd.Prim,
        topology: Topology,
        point_count: int,
        frame: float,
        given_color: np.ndarray | None,
    ) -> Appearance:
        """As :func:`appearance_of`."""
        arguments = self._materials, self._warnings, given_color
        if given_color is not None:
            return appearance_of(prim, topology, point_count, frame, *arguments)
        path = str(prim.GetPath())
        known = self._known.get(path)
        if known is None or known[1] is not topology or (known[2].varies and known[0] != frame):
            known = frame, topology, appearance_of(prim, topology, point_count, frame, *arguments)
            self._known[path] = known
        return known[2]

    def priority(self, prim: Usd.Prim) -> int:
        """``primvars:tpdwarp:priority`` of a mesh, or of what it inherits from; 0 without.

        Where solids overlap the highest holds (:mod:`tpdwarp.scene.nesting`).
        """
        path = str(prim.GetPath())
        if path not in self._priorities:
            self._priorities[path] = self._priority(prim)
        return self._priorities[path]

    def _priority(self, prim: Usd.Prim) -> int:
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(PRIORITY)
        if not primvar or not primvar.HasValue():
            return 0
        value = primvar.Get(Usd.TimeCode.EarliestTime())
        if not isinstance(value, int):
            self._warnings(str(primvar.GetAttr().GetPath()), "is no whole number and is ignored (author an int)")
            return 0
        return value


def appearance_of(
    prim: Usd.Prim,
    topology: Topology,
    point_count: int,
    frame: float,
    materials: Materials,
    warnings: WarnOnce,
    given_color: np.ndarray | None,
) -> Appearance:
    """Materials and display colours of a mesh at a time code.

    Args:
        prim: The mesh, as placed (inherited bindings and primvars count).
        topology: Its triangles.
        point_count: Its points.
        frame: Time code.
        materials: Reads the bound materials.
        warnings: Takes what is not supported, and names the file in errors.
        given_color: The colour [3] of a mesh without display colours, or None.

    Raises:
        InputError: Unusable material inputs.
    """
    numbered: dict[Surface, int] = {materials.bound(prim, frame): 0}
    face_surfaces = np.zeros(topology.face_count, dtype=np.int32)
    subsets_vary = False
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        if text_at(subset.GetElementTypeAttr()) != UsdGeom.Tokens.face:
            warnings(str(subset.GetPath()), "binds a material to something other than faces and is ignored")
            continue
        subsets_vary |= subset.GetIndicesAttr().ValueMightBeTimeVarying()
        faces = indices_or_none(subset.GetIndicesAttr(), frame, warnings)
        if len(faces) and (faces.min() < 0 or faces.max() >= topology.face_count):
            warnings(f"{subset.GetPath()}.indices", "names faces that the mesh does not have, which are ignored")
            faces = faces[(faces >= 0) & (faces < topology.face_count)]
        face_surfaces[faces] = numbered.setdefault(materials.bound(subset.GetPrim(), frame), len(numbered))
    surfaces = list(numbered)
    used = np.unique(face_surfaces[topology.faces])
    renumbered = np.zeros(len(surfaces), dtype=np.int32)
    renumbered[used] = np.arange(len(used))
    surfaces = [surfaces[i] for i in used]
    triangle_materials = renumbered[face_surfaces[topology.faces]]
    named = [s.color_primvar if s.material.interaction == Interaction.DIFFUSE else "" for s in surfaces]
    colors = indices = None
    colors_vary, given_at = False, -1
    for name in filter(None, dict.fromkeys(named)):
        found, of_corners, vary = _colors_of(prim, name, topology, point_count, frame, warnings)
        if found is None and name == DISPLAY_COLOR and given_color is not None:
            found, of_corners = given_color[None], np.zeros(topology.triangles.shape, dtype=np.int32)
            vary, given_at = True, 0 if colors is None else len(colors)
        colors_vary |= vary
        if found is None:
            continue
        asked = np.array([of_surface == name for of_surface in named], dtype=bool)
        if colors is None:
            colors, indices = np.zeros((0, 3)), np.full(topology.triangles.shape, -1, dtype=np.int32)
        indices = np.where(asked[triangle_materials][:, None], of_corners + len(colors), indices).astype(np.int32)
        colors = np.concatenate([colors, found])
    # Materials say themselves how much of them is there.
    if not all(surface.material.path for surface in surfaces):
        opacity, opacity_varies = _display_opacity(prim, frame, warnings)
        colors_vary |= opacity_varies
        surfaces = [
            surface if surface.material.path else replace(surface, material=replace(surface.material, presence=opacity))
            for surface in surfaces
        ]
    coordinates, coordinate_indices, coordinates_vary = _coordinates(
        prim, topology, point_count, frame, surfaces, triangle_materials, warnings
    )
    absent = np.array([surface.absent for surface in surfaces], dtype=bool)
    return Appearance(
        tuple(surface.material for surface in surfaces),
        triangle_materials,
        colors,
        indices,
        coordinates,
        coordinate_indices,
        ~absent[triangle_materials] if absent.any() else None,
        subsets_vary or colors_vary or coordinates_vary or any(surface.varies for surface in surfaces),
        given_at,
    )


def _coordinates(
    prim: Usd.Prim,
    topology: Topology,
    point_count: int,
    frame: float,
    surfaces: list[Surface],
    triangle_materials: np.ndarray,
    warnings: WarnOnce,
) -> tuple[np.ndarray | None, np.ndarray | None, bool]:
    """Texture coordinates [s, 2], those of each triangle corner [m, 3] (−1: none), and whether they may change.

    Each surface looks up its textures by a primvar of its own.
    """
    parts: list[np.ndarray] = []
    indices = np.full(topology.triangles.shape, -1, dtype=np.int32)
    count, varies = 0, False
    for number, surface in enumerate(surfaces):
        if surface.coordinates is None:
            continue
        name = surface.coordinates.primvar
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        if not primvar or not primvar.HasValue():
            warnings(f"{prim.GetPath()}.primvars:{name}", "is not there for textures: their mean colour is rendered")
            continue
        curve = flattened(primvar, warnings.file, shape=(None, None))
        varies |= curve.varies
        try:
            values = curve.at(frame)
        except InputError as error:
            warnings(error.prim, f"{error.message}; until then textures have their mean colour", "textures")
            continue
        spread = None
        if values is not None and len(values) and values.shape[1] >= 2:
            spread = topology.spread(values[:, :2], str(primvar.GetInterpolation()), point_count)
        if spread is None:
            warnings(
                str(primvar.GetAttr().GetPath()), "does not fit its interpolation: textures have their mean colour"
            )
            continue
        rows = triangle_materials == number
        indices[rows] = spread[1][rows] + count
        parts.append(surface.coordinates.of(spread[0]))
        if surface.tiles is not None and _misses_tiles(parts[-1][spread[1][rows]], surface.tiles):
            warnings(str(prim.GetPath()), "lies on tiles (UDIM) that its textures have no files for: black there")
        count += len(parts[-1])
    return (np.concatenate(parts), indices, varies) if parts else (None, None, varies)


def _misses_tiles(coordinates: np.ndarray, tiles: frozenset[tuple[int, int]]) -> bool:
    """Whether triangles of texture coordinates [m, 3, 2] have their middles on unit squares other than ``tiles``."""
    middles = coordinates.mean(axis=1)
    squares = np.unique(np.floor(middles[np.isfinite(middles).all(axis=1)]), axis=0)
    return any((int(s), int(t)) not in tiles for s, t in squares)


def _display_opacity(prim: Usd.Prim, frame: float, warnings: WarnOnce) -> tuple[float, bool]:
    """``displayOpacity`` of a mesh, the mean of it where it differs over the surface, and whether it may change."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayOpacity")
    if not primvar or not primvar.HasValue():
        return 1.0, False
    attribute = primvar.GetAttr()
    values = value_at(attribute, frame)
    if values is None or not values.size or not np.isfinite(values).all():
        return 1.0, attribute.ValueMightBeTimeVarying()
    if values.size > 1 and np.ptp(values) > 0:
        warnings(str(attribute.GetPath()), "displayOpacity is rendered by its mean over the surface")
    return float(np.clip(values.mean(), 0.0, 1.0)), attribute.ValueMightBeTimeVarying()


def _colors_of(
    prim: Usd.Prim, name: str, topology: Topology, point_count: int, frame: float, warnings: WarnOnce
) -> tuple[np.ndarray | None, np.ndarray | None, bool]:
    """A primvar's colours [c, 3], those of each triangle corner [m, 3], and whether they may change."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasValue():
        return None, None, False
    path = str(primvar.GetAttr().GetPath())
    curve = flattened(primvar, warnings.file)
    try:
        colors = curve.at(frame)
    except InputError as error:
        warnings(error.prim, f"{error.message}; until then the colours are ignored", "colours are ignored")
        return None, None, curve.varies
    if colors is None or len(colors) == 0:
        return None, None, curve.varies
    if colors.min() < 0 or colors.max() > BRIGHTEST:
        warnings(path, f"holds colours outside 0 … {BRIGHTEST:g}, which are clamped")
        colors = np.clip(colors, 0.0, BRIGHTEST)
    interpolation = str(primvar.GetInterpolation())
    spread = topology.spread(colors, interpolation, point_count)
    if spread is None:
        warnings(path, f"does not fit its interpolation ({interpolation}) and is ignored")
        return None, None, curve.varies
    colors, indices = spread
    return colors, np.ascontiguousarray(indices, dtype=np.int32), curve.varies
