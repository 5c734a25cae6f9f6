"""Dispersion: glass whose index of refraction differs by wavelength (beyond the paper).

Light is traced at a few wavelengths, each of which carries its share of red, green and blue: tents over the spectrum
that add up to one everywhere, so that white light without a prism stays white. The index follows Cauchy's law
n = A + B/λ² with the Abbe number V = (n_d − 1)/(n_F − n_C) that is authored.

The view refracts by n_d: what is seen through a prism has no colours of its own, what falls on a wall behind it has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import Material
from tpdwarp.scene.device.geometry import Geometry, Surfaces, replace_time
from tpdwarp.scene.nesting import Nesting

# Fraunhofer's lines d, F and C [µm], by which the Abbe number is defined.
LINE_D, LINE_F, LINE_C = 0.5876, 0.4861, 0.6563
# Wavelengths traced [µm]. Nine are chosen, not derived: of a spectrum they leave steps of a ninth.
WAVELENGTHS = np.linspace(0.43, 0.67, 9)
# Where the tents of blue, green and red stand [µm]: the dominant wavelengths of the primaries of Rec. 709.
TENTS = np.array([0.464, 0.549, 0.612])


def band_colors() -> np.ndarray:
    """Shares of red, green and blue of each wavelength, shape [k, 3]; those of each channel add up to one."""
    blue, green, red = (np.interp(WAVELENGTHS, TENTS, row) for row in np.eye(3))
    shares = np.stack([red, green, blue], axis=1)
    return shares / shares.sum(axis=0)


def index_at(material: Material, wavelength: float) -> float:
    """Index of refraction of a material at a wavelength [µm]."""
    if material.abbe <= 0.0:
        return material.ior
    b = (material.ior - 1.0) / material.abbe / (LINE_F**-2 - LINE_C**-2)
    return material.ior + b * (wavelength**-2 - LINE_D**-2)


@dataclass(frozen=True, eq=False)
class Band:
    """One of the wavelengths that light is traced at.

    Attributes:
        number: Which.
        surfaces: The surfaces, with their indices of refraction there.
        color: Its shares of red, green and blue; None for all of them.
    """

    number: int
    surfaces: Surfaces
    color: np.ndarray | None = None

    def tinted(self, power: wp.vec3) -> wp.vec3:
        """What a light has of its power at this wavelength."""
        return power if self.color is None else wp.vec3(*(float(p * c) for p, c in zip(power, self.color, strict=True)))

    def path(self, masks: np.ndarray) -> np.ndarray:
        """Masks of paths with the number of the wavelength beyond them, shape [n] int64."""
        return masks.astype(np.int64) * len(WAVELENGTHS) + self.number if self.color is not None else masks


def bands_of(geometry: Geometry, nesting: Nesting | None, launcher: Launcher) -> list[Band]:
    """The wavelengths that light is traced at through a scene with glass that disperses."""
    media = () if nesting is None else nesting.materials
    bands = []
    for number, (wavelength, color) in enumerate(zip(WAVELENGTHS, band_colors(), strict=True)):
        surfaces = replace_time(geometry.surfaces, geometry.surfaces.time)
        for name, materials in (("ior", geometry.materials), ("medium_index", media)):
            indices = np.array([index_at(material, float(wavelength)) for material in materials], np.float32)
            setattr(surfaces, name, launcher.array(indices, wp.float32))
        bands.append(Band(number, surfaces, color))
    return bands
