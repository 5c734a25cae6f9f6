"""Whether prims are visible at some time."""

from __future__ import annotations

from pxr import Usd, UsdGeom


def visibility_varies(prim: Usd.Prim) -> bool:
    """Whether a prim may appear or vanish over time, by itself or with an ancestor."""
    while prim and not prim.IsPseudoRoot():
        attribute = UsdGeom.Imageable(prim).GetVisibilityAttr() if prim.IsA(UsdGeom.Imageable) else None
        if attribute and attribute.ValueMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False


def may_be_visible(prim: Usd.Prim) -> bool:
    """Whether a prim is visible at some time."""
    visible = UsdGeom.Imageable(prim).ComputeVisibility(Usd.TimeCode.EarliestTime()) != UsdGeom.Tokens.invisible
    return visible or visibility_varies(prim)
