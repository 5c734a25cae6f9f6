"""Why a stage shows nothing: what it holds instead of something that is drawn."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from pxr import Usd, UsdGeom, UsdLux, UsdShade

from tpdwarp.usd.read.contents import is_drawn
from tpdwarp.usd.read.visibilities import may_be_visible

# What a stage without shapes may be good for, in the words of its schemas.
OTHERS = ((UsdShade.Material, "material"), (UsdLux.LightAPI, "light"), (UsdGeom.Camera, "camera"))


def why_empty(stage: Usd.Stage, purposes: Iterable[str]) -> str:
    """What is to be said of a stage that has nothing to render for ``purposes``, and what to do."""
    every = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
    prims = list(Usd.PrimRange(stage.GetPseudoRoot(), every))
    shapes = [prim for prim in prims if _is_shape(prim)]
    there = [prim for prim in shapes if prim.IsActive() and prim.IsDefined() and not prim.IsAbstract()]
    known = [prim for prim in there if is_drawn(prim) or prim.IsA(UsdGeom.PointInstancer)]
    others = Counter(_purpose(prim) for prim in known if _purpose(prim) not in purposes)
    if not shapes:
        why = f"it holds nothing that is drawn, but {_held(prims)} (add a mesh, or name a stage that holds one)"
    elif not there:
        why = f"all of its {len(shapes)} shapes are classes, or inactive (name the stage that makes use of them)"
    elif not known:
        kinds = Counter(str(prim.GetTypeName()) for prim in there).most_common()
        held = ", ".join(f"{count} × {kind}" for kind, count in kinds)
        why = f"it holds nothing that can be rendered, but {held} (add a mesh)"
    elif others.total() == len(known):
        held = ", ".join(f"{count} of purpose {name}" for name, count in others.most_common())
        why = f"it holds only {held} (add one of them with --purposes)"
    elif not any(may_be_visible(prim) for prim in known if _purpose(prim) in purposes):
        why = f"all of its {len(known) - others.total()} shapes are invisible (make one visible)"
    else:
        why = "its instancers place none (add one, or see --purposes)"
    return f"no visible mesh: {why}"


def _is_shape(prim: Usd.Prim) -> bool:
    """Whether a prim is of a kind that some renderer draws."""
    light = prim.HasAPI(UsdLux.LightAPI) and not prim.IsA(UsdGeom.Gprim)
    drawn = prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer) or is_drawn(prim)
    return (drawn or prim.GetTypeName() == "Volume") and not light


def _purpose(prim: Usd.Prim) -> str:
    return str(UsdGeom.Imageable(prim).ComputePurpose())


def _held(prims: list[Usd.Prim]) -> str:
    """What there is, in words."""
    counts = {name: sum(prim.HasAPI(kind) if kind is UsdLux.LightAPI else prim.IsA(kind) for prim in prims)
              for kind, name in OTHERS}  # fmt: skip
    found = [f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count]
    return ", ".join(found) or "prims without a shape" if len(prims) > 1 else "it is empty"
