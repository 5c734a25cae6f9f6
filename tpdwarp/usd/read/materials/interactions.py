"""From the physical description to the three interactions that are rendered; what they cannot show is warned about."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tpdwarp.errors import WarnOnce
from tpdwarp.scene.description import Interaction, Material, Texture
from tpdwarp.usd.read.materials.physical import Physical
from tpdwarp.usd.read.materials.textures import Image, combined
from tpdwarp.usd.read.values import ITS_DEFAULT, positive

# Up to this roughness r a microfacet lobe is narrower (r² < .0049) than the sun's disc (.0046 rad): smooth.
SMOOTH = 0.07
# Up to this (.3, in single precision) the lobe (.09 rad) is a blurred mirror rather than a surface that shines
# everywhere.
MIRROR_LIKE = 0.3 + 1e-6
# Pictures are kept in half precision, which rounds by so much.
HALF_UP = 1.0 + 2.0**-11
# Less metal than this is left out: it would reflect no more than varnish does.
LEAST_METAL = 0.05
# No dielectric of an index below 2.6 reflects more than this at normal incidence: what does is a metal.
MOST_DIELECTRIC_REFLECTANCE = 0.2
# Weights are authored in single precision and by hand: this near to 0 or 1 they are.
NEARLY = 0.01
# A tint of nothing would absorb without end: after its depth this much is left, which is no step of eight bits.
DARKEST = 1e-4


def interaction_of(physical: Physical, path: str, warnings: WarnOnce) -> Material | None:
    """The material that comes nearest to a description.

    Args:
        physical: The description.
        path: Path of the material.
        warnings: Takes what is approximated.

    Returns:
        None for a surface that is not there.
    """

    def warn(name: str, message: str) -> None:
        warnings(physical.sources.get(name, path), message)

    if max(physical.emission) > 0 and not physical.unlit:
        warn("emission", "light that a surface gives off is seen, but lights nothing (without MeshLightAPI)")
    if physical.presence < NEARLY:
        return None
    there = replace(_present(physical, path, warn), presence=physical.presence)
    if there.presence > 1 - NEARLY:
        there = replace(there, presence=1.0)
    if physical.cutout is not None:
        there = replace(there, cutout=physical.cutout.texture(), threshold=physical.threshold)
    return there


def _present(physical: Physical, path: str, warn: Callable[[str, str], None]) -> Material:
    """The material where all of the surface is there."""
    clear, metal = _shares(physical, warn)
    normal_map = None if physical.normal_image is None else physical.normal_image.texture()
    shown = {"emission": physical.emission, "normal_map": normal_map}
    if (image := physical.images.get("emission")) is not None and image.most > 0:
        shown["emission_map"] = image.texture()
    reflectance = ((physical.ior - 1.0) / (physical.ior + 1.0)) ** 2 if physical.ior > 0 else 0.0
    specular = isinstance(clear, Image) or clear > NEARLY or isinstance(metal, Image) or metal >= LEAST_METAL
    if not specular and reflectance > max(MOST_DIELECTRIC_REFLECTANCE, *physical.base_color):
        # What is darker than it shines is a metal that is authored by its index.
        images = {name: image for name, image in physical.images.items() if name != "metalness"}
        grey = (min(reflectance, 1.0),) * 3
        physical = replace(physical, base_color=grey, base_image=None, metalness=1.0, images=images)
        clear, metal = _shares(physical, warn)
    rough = _rough_metal(physical, clear, warn)
    if isinstance(clear, Image) or clear > NEARLY:
        return _partly(_dielectric(physical, path, warn), clear, physical, rough)
    if isinstance(metal, Image) or metal >= LEAST_METAL:
        return _partly(_mirror(physical, path, warn), metal, physical, rough)
    if metal > NEARLY:
        warn("metalness", "metal that is hardly any is rendered as diffuse")
    return Material(Interaction.DIFFUSE, physical.base_color, physical.ior, path, _texture(physical), **shown, **rough)


def _rough_metal(
    physical: Physical, clear: float | Image, warn: Callable[[str, str], None]
) -> dict[str, float | Texture]:
    """The share that is metal too rough for a mirror, of what is not clear, and its width; nothing where there is none.

    Args:
        clear: Share of the surface that is clear.
    """
    share: float | Image | None = None
    if physical.images.keys() & {"metalness", "roughness"}:
        values = [
            physical.images.get("metalness", np.array([float(physical.metalness)])),
            physical.images.get("roughness", np.array([float(physical.roughness)])),
            clear if isinstance(clear, Image) else np.array([clear]),
        ]
        share = _over(
            lambda m, r, c: np.where(r > MIRROR_LIKE * HALF_UP, m / np.maximum(np.maximum(1.0 - c, m), NEARLY), 0.0),
            values,
        )
    if share is None:
        rest = max(1.0 - (_mean(clear) if isinstance(clear, Image) else clear), physical.metalness, NEARLY)
        share = physical.metalness / rest if physical.roughness > MIRROR_LIKE else 0.0
    if not isinstance(share, Image):
        if share <= NEARLY:
            return {}
        share = 1.0 if share > 1.0 - NEARLY else share
    warn("metalness", f"what metal rougher than {MIRROR_LIKE:.3g} throws onto other surfaces is left out")
    found = {"metal": share} if not isinstance(share, Image) else {"metal": _mean(share), "metal_map": share.texture()}
    return {**found, **_roughness(physical)}


def _partly(whole: Material, share: float | Image, physical: Physical, rough: dict[str, float | Texture]) -> Material:
    """What is specular in that share of the surface, and in the rest diffuse and of ``rough`` metal."""
    if isinstance(share, Image):
        rest = share.mapped(lambda pixels: 1.0 - pixels)
        shares = {"diffuse_share": _mean(rest), "diffuse_map": rest.texture()}
    elif share < 1.0 - NEARLY:
        shares = {"diffuse_share": 1.0 - share}
    else:
        return whole
    return replace(whole, **shares, **rough, texture=_texture(physical))


def _shares(physical: Physical, warn: Callable[[str, str], None]) -> tuple[float | Image, float | Image]:
    """Shares of a surface that are clear, and that are metal which mirrors; where it has both, the larger one counts.

    Where they differ over the surface, what is hardly any is none.
    """
    names = "metalness", "transmission", "roughness"
    if not physical.images.keys() & set(names):
        metal = physical.metalness if physical.roughness <= MIRROR_LIKE else 0.0
        return physical.transmission * (1.0 - physical.metalness), metal
    values = [physical.images.get(name, np.array([float(getattr(physical, name))])) for name in names]
    clear = _over(lambda m, t, r: _some(t * (1.0 - m)), values)
    metal = _over(lambda m, t, r: _some(np.where(r <= MIRROR_LIKE * HALF_UP, m * (1.0 - t), 0.0)), values)
    if clear is None or metal is None:
        warn("metalness", "textures of metal, glass and roughness that lie differently are rendered by their means")
        return _shares(replace(physical, images={}), warn)
    if clear and metal:
        warn("metalness", "what is metal here and glass there is rendered as what there is more of")
        most = max((clear, metal), key=_mean)
        return (clear, 0.0) if most is clear else (0.0, metal)
    return clear, metal


def _mean(share: float | Image) -> float:
    return float(share.mean.mean()) if isinstance(share, Image) else share


def _some(share: np.ndarray) -> np.ndarray:
    """A share, where it is more than hardly any."""
    return np.where(share >= LEAST_METAL, np.where(share > 1.0 - NEARLY, 1.0, share), 0.0)


def _over(function: Callable[..., np.ndarray], values: list[np.ndarray | Image]) -> float | Image | None:
    """A function of shares over a surface; a number where it is 0 or 1 everywhere; None where they lie differently."""
    found = combined(lambda arguments: function(*arguments), values)
    if found is None or found.most > found.least:
        return found
    return found.most


def _texture(physical: Physical) -> Texture | None:
    return None if physical.base_image is None else physical.base_image.texture()


def _warn_normal_map(physical: Physical, warn: Callable[[str, str], None]) -> None:
    if physical.normal_image is not None:
        warn("normal_image", "a normal map of what reflects or refracts is not rendered")


def _dielectric(physical: Physical, path: str, warn: Callable[[str, str], None]) -> Material:
    _warn_normal_map(physical, warn)
    ior = physical.ior
    if not positive(ior):
        warn("ior", f"holds an index of refraction of {ior:g}; {ITS_DEFAULT}, {Physical.ior:g} (author one above 0)")
        ior = Physical.ior
    if physical.roughness > MIRROR_LIKE and "roughness" not in physical.images:
        warn("roughness", f"transmission as rough as this (above {MIRROR_LIKE:.3g}) is rendered as a wide beam")
    inside = {
        "thin_walled": physical.thin_walled,
        **_roughness(physical),
        "abbe": 0.0 if physical.thin_walled or not math.isfinite(physical.abbe) else max(physical.abbe, 0.0),
    }
    if max(physical.tint) > 1:
        warn("tint", "glass passes no more than it receives: its tint is limited to 1")
    tint = tuple(min(channel, 1.0) for channel in physical.tint)
    if (image := physical.images.get("tint")) is not None:
        if physical.absorption_depth > 0 and not physical.thin_walled:
            warn("tint", "is a texture of what is absorbed inside, of which the mean is rendered")
        else:
            inside["transmittance_map"] = image.mapped(lambda pixels: np.minimum(pixels, 1.0)).texture()
    if physical.absorption_depth > 0 and not physical.thin_walled:
        absorption = tuple(-math.log(max(channel, DARKEST)) / physical.absorption_depth for channel in tint)
        return Material(Interaction.DIELECTRIC, physical.base_color, ior, path, absorption=absorption, **inside)
    return Material(Interaction.DIELECTRIC, physical.base_color, ior, path, transmittance=tint, **inside)


def _mirror(physical: Physical, path: str, warn: Callable[[str, str], None]) -> Material:
    _warn_normal_map(physical, warn)
    color = physical.base_color
    if max(color) > 1:
        warn("base_color", "a mirror reflects no more than it receives: its colour is limited to 1")
        color = tuple(min(channel, 1.0) for channel in color)
    return Material(Interaction.MIRROR, color, physical.ior, path, _texture(physical), **_roughness(physical))


def _roughness(physical: Physical) -> dict[str, float | Texture]:
    """The width of the microfacet distribution, and its map where it differs over the surface."""
    image = physical.images.get("roughness")
    if image is None:
        return {"roughness": _width(physical.roughness)}
    widths = image.mapped(lambda pixels: np.where(pixels > SMOOTH, np.minimum(pixels, 1.0) ** 2, 0.0))
    if widths.most == 0.0:
        return {}
    return {"roughness": _mean(widths), "roughness_map": widths.texture()}


def _width(roughness: float) -> float:
    """The width α = r² of the microfacet distribution; 0 for what is smooth, and no more than 1."""
    return min(roughness, 1.0) ** 2 if roughness > SMOOTH else 0.0
