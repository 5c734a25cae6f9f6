"""What a dialect is: a table from its inputs to the physical description, and what the table cannot say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tpdwarp.usd.read.materials.inputs import ITS_MEAN, Inputs
from tpdwarp.usd.read.materials.interactions import LEAST_METAL, NEARLY
from tpdwarp.usd.read.materials.physical import Color, Physical
from tpdwarp.usd.read.materials.textures import Image

# Colours above one are art; above this, an accident.
BRIGHTEST = 1e6
# Properties that say how much of a surface is there; textures of them cut out shapes.
PRESENCES = ("presence", "opacity", "alpha")
# What dialects call the normal: a map of it counts, and no value.
NORMALS = ("normal", "geometry_normal", "normalCamera")
# Properties that do not show on what neither transmits nor is metal.
OF_SPECULAR = ("roughness", "ior", "tint", "absorption_depth", "abbe", "metalness")
# Properties that may differ over a surface, beside its base colour; those that are shares lie in 0 … 1.
SPREAD = ("metalness", "transmission", "roughness", "tint", "emission")
SHARES = ("metalness", "transmission", "roughness")
ONLY_SPECULAR = ("roughness", "tint")


@dataclass(frozen=True)
class Field:
    """Where a property comes from.

    Attributes:
        names: Inputs; the first that is authored counts.
        default: Value where none is; a float, a bool or a colour, and what is read is of its kind.
        weight: An input that multiplies it, and that input's default.
    """

    names: tuple[str, ...]
    default: float | bool | Color
    weight: tuple[str, float] | None = None


@dataclass(frozen=True)
class Dialect:
    """A kind of surface shader.

    Attributes:
        ids: Identifiers it goes by, without the prefixes and suffixes of MaterialX and Arnold.
        fields: A :class:`Field` for each property of :class:`Physical` that it has, and for others that ``adjust``
            takes.
        ignored: Inputs that add something which is not rendered, with the value at which they add nothing.
        adjust: Finishes the properties read, in place, where a table cannot say what they mean.
        untinted: Inputs whose colour does not reach what is transmitted, though an author may expect it to.
    """

    ids: tuple[str, ...]
    fields: dict[str, Field]
    ignored: dict[str, float] = field(default_factory=dict)
    adjust: Callable[[Inputs, dict[str, Any]], None] | None = None
    untinted: str = ""

    def read(self, inputs: Inputs) -> Physical:
        """The physical description that a shader's inputs mean."""
        values: dict[str, Any] = {}
        sources: dict[str, str] = {}
        shown = ""
        held: dict[str, list[tuple[str, str]]] = {}
        for name, where in self.fields.items():
            sources[name] = inputs.source(*where.names)
            image = _base_image(inputs, where) if name == "base_color" else None
            if image is not None:
                values["base_image"] = image
                values[name] = tuple(map(float, np.broadcast_to(image.mean, 3)))
                continue
            if name in PRESENCES and (image := inputs.image(*where.names)) is not None:
                values["cutout"] = image.mapped(lambda pixels: pixels.mean(axis=-1, keepdims=True))
                values[name] = 1.0
                continue
            with inputs.warnings_held(held.setdefault(name, []) if name in (*SPREAD, *OF_SPECULAR) else None):
                values[name] = _value(inputs, name, where)
                found = inputs.value(*where.names)
                if name == "base_color":
                    shown = "displayColor" if found is None else found.primvar
                elif found is not None and found.primvar and found.spread:
                    inputs.warn(where.names[0], "is a primvar, which is not spread; its fallback is used")
        if inputs.node(*NORMALS):
            values["normal_image"] = inputs.image(*NORMALS)
            sources["normal_image"] = inputs.source(*NORMALS)
            if values["normal_image"] is None:
                inputs.warnings(sources["normal_image"], "is not rendered")
        read = dict(values)
        if self.adjust is not None:
            self.adjust(inputs, values)
        images = values.setdefault("images", {})
        for name in filter(held.__contains__, SPREAD):
            if name in ONLY_SPECULAR and not _specular(values):
                continue
            weight = self.fields[name].weight
            if weight is not None and inputs.number((weight[0],), weight[1]) == 0.0:
                held[name].clear()
                continue
            # What a dialect gives another meaning is no longer what its picture shows.
            image = _spread_image(inputs, name, self.fields[name]) if values.get(name) == read[name] else None
            if image is not None:
                if image.least < image.most:
                    images[name] = image
                held[name] = [words for words in held[name] if not words[1].endswith(ITS_MEAN)]
        for name in PRESENCES:
            if name in sources:
                sources.setdefault("presence", sources[name])
        self._warn(inputs, values)
        shows = _specular(values)
        for name, said in held.items():
            for about, message in said if shows or name not in OF_SPECULAR else ():
                inputs.warnings(about, message)
        known = {name: value for name, value in values.items() if name in Physical.__dataclass_fields__}
        return Physical(**{"color_primvar": shown, **known}, sources=sources)

    def _warn(self, inputs: Inputs, values: dict[str, Any]) -> None:
        for name, harmless in self.ignored.items():
            value = inputs.value(name)
            if value is not None and (value.numbers is None or np.any(value.numbers != harmless)):
                inputs.warn(name, "is not rendered")
        color = values.get("base_color")
        if self.untinted and values.get("transmission", 0.0) >= 0.5 and max(color) - min(color) > 0.05:
            inputs.warnings(
                inputs.source(*self.fields["base_color"].names), f"does not colour the glass: {self.untinted} would"
            )


def tint_below_coat(values: dict[str, Any]) -> None:
    """Multiplies what lies below a coat by its colour, as far as the coat covers it, in place."""
    tint = 1.0 + values.pop("coat") * (np.array(values.pop("coat_color")) - 1.0)
    if (tint == 1.0).all():
        return
    for name in ("base_color", "tint"):
        values[name] = tuple(map(float, np.array(values[name]) * tint))
    if "base_image" in values:
        values["base_image"] = values["base_image"].mapped(lambda pixels: pixels * tint)


def reflect_by(inputs: Inputs, values: dict[str, Any], name: str, color: Color) -> None:
    """Makes metal of a surface, in place, that reflects by the input ``name``, whose mean is ``color``."""
    values["metalness"], values["base_color"] = 1.0, color
    values["base_image"] = _base_image(inputs, Field((name,), color))


def _value(inputs: Inputs, name: str, where: Field) -> float | bool | Color:
    default = where.default
    weight = 1.0 if where.weight is None else inputs.number((where.weight[0],), where.weight[1])
    if isinstance(default, bool):
        return inputs.number(where.names, float(default)) > 0.5
    if isinstance(default, tuple):
        return _plausible(inputs, where.names, inputs.color(where.names, default), default, weight)
    value = inputs.number(where.names, default) * weight
    if not np.isfinite(value) and name != "ior":
        inputs.warnings(inputs.source(*where.names), "holds no finite number; its default is used")
        return default
    return value


def _base_image(inputs: Inputs, where: Field) -> Image | None:
    """A colour over the surface, clamped to what a colour may be; None where it is the same everywhere."""
    image = inputs.image(*where.names)
    if image is None:
        return None
    weight = 1.0 if where.weight is None else inputs.number((where.weight[0],), where.weight[1])
    return image.mapped(lambda pixels: np.nan_to_num(np.clip(pixels * weight, 0.0, BRIGHTEST)))


def _specular(values: dict[str, Any]) -> bool:
    """Whether there is metal or glass, anywhere on the surface."""
    images = values["images"]
    most = [images[name].most if name in images else values.get(name, 0.0) for name in ("metalness", "transmission")]
    return most[0] >= LEAST_METAL or most[1] > NEARLY


def _spread_image(inputs: Inputs, name: str, where: Field) -> Image | None:
    """A property over the surface, within what it may be; None where it is the same everywhere."""
    image = inputs.image(*where.names)
    if image is None:
        return None
    weight = 1.0 if where.weight is None else inputs.number((where.weight[0],), where.weight[1])
    most = 1.0 if name in SHARES else BRIGHTEST

    def within(pixels: np.ndarray) -> np.ndarray:
        if name in SHARES:
            pixels = pixels.mean(axis=-1, keepdims=True)
        return np.nan_to_num(np.clip(pixels * weight, 0.0, most))

    return image.mapped(within)


def _plausible(inputs: Inputs, names: tuple[str, ...], color: Color, default: Color, weight: float) -> Color:
    with np.errstate(invalid="ignore", over="ignore"):
        weighted = np.array(color) * weight
    if not np.isfinite(weighted).all():
        inputs.warnings(inputs.source(*names), "holds no finite colour; its default is used")
        return default
    if weighted.min() < 0 or weighted.max() > BRIGHTEST:
        inputs.warnings(inputs.source(*names), f"holds a colour outside 0 … {BRIGHTEST:g}, which is clamped")
    return tuple(map(float, np.clip(weighted, 0.0, BRIGHTEST)))
