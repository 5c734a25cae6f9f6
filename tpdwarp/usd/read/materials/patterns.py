"""Nodes of MaterialX and Arnold that draw a pattern over texture coordinates: ramps, splits, checkerboards.

They become pictures, which are filtered as all pictures are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from tpdwarp.scene.description import Wrap
from tpdwarp.usd.read.materials.physical import Color

# Texels of a ramp, and of a side of a picture with edges. Chosen, not derived: a level of eight bits a texel.
FINE = 256
CENTERS = (np.arange(FINE) + 0.5) / FINE
CONSTANT = 0
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


class Inputs(Protocol):
    """The inputs of a node, as :class:`tpdwarp.usd.read.materials.inputs.Inputs` has them."""

    def value(self, *names: str) -> Any: ...
    def number(self, names: tuple[str, ...], default: float) -> float: ...
    def color(self, names: tuple[str, ...], default: Color) -> Color: ...
    def pair(self, name: str, default: float) -> np.ndarray: ...
    def flag(self, name: str, default: bool = False) -> bool: ...
    def text(self, name: str) -> str: ...


@dataclass(frozen=True)
class Pattern:
    """A picture that a node draws.

    Attributes:
        pixels: Values, rows from t = 1 down, shape [h, w, c].
        wrap: How it goes on along s and t.
        scale, offset: Its own coordinates are scale · (s, t) + offset, shapes [2].
    """

    pixels: np.ndarray
    wrap: Wrap = Wrap.CLAMP
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def matrix(self) -> np.ndarray:
        """The map from (s, t) to its own coordinates, shape [2, 3]."""
        return np.column_stack([np.diag(self.scale), self.offset])


def draws(kind: str) -> bool:
    """Whether a node of this identifier draws a pattern."""
    return kind.startswith(tuple(PATTERNS))


def pattern_of(kind: str, inputs: Inputs) -> Pattern | None:
    """What a node of this identifier draws; None for one that draws nothing, or by something else than coordinates."""
    for prefix, draw in PATTERNS.items():
        if kind.startswith(prefix):
            return draw(inputs)
    return None


def curve_of(kind: str, inputs: Inputs) -> Callable[[np.ndarray], np.ndarray] | None:
    """What a ramp of Arnold's makes of its own input, channels last; None for other nodes."""
    if not kind.startswith("arnold:ramp_") or inputs.text("type") != "custom":
        return None
    return _curve(inputs)


def mean_of(kind: str, inputs: Inputs) -> np.ndarray | None:
    """The middle of what a node of noise lies between, shape [c]; None for other nodes."""
    for prefix, (low, high) in NOISES.items():
        if kind.startswith(prefix):
            ends = [inputs.color((name,), (default,) * 3) if name else (default,) * 3 for name, default in (low, high)]
            return np.mean(ends, axis=0)
    return None


def _curve(inputs: Inputs) -> Callable[[np.ndarray], np.ndarray]:
    """Arnold's ramp: a value for each position between 0 and 1, from one knot to the next in a line, or held."""
    places, values = inputs.value("position"), inputs.value("color", "value")
    x = np.array([0.0, 1.0]) if places is None or places.numbers is None else np.ravel(places.numbers)
    y = np.array([[0.0], [1.0]]) if values is None or values.numbers is None else values.numbers
    y = np.reshape(y, (len(y), -1))
    count = min(len(x), len(y))
    order = np.argsort(x[:count], kind="stable")
    x, y = x[:count][order], y[:count][order]
    mode = inputs.value("interpolation")
    held = mode is not None and mode.numbers is not None and bool(np.all(mode.numbers == CONSTANT))

    def at(value: np.ndarray) -> np.ndarray:
        place = value[..., 0]
        if not count:
            return np.zeros((*place.shape, 1))
        if held:
            return y[np.clip(np.searchsorted(x, place, side="right") - 1, 0, count - 1)]
        return np.stack([np.interp(place, x, channel) for channel in y.T], axis=-1)

    return at


def _grid() -> tuple[np.ndarray, np.ndarray]:
    """s and t of the texels of a square picture, shape [FINE, FINE] each."""
    return np.meshgrid(CENTERS, 1.0 - CENTERS)


def _arnold_ramp(inputs: Inputs) -> Pattern | None:
    s, t = _grid()
    around = np.arctan2(t - 0.5, s - 0.5) / (2.0 * np.pi) % 1.0
    places = {
        "u": s,
        "v": t,
        "diagonal": 0.5 * (s + t),
        "radial": around,
        "circular": np.hypot(s - 0.5, t - 0.5) * np.sqrt(2.0),
        "box": 2.0 * np.maximum(np.abs(s - 0.5), np.abs(t - 0.5)),
    }
    place = places.get(inputs.text("type") or "v")
    if place is None:
        return None
    wrap = Wrap.REPEAT if inputs.flag("wrap_uvs") else Wrap.CLAMP
    return Pattern(_curve(inputs)(place[..., None]), wrap)


def _ramp(*corners: str) -> Callable[[Inputs], Pattern]:
    """Values at the top left, top right, bottom left and bottom right corners, and in lines between them."""

    def draw(inputs: Inputs) -> Pattern:
        tl, tr, bl, br = (np.array(inputs.color((name,), BLACK)) for name in corners)
        s, t = (part[..., None] for part in _grid())
        return Pattern(t * ((1.0 - s) * tl + s * tr) + (1.0 - t) * ((1.0 - s) * bl + s * br))

    return draw


def _split(first: str, second: str, across: bool) -> Callable[[Inputs], Pattern]:
    """One value on this side of the center, and another beyond it, along s or along t."""

    def draw(inputs: Inputs) -> Pattern:
        one, other = (np.array(inputs.color((name,), BLACK)) for name in (first, second))
        s, t = _grid()
        center = inputs.number(("center",), 0.5)
        return Pattern(np.where(((s if across else t) < center)[..., None], one, other))

    return draw


def _checks(inputs: Inputs, scale: np.ndarray, offset: np.ndarray) -> Pattern:
    """Squares of two colours, the first at the lower left; two of them are as long as the picture."""
    one, other = (np.array(inputs.color((name,), default)) for name, default in (("color1", WHITE), ("color2", BLACK)))
    s, t = _grid()
    pixels = np.where(((s < 0.5) == (t < 0.5))[..., None], one, other)
    return Pattern(pixels, Wrap.REPEAT, tuple(map(float, scale)), tuple(map(float, offset)))


def _mtlx_checks(inputs: Inputs) -> Pattern:
    return _checks(inputs, 0.5 * inputs.pair("uvtiling", 8.0), -0.5 * inputs.pair("uvoffset", 0.0))


def _arnold_checks(inputs: Inputs) -> Pattern:
    scale, offset = (
        np.array([inputs.number((f"{axis}_{name}",), default) for axis in "uv"])
        for name, default in (("frequency", 1.0), ("offset", 0.0))
    )
    return _checks(inputs, scale, offset)


PATTERNS: dict[str, Callable[[Inputs], Pattern | None]] = {
    "arnold:ramp_": _arnold_ramp,
    "arnold:checkerboard": _arnold_checks,
    "ND_checkerboard_": _mtlx_checks,
    "ND_ramplr_": _ramp("valuel", "valuer", "valuel", "valuer"),
    "ND_ramptb_": _ramp("valuet", "valuet", "valueb", "valueb"),
    "ND_ramp4_": _ramp("valuetl", "valuetr", "valuebl", "valuebr"),
    "ND_splitlr_": _split("valuel", "valuer", across=True),
    "ND_splittb_": _split("valueb", "valuet", across=False),
}
# Noise, by the inputs of its ends and what these are where they are not authored.
NOISES: dict[str, tuple[tuple[str, float], tuple[str, float]]] = {
    "arnold:noise": (("color1", 0.0), ("color2", 1.0)),
    "ND_noise2d_": (("pivot", 0.0), ("pivot", 0.0)),
    "ND_noise3d_": (("pivot", 0.0), ("pivot", 0.0)),
    "ND_fractal": (("", 0.0), ("", 0.0)),
    "ND_cellnoise": (("", 0.0), ("", 1.0)),
    "ND_unifiednoise": (("outmin", 0.0), ("outmax", 1.0)),
}
