"""From the physical description to the three interactions that are rendered; what they cannot show is warned about."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Interaction, Material, Texture
from tpdwarp.usd.read.materials.physical import Physical

# Up to this roughness r a microfacet lobe is narrower (r² < .0049) than the sun's disc (.0046 rad): smooth.
SMOOTH = 0.07
# Up to this (.3, in single precision) the lobe (.09 rad) is a blurred mirror rather than a surface that shines
# everywhere.
MIRROR_LIKE = 0.3 + 1e-6
# Less metal than this is left out: it would reflect no more than varnish does.
LEAST_METAL = 0.05
# Weights are authored in single precision and by hand: this near to 0 or 1 they are.
NEARLY = 0.01
# A tint of nothing would absorb without end: after its depth this much is left, which is no step of eight bits.
DARKEST = 1e-4


def interaction_of(physical: Physical, path: str, warnings: WarnOnce) -> Material | None:
    """The material that comes nearest to a description.

    Args:
        physical: The description.
        path: Path of the material.
        warnings: Takes what is approximated, and names the file in errors.

    Returns:
        None for a surface that is not there.

    Raises:
        InputError: An index of refraction that means nothing, where there is refraction.
    """

    def warn(name: str, message: str) -> None:
        warnings(physical.sources.get(name, path), message)

    if max(physical.emission) > 0 and not physical.unlit:
        warn("emission", "light that a surface gives off is seen, but lights nothing (MeshLightAPI makes it a light)")
    if physical.presence < NEARLY:
        return None
    there = replace(_present(physical, path, warn, warnings), presence=physical.presence)
    if there.presence > 1 - NEARLY:
        there = replace(there, presence=1.0)
    if physical.cutout is not None:
        there = replace(there, cutout=physical.cutout.texture(), threshold=physical.threshold)
    return there


def _present(physical: Physical, path: str, warn: Callable[[str, str], None], warnings: WarnOnce) -> Material:
    """The material where all of the surface is there."""
    transmission = physical.transmission * (1.0 - physical.metalness)
    if transmission > NEARLY:
        clear = _dielectric(physical, path, warn, warnings)
        if transmission > 1 - NEARLY:
            return clear
        return replace(clear, diffuse_share=1.0 - transmission, texture=_texture(physical))
    if physical.metalness >= LEAST_METAL and physical.roughness <= MIRROR_LIKE:
        mirror = _mirror(physical, path, warn)
        share = 1.0 - physical.metalness
        return replace(mirror, diffuse_share=share, texture=_texture(physical)) if share > NEARLY else mirror
    if physical.metalness > NEARLY:
        warn("metalness", "metal that is rough, or hardly any, is rendered as diffuse")
    normal_map = None if physical.normal_image is None else physical.normal_image.texture()
    shown = {"emission": physical.emission, "normal_map": normal_map}
    return Material(Interaction.DIFFUSE, physical.base_color, physical.ior, path, _texture(physical), **shown)


def _texture(physical: Physical) -> Texture | None:
    return None if physical.base_image is None else physical.base_image.texture()


def _warn_normal_map(physical: Physical, warn: Callable[[str, str], None]) -> None:
    if physical.normal_image is not None:
        warn("normal_image", "a normal map of what reflects or refracts is not rendered")


def _dielectric(physical: Physical, path: str, warn: Callable[[str, str], None], warnings: WarnOnce) -> Material:
    _warn_normal_map(physical, warn)
    ior = physical.ior
    if not (math.isfinite(ior) and ior > 0):
        raise InputError(
            f"holds an index of refraction of {ior:g} (author one above 0, glass has 1.5)",
            warnings.file,
            physical.sources.get("ior", path),
        )
    if physical.roughness > MIRROR_LIKE:
        warn("roughness", f"transmission as rough as this (above {MIRROR_LIKE:g}) is rendered as a wide beam")
    inside = {
        "thin_walled": physical.thin_walled,
        "roughness": _width(physical.roughness),
        "abbe": 0.0 if physical.thin_walled or not math.isfinite(physical.abbe) else max(physical.abbe, 0.0),
    }
    if max(physical.tint) > 1:
        warn("tint", "glass passes no more than it receives: its tint is limited to 1")
    tint = tuple(min(channel, 1.0) for channel in physical.tint)
    if physical.absorption_depth > 0 and not physical.thin_walled:
        absorption = tuple(-math.log(max(channel, DARKEST)) / physical.absorption_depth for channel in tint)
        return Material(Interaction.DIELECTRIC, physical.base_color, ior, path, absorption=absorption, **inside)
    return Material(Interaction.DIELECTRIC, physical.base_color, ior, path, transmittance=tint, **inside)


def _mirror(physical: Physical, path: str, warn: Callable[[str, str], None]) -> Material:
    _warn_normal_map(physical, warn)
    color = physical.base_color
    if physical.base_image is not None:
        warn("base_color", "is a texture on metal, of which the mean colour is rendered")
    if max(color) > 1:
        warn("base_color", "a mirror reflects no more than it receives: its colour is limited to 1")
        color = tuple(min(channel, 1.0) for channel in color)
    return Material(Interaction.MIRROR, color, physical.ior, path, roughness=_width(physical.roughness))


def _width(roughness: float) -> float:
    """The width α = r² of the microfacet distribution; 0 for what is smooth, and no more than 1."""
    return min(roughness, 1.0) ** 2 if roughness > SMOOTH else 0.0
