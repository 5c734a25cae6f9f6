"""What a stage holds: one walk over its prims sorts out meshes, instancers, lights, cameras and the rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from pxr import Usd, UsdGeom, UsdLux, UsdSkel

from tpdwarp.errors import WarnOnce
from tpdwarp.usd.read.blobs import is_blob
from tpdwarp.usd.read.domes import is_dome
from tpdwarp.usd.read.instances import Instancer, Prototype
from tpdwarp.usd.read.lights import is_light
from tpdwarp.usd.read.mesh_lights import is_mesh_light
from tpdwarp.usd.read.primitives import is_primitive
from tpdwarp.usd.read.transforms import Transforms
from tpdwarp.usd.read.visibilities import may_be_visible

# Prototypes are often abstract (class prims), or lie below an over that hides them: an ordinary traversal passes both.
PROTOTYPE_PRIMS = Usd.PrimIsActive & Usd.PrimHasDefiningSpecifier & Usd.PrimIsLoaded
# Boundable prims that draw nothing of their own.
DRAWN_OTHERWISE = (UsdGeom.PointInstancer, UsdSkel.Root, UsdSkel.Skeleton)


@dataclass
class Contents:
    """The prims that matter, in stage order.

    Attributes:
        meshes: Meshes, primitives, points and curves of an included purpose, native instances included.
        instancers: Point instancers of an included purpose that are not nested in another's prototype.
        lights: Lights that are rendered.
        cameras: Cameras.
        domes: Dome lights.
        circular: Whether an instancer holds itself, which USD's own bounds of it do not survive.
    """

    meshes: list[Usd.Prim] = field(default_factory=list)
    instancers: list[Instancer] = field(default_factory=list)
    lights: list[Usd.Prim] = field(default_factory=list)
    cameras: list[Usd.Prim] = field(default_factory=list)
    domes: list[Usd.Prim] = field(default_factory=list)
    circular: bool = False

    @property
    def shows_anything(self) -> bool:
        """Whether anything is drawn that is visible at some time."""
        prims = [*self.meshes, *(of.instancer.GetPrim() for of in self.instancers if of.holds_meshes)]
        return any(map(may_be_visible, prims))


class Walker:
    """Sorts the prims of a stage.

    Args:
        purposes: Purposes included.
        transforms: Transforms of the stage.
        warnings: Takes what is left out.
    """

    def __init__(self, purposes: frozenset[str], transforms: Transforms, warnings: WarnOnce) -> None:
        self._purposes, self._transforms, self._warnings = purposes, transforms, warnings
        self._prototypes: dict[str, Prototype] = {}
        self._walking: set[str] = set()
        self._circular = False

    def walk(self, stage: Usd.Stage) -> Contents:
        """Everything on the stage that can be rendered; what cannot is warned about, once by prim."""
        contents = Contents()
        for prim in self._prims(stage.GetPseudoRoot(), Usd.PrimDefaultPredicate):
            if prim.IsA(UsdGeom.Camera):
                contents.cameras.append(prim)
            elif is_light(prim):
                contents.lights.append(prim)
            elif is_dome(prim):
                contents.domes.append(prim)
            elif self._included(prim):
                if is_drawn(prim):
                    contents.meshes.append(prim)
                elif prim.IsA(UsdGeom.PointInstancer):
                    contents.instancers.append(self._instancer(prim))
                self._warn_unsupported(prim)
        contents.circular = self._circular
        return contents

    def _prims(self, root: Usd.Prim, predicate: object) -> Iterator[Usd.Prim]:
        """Prims below a root, without what lies inside instancers: that is drawn as prototypes only."""
        prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(predicate)))
        for prim in prims:
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
            yield prim

    def _included(self, prim: Usd.Prim) -> bool:
        imageable = UsdGeom.Imageable(prim)
        return bool(imageable) and str(imageable.ComputePurpose()) in self._purposes

    def _instancer(self, prim: Usd.Prim) -> Instancer:
        instancer = UsdGeom.PointInstancer(prim)
        stage = prim.GetStage()
        prototypes = []
        for path in instancer.GetPrototypesRel().GetForwardedTargets():
            root = stage.GetPrimAtPath(path)
            if not root:
                self._warnings(f"{prim.GetPath()}.prototypes", f"names {path}, which does not exist")
            prototypes.append(self._prototype(root) if root else Prototype(prim))
        return Instancer(instancer, prototypes, self._transforms, self._warnings)

    def _prototype(self, root: Usd.Prim) -> Prototype:
        key = str(root.GetPath())
        if key in self._walking:
            self._warnings(key, "is a prototype that holds itself: that instance is left out")
            self._circular = True
            return Prototype(root)
        if key in self._prototypes:
            return self._prototypes[key]
        prototype = self._prototypes[key] = Prototype(root)
        self._walking.add(key)
        for prim in self._prims(root, PROTOTYPE_PRIMS):
            if is_light(prim):
                prototype.lights.append(prim)
                continue
            if prim.HasAPI(UsdLux.LightAPI) and not is_drawn(prim):
                self._warnings(str(prim.GetPath()), f"a {prim.GetTypeName()} in a prototype is left out")
                continue
            if not self._included(prim):
                continue
            if is_drawn(prim):
                prototype.meshes.append(prim)
            elif prim.IsA(UsdGeom.PointInstancer):
                prototype.instancers.append(self._instancer(prim))
            self._warn_unsupported(prim)
        self._walking.remove(key)
        return prototype

    def _warn_unsupported(self, prim: Usd.Prim) -> None:
        path, kind = str(prim.GetPath()), prim.GetTypeName()
        if not may_be_visible(prim):
            return
        if prim.IsA(UsdGeom.Mesh):
            if prim.HasAPI(UsdLux.LightAPI) and not is_mesh_light(prim):
                self._warnings(path, "the mesh is rendered, but the light it emits is not (apply MeshLightAPI)")
            return
        if is_drawn(prim) and prim.HasAPI(UsdLux.LightAPI):
            self._warnings(path, f"the {kind} is rendered, but the light it emits is not")
            return
        if prim.IsA(UsdLux.PortalLight):
            self._warnings(path, "a PortalLight only says where light of domes comes in: domes are sampled as a whole")
            return
        drawn = is_drawn(prim) or any(map(prim.IsA, DRAWN_OTHERWISE))
        if prim.HasAPI(UsdLux.LightAPI) or (prim.IsA(UsdGeom.Boundable) and not drawn):
            self._warnings(path, f"a {kind} is not rendered")


def is_drawn(prim: Usd.Prim) -> bool:
    """Whether a prim has a shape that is rendered."""
    return prim.IsA(UsdGeom.Mesh) or is_primitive(prim) or is_blob(prim)
