"""What a camera sees past clipping planes, in linked light, through sheets and in rough mirrors.

All of it is seen by one kernel, which is compiled for everything that is tested here.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SHUTTER, SUN, floor, looking_down, quad, see, turned
from tpdwarp.scene.description import (
    CameraAtShutter,
    EmissionProfile,
    Extent,
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    SceneAtShutter,
)
from usd_scenes.oracle.closed_forms import fresnel_reflectance

EVERYTHING = {
    "refraction": True,
    "reflection": True,
    "linked": True,
    "thin_walls": True,
    "rough": True,
    "clipped": True,
    "extended_lights": ("/panel",),
}
SIZE = 8
MIDDLE = [(SIZE / 2, SIZE / 2)]
# Single precision in a scene of unit size.
POSITION = 1e-5
LAMP = LightAtShutter("/lamp", LightKind.POINT, (3.0, 2.0, 1.0), np.array([0.0, 0.0, 2.0]))
PANEL = LightAtShutter(
    "/panel",
    LightKind.POINT,
    (4.0, 4.0, 4.0),
    np.array([0.0, 0.0, 2.0]),
    profile=EmissionProfile.COSINE,
    extent=Extent(ExtentShape.RECT, spans=np.array([[0.5, 0, 0], [0, 0.5, 0]])),
)
CARD = quad("/card", (-1, -1), (1, 1), 1.0, Material(color=(0.5, 0.5, 0.5)))


def seen(meshes, camera=None, lights=(), films=MIDDLE):
    scene = SceneAtShutter(SHUTTER, tuple(meshes), tuple(lights), camera or looking_down())
    return see(scene, SIZE, SIZE, films, **EVERYTHING)[0]


def clipped(*planes, **options) -> CameraAtShutter:
    return looking_down(clipping_planes=np.array(planes, float), **options)


@pytest.mark.parametrize(
    ("planes", "depth"),
    [
        # The camera stands at height 3 and looks down: its z is how far behind it something is.
        ([], 2.0),
        ([(0, 0, -1, -1.5)], 2.0),
        ([(0, 0, -1, -2.5)], 3.0),
        ([(0, 0, -2, -5)], 3.0),
        ([(0, 0, -1, -3.5)], None),
        ([(0, 0, 1, 2.5)], 2.0),
        ([(0, 0, 1, 1.5)], None),
        ([(0, 0, -1, -2.5), (0, 0, 1, 3.5)], 3.0),
        ([(0, 0, -1, -2.5), (0, 0, 1, 2.9)], None),
        # Across the view: half of the image.
        ([(1, 0, 0, 0.1)], 2.0),
        ([(1, 0, 0, -0.1)], None),
    ],
)
def test_a_clipping_plane_cuts_off_what_lies_beyond_it(planes, depth):
    camera = clipped(*planes) if planes else looking_down()
    found = seen([floor(), CARD], camera).depths[0]
    if depth is None:
        assert found < 0
    else:
        np.testing.assert_allclose(found, depth, atol=POSITION)


def test_a_clipping_plane_rides_with_the_camera():
    axes = turned((0, 0.3, 1e-12))
    camera = replace(clipped((0, 0, -1, -2.2)), axes=axes, position=2.0 * axes[2] + (0, 0, 1))
    # The card lies 2 along the middle ray, and the floor behind it.
    found = seen([floor(), CARD], camera)
    np.testing.assert_allclose(found.depths[0], 2.0 + 1.0 / math.cos(0.3), atol=POSITION)


@pytest.mark.parametrize("light", [SUN, LAMP, PANEL], ids=["sun", "lamp", "panel"])
def test_light_falls_where_it_is_linked_and_past_what_it_is_not_to_be_hidden_by(light):
    below = looking_down(height=0.5)

    def radiance(meshes, **links):
        return seen(meshes, below, [replace(light, **links)]).direct[0]

    lit = radiance([floor()])
    assert lit.min() > 0
    np.testing.assert_array_equal(radiance([floor(), CARD]), 0)
    np.testing.assert_array_equal(radiance([floor()], unlit=frozenset({"/floor"})), 0)
    np.testing.assert_allclose(radiance([floor(), CARD], passed=frozenset({"/card"})), lit, rtol=1e-6)
    # Nothing that a light does not shine on keeps it from throwing shadows.
    np.testing.assert_array_equal(radiance([floor(), CARD], unlit=frozenset({"/card"})), 0)
    np.testing.assert_allclose(radiance([floor()], unlit=frozenset({"/other"})), lit, rtol=1e-6)


@pytest.mark.parametrize("theta", [0.0, 0.6])
def test_a_sheet_shows_what_is_behind_it_unbent_and_dimmed_by_both_of_its_sides(theta):
    axes = turned((0, -theta, 1e-12))
    camera = CameraAtShutter("/cam", True, np.array([0, 0, 1.0]) + axes[2], axes, (-0.1, 0.1, -0.1, 0.1))
    sheet = quad("/sheet", (-2, -2), (2, 2), 1.0, Material(Interaction.DIELECTRIC, thin_walled=True))
    found = seen([floor(), sheet], camera)
    np.testing.assert_allclose(found.positions[0], [math.tan(theta), 0, 0], atol=POSITION)
    reflectance = fresnel_reflectance(theta, 1.0, 1.5)
    np.testing.assert_allclose(math.pi * found.weights[0], (1 - reflectance) / (1 + reflectance), rtol=1e-5)


@pytest.mark.parametrize("roughness", [0.1, 0.3])
def test_a_rough_mirror_shows_the_surroundings_as_far_apart_as_its_facets_send_it(roughness):
    width = roughness**2
    mirror = quad("/mirror", (-2, -2), (2, 2), 0.0, Material(Interaction.MIRROR, (1.0, 1.0, 1.0), roughness=width))
    ceiling = quad("/ceiling", (-9, -9), (9, 9), 2.0, up=False)
    camera = looking_down(height=1.0, window=(-1e-6, 1e-6, -1e-6, 1e-6))
    count = 4096
    found = seen([mirror, ceiling], camera, films=np.full((count, 2), SIZE / 2))
    there = found.receivers == 1
    # Facets steeper than .8 send light past the ceiling, one in eighty.
    assert there.mean() > 0.98
    # A facet that is off by the angle a sends light off by 2a. Half of GGX's slopes lie within α/√3 along an axis.
    expected = 2.0 * math.tan(2.0 * math.atan(width / math.sqrt(3.0)))
    medians = np.median(np.where(there[:, None], np.abs(found.positions[:, :2]), np.inf), axis=0)
    # The density at the median of |x| is 3√3/(4α), so that the median of n has a deviation of 2α/(3√3 √n), 1 % here;
    # three of them, and facets that tilt across the axis too, which shortens what lies along it by their square.
    np.testing.assert_allclose(medians, expected, rtol=0.03 + 2 * width**2)
