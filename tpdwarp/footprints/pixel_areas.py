"""How large pixels are on what photons light: finer light is not told apart.

Beyond the paper.
"""

from __future__ import annotations

import numpy as np

from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.photon_map import PhotonMap


def typical_pixel_area(photons: PhotonMap, pixel: PixelSize | None) -> float:
    """The median area of what a pixel sees where photons lie, on planes that face it, in tracer's units squared.

    Args:
        pixel: What a query stands for; 0 is the area without.
    """
    if pixel is None or not len(photons):
        return 0.0
    offset = photons.position - np.array(pixel.eye)
    right, up = np.array(pixel.right), np.array(pixel.up)
    if not right.any():
        sides = float(pixel.base) + float(pixel.slope) * np.linalg.norm(offset, axis=1)
        return float(np.median(sides**2))
    area = float(np.linalg.norm(np.cross(right, up)))
    return area if pixel.orthographic else area * float(np.median((offset @ np.array(pixel.back)) ** 2))
