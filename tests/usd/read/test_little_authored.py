"""Stages that author next to nothing: defaults of USD and of a dialect say what is there, and nothing is advised."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdLux, UsdShade

from tests.usd.stages import SmallStage, mesh_named, set_inputs
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.settings import Settings

STANDARD = "ND_standard_surface_surfaceshader"
STILL = Shutter.still(1)
ALBEDO = 0.18


def square(size, height=0.0):
    """Corners of a square about the z axis that is open to above, ``size`` wide."""
    return [(x * size / 2, y * size / 2, height) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


@pytest.fixture
def small(tmp_path):
    """A floor without a colour of its own in the plane z = 0, and no light."""
    made = SmallStage(tmp_path, light=False)
    UsdGeom.SetStageUpAxis(made.stage, "Z")
    made.mesh("/Floor", square(8.0))
    return made


def look_down(small, height):
    """A camera that looks straight down on a part of the floor a quarter as wide as it is high above it."""
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    camera.CreateHorizontalApertureAttr(5.0)
    camera.CreateVerticalApertureAttr(5.0)
    camera.CreateFocalLengthAttr(20.0)
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, height))


def surface(small, path, **inputs):
    """A standard_surface of MaterialX with no other inputs than these."""
    material = UsdShade.Material.Define(small.stage, path)
    shader = UsdShade.Shader.Define(small.stage, f"{path}/Surface")
    shader.CreateIdAttr(STANDARD)
    material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
    set_inputs(shader, **inputs)


def rendered(small):
    """The beauty [8, 8, 3], energies, and what is warned about."""
    scene = small.open()
    frame = render_frame(RenderContext(scene, Settings(photons=4096, samples=4)), STILL, 8, 8)
    pixels = np.stack([frame.channels[name] for name in "RGB"], axis=-1)
    return pixels, frame.energy, scene.warnings.messages


def test_a_sun_of_no_attributes_shines_with_the_radiance_of_usds_defaults_over_its_disc(small):
    """50 000 within .265° of its axis: 50 000 π sin² .265° = 3.360 across it, at 20° from upright cos 20° of that."""
    UsdLux.DistantLight.Define(small.stage, "/Sun").AddRotateXOp().Set(20.0)
    look_down(small, 4.0)
    pixels, _, warnings = rendered(small)
    irradiance = 50000.0 * math.pi * math.sin(math.radians(0.265)) ** 2 * math.cos(math.radians(20.0))
    np.testing.assert_allclose(pixels, ALBEDO / math.pi * irradiance, rtol=1e-5)
    # There is nothing to do about its angle.
    assert warnings == []


def test_a_surface_that_authors_its_opacity_alone_is_there_so_far_and_lets_the_rest_of_the_light_pass(small):
    """Two faces of opacity .4 above the floor, each of which passes .6."""
    surface(small, "/Veil", opacity=(0.4, 0.4, 0.4))
    box = UsdGeom.Cube.Define(small.stage, "/Box")
    box.CreateSizeAttr(2.0)
    box.AddTranslateOp().Set(Gf.Vec3d(0, 0, 4.0))
    small.bind(box, "/Veil")
    sun = UsdLux.DistantLight.Define(small.stage, "/Sun")
    sun.CreateAngleAttr(0.0)
    sun.CreateIntensityAttr(math.pi)
    look_down(small, 2.0)
    pixels, _, warnings = rendered(small)
    np.testing.assert_allclose(pixels, ALBEDO * 0.6**2, rtol=1e-5)
    assert warnings == []
    (material,) = mesh_named(small.open().at(STILL), "/Box").materials
    # Base colour .8 by base 1.
    assert (material.interaction, material.color) == (Interaction.DIFFUSE, pytest.approx((0.8,) * 3))


def test_glass_of_default_roughness_in_thin_walls_is_so_and_only_the_colour_that_it_has_not_is_said(small):
    small.mesh("/Sheet", square(1.0, 1.0))
    surface(small, "/Glass", transmission=1.0, thin_walled=1.0, base_color=(1.0, 0.1, 0.1))
    small.bind(UsdGeom.Mesh(small.stage.GetPrimAtPath("/Sheet")), "/Glass")
    scene = small.open()
    (material,) = mesh_named(scene.at(STILL), "/Sheet").materials
    assert (material.interaction, material.thin_walled) == (Interaction.DIELECTRIC, True)
    assert material.roughness == pytest.approx(0.2**2)
    assert material.transmittance == (1.0, 1.0, 1.0)
    said = [message for message in scene.warnings.messages if "/Glass" in message]
    assert len(said) == 1 and "base_color: does not colour the glass" in said[0]


def parallel_squares(lamp, sheet, apart):
    """Part of a Lambertian square's light that reaches a parallel one: 1/A ∬ d² / (π r⁴) dA dA', by Gauss' rule."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    places = [np.meshgrid(nodes * size / 2, nodes * size / 2) for size in (lamp, sheet)]
    (x, y), (u, v) = ([axis.ravel() for axis in pair] for pair in places)
    squared = (x[:, None] - u) ** 2 + (y[:, None] - v) ** 2 + apart**2
    w = np.outer(weights, weights).ravel() / 4
    return sheet**2 * (w @ (apart**2 / (math.pi * squared**2)) @ w)


@pytest.mark.parametrize("apart", [1.0, 3.0])
def test_a_lone_rectangle_sends_glass_the_light_that_reaches_it(small, apart):
    """One unit wide by default, of radiance 30: 30 π by the part that reaches the sheet, in each of three channels.

    Middles of a few parts stand for the rectangle, which is off by .002.
    """
    small.mesh("/Sheet", square(2.0, 3.0))
    small.preview("/Glass", opacity=0.0, roughness=0.0)
    small.bind(UsdGeom.Mesh(small.stage.GetPrimAtPath("/Sheet")), "/Glass")
    lamp = UsdLux.RectLight.Define(small.stage, "/Lamp")
    lamp.CreateIntensityAttr(30.0)
    lamp.AddTranslateOp().Set(Gf.Vec3d(0, 0, 3.0 + apart))
    look_down(small, 2.0)
    pixels, energy, warnings = rendered(small)
    assert energy.sent == pytest.approx(3 * 30 * math.pi * parallel_squares(1.0, 2.0, apart), rel=3e-3)
    assert pixels.min() > 0 and warnings == []
