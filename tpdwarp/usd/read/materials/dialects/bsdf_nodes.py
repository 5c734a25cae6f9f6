"""MaterialX surfaces put together from BSDF nodes: dielectrics, conductors, diffuse ones, and mixtures of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tpdwarp.usd.read.materials.dialects.table import BRIGHTEST
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import BLACK, WHITE, Color, Physical

ID = "surface"
# Layers deeper than this count as circular. Chosen, not derived: hand-made networks have a few, and each may be of two.
DEEPEST = 12


def read(inputs: Inputs) -> Physical:
    """The surface whose BSDF is connected to a ``surface`` node."""
    found = _bsdf(inputs, "bsdf", 0)
    if emission := _emission(inputs):
        found = replace(found, emission=emission)
    presence = inputs.number(("opacity",), 1.0)
    sources = {**found.sources, "presence": inputs.source("opacity"), "emission": inputs.source("edf")}
    return replace(found, presence=presence, thin_walled=inputs.flag("thin_walled"), sources=sources)


def _emission(inputs: Inputs) -> Color | None:
    """What an EDF gives off in all directions alike; None where there is none."""
    node = inputs.node("edf")
    if not node:
        return None
    if not str(node.GetShaderId() or "").startswith("ND_uniform_edf"):
        inputs.warn("edf", "is not rendered")
        return None
    below = inputs.of(node)
    color = below.color(("color",), WHITE)
    inputs.varies |= below.varies
    return tuple(min(max(channel, 0.0), BRIGHTEST) for channel in color)


def _bsdf(inputs: Inputs, name: str, depth: int) -> Physical:
    node = inputs.node(name)
    if not node:
        return Physical(BLACK)
    if depth > DEEPEST:
        inputs.warn(name, "is fed by a network that is too deep, or circular; its default is used")
        return Physical(BLACK)
    kind = str(node.GetShaderId() or "")
    below = inputs.of(node)
    for part, read_part in NODES.items():
        if kind.startswith(f"ND_{part}"):
            found = read_part(below, depth)
            inputs.varies |= below.varies
            return found
    inputs.warn(name, f"is connected to {kind or 'a node'}, which is not read; it counts as black")
    return Physical(BLACK)


def _sources(inputs: Inputs) -> dict[str, str]:
    """What BSDF nodes call the properties."""
    names = {
        "base_color": ("color",),
        "tint": ("tint",),
        "ior": ("ior", "color0"),
        "roughness": ("roughness",),
        "transmission": ("scatter_mode",),
    }
    return {key: inputs.source(*value) for key, value in names.items()}


def _diffuse(inputs: Inputs, depth: int) -> Physical:
    weight = inputs.number(("weight",), 1.0)
    image = inputs.image("color")
    if image is not None:
        image = image.mapped(lambda pixels: np.clip(weight * pixels, 0.0, BRIGHTEST))
        return Physical(tuple(map(float, np.broadcast_to(image.mean, 3))), image, sources=_sources(inputs))
    color = tuple(weight * c for c in inputs.color(("color",), (0.18, 0.18, 0.18)))
    return Physical(color, sources=_sources(inputs))


def _roughness(inputs: Inputs, default: float) -> float:
    """BSDF nodes hold the width α, the square of what other dialects call roughness."""
    return math.sqrt(max(inputs.number(("roughness",), default), 0.0))


def _dielectric(inputs: Inputs, depth: int) -> Physical:
    transmits = "T" in inputs.text("scatter_mode")
    return Physical(
        BLACK,
        transmission=inputs.number(("weight",), 1.0) if transmits else 0.0,
        ior=inputs.number(("ior",), 1.5),
        roughness=_roughness(inputs, 0.05),
        tint=inputs.color(("tint",), WHITE) if transmits else WHITE,
        sources=_sources(inputs),
    )


def _conductor(inputs: Inputs, depth: int) -> Physical:
    # Gold, as the node's definition has it.
    n = np.array(inputs.color(("ior",), (0.271, 0.677, 1.316)))
    k = np.array(inputs.color(("extinction",), (3.609, 2.625, 2.292)))
    reflectance = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    return Physical(
        tuple(map(float, reflectance)), metalness=1.0, roughness=_roughness(inputs, 0.05), sources=_sources(inputs)
    )


def _schlick(inputs: Inputs, depth: int) -> Physical:
    color = inputs.color(("color0",), WHITE)
    roughness = _roughness(inputs, 0.05)
    if "T" in inputs.text("scatter_mode"):
        root = math.sqrt(min(max(float(np.mean(color)), 0.0), 0.99))
        ior = (1 + root) / (1 - root)
        return Physical(BLACK, transmission=1.0, ior=ior, roughness=roughness, sources=_sources(inputs))
    # No dielectric of an index below 2.6 reflects so much at normal incidence.
    if max(color) > 0.2:
        return Physical(color, metalness=1.0, roughness=roughness, sources=_sources(inputs))
    return Physical(BLACK, roughness=roughness, sources=_sources(inputs))


def _layer(inputs: Inputs, depth: int) -> Physical:
    top, base = _bsdf(inputs, "top", depth + 1), _bsdf(inputs, "base", depth + 1)
    return top if top.transmission >= 0.5 or top.metalness >= 0.5 else base


def _add(inputs: Inputs, depth: int) -> Physical:
    first, second = _bsdf(inputs, "in1", depth + 1), _bsdf(inputs, "in2", depth + 1)
    return max(first, second, key=lambda part: (part.transmission + part.metalness, max(part.base_color)))


def _mix(inputs: Inputs, depth: int) -> Physical:
    share = inputs.number(("mix",), 0.0)
    if 0 < share < 1:
        inputs.warn("mix", "a mixture of surfaces is rendered as the larger part of it")
    return _bsdf(inputs, "fg" if share >= 0.5 else "bg", depth + 1)


def _multiply(inputs: Inputs, depth: int) -> Physical:
    found = _bsdf(inputs, "in1", depth + 1)
    factor = inputs.color(("in2",), WHITE)

    def scaled(color: Color) -> Color:
        return tuple(c * f for c, f in zip(color, factor, strict=True))

    image = None if found.base_image is None else found.base_image.mapped(lambda pixels: pixels * np.array(factor))
    return replace(found, base_color=scaled(found.base_color), base_image=image, tint=scaled(found.tint))


NODES: dict[str, Callable[[Inputs, int], Physical]] = {
    "oren_nayar_diffuse_bsdf": _diffuse,
    "burley_diffuse_bsdf": _diffuse,
    "dielectric_bsdf": _dielectric,
    "conductor_bsdf": _conductor,
    "generalized_schlick_bsdf": _schlick,
    "layer_bsdf": _layer,
    "add_bsdf": _add,
    "mix_bsdf": _mix,
    "multiply_bsdf": _multiply,
}
