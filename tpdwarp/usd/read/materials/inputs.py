"""The inputs of a shader at one time code, through whatever simple network feeds them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from pxr import Sdf, Usd, UsdShade

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.materials.constants import Constants, size_of
from tpdwarp.usd.read.materials.coordinates import Coordinates, placed, scaled_turned_moved
from tpdwarp.usd.read.materials.nodes import operation_of
from tpdwarp.usd.read.materials.patterns import curve_of, mean_of, pattern_of
from tpdwarp.usd.read.materials.physical import Color
from tpdwarp.usd.read.materials.textures import LARGEST_HALF, Image, Textures, combined
from tpdwarp.usd.read.numbered_files import changes_by_frame
from tpdwarp.usd.read.values import ITS_DEFAULT, raw_at, text_at, value_at

# Networks deeper than this count as circular. Chosen, not derived: hand-made networks have a few.
DEEPEST = 64
DEFAULTS = ("fallback", "default", "missing_color")
# What the identifiers of nodes that read primvars hold: USD's, MaterialX's and Arnold's.
PRIMVAR_READERS = ("primvarreader", "geompropvalue", "geomcolor", "user_data_")
# How a warning ends that a picture is not spread over the surface.
ITS_MEAN = "its mean is rendered"
# Types of inputs that take four numbers.
FOUR = ("float4", "color4f")
FILES = ("file", "filename", "in", "texture")
_FILE_NAMES = (str, Sdf.AssetPath)
MATERIALX_IMAGES = ("ND_image_", "ND_tiledimage_")


@dataclass(frozen=True)
class Value:
    """The value at an input, and where it comes from.

    Attributes:
        numbers: The value, shape [n]; None where it cannot be determined.
        spread: Whether it differs over the surface, so that ``numbers`` is its mean or a fallback.
        primvar: The mesh's primvar that it is; empty for none.
        image: The value over the surface, where that was asked for and is known.
    """

    numbers: np.ndarray | None
    spread: bool = False
    primvar: str = ""
    image: Image | None = None

    @property
    def argument(self) -> np.ndarray | Image | None:
        """What a node computes with."""
        return self.numbers if self.image is None else self.image


class _Held(WarnOnce):
    """Warnings that may turn out to be about nothing."""

    def __init__(self, file: str, held: list[tuple[str, str]]) -> None:
        super().__init__(file, silent=True)
        self._held_back = held

    def __call__(self, prim: str, message: str, kind: str = "") -> None:
        self._held_back.append((prim, message))


@dataclass
class _Walk:
    """A walk through a network: what is being computed, and what has been since it began, with whether that varies.

    So that networks whose branches meet again are walked once, and circular ones end.
    """

    open: set[tuple[str, str, bool]] = field(default_factory=set)
    known: dict[tuple[str, str, bool], tuple[Value, bool]] = field(default_factory=dict)


class Inputs:
    """Reads the inputs of one shader.

    Args:
        shader: The shader.
        frame: Time code.
        textures: Mean colours of textures.
        warnings: Takes what is not supported, and names the file in errors.
        constants: Gives the primvars that are one value over the whole surface.
        walk: Where in the network one is that asks for these inputs.
    """

    def __init__(
        self,
        shader: UsdShade.Shader,
        frame: float,
        textures: Textures,
        warnings: WarnOnce,
        constants: Constants | None = None,
        walk: _Walk | None = None,
    ) -> None:
        self.shader, self.frame, self.textures, self.warnings = shader, frame, textures, warnings
        self._constants = constants
        self.varies = False
        self._as_images = False
        self._walk = _Walk() if walk is None else walk

    @contextmanager
    def warnings_held(self, held: list[tuple[str, str]] | None) -> Iterator[None]:
        """While entered, warnings are added to ``held``, by what they are about; None says them as ever."""
        if held is None:
            yield
            return
        said = self.warnings
        self.warnings = _Held(said.file, held)
        try:
            yield
        finally:
            self.warnings = said

    @contextmanager
    def entered(self) -> Iterator[bool]:
        """While entered, the same surface is not to be read again; whether it was not being read before."""
        key = self.path, "surface", False
        fresh = key not in self._walk.open
        self._walk.open.add(key)
        try:
            yield fresh
        finally:
            if fresh:
                self._walk.open.discard(key)

    @property
    def path(self) -> str:
        return str(self.shader.GetPath())

    def of(self, shader: UsdShade.Shader) -> Inputs:
        """The inputs of another shader of the same network; ``varies`` is to be taken over."""
        return Inputs(shader, self.frame, self.textures, self.warnings, self._constants, self._walk)

    def find(self, *names: str) -> UsdShade.Input | None:
        """The first input of these names that is connected or has an authored value."""
        for name in names:
            found = self.shader.GetInput(name)
            if found and (found.HasConnectedSource() or found.GetAttr().HasAuthoredValue()):
                return found
            if found and found.GetAttr().HasAuthoredConnections():
                self._warn_nowhere(found)
        return None

    def value(self, *names: str) -> Value | None:
        """The value at the first of these inputs that is authored; None where none is."""
        found = self.find(*names)
        return None if found is None else self._arriving(found, 0)

    def image(self, *names: str) -> Image | None:
        """The value over the surface at the first of these inputs that is authored; None where it is one value.

        What is computed from textures is computed by pixel.
        """
        found = self.find(*names)
        if found is None:
            return None
        self._as_images = True
        try:
            return self._arriving(found, 0).image
        finally:
            self._as_images = False

    def output(self) -> Value:
        """What the shader itself computes, where it is a node that computes a value; over the surface if it differs."""
        self._as_images = True
        try:
            return self._computed(self.shader, "out", self.path, 0)
        finally:
            self._as_images = False

    def number(self, names: tuple[str, ...], default: float) -> float:
        """A number at the first of these inputs that is authored; the mean of a colour."""
        value = self.value(*names)
        if value is None or value.numbers is None:
            return default
        return float(np.mean(value.numbers))

    def color(self, names: tuple[str, ...], default: Color) -> Color:
        """A colour at the first of these inputs that is authored; a number gives a grey."""
        value = self.value(*names)
        if value is None or value.numbers is None:
            return default
        if value.numbers.size not in (1, 3, 4):
            message = f"holds {value.numbers.size} numbers; {ITS_DEFAULT} (author a colour)"
            self.warnings(self.source(*names), message)
            return default
        return tuple(map(float, np.broadcast_to(value.numbers[:3], 3)))

    def flag(self, name: str, default: bool = False) -> bool:
        """A switch."""
        return self.number((name,), float(default)) > 0.5

    def text(self, name: str) -> str:
        """A token or a string; empty where there is none."""
        found = self.find(name)
        attributes = [] if found is None else found.GetValueProducingAttributes()
        return text_at(attributes[0], self.frame) if attributes else ""

    def node(self, *names: str) -> UsdShade.Shader | None:
        """The shading node that the first of these inputs which is authored is connected to."""
        found = self.find(*names)
        return None if found is None else _node(found)[0]

    def coordinates(self, depth: int = 0) -> Coordinates:
        """Where the coordinates of this texture come from: the mesh's ``st`` where nothing else is said."""
        uv_set = self.text("uvset")
        for name in ("st", "texcoord", "in"):
            node = self.node(name)
            if node is None or depth > DEEPEST:
                continue
            inner, kind = self.of(node), str(node.GetShaderId() or "")
            if "primvarreader" in kind.lower() or "geompropvalue" in kind:
                found = Coordinates(inner.text("varname") or inner.text("geomprop") or "st")
            elif "texcoord" in kind:
                index = int(inner.number(("index",), 0.0))
                found = Coordinates("st" if index == 0 else f"st{index}")
            else:
                found = inner.coordinates(depth + 1)
                if kind.removeprefix("ND_") == "UsdTransform2d":
                    scale, turn = inner.pair("scale", 1.0), inner.number(("rotation",), 0.0)
                    found = found.then(scaled_turned_moved(scale, turn, inner.pair("translation", 0.0)))
                elif "place2d" in kind:
                    pair = [inner.pair(*pair) for pair in (("pivot", 0.0), ("scale", 1.0), ("offset", 0.0))]
                    turn, order = (inner.number((name,), 0.0) for name in ("rotate", "operationorder"))
                    found = found.then(placed(pair[0], pair[1], turn, pair[2], moved_first=order == 1))
                else:
                    self.warn(name, f"places a texture by {kind or 'a node'}, which is not read")
            self.varies |= inner.varies
            break
        else:
            found = Coordinates(uv_set or "st")
        if "tiledimage" in str(self.shader.GetShaderId() or ""):
            tiling, offset = self.pair("uvtiling", 1.0), self.pair("uvoffset", 0.0)
            size = self.pair("realworldtilesize", 1.0) / self.pair("realworldimagesize", 1.0)
            found = found.then(np.column_stack([np.diag(tiling * size), -offset * size]))
        if not np.isfinite(found.matrix).all():
            self.warnings(self.path, "places a texture by no finite numbers, and as it is instead")
            return Coordinates(found.primvar)
        return found

    def pair(self, name: str, default: float) -> np.ndarray:
        """Two numbers, shape [2]."""
        value = self.value(name)
        if value is None or value.numbers is None or value.numbers.size not in (1, 2):
            return np.full(2, default)
        return np.broadcast_to(value.numbers, 2)

    def source(self, *names: str) -> str:
        """Path of the first of these inputs that is authored, or of the first if none is."""
        found = self.find(*names)
        return f"{self.path}.inputs:{names[0]}" if found is None else str(found.GetAttr().GetPath())

    def warn(self, name: str, message: str) -> None:
        """Warns about an input."""
        self.warnings(self.source(name), message)

    def _arriving(self, found: UsdShade.Input, depth: int) -> Value:
        node, output = _node(found)
        if node is None:
            attributes = found.GetValueProducingAttributes()
            if not attributes:
                return Value(None)
            self.varies |= attributes[0].ValueMightBeTimeVarying()
            return Value(self._numbers(attributes[0], str(found.GetAttr().GetPath())))
        value = self._computed(node, output, str(found.GetAttr().GetPath()), depth + 1)
        if value.numbers is not None and value.numbers.size == 4 and str(found.GetTypeName()) not in FOUR:
            # A texture has four channels whatever it feeds.
            image = None if value.image is None else value.image.chosen(lambda pixels: pixels[..., :3])
            return Value(value.numbers[:3], value.spread, value.primvar, image)
        return value

    def _warn_nowhere(self, found: UsdShade.Input) -> None:
        """Says where an input is connected to what is not there."""
        attribute = found.GetAttr()
        stage = attribute.GetStage()
        for path in attribute.GetConnections():
            if not stage.GetObjectAtPath(path):
                self.warnings(str(attribute.GetPath()), f"is connected to {path}, which does not exist; {ITS_DEFAULT}")

    def _numbers(self, attribute: Usd.Attribute, asking: str) -> np.ndarray | None:
        """An attribute's numbers, shape [n]; None where it holds nothing, or something else, which is said."""
        try:
            value = value_at(attribute, self.frame)
        except InputError as error:
            self.warnings(asking, f"{error.message}; {ITS_DEFAULT}", f"{ITS_DEFAULT} for its type")
            return None
        if value is not None and value.size == 0:
            self.warnings(asking, f"holds no number; {ITS_DEFAULT} (author a finite value)")
            return None
        return None if value is None else np.atleast_1d(value)

    def _computed(self, node: UsdShade.Shader, output: str, asking: str, depth: int) -> Value:
        walk, key = self._walk, (str(node.GetPath()), output, self._as_images)
        if key in walk.known:
            value, varies = walk.known[key]
            self.varies |= varies
            return value
        if depth > DEEPEST or key in walk.open:
            self.warnings(asking, f"is fed by a network that is too deep, or circular; {ITS_DEFAULT}")
            return Value(None)
        walk.open.add(key)
        varied, self.varies = self.varies, False
        try:
            value = self._compute(node, output, asking, depth)
            walk.known[key] = value, self.varies
        finally:
            walk.open.discard(key)
            self.varies |= varied
            if not walk.open:
                walk.known.clear()
        return value

    def _compute(self, node: UsdShade.Shader, output: str, asking: str, depth: int) -> Value:
        kind = str(node.GetShaderId() or "")
        operation = operation_of(kind)
        if operation is not None:
            arguments = [self._argument(node, name, default, depth) for name, default in operation.arguments]
            if any(argument.numbers is None for argument in arguments):
                return Value(None, True)
            words = self._words(node)
            numbers = operation.apply([argument.numbers for argument in arguments], output, words)
            spread = any(argument.spread for argument in arguments)
            shown = arguments[0].primvar if len(arguments) == 1 else ""
            image = None
            if numbers is not None and any(argument.image is not None for argument in arguments):
                image = combined(
                    lambda values: operation.apply(list(values), output, words), [a.argument for a in arguments]
                )
                if image is None:
                    self.warnings(asking, "combines textures that lie differently: their mean colours are rendered")
            return Value(numbers if image is None else image.mean, spread, shown, image)
        inner = self.of(node)
        if any(word in kind.lower() for word in PRIMVAR_READERS):
            name = inner.text("varname") or inner.text("geomprop") or inner.text("attribute")
            value = inner.value(*DEFAULTS)
            self.varies |= inner.varies
            if "geomcolor" in kind:
                name = "displayColor"
            constant = None if self._constants is None else self._constants.of(name, size_of(kind))
            if constant is not None and constant.size:
                return Value(constant, False, name)
            # Where there is no such primvar, the fallback is what counts.
            return Value(None if value is None else value.numbers, constant is None, name)
        value = self._drawn(inner, output, asking, kind, depth)
        if value is None:
            value = self._texture(inner, output, asking, kind)
        self.varies |= inner.varies
        return value

    def _drawn(self, inner: Inputs, output: str, asking: str, kind: str, depth: int) -> Value | None:
        """What a node draws over the surface by itself; None for one that does not."""
        curve = curve_of(kind, inner)
        if curve is not None:
            given = self._argument(inner.shader, "input", 0.0, depth)
            if given.numbers is None:
                return Value(None, True)
            if given.image is None:
                return Value(_channel(curve(given.numbers), output, kind), given.spread)
            image = given.image.mapped(lambda pixels: _channel(curve(pixels), output, kind))
            return Value(image.mean, True, image=image)
        pattern = pattern_of(kind, inner)
        if pattern is not None:
            pixels = np.clip(_channel(pattern.pixels, output, kind), -LARGEST_HALF, LARGEST_HALF).astype(np.float16)
            matrix = pattern.matrix if np.isfinite(pattern.matrix).all() else np.eye(2, 3)
            placed = inner.coordinates().then(matrix)
            image = Image({(0, 0): pixels}, (pattern.wrap, pattern.wrap), np.zeros(pixels.shape[-1]), placed)
            if not self._as_images:
                self.warnings(asking, "is a pattern, which is not spread over the surface: " + ITS_MEAN)
            return Value(image.mean, True, image=image if self._as_images else None)
        mean = mean_of(kind, inner)
        if mean is None:
            return None
        self.warnings(asking, "is noise, which is not drawn: the middle of what it lies between is rendered")
        return Value(_channel(mean, output, kind), True)

    def _argument(
        self, node: UsdShade.Shader, name: str, default: float | tuple[float, ...] | None, depth: int
    ) -> Value:
        found = self.of(node).find(name)
        if found is None:
            return Value(None if default is None else np.atleast_1d(default))
        return self._arriving(found, depth)

    def _words(self, node: UsdShade.Shader) -> dict[str, str]:
        """The texts among a node's inputs."""
        inner = self.of(node)
        return {name: inner.text(name) for name in ("channels", "mode")}

    def _texture(self, inner: Inputs, output: str, asking: str, kind: str) -> Value:
        """A texture, or its mean where one value is asked for, or the fallback of whatever else is connected."""
        file = inner.find(*FILES)
        attributes = [] if file is None else file.GetValueProducingAttributes()
        encoding = _encoding(inner, attributes, kind)
        self.varies |= any(
            attribute.ValueMightBeTimeVarying() or changes_by_frame(attribute, self.frame) for attribute in attributes
        )
        if attributes and self._as_images:
            image = self.textures.image(attributes[0], self.frame, encoding, _wrap(inner), inner.coordinates())
            if image is not None:
                if _is_adjusted(inner):
                    image = image.mapped(lambda pixels: _adjusted(inner, pixels))
                image = image.chosen(lambda pixels: _channel(pixels, output, kind))
                return Value(image.mean, True, image=image)
        mean = self.textures.mean(attributes[0], self.frame, encoding) if attributes else None
        if mean is not None:
            if not self._as_images:
                self.warnings(asking, "is a texture, which is not spread over the surface: " + ITS_MEAN)
            return Value(_channel(_adjusted(inner, mean), output, kind), True)
        fallback = inner.value(*DEFAULTS)
        instead = "default" if fallback is None or fallback.numbers is None else "fallback"
        named = kind or "a shading node"
        named_file = raw_at(attributes[0], self.frame) if attributes else None
        why = "whose file cannot be read" if named_file and isinstance(named_file, _FILE_NAMES) else "which is not read"
        if kind.startswith(MATERIALX_IMAGES) and not named_file:
            # As their definitions have it: what names no file has its default everywhere, which is black.
            nothing = np.zeros(size_of(kind) or 1)
            return Value(_channel(nothing if instead == "default" else fallback.numbers, output, kind))
        self.warnings(asking, f"is connected to {named}, {why}; its {instead} is used")
        if instead == "default":
            return Value(None, True)
        return Value(_channel(fallback.numbers, output, kind), True)


def _scale_and_bias(inner: Inputs) -> Iterator[np.ndarray | None]:
    """A texture's scale and bias, shape [1] or [4]; None where there is none."""
    for name in ("scale", "bias"):
        value = inner.value(name)
        usable = value is not None and value.numbers is not None and value.numbers.size in (1, 4)
        yield value.numbers if usable else None


def _is_adjusted(inner: Inputs) -> bool:
    """Whether a texture's scale and bias change its values."""
    pairs = zip(_scale_and_bias(inner), (1.0, 0.0), strict=True)
    return any(value is not None and np.any(value != without) for value, without in pairs)


def _adjusted(inner: Inputs, pixels: np.ndarray) -> np.ndarray:
    """Values of a texture [..., 4] with its scale and bias, in the precision of the values."""
    scale, bias = _scale_and_bias(inner)
    if scale is not None:
        pixels = pixels * scale.astype(pixels.dtype)
    return pixels if bias is None else pixels + bias.astype(pixels.dtype)


def _encoding(inner: Inputs, attributes: list[Usd.Attribute], kind: str) -> str:
    """How a texture's numbers are encoded, as :meth:`Textures.mean` takes it."""
    space = inner.text("sourceColorSpace") or (str(attributes[0].GetColorSpace()) if attributes else "")
    if space.lower().startswith("srgb"):
        return "sRGB"
    if space == "raw" or space.startswith("lin"):
        return "raw"
    return "auto" if kind.startswith("UsdUVTexture") or "color" in kind else "raw"


def _wrap(inner: Inputs) -> tuple[str, str]:
    """Names of a texture's wrap modes along s and t; MaterialX's repeat where nothing is authored."""
    default = "useMetadata" if str(inner.shader.GetShaderId()).startswith("UsdUVTexture") else "periodic"
    s, t = (inner.text(usd) or inner.text(mtlx) for usd, mtlx in (("wrapS", "uaddressmode"), ("wrapT", "vaddressmode")))
    return s or default, t or default


def _channel(numbers: np.ndarray, output: str, kind: str) -> np.ndarray:
    """The part of a texture's value [..., c] that an output gives."""
    count = numbers.shape[-1]
    if output in ("r", "g", "b", "a") and count == 4:
        place = "rgba".index(output)
        return numbers[..., place : place + 1]
    if count >= 3:
        return numbers[..., :1] if "float" in kind and not kind.startswith("UsdUVTexture") else numbers[..., :3]
    return numbers


def _node(found: UsdShade.Input) -> tuple[UsdShade.Shader | None, str]:
    """The shading node whose output an input is connected to, and that output; None where it has a plain value."""
    for attribute in found.GetValueProducingAttributes():
        name, kind = UsdShade.Utils.GetBaseNameAndType(attribute.GetName())
        if kind == UsdShade.AttributeType.Output:
            return UsdShade.Shader(attribute.GetPrim()), str(name)
    return None, ""
