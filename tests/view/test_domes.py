"""Domes: where their picture is seen, and the direct light that they give."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import WATER, Source, floor, looking_down, quad
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import (
    CameraAtShutter,
    DomeAtShutter,
    Interaction,
    Material,
    SceneAtShutter,
    Shutter,
)
from tpdwarp.settings import Settings
from tpdwarp.view.domes import strata

GREY = Material(color=(0.5, 0.4, 0.3))
UNIFORM = DomeAtShutter("/dome", np.broadcast_to(np.float32([1.0, 2.0, 3.0]), (32, 64, 3)))
# Something to render that no camera here looks at.
BEHIND = quad("/behind", (-1, -1), (1, 1), -5.0)
STILL = Shutter(0, 0, 0)
# Pictures are kept in half precision.
HALF = 2.0**-11
# From axes of an image (x right, y up, z to the viewer) to a floor's up.
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def render(meshes, dome=UNIFORM, camera=None, size=16, samples=4):
    camera = camera or looking_down()
    source = Source(lambda shutter: SceneAtShutter(shutter, tuple(meshes), (), camera, (dome,)))
    frame = render_frame(RenderContext(source, Settings(samples=samples, photons=64, threads=1)), STILL, size, size)
    return np.stack([frame.channels[c] for c in "RGB"], axis=-1).astype(float), frame.channels["A"]


def narrow(forward, up) -> CameraAtShutter:
    """A perspective camera that looks along ``forward``, .6° wide."""
    back = -np.array(forward, float)
    axes = np.array([np.cross(up, back), up, back])
    return CameraAtShutter("/cam", False, np.zeros(3), axes, (-0.005, 0.005, -0.005, 0.005))


def test_a_uniform_dome_gives_pi_times_its_radiance():
    found, alpha = render([floor(material=GREY)], size=32)
    expected = np.array(GREY.color) * (1.0, 2.0, 3.0)
    # Sixteen parts a sample of 1024; of the cosine over them, 16 × 4 × 1024 choices leave well below a percent.
    np.testing.assert_allclose(found.mean(axis=(0, 1)), expected, rtol=0.01)
    assert found.std(axis=(0, 1)).max() < 0.1 * expected.max()
    assert (alpha == 1).all()


@pytest.mark.parametrize(
    ("forward", "up", "column", "row"),
    [
        # OpenEXR: longitude 0 is +z and in the middle, +x is at 90° and left of it; +y is on top.
        ((0, 0, 1), (0, 1, 0), 0.5, 0.5),
        ((1, 0, 0), (0, 1, 0), 0.25, 0.5),
        ((-1, 0, 0), (0, 1, 0), 0.75, 0.5),
        ((0, math.sqrt(0.5), math.sqrt(0.5)), (0, math.sqrt(0.5), -math.sqrt(0.5)), 0.5, 0.25),
    ],
)
def test_the_picture_is_seen_where_openexr_has_it(forward, up, column, row):
    height, width = 64, 128
    rows, columns = np.mgrid[:height, :width]
    radiance = np.stack([(rows + 0.5) / height, (columns + 0.5) / width, np.ones((height, width))], axis=-1)
    dome = DomeAtShutter("/dome", radiance.astype(np.float32))
    found, alpha = render([BEHIND], dome, narrow(forward, up), 1, 1)
    np.testing.assert_allclose(found[0, 0], (row, column, 1.0), atol=4 * HALF + 0.005)
    assert alpha[0, 0] == 0


def test_a_turned_dome_is_seen_turned():
    radiance = np.zeros((64, 128, 3), np.float32)
    radiance[:2] = 1.0
    # The pole of the dome is the world's z.
    dome = DomeAtShutter("/dome", radiance, np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))
    found, _ = render([BEHIND], dome, narrow((0, 0, 1), (0, 1, 0)), 1, 1)
    np.testing.assert_allclose(found, 1.0, atol=HALF)


def test_parts_of_a_dome_hold_all_of_its_light():
    random = np.random.default_rng(4)
    for radiance in (UNIFORM.radiance, random.gamma(0.1, 1.0, (24, 48, 3)).astype(np.float32)):
        directions, irradiances = strata(DomeAtShutter("/dome", radiance))
        edges = np.sin(np.linspace(0.5 * math.pi, -0.5 * math.pi, len(radiance) + 1))
        solid = (edges[:-1] - edges[1:]) * 2 * math.pi / radiance.shape[1]
        expected = np.einsum("hwc,h->c", radiance.astype(float), solid)
        np.testing.assert_allclose(irradiances.sum(axis=0), expected, rtol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)


def test_a_dark_dome_has_no_parts_and_gives_no_light():
    dark = DomeAtShutter("/dome", np.zeros((8, 16, 3), np.float32))
    assert len(strata(dark)[0]) == 0
    assert render([floor()], dark)[0].max() == 0


def test_a_sun_in_the_picture_lights_as_a_distant_light_does():
    radiance = np.zeros((64, 128, 3), np.float32)
    radiance[15, 64] = 1000.0
    found, _ = render([floor(material=GREY)], DomeAtShutter("/dome", radiance, UPRIGHT))
    top, bottom = (0.5 * math.pi - math.pi * k / 64 for k in (15, 16))
    irradiance = 1000.0 * (math.sin(top) - math.sin(bottom)) * 2 * math.pi / 128
    sine = 0.5 * (math.sin(top) + math.sin(bottom))
    expected = np.array(GREY.color) / math.pi * irradiance * sine
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-5)


def test_nothing_shines_through_a_wide_ceiling_but_through_glass():
    above = replace(looking_down(), position=np.array([0.0, 0.0, 0.5]))
    lid = quad("/lid", (-100, -100), (100, 100), 1.0)
    dark, _ = render([floor(material=GREY), lid], camera=above)
    # A gap of 1 over 100 to either side: sine .01.
    assert dark.max() < 0.01 * 3.0
    open_sky, _ = render([floor(material=GREY)], camera=above)
    sheet, _ = render([floor(material=GREY), replace(lid, materials=(WATER,))], camera=above)
    np.testing.assert_allclose(sheet.mean(axis=(0, 1)), open_sky.mean(axis=(0, 1)), rtol=0.01)


def test_a_mirror_shows_the_dome_in_its_own_colour():
    mirror = quad("/mirror", (-3, -3), (3, 3), 1.0, Material(Interaction.MIRROR, (0.9, 0.5, 0.2)))
    found, alpha = render([mirror, floor()])
    np.testing.assert_allclose(found, np.broadcast_to(np.float64([0.9, 1.0, 0.6]), found.shape), rtol=4 * HALF)
    assert (alpha == 1).all()
