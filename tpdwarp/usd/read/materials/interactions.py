"""From the physical description to the three interactions that are rendered; what they cannot show is warned about."""

from __future__ import annotations

import math

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Interaction, Material
from tpdwarp.usd.read.materials.physical import WHITE, Physical

# Up to this roughness r a microfacet lobe is narrower (r² < .0049) than the sun's disc (.0046 rad): smooth.
SMOOTH = 0.07
# Up to this the lobe (.09 rad) is a blurred mirror rather than a surface that shines everywhere.
MIRROR_LIKE = 0.3
# Weights are authored in single precision and by hand: this near to 0 or 1 they are.
NEARLY = 0.01


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

    if max(physical.emission) > 0:
        warn("emission", "light that a surface gives off is not rendered")
    if physical.presence < 0.5:
        if physical.presence > NEARLY:
            warn("presence", "partial opacity is rendered as nothing")
        return None
    if physical.presence < 1 - NEARLY:
        warn("presence", "partial opacity is rendered as opaque")
    transmission = physical.transmission * (1.0 - physical.metalness)
    # Where no transmission is authored, it is the opacity that lets light pass.
    clear = "transmission" if physical.transmission == 0 or "opacity" not in physical.sources else "opacity"
    if transmission >= 0.5:
        if transmission < 1 - NEARLY:
            warn(clear, "partial transmission is rendered as clear")
        return _dielectric(physical, path, warn, warnings)
    if transmission > NEARLY:
        warn(clear, "partial transmission is rendered as opaque")
    if physical.metalness >= 0.5 and physical.roughness <= MIRROR_LIKE:
        return _mirror(physical, path, warn)
    if physical.metalness > NEARLY:
        warn("metalness", "metal that is rough or partial is rendered as diffuse")
    texture = None if physical.base_image is None else physical.base_image.texture()
    return Material(Interaction.DIFFUSE, physical.base_color, physical.ior, path, texture)


def _dielectric(physical: Physical, path: str, warn: object, warnings: WarnOnce) -> Material:
    ior = physical.ior
    if not (math.isfinite(ior) and ior > 0):
        raise InputError(
            f"holds an index of refraction of {ior:g} (author one above 0, glass has 1.5)",
            warnings.file,
            physical.sources.get("ior", path),
        )
    if physical.roughness > SMOOTH:
        warn("roughness", "rough transmission is rendered as smooth")
    if max(abs(c - w) for c, w in zip(physical.tint, WHITE, strict=True)) > NEARLY:
        lost = "absorption within it" if physical.absorption_depth > 0 else "its colour"
        warn("tint", f"glass is rendered clear: {lost} is not rendered")
    if physical.thin_walled:
        warn("thin_walled", "a thin wall passes light straight on; what it reflects is not rendered")
        ior = 1.0
    return Material(Interaction.DIELECTRIC, physical.base_color, ior, path)


def _mirror(physical: Physical, path: str, warn: object) -> Material:
    if physical.metalness < 1 - NEARLY:
        warn("metalness", "partial metalness is rendered as metal")
    if physical.roughness > SMOOTH:
        warn("roughness", "rough metal is rendered as a smooth mirror")
    color = physical.base_color
    if physical.base_image is not None:
        warn("base_color", "is a texture on metal, of which the mean colour is rendered")
    if max(color) > 1:
        warn("base_color", "a mirror reflects no more than it receives: its colour is limited to 1")
        color = tuple(min(channel, 1.0) for channel in color)
    return Material(Interaction.MIRROR, color, physical.ior, path)
