"""Nodes of MaterialX and Arnold that compute a value from values, for simple shading networks.

Values have their channels along the last axis, so that nodes compute pictures [h, w, c] as they compute numbers [c].
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Numbers = list[np.ndarray]
Words = dict[str, str]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# What a metal is that says nothing else.
GOLD, GOLD_EDGE = (0.944, 0.776, 0.373), (0.998, 0.981, 0.751)
CHANNELS = {**{name: k for k, name in enumerate("rgba")}, **{name: k for k, name in enumerate("xyzw")}}


@dataclass(frozen=True)
class Operation:
    """What a node computes.

    Attributes:
        arguments: Its inputs' names with their defaults; None for one that must be authored.
        compute: Gives the value from those of the inputs, the name of the output and the texts among the inputs.
    """

    arguments: tuple[tuple[str, float | tuple[float, ...] | None], ...]
    compute: Callable[[Numbers, str, Words], np.ndarray]

    def apply(self, numbers: Numbers, output: str, words: Words) -> np.ndarray | None:
        """The value, channels last; None where the inputs do not fit each other."""
        with np.errstate(all="ignore"):
            try:
                return np.atleast_1d(np.asarray(self.compute(numbers, output, words)))
            except (ValueError, IndexError, KeyError):
                return None


def operation_of(kind: str) -> Operation | None:
    """What a node of this identifier computes; None for textures, primvars and all that is not known."""
    if kind.startswith("arnold:"):
        return ARNOLD.get(kind.removeprefix("arnold:"))
    if (special := OF_SURFACES.get(kind)) is not None:
        return special
    found = re.match(r"(?:Maya)?ND_([A-Za-z]+[0-9]?)", kind)
    return OPERATIONS.get(found.group(1)) if found else None


def _of(compute: Callable[..., np.ndarray], *arguments: tuple[str, float | None]) -> Operation:
    return Operation(arguments, lambda numbers, output, words: compute(*numbers))


def _pair(compute: Callable[..., np.ndarray], neutral: float) -> Operation:
    return _of(compute, ("in1", 0.0), ("in2", neutral))


def _unary(compute: Callable[..., np.ndarray]) -> Operation:
    return _of(compute, ("in", 0.0))


def _remap(value: np.ndarray, *ends: np.ndarray) -> np.ndarray:
    low, high, out_low, out_high = ends
    return out_low + (value - low) * (out_high - out_low) / (high - low)


def _smoothstep(value: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """From 0 at ``low`` to 1 at ``high``; a step where these are one."""
    part = np.clip((value - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    return np.where(high > low, part * part * (3.0 - 2.0 * part), value >= high)


def _hsv(value: np.ndarray) -> np.ndarray:
    """Hue, saturation and value of a colour, all in 0 … 1."""
    most, least = value.max(axis=-1, keepdims=True), value.min(axis=-1, keepdims=True)
    range_ = np.where(most > least, most - least, 1.0)
    r, g, b = (_channel(value, k) for k in range(3))
    hue = np.where(r == most, (g - b) / range_, np.where(g == most, 2.0 + (b - r) / range_, 4.0 + (r - g) / range_))
    hue = np.where(most > least, (hue / 6.0) % 1.0, 0.0)
    return np.concatenate([hue, np.where(most > 0, (most - least) / np.where(most > 0, most, 1.0), 0.0), most], axis=-1)


def _of_hsv(value: np.ndarray) -> np.ndarray:
    """The colour of a hue, saturation and value."""
    hue, saturation, most = (_channel(value, k) for k in range(3))
    around = (hue * 6.0 + np.array([5.0, 3.0, 1.0])) % 6.0
    return most * (1.0 - saturation * np.clip(np.minimum(around, 4.0 - around), 0.0, 1.0))


def _blended(compute: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Callable[..., np.ndarray]:
    """What blends a foreground over a background, by how much ``mix`` says."""
    return lambda bg, fg, mix: bg + mix * (compute(fg, bg) - bg)


def _luminance(value: np.ndarray) -> np.ndarray:
    grey = (value[..., :3] @ LUMINANCE)[..., None] if value.shape[-1] >= 3 else value[..., :1]
    return np.repeat(grey, 3, axis=-1)


def _saturate(value: np.ndarray, amount: np.ndarray) -> np.ndarray:
    grey = _luminance(value)[..., : value.shape[-1]]
    return grey + amount * (value - grey)


def _signed(value: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """A normal from the colour that it is stored as, leaning more by ``scale``."""
    lean = np.ones(3)
    lean[:2] = scale[:2]
    return (2.0 * value[..., :3] - 1.0) * lean


def _separate(numbers: Numbers, output: str, words: Words) -> np.ndarray:
    return _channel(numbers[0], CHANNELS[output.removeprefix("out")[:1]])


def _swizzle(numbers: Numbers, output: str, words: Words) -> np.ndarray:
    value = numbers[0]
    constants = {"0": np.zeros_like(value[..., :1]), "1": np.ones_like(value[..., :1])}
    parts = [constants[c] if c in constants else _channel(value, CHANNELS[c]) for c in words["channels"]]
    return np.concatenate(parts, axis=-1)


def _channel(value: np.ndarray, index: int) -> np.ndarray:
    """One channel of a value, kept as an axis of one.

    Raises:
        IndexError: There is none of this number.
    """
    return np.take(value, [index], axis=-1)


def _combine(*numbers: np.ndarray) -> np.ndarray:
    shape = np.broadcast_shapes(*(value.shape[:-1] for value in numbers))
    return np.concatenate([np.broadcast_to(value, (*shape, value.shape[-1])) for value in numbers], axis=-1)


def _file_of_maya(numbers: Numbers, output: str, words: Words) -> np.ndarray:
    """A file texture of Maya's, which scales and moves the colours of the picture that it is given."""
    value, gain, offset = numbers
    if output == "outAlpha":
        return _channel(value, 3) if value.shape[-1] == 4 else _luminance(value)[..., :1]
    color = value[..., :3] * gain[..., :3] + offset[..., :3]
    channel = output.removeprefix("outColor").lower()
    return _channel(color, CHANNELS[channel]) if channel in CHANNELS else color


def _complex_index(numbers: Numbers, output: str, words: Words) -> np.ndarray:
    """Index and extinction of a metal by its reflectance at normal incidence and at the edge (Gulbrandsen 2014)."""
    reflectivity, edge = np.clip(numbers[0], 0.0, 0.99), numbers[1]
    root = np.sqrt(reflectivity)
    least, most = (1.0 - reflectivity) / (1.0 + reflectivity), (1.0 + root) / (1.0 - root)
    n = most + (least - most) * edge
    k = np.sqrt(np.maximum(((n + 1.0) ** 2 * reflectivity - (n - 1.0) ** 2) / (1.0 - reflectivity), 0.0))
    return k if output.startswith("extinction") else n


def _widths(roughness: np.ndarray, anisotropy: np.ndarray) -> np.ndarray:
    """Widths α of a lobe along its two axes, as MaterialX has them."""
    aspect = np.sqrt(1.0 - np.clip(anisotropy, 0.0, 0.98))
    square = roughness**2
    return _combine(np.minimum(square / aspect, 1.0), square * aspect) if square.shape[-1] == 1 else square


def _choose(compare: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Operation:
    return _of(
        lambda a, b, yes, no: np.where(compare(a[..., :1], b[..., :1]), yes, no),
        ("value1", 1.0),
        ("value2", 0.0),
        ("in1", 0.0),
        ("in2", 0.0),
    )


_INS = tuple((f"in{k}", 0.0) for k in range(1, 11))
_SEPARATE = Operation((("in", 0.0),), _separate)

OPERATIONS: dict[str, Operation] = {
    "constant": _of(lambda value: value, ("value", 0.0)),
    "dot": _unary(lambda value: value),
    "convert": _unary(lambda value: value),
    "add": _pair(lambda a, b: a + b, 0.0),
    "subtract": _pair(lambda a, b: a - b, 0.0),
    "multiply": _pair(lambda a, b: a * b, 1.0),
    "divide": _pair(lambda a, b: a / b, 1.0),
    "power": _pair(lambda a, b: a**b, 1.0),
    "min": _pair(np.minimum, 0.0),
    "max": _pair(np.maximum, 0.0),
    "absval": _unary(np.abs),
    "sqrt": _unary(np.sqrt),
    "exp": _unary(np.exp),
    "ln": _unary(np.log),
    "floor": _unary(np.floor),
    "ceil": _unary(np.ceil),
    "luminance": _unary(_luminance),
    "invert": _of(lambda value, amount: amount - value, ("in", 0.0), ("amount", 1.0)),
    "clamp": _of(lambda value, low, high: np.clip(value, low, high), ("in", 0.0), ("low", 0.0), ("high", 1.0)),
    "saturate": _of(_saturate, ("in", 0.0), ("amount", 1.0)),
    "contrast": _of(
        lambda value, amount, pivot: (value - pivot) * amount + pivot, ("in", 0.0), ("amount", 1.0), ("pivot", 0.5)
    ),
    "remap": _of(_remap, ("in", 0.0), ("inlow", 0.0), ("inhigh", 1.0), ("outlow", 0.0), ("outhigh", 1.0)),
    "range": _of(_remap, ("in", 0.0), ("inlow", 0.0), ("inhigh", 1.0), ("outlow", 0.0), ("outhigh", 1.0)),
    # Up, where nothing is connected. How much it leans may be told along s and t apart.
    "normalmap": Operation((("in", None), ("scale", 1.0)), lambda numbers, output, words: _signed(*numbers)),
    "mix": _of(lambda bg, fg, mix: bg + (fg - bg) * mix, ("bg", 0.0), ("fg", 0.0), ("mix", 0.0)),
    "combine2": _of(_combine, *_INS[:2]),
    "combine3": _of(_combine, *_INS[:3]),
    "combine4": _of(_combine, *_INS[:4]),
    "extract": _of(lambda value, index: _channel(value, int(index[0])), ("in", 0.0), ("index", 0.0)),
    "separate2": _SEPARATE,
    "separate3": _SEPARATE,
    "separate4": _SEPARATE,
    "swizzle": Operation((("in", 0.0),), _swizzle),
    "ifgreater": _choose(lambda a, b: a > b),
    "ifgreatereq": _choose(lambda a, b: a >= b),
    "ifequal": _choose(lambda a, b: a == b),
    "switch": _of(lambda *v: v[int(v[-1].flat[0])], *_INS, ("which", 0.0)),
    "fileTexture": Operation((("inColor", None), ("colorGain", 1.0), ("colorOffset", 0.0)), _file_of_maya),
    "smoothstep": _of(_smoothstep, ("in", 0.0), ("low", 0.0), ("high", 1.0)),
    "modulo": _pair(lambda a, b: a - b * np.floor(a / b), 1.0),
    "fract": _unary(lambda value: value - np.floor(value)),
    "sign": _unary(np.sign),
    "round": _unary(np.round),
    "sin": _unary(np.sin),
    "cos": _unary(np.cos),
    "tan": _unary(np.tan),
    "asin": _unary(np.arcsin),
    "acos": _unary(np.arccos),
    "safepower": _pair(lambda a, b: np.sign(a) * np.abs(a) ** b, 1.0),
    "magnitude": _unary(lambda value: np.linalg.norm(value, axis=-1, keepdims=True)),
    "dotproduct": _pair(lambda a, b: (a * b).sum(axis=-1, keepdims=True), 0.0),
    "hsvtorgb": _unary(_of_hsv),
    "rgbtohsv": _unary(_hsv),
    "hsvadjust": _of(
        lambda value, amount: _of_hsv(_hsv(value) * (0, 1, 1) * amount + (_hsv(value) + amount) * (1, 0, 0)),
        ("in", 0.0), ("amount", None),
    ),
    **{
        name: _of(_blended(compute), ("bg", 0.0), ("fg", 0.0), ("mix", 1.0))
        for name, compute in (
            ("plus", lambda fg, bg: bg + fg),
            ("minus", lambda fg, bg: bg - fg),
            ("difference", lambda fg, bg: np.abs(bg - fg)),
            ("burn", lambda fg, bg: 1.0 - (1.0 - bg) / fg),
            ("dodge", lambda fg, bg: bg / (1.0 - fg)),
            ("screen", lambda fg, bg: 1.0 - (1.0 - fg) * (1.0 - bg)),
            ("overlay", lambda fg, bg: np.where(bg < 0.5, 2.0 * fg * bg, 1.0 - 2.0 * (1.0 - fg) * (1.0 - bg))),
        )
    },
}  # fmt: skip


# Helpers of MaterialX's surfaces, by their whole names.
OF_SURFACES: dict[str, Operation] = {
    "ND_artistic_ior": Operation((("reflectivity", GOLD), ("edge_color", GOLD_EDGE)), _complex_index),
    "ND_roughness_anisotropy": _of(_widths, ("roughness", 0.0), ("anisotropy", 0.0)),
    "ND_roughness_dual": _of(lambda roughness: roughness**2, ("roughness", 0.0)),
    "ND_glossiness_anisotropy": _of(
        lambda gloss, anisotropy: _widths(1.0 - gloss, anisotropy), ("glossiness", 1.0), ("anisotropy", 0.0)
    ),
}


def _arnold_pair(compute: Callable[..., np.ndarray], neutral: float) -> Operation:
    return _of(compute, ("input1", neutral), ("input2", neutral))


def _arnold(compute: Callable[..., np.ndarray]) -> Operation:
    return _of(compute, ("input", 0.0))


_RANGE = (("input_min", 0.0), ("input_max", 1.0), ("output_min", 0.0), ("output_max", 1.0))
_MIX = _of(lambda first, second, mix: first + (second - first) * mix, ("input1", 0.0), ("input2", 1.0), ("mix", 0.5))

ARNOLD: dict[str, Operation] = {
    "add": _arnold_pair(lambda a, b: a + b, 0.0),
    "subtract": _arnold_pair(lambda a, b: a - b, 0.0),
    "multiply": _arnold_pair(lambda a, b: a * b, 1.0),
    "divide": _arnold_pair(lambda a, b: a / b, 1.0),
    "min": _arnold_pair(np.minimum, 0.0),
    "max": _arnold_pair(np.maximum, 0.0),
    "pow": _of(lambda value, exponent: value**exponent, ("base", 0.0), ("exponent", 1.0)),
    "abs": _arnold(np.abs),
    "negate": _arnold(np.negative),
    "sign": _arnold(np.sign),
    "fraction": _arnold(lambda value: value - np.floor(value)),
    "clamp": _of(lambda value, low, high: np.clip(value, low, high), ("input", 0.0), ("min", 0.0), ("max", 1.0)),
    # Seen, it is a surface; where it feeds an input, it is its colour.
    "flat": _of(lambda value: value, ("color", 1.0)),
    "complement": _arnold(lambda value: 1.0 - value),
    "reciprocal": _arnold(lambda value: 1.0 / value),
    "sqrt": _arnold(np.sqrt),
    "exp": _arnold(np.exp),
    "mix_rgb": _MIX,
    "mix_rgba": _MIX,
    "range": _of(_remap, ("input", 0.0), *_RANGE),
    "normal_map": Operation((("input", None), ("strength", 1.0)), lambda numbers, output, words: _signed(*numbers)),
    "float_to_rgb": _of(_combine, ("r", 0.0), ("g", 0.0), ("b", 0.0)),
    "float_to_rgba": _of(_combine, ("r", 0.0), ("g", 0.0), ("b", 0.0), ("a", 1.0)),
}
