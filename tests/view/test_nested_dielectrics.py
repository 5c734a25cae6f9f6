"""What a camera sees through solids that lie in each other or touch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.photons.shapes import box, glass
from tests.view.scenes import SHUTTER, floor, looking_down, see, turned
from tpdwarp.scene.description import CameraAtShutter, SceneAtShutter
from usd_scenes.oracle.closed_forms import fresnel_reflectance, snell

WATER, GLASS, ICE = 1.33, 1.5, 1.31
THETA, SIZE = 0.6, 8
MIDDLE = [(SIZE / 2, SIZE / 2)]
# Single precision in a scene of unit size, through some surfaces.
POSITION = 1e-5


def slanted(height: float) -> CameraAtShutter:
    """A camera whose middle ray meets (0, 0, 1) at THETA from the vertical, along +x."""
    axes = turned((0, -THETA, 1e-12))
    return CameraAtShutter("/cam", True, np.array([0, 0, 1.0]) + (height - 1) * axes[2], axes, (-0.1, 0.1, -0.1, 0.1))


@pytest.mark.parametrize("grown", [0.0, 0.05], ids=["touching", "grown into it"])
def test_through_water_on_glass_the_floor_is_shifted_and_dimmed_at_each_interface_once(grown):
    water = box("/water", (-2, -2, 0.7 - grown), (2, 2, 1.0), glass(WATER))
    slab = box("/slab", (-2, -2, 0.4), (2, 2, 0.7), glass(GLASS))
    seen = see(SceneAtShutter(SHUTTER, (floor(), water, slab), (), slanted(2.0)), SIZE, SIZE, MIDDLE)[0]
    in_water, in_glass = snell(THETA, 1.0, WATER), snell(THETA, 1.0, GLASS)
    x = 0.3 * math.tan(in_water) + 0.3 * math.tan(in_glass) + 0.4 * math.tan(THETA)
    np.testing.assert_allclose(seen.positions[0], [x, 0, 0], atol=POSITION)
    passed = (
        (1 - fresnel_reflectance(THETA, 1.0, WATER))
        * (1 - fresnel_reflectance(in_water, WATER, GLASS))
        * (1 - fresnel_reflectance(in_glass, GLASS, 1.0))
    )
    # The squares of the indices cancel, since it looks into air again.
    np.testing.assert_allclose(math.pi * seen.weights[0], passed, rtol=1e-5)


def test_a_camera_in_water_sees_ice_from_water():
    water = box("/water", (-2, -2, 0.0), (2, 2, 3.0), glass(WATER))
    ice = box("/ice", (-1, -1, 0.6), (1, 1, 1.0), glass(ICE))
    ground = floor(1.9)
    ground.points[:, 2] = 0.2
    seen = see(SceneAtShutter(SHUTTER, (ground, water, ice), (), slanted(2.0)), SIZE, SIZE, MIDDLE)[0]
    in_ice = snell(THETA, WATER, ICE)
    x = 0.4 * math.tan(in_ice) + 0.4 * math.tan(THETA)
    np.testing.assert_allclose(seen.positions[0], [x, 0, 0.2], atol=POSITION)
    passed = (1 - fresnel_reflectance(THETA, WATER, ICE)) * (1 - fresnel_reflectance(in_ice, ICE, WATER))
    np.testing.assert_allclose(math.pi * seen.weights[0], passed, rtol=1e-5)


def test_what_comes_first_is_the_first_surface_that_is_there():
    """A camera in a solid that holds, whose water begins within it."""
    block = box("/block", (-2, -2, 0.5), (2, 2, 3.0), glass(GLASS))
    water = box("/water", (-1.9, -1.9, 0.0), (1.9, 1.9, 0.6), glass(WATER))
    scene = SceneAtShutter(SHUTTER, (floor(1.8), block, water), (), looking_down(height=2.0))
    seen = see(scene, SIZE, SIZE, MIDDLE)[0]
    # Not the water's top at 0.6, which the block displaces.
    np.testing.assert_allclose(seen.depths[0], 1.5, atol=POSITION)
