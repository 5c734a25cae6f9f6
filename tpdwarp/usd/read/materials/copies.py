"""Copies of a material: assets that are referenced many times bring their materials each time."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from pxr import Sdf, Usd, UsdShade

from tpdwarp.errors import WarnOnce
from tpdwarp.usd.read.numbered_files import changes_by_frame, files_at


@dataclass(frozen=True)
class Said:
    """What was said of a material: about what, and of which kind it is where that is not its text."""

    about: str
    text: str
    kind: str

    def of(self, original: str, copy: str) -> tuple[str, str, str]:
        """The same, said of a copy."""
        about, text, kind = (words.replace(original, copy) for words in (self.about, self.text, self.kind))
        return about, text, kind


class Heard(WarnOnce):
    """Passes warnings on, and keeps them to be said of copies too.

    Args:
        to: Takes them.
    """

    def __init__(self, to: WarnOnce) -> None:
        super().__init__(to.file, silent=True)
        self._to = to
        self.said: list[Said] = []

    def __call__(self, prim: str, message: str, kind: str = "") -> None:
        self.said.append(Said(str(prim), message, kind))
        self._to(prim, message, kind)


def content_of(material: UsdShade.Material, frame: float) -> Hashable | None:
    """All that a material's surface is read from at a time code; what two materials have in common looks the same.

    Returns:
        None where some of it lies outside the material, or is not to be compared.
    """
    root = material.GetPrim()
    own = root.GetPath()
    found: list[Hashable] = []
    for prim in Usd.PrimRange(root, Usd.TraverseInstanceProxies()):
        found.append((str(prim.GetPath().MakeRelativePath(own)), str(prim.GetTypeName())))
        for attribute in prim.GetAuthoredAttributes():
            connections = attribute.GetConnections()
            if not all(target.HasPrefix(own) for target in connections):
                return None
            found.append((
                attribute.GetName(),
                str(attribute.GetTypeName()),
                attribute.GetColorSpace(),
                attribute.ValueMightBeTimeVarying(),
                tuple(str(target.MakeRelativePath(own)) for target in connections),
                _value(attribute, frame),
            ))
    try:
        hash(key := tuple(found))
    except TypeError:
        return None
    return key


def _value(attribute: Usd.Attribute, frame: float) -> Hashable:
    """An attribute's value, with its type: 1, 1.0 and True are equal, and mean different things."""
    value = attribute.Get(frame)
    if isinstance(value, Sdf.AssetPath):
        files = tuple(sorted(files_at(attribute, frame).items()))
        return value.path, files, changes_by_frame(attribute, frame)
    kind = type(value).__name__
    return (kind, tuple(value)) if kind.endswith("Array") else (kind, value)
