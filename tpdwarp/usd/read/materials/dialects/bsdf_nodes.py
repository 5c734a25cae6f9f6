"""Surfaces put together from BSDF nodes of MaterialX and Lama: dielectrics, conductors, diffuse ones, and mixtures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tpdwarp.usd.read.materials.dialects import lama
from tpdwarp.usd.read.materials.dialects.table import BRIGHTEST
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import BLACK, WHITE, Color, Physical

# Terminals, by whose inputs a BSDF is found, and what may stand in the place of one.
IDS = ("surface", "lama_surface", "LamaSurface")
DIRECT = ("LamaDielectric", "LamaConductor", "LamaGeneralizedSchlick", "LamaDiffuse", "LamaLayer", "LamaMix", "LamaAdd")
# Layers deeper than this count as circular. Chosen, not derived: hand-made networks have a few, and each may be of two.
DEEPEST = 12


def read(inputs: Inputs) -> Physical:
    """The surface whose BSDF is connected to a terminal."""
    found = _bsdf(inputs, ("bsdf", "materialFront"), 0)
    if emission := _emission(inputs):
        found = replace(found, emission=emission)
    presence = inputs.number(("opacity", "presence"), 1.0)
    sources = {**found.sources, "presence": inputs.source("opacity", "presence"), "emission": inputs.source("edf")}
    return replace(found, presence=presence, thin_walled=inputs.flag("thin_walled"), sources=sources)


def read_node(inputs: Inputs) -> Physical:
    """The surface that a BSDF is, where it stands in the place of a terminal, as RenderMan takes it."""
    return _read_part(str(inputs.shader.GetShaderId() or ""))(inputs, 0)


def _plain(kind: str) -> str:
    """What a node is called, without its prefix and however its words are told apart."""
    return kind.removeprefix("ND_").replace("_", "").lower()


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


def _bsdf(inputs: Inputs, names: tuple[str, ...], depth: int) -> Physical:
    node = inputs.node(*names)
    if not node:
        return Physical(BLACK)
    if depth > DEEPEST:
        inputs.warnings(inputs.source(*names), "is fed by a network that is too deep, or circular; its default is used")
        return Physical(BLACK)
    kind = str(node.GetShaderId() or "")
    below = inputs.of(node)
    read_part = _read_part(kind)
    if read_part is None:
        inputs.warnings(
            inputs.source(*names), f"is connected to {kind or 'a node'}, which is not read; it counts as black"
        )
        return Physical(BLACK)
    found = read_part(below, depth)
    inputs.varies |= below.varies
    return found


def _read_part(kind: str) -> Callable[[Inputs, int], Physical] | None:
    plain = _plain(kind)
    return next((read_part for name, read_part in NODES.items() if plain.startswith(name)), None)


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


def _soft(inputs: Inputs, depth: int) -> Physical:
    """What scatters light below its surface or through it, as if it were diffuse."""
    inputs.warn("color", "is the colour of light scattered inside, which is rendered as diffuse")
    return _diffuse(inputs, depth)


def _layer(inputs: Inputs, depth: int) -> Physical:
    top, base = _bsdf(inputs, ("top", "materialTop"), depth + 1), _bsdf(inputs, ("base", "materialBase"), depth + 1)
    if inputs.node("materialTop") and inputs.node("materialBase") and top.transmission > 0:
        # Lama's dielectric on top of something is a coat.
        inputs.warn("materialTop", "is a coat, which is not rendered")
        return base
    shown = inputs.number(("topMix",), 1.0)
    return top if shown * max(top.transmission, top.metalness) >= 0.5 else base


def _add(inputs: Inputs, depth: int) -> Physical:
    weights = 1.0, 1.0
    if inputs.find("material1", "material2"):
        weights = inputs.number(("weight1",), 1.0), inputs.number(("weight2",), 0.0)
    parts = (
        (weight, _bsdf(inputs, names, depth + 1))
        for weight, names in zip(weights, (("in1", "material1"), ("in2", "material2")), strict=True)
    )
    found = [part for weight, part in parts if weight > 0] or [Physical(BLACK)]
    return max(found, key=lambda part: (part.transmission + part.metalness, max(part.base_color)))


def _mix(inputs: Inputs, depth: int) -> Physical:
    share = min(max(inputs.number(("mix",), 0.0), 0.0), 1.0)
    below, above = (_bsdf(inputs, names, depth + 1) for names in (("bg", "material1"), ("fg", "material2")))
    if share in (0.0, 1.0):
        return above if share else below
    mixed = mixture(below, above, share)
    if mixed is None:
        inputs.warn("mix", "a mixture of surfaces is rendered as the larger part of it")
        return above if share >= 0.5 else below
    return mixed


def mixture(below: Physical, above: Physical, share: float) -> Physical | None:
    """The surface of which a share is ``above``; None where one description does not hold both.

    It holds glass in a share of what is diffuse.
    """
    (weight, clear), (_, solid) = sorted(
        ((1.0 - share, below), (share, above)), key=lambda part: part[1].transmission, reverse=True
    )
    holds = clear.transmission > 0 == clear.metalness and not (solid.transmission or solid.metalness)
    if not holds or clear.presence != solid.presence or clear.images or solid.images or clear.cutout or solid.cutout:
        return None
    return replace(
        clear,
        transmission=weight * clear.transmission,
        base_color=solid.base_color,
        base_image=solid.base_image,
        color_primvar=solid.color_primvar,
    )


def _multiply(inputs: Inputs, depth: int) -> Physical:
    found = _bsdf(inputs, ("in1",), depth + 1)
    factor = inputs.color(("in2",), WHITE)

    def scaled(color: Color) -> Color:
        return tuple(c * f for c, f in zip(color, factor, strict=True))

    image = None if found.base_image is None else found.base_image.mapped(lambda pixels: pixels * np.array(factor))
    return replace(found, base_color=scaled(found.base_color), base_image=image, tint=scaled(found.tint))


# By what their names begin with, as :func:`_plain` has them.
NODES: dict[str, Callable[[Inputs, int], Physical]] = {
    "orennayardiffusebsdf": _diffuse,
    "burleydiffusebsdf": _diffuse,
    "translucentbsdf": _soft,
    "subsurfacebsdf": _soft,
    "dielectricbsdf": _dielectric,
    "conductorbsdf": _conductor,
    "generalizedschlickbsdf": _schlick,
    "layerbsdf": _layer,
    "addbsdf": _add,
    "mixbsdf": _mix,
    "multiplybsdf": _multiply,
    "lamadielectric": lama.dielectric,
    "lamaconductor": lama.conductor,
    "lamageneralizedschlick": lama.generalized_schlick,
    "lamadiffuse": _diffuse,
    "lamasss": _soft,
    "lamatranslucent": _soft,
    "lamalayer": _layer,
    "lamaadd": _add,
    "lamamix": _mix,
}
