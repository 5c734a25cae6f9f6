"""Leaves of RenderMan's layered materials (Lama), also as MaterialX defines them: what each says of a surface alone."""

from __future__ import annotations

import math

import numpy as np

from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import BLACK, WHITE, Color, Physical

ARTISTIC = 0
# Reflectances from here on are those of nothing that refracts.
MOST_REFLECTANCE = 0.99


def dielectric(inputs: Inputs, depth: int) -> Physical:
    """Glass; its index is given by itself, or by its reflectance at normal incidence."""
    if _artistic(inputs):
        root = math.sqrt(min(max(inputs.number(("reflectivity",), 0.04), 0.0), MOST_REFLECTANCE))
        ior = (1 + root) / (1 - root)
    else:
        ior = inputs.number(("IOR",), 1.5)
    return _clear(inputs, ior, "reflectivity" if _artistic(inputs) else "IOR")


def generalized_schlick(inputs: Inputs, depth: int) -> Physical:
    """A dielectric that reflects by a colour; a metal where that is more than dielectrics reflect."""
    n = np.array(inputs.color(("IOR",), (1.5,) * 3))
    face = np.array(inputs.color(("reflectivity",), (0.04,) * 3)) if _artistic(inputs) else ((n - 1) / (n + 1)) ** 2
    if face.max() > 0.2:
        return _metal(inputs, face * inputs.color(("reflectionTint",), WHITE))
    return _clear(inputs, float(n[0]), "IOR")


def conductor(inputs: Inputs, depth: int) -> Physical:
    """A metal by its reflectance at normal incidence, or by its complex index."""
    if _artistic(inputs):
        face = np.array(inputs.color(("reflectivity",), (0.945, 0.7772, 0.3737)))
    else:
        n = np.array(inputs.color(("IOR",), (0.18, 0.42, 1.37)))
        k = np.array(inputs.color(("extinction",), (3.42, 2.35, 1.77)))
        face = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    return _metal(inputs, face * inputs.color(("tint",), WHITE))


def _artistic(inputs: Inputs) -> bool:
    return int(inputs.number(("fresnelMode",), ARTISTIC)) == ARTISTIC


def _clear(inputs: Inputs, ior: float, ior_from: str) -> Physical:
    """Glass of an index, with its absorption inside; its colour at the surface counts where it absorbs nothing."""
    if any(inputs.color(("scatterColor",), BLACK)):
        inputs.warn("scatterColor", "is not rendered")
    surface, inside = inputs.color(("transmissionTint",), WHITE), inputs.color(("absorptionColor",), WHITE)
    radius = inputs.number(("absorptionRadius",), 1.0)
    absorbs = min(inside) < 1
    if absorbs and min(surface) < 1:
        inputs.warn("transmissionTint", "is not rendered beside absorption")
    return Physical(
        BLACK,
        transmission=1.0,
        ior=ior,
        roughness=inputs.number(("roughness",), 0.1),
        tint=inside if absorbs else surface,
        absorption_depth=max(radius, 0.0) if absorbs else 0.0,
        sources=_sources(inputs, ior_from, "absorptionColor" if absorbs else "transmissionTint"),
    )


def _metal(inputs: Inputs, face: np.ndarray) -> Physical:
    color: Color = tuple(map(float, np.clip(face, 0.0, 1.0)))
    roughness = inputs.number(("roughness",), 0.1)
    return Physical(color, metalness=1.0, roughness=roughness, sources=_sources(inputs, "IOR", "tint"))


def _sources(inputs: Inputs, ior: str, tint: str) -> dict[str, str]:
    names = {"ior": ior, "roughness": "roughness", "tint": tint, "base_color": "reflectivity"}
    return {key: inputs.source(name) for key, name in names.items()}
