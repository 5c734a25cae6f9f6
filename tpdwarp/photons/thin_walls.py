"""Thin walls: sheets of glass whose two sides are one surface (beyond the paper).

Light that enters a sheet is reflected to and fro between its sides, R at each: 2R/(1 + R) of it comes back, and the
rest leaves on the other side as it came. What goes through is not bent, and lands where it would without the sheet.
"""

import warp as wp

from tpdwarp.scene.device.geometry import Surfaces


@wp.func
def sheet_index(surfaces: Surfaces, material: int) -> float:
    """η = η_i/η_t of either side of a sheet, for light from outside."""
    return 1.0 / surfaces.ior[material]


@wp.func
def sheet_reflectance(reflectance: float) -> float:
    """Share that a sheet reflects of which one side reflects R."""
    return 2.0 * reflectance / (1.0 + reflectance)
