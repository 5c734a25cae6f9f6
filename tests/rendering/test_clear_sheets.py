"""A sheet of index one bends nothing: light from lights with extent through it is that of their closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.rendering.test_extended_lights import LAMP, STILL, beauty, relative, sun
from tests.view.scenes import WATER, floor, looking_down, quad, steady, turned
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import EmissionProfile, Extent, ExtentShape, Interaction, Material
from tpdwarp.settings import Settings
from usd_scenes.oracle.closed_forms import fresnel_reflectance

CLEAR = Material(Interaction.DIELECTRIC, ior=1.0)
SHEET = quad("/clear", (-8, -8), (8, 8), 1.0, CLEAR)
BELOW = looking_down(height=0.5)
NEAR = replace(LAMP, position=np.array([0.1, 0.2, 2.0]))
SPANS = np.array([[0.4, 0.0, 0.0], [0.0, 0.25, 0.0]])
FLAT = replace(NEAR, profile=EmissionProfile.COSINE)
TUBE = replace(NEAR, profile=EmissionProfile.SINE)
TURNED = turned((0.7, 0.2, 0.5))
LIGHTS = {
    "sphere": replace(NEAR, extent=Extent(ExtentShape.ROUND, 0.2)),
    "disk": replace(FLAT, extent=Extent(ExtentShape.DISK, 0.0, SPANS[0, 0] * np.eye(3)[:2])),
    "rect": replace(FLAT, extent=Extent(ExtentShape.RECT, 0.0, SPANS)),
    "tilted rect": replace(FLAT, axes=TURNED, extent=Extent(ExtentShape.RECT, 0.0, 0.2 * TURNED[:2])),
    "tube": replace(TUBE, extent=Extent(ExtentShape.CYLINDER, 0.2, SPANS * [[1.0], [0.0]])),
    "tilted tube": replace(
        TUBE, axes=TURNED, extent=Extent(ExtentShape.CYLINDER, 0.15, np.array([0.2 * TURNED[0], np.zeros(3)]))
    ),
    "sun": sun(60.0),
}


def lit(light, *meshes, splits, photons=1 << 15):
    source = steady([floor(12.0), *meshes], (light,), BELOW)
    return math.pi * beauty(source, 24, 20, photons=photons, light_splits=splits)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_light_close_to_a_clear_sheet_lights_the_floor_as_if_nothing_was_between(name):
    """In one part: the flux of its places through each point of the sheet, and where their middle lands."""
    bare, through = lit(LIGHTS[name], splits=1), lit(LIGHTS[name], SHEET, splits=1)
    assert through.mean() == pytest.approx(bare.mean(), rel=0.01)
    assert relative(through, bare) < 0.03


@pytest.mark.parametrize("height", [0.95, 1.05, 1.21])
@pytest.mark.parametrize("name", ["sphere", "tube"])
def test_light_that_stands_in_a_clear_sheet_or_on_it_is_counted_once(name, height):
    """What is above shines through the sheet, by photons; what is below is direct light."""
    light = replace(LIGHTS[name], position=np.array([0.1, 0.2, height]))
    bare, through = lit(light, splits=1), lit(light, SHEET, splits=127, photons=1 << 16)
    # Faces of a prism stand for the tube, and one of them all but touches the sheet.
    assert through.mean() == pytest.approx(bare.mean(), rel=0.07)


def test_water_reflects_the_mean_of_what_it_reflects_of_a_low_sun():
    """Fresnel's reflectance rises so steeply there that what the middle of the sun loses is too little."""
    tilt, half = math.radians(78.0), math.radians(8.0)
    low = sun(math.degrees(2.0 * half), axes=turned((0.0, tilt, 0.0)).T)
    source = steady([floor(12.0), quad("/water", (-1, -1), (1, 1), 1.0, WATER)], (low,), BELOW)
    settings = Settings(photons=1 << 12, samples=1, threads=1, light_splits=1)
    deposited = render_frame(RenderContext(source, settings), STILL, 8, 8).energy.deposited

    # ---- The integral over its disc, by sines
    steps = math.sin(half) * ((2.0 * np.arange(400) + 1.0) / 400 - 1.0)
    x, y = (values.ravel() for values in np.meshgrid(steps, steps))
    within = x**2 + y**2 < math.sin(half) ** 2
    x, y = x[within], y[within]
    depth = np.sqrt(1.0 - x**2 - y**2)
    cosine = math.cos(tilt) * depth + math.sin(tilt) * x
    passed = np.array([1.0 - fresnel_reflectance(math.acos(c), 1.0, 1.33) for c in cosine[::37]])
    truth = 3.0 * 4.0 * np.mean(passed * cosine[::37] / depth[::37])
    middle = 3.0 * 4.0 * math.cos(tilt) * (1.0 - fresnel_reflectance(tilt, 1.0, 1.33))
    assert abs(middle / truth - 1.0) > 0.015
    assert deposited == pytest.approx(truth, rel=0.007)
