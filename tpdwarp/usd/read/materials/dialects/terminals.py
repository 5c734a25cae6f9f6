"""Terminals that are no surfaces: what hands on another shader, and what mixes two."""

from __future__ import annotations

from collections.abc import Callable

from pxr import Usd, UsdShade

from tpdwarp.usd.read.materials.dialects.bsdf_nodes import mixture
from tpdwarp.usd.read.materials.dialects.names import name_of
from tpdwarp.usd.read.materials.inputs import Inputs
from tpdwarp.usd.read.materials.physical import Physical
from tpdwarp.usd.read.values import number_at

EARLIEST = Usd.TimeCode.EarliestTime().GetValue()
# Terminals that hand on another shader, by the input that it is connected to: where rays that do not come from the
# camera have another, or backs, that of the camera and of the front is rendered.
HANDED_ON = {
    "ND_surfacematerial": "surfaceshader",
    "arnold:two_sided": "front",
    "arnold:ray_switch_shader": "camera",
    "arnold:ray_switch_rgba": "camera",
    "arnold:matte": "passthrough",
    "arnold:passthrough": "passthrough",
}
# Mixtures of two shaders, by the inputs of what is there at a share of 0 and of 1, and the share that is not authored.
MIXED = {"ND_mix_surfaceshader": ("bg", "fg", 0.0), "arnold:mix_shader": ("shader1", "shader2", 0.5)}

Reader = Callable[[Inputs], Physical]


def handed_on(shader: UsdShade.Shader) -> UsdShade.Shader:
    """The shader that a terminal hands on; a mixture that is all of one of its two hands on that one."""
    seen: set[str] = set()
    while shader and (kind := name_of(shader)) in (*HANDED_ON, *MIXED) and str(shader.GetPath()) not in seen:
        seen.add(str(shader.GetPath()))
        name = HANDED_ON.get(kind, "")
        if kind in MIXED:
            share = _share(shader)
            if 0 < share < 1:
                return shader
            name = MIXED[kind][share >= 1]
        shader = _fed_by(shader, name)
    return shader


def read_mixture(inputs: Inputs, reader_of: Callable[[UsdShade.Shader], Reader | None]) -> Physical:
    """The surface that a mixture is: glass in a share of what is diffuse, or else the larger part, which is said.

    Args:
        inputs: Those of the mixture.
        reader_of: What reads a surface.
    """
    shader, share = inputs.shader, _share(inputs.shader)
    larger = share >= 0.5
    with inputs.entered() as fresh:
        parts = [_read(inputs, name, reader_of) if fresh else None for name in MIXED[name_of(shader)][:2]]
    if None not in parts and (found := mixture(parts[0], parts[1], share)) is not None:
        return found
    inputs.warnings(inputs.path, "a mixture of surfaces is rendered as the larger part of it")
    return parts[larger] or parts[not larger] or Physical()


def _read(inputs: Inputs, name: str, reader_of: Callable[[UsdShade.Shader], Reader | None]) -> Physical | None:
    """One part of a mixture; None where it cannot be read."""
    part = handed_on(_fed_by(inputs.shader, name))
    reader = reader_of(part) if part else None
    if reader is None:
        return None
    below = inputs.of(part)
    found = reader(below)
    inputs.varies |= below.varies
    return found


def _share(shader: UsdShade.Shader) -> float:
    default = MIXED[name_of(shader)][2]
    mix = shader.GetInput("mix")
    return number_at(mix.GetAttr(), EARLIEST, default) if mix else default


def _fed_by(shader: UsdShade.Shader, name: str) -> UsdShade.Shader:
    """The shader that an input is connected to; an invalid one where there is none."""
    sources = shader.GetInput(name).GetConnectedSources()[0] if shader.GetInput(name) else []
    return UsdShade.Shader(sources[0].source.GetPrim()) if sources else UsdShade.Shader()
