"""Inputs of lights, also under the names that they had until USD 21.02."""

from __future__ import annotations

from pxr import Usd

PREFIX = "inputs:"
# What lights had without the prefix.
OLD = frozenset(
    (
        "intensity", "exposure", "diffuse", "specular", "color", "normalize", "enableColorTemperature",
        "colorTemperature", "angle", "radius", "width", "height", "length", "texture:file", "texture:format",
        "shaping:cone:angle", "shaping:cone:softness", "shaping:focus", "shaping:focusTint", "shaping:ies:file",
        "shaping:ies:angleScale", "shaping:ies:normalize",
        "shadow:enable", "shadow:color", "shadow:distance",
    )
)  # fmt: skip


def light_input(prim: Usd.Prim, name: str) -> Usd.Attribute:
    """The attribute of an input of a light; under its old name where it is authored only there."""
    new, old = prim.GetAttribute(PREFIX + name), prim.GetAttribute(name)
    authored = new and new.HasAuthoredValue()
    return old if not authored and name in OLD and old and old.HasAuthoredValue() else new


def old_inputs(prim: Usd.Prim) -> list[str]:
    """The names of a light's inputs that count under their old names."""
    return [name for name in sorted(OLD) if light_input(prim, name).GetName() == name]
