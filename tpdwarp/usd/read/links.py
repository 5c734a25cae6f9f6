"""Light linking: the meshes that a light shines on, and those that throw shadows in its light."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Sdf, Usd, UsdLux

from tpdwarp.errors import WarnOnce
from tpdwarp.usd.read.light_inputs import light_input
from tpdwarp.usd.read.values import number_or_fallback, raw_at

EARLIEST = Usd.TimeCode.EarliestTime().GetValue()


class LightLinks:
    """What a light's collections say of meshes.

    A mesh that ``shadowLink`` leaves out lets the light pass as if it were not there; of a light whose shadows are
    turned off, all of them do.

    Args:
        api: The light.
        warnings: Takes what is not supported.
    """

    def __init__(self, api: UsdLux.LightAPI, warnings: WarnOnce) -> None:
        self._lit = _query(api.GetLightLinkCollectionAPI())
        self._hiding = _query(api.GetShadowLinkCollectionAPI())
        enabled = light_input(api.GetPrim(), "shadow:enable")
        asks = enabled and enabled.HasAuthoredValue()
        self._shadowless = bool(asks and not number_or_fallback(enabled, EARLIEST, warnings, 1.0))
        self._known: dict[str, tuple[bool, bool]] = {}

    @property
    def limited(self) -> bool:
        """Whether they leave any mesh out."""
        return self._shadowless or self._lit is not None or self._hiding is not None

    def of(self, meshes: Iterable[tuple[str, Sdf.Path]]) -> tuple[frozenset[str], frozenset[str]]:
        """Names of the meshes that the light does not shine on, and of those that it passes.

        Args:
            meshes: What each mesh is called, and the path that collections know it by.
        """
        unlit, passed = set(), set()
        for name, path in meshes:
            if name not in self._known:
                out = self._lit is not None and not self._lit.IsPathIncluded(path)
                clear = self._shadowless or (self._hiding is not None and not self._hiding.IsPathIncluded(path))
                self._known[name] = out, clear
            out, clear = self._known[name]
            if out:
                unlit.add(name)
            if clear:
                passed.add(name)
        return frozenset(unlit), frozenset(passed)


def _query(collection: Usd.CollectionAPI) -> object | None:
    """What tells whether a path is in a collection; None for one that holds everything."""
    include_root = collection.GetIncludeRootAttr()
    whole = raw_at(include_root, None) if include_root else None
    targets = [rel for rel in (collection.GetIncludesRel(), collection.GetExcludesRel()) if rel]
    if whole is False or any(rel.HasAuthoredTargets() for rel in targets):
        return collection.ComputeMembershipQuery()
    return None
