"""One description of a surface, whatever dialect it is authored in."""

from __future__ import annotations

from dataclasses import dataclass, field

from tpdwarp.usd.read.materials.textures import Image

Color = tuple[float, float, float]
WHITE: Color = (1.0, 1.0, 1.0)
BLACK: Color = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Physical:
    """How a surface deals with light. Colours are linear Rec.709; weights lie in 0 … 1.

    Attributes:
        base_color: Albedo, and what a metal reflects.
        base_image: The base colour over the surface; None where it is the same everywhere.
        color_primvar: The mesh's primvar that takes the place of the base colour where there is one; empty for none.
        metalness: Share that is metal.
        transmission: Share of what is not metal that is clear: refracts, or passes a thin wall.
        ior: Index of refraction inside, relative to outside.
        roughness: Square root of the width α of the microfacet distribution.
        tint: Colour of what is transmitted.
        absorption_depth: Distance after which white light has taken on the tint, in scene units; 0: at once.
        abbe: Abbe number of what disperses; 0 for none.
        thin_walled: Whether the surface is a sheet, which does not refract.
        presence: Share of the surface that is there at all.
        cutout: Presence over the surface; None where it is the same everywhere.
        threshold: Where ``cutout`` is at least this, above 0, all of the surface is there, and elsewhere nothing.
        emission: Radiance that it gives off.
        unlit: Whether that is all that it shows, as light has no part in it.
        normal_image: Normals over the surface in the frame of its texture coordinates; None for the mesh's own.
        images: Others of these over the surface, by name: ``metalness``, ``transmission``, ``roughness``, ``tint`` and
            ``emission``, whose means are above.
        sources: Path of the attribute that each of these comes from, by name; none where nothing is authored.
    """

    base_color: Color = (0.18, 0.18, 0.18)
    base_image: Image | None = None
    color_primvar: str = ""
    metalness: float = 0.0
    transmission: float = 0.0
    ior: float = 1.5
    roughness: float = 0.0
    tint: Color = WHITE
    absorption_depth: float = 0.0
    abbe: float = 0.0
    thin_walled: bool = False
    presence: float = 1.0
    cutout: Image | None = None
    threshold: float = 0.0
    emission: Color = BLACK
    unlit: bool = False
    normal_image: Image | None = None
    images: dict[str, Image] = field(default_factory=dict, compare=False)
    sources: dict[str, str] = field(default_factory=dict, compare=False)
