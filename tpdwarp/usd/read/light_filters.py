"""Light filters: those that scale a light as a whole are rendered, and the others named with what they would do."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdLux

from tpdwarp.errors import WarnOnce
from tpdwarp.usd.read.values import number_or_fallback, raw_at, text_at, value_or_fallback
from tpdwarp.usd.read.visibilities import may_be_visible

# What multiplies a light by intensity × 2^exposure × colour: RenderMan's and MoonRay's.
SCALING = ("PxrIntMultLightFilter", "IntensityLightFilter")
# Where renderers name the kind of a filter, before the type of the prim.
KINDS = ("moonray:class", "ri:lightFilter:shaderId", "arnold:lightFilter:shaderId", "lightFilter:shaderId")
# Attributes that are no inputs of what a filter does.
ELSEWHERE = ("xformOp", "visibility", "purpose", "collection:", "outputs:", *KINDS)

EARLIEST = Usd.TimeCode.EarliestTime().GetValue()


class LightFilters:
    """The filters of a light.

    A filter that is not there, inactive, invisible, turned off or of no kind at all filters nothing, in any renderer.

    Args:
        api: The light.
        path: What the light is called.
        warnings: Takes the filters that are not rendered.
    """

    def __init__(self, api: UsdLux.LightAPI, path: str, warnings: WarnOnce) -> None:
        self._warnings, self._scaling = warnings, []
        stage = api.GetPrim().GetStage()
        for target in api.GetFiltersRel().GetForwardedTargets():
            prim = stage.GetPrimAtPath(target)
            kind = _kind(prim) if prim and prim.IsActive() else ""
            if not prim:
                warnings(f"{path}.light:filters", f"names {target}, which does not exist", "filters that are not there")
            elif _is_something_else(prim):
                said = f"names {target}, which is no light filter and is ignored"
                warnings(f"{path}.light:filters", said, "no filters")
            elif not kind or not may_be_visible(prim) or _is_off(prim, warnings):
                continue
            elif kind in SCALING and _only_scales(prim):
                self._scaling.append(prim)
            else:
                warnings(path, f"a light filter, {kind} ({target}), is not rendered: the light is brighter", kind)

    @property
    def attributes(self) -> list[Usd.Attribute]:
        """The attributes by which its scale may change with time."""
        return [attribute for prim in self._scaling for attribute in _inputs(prim).values()]

    def scale(self, frame: float) -> np.ndarray:
        """What they multiply the light by at a time code, shape [3]."""
        total = np.ones(3)
        for prim in self._scaling:
            inputs = _inputs(prim)
            color = value_or_fallback(inputs["color"], frame, self._warnings, (3,)) if "color" in inputs else None
            intensity, exposure = (
                number_or_fallback(inputs[name], frame, self._warnings, none) if name in inputs else none
                for name, none in (("intensity", 1.0), ("exposure", 0.0))
            )
            factor = intensity * np.exp2(exposure)
            scaled = factor * (np.ones(3) if color is None else color)
            total = total * (np.maximum(scaled, 0.0) if np.isfinite(scaled).all() else 1.0)
        return total


def _kind(prim: Usd.Prim) -> str:
    """What a filter does, as its renderer calls it; empty for a filter of no renderer."""
    named = (text_at(attribute) for name in KINDS if (attribute := prim.GetAttribute(name)))
    generic = prim.GetTypeName() in ("", "LightFilter")
    return next(filter(None, named), "" if generic else str(prim.GetTypeName()))


def _is_something_else(prim: Usd.Prim) -> bool:
    """Whether a prim is of a type that is known and no filter; renderers have types of their own."""
    known = prim.GetTypeName() and not Usd.SchemaRegistry.GetTypeFromName(prim.GetTypeName()).isUnknown
    return bool(known and not prim.IsA(UsdLux.LightFilter))


def _inputs(prim: Usd.Prim) -> dict[str, Usd.Attribute]:
    """What a filter's authored inputs are called without the prefixes of renderers."""
    authored = (a for a in prim.GetAuthoredAttributes() if not a.GetName().startswith(ELSEWHERE))
    return {attribute.GetName().rpartition(":")[2]: attribute for attribute in authored}


def _is_off(prim: Usd.Prim, warnings: WarnOnce) -> bool:
    attribute = _inputs(prim).get("on")
    return attribute is not None and number_or_fallback(attribute, EARLIEST, warnings, 1.0) == 0.0


def _only_scales(prim: Usd.Prim) -> bool:
    """Whether a scaling filter asks for nothing else, on all that the light shines on."""
    for name, attribute in _inputs(prim).items():
        if name not in ("intensity", "exposure", "color", "on") and raw_at(attribute, EARLIEST) not in (False, None):
            return False
    links = UsdLux.LightFilter(prim).GetFilterLinkCollectionAPI() if prim.IsA(UsdLux.LightFilter) else None
    limited = links and (links.GetIncludesRel().HasAuthoredTargets() or links.GetExcludesRel().HasAuthoredTargets())
    return not limited
