"""Dome lights of a stage."""

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, UsdGeom, UsdLux

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Shutter

STILL = Shutter.still(1)


@pytest.fixture
def small(tmp_path):
    found = SmallStage(tmp_path, light=False)
    found.mesh()
    return found


def only(small, words=0):
    scene = small.open()
    (dome,) = scene.at(STILL).domes
    assert len(scene.warnings.messages) == words, scene.warnings.messages
    return dome


def test_a_dome_has_its_radiance_all_around(small):
    light = UsdLux.DomeLight.Define(small.stage, "/Dome")
    light.CreateIntensityAttr(3.0)
    light.CreateExposureAttr(1.0)
    light.CreateColorAttr(Gf.Vec3f(1.0, 0.5, 0.25))
    dome = only(small)
    np.testing.assert_allclose(dome.radiance, np.broadcast_to((6.0, 3.0, 1.5), dome.radiance.shape), rtol=1e-6)
    np.testing.assert_allclose(dome.axes, np.eye(3))


def test_a_dome_lights_a_stage_so_that_no_light_stands_in(small):
    UsdLux.DomeLight.Define(small.stage, "/Dome")
    scene = small.open().at(STILL)
    assert len(scene.domes) == 1 and scene.lights == ()


def test_its_picture_is_multiplied_by_its_colour(small):
    pixels = np.random.default_rng(2).gamma(1.0, 1.0, (4, 8, 3)).astype(np.float32)
    assert oiio.ImageBuf(pixels).write(str(Path(small.file).parent / "sky.exr"))
    light = UsdLux.DomeLight.Define(small.stage, "/Dome")
    light.CreateTextureFileAttr("./sky.exr")
    light.CreateColorAttr(Gf.Vec3f(1.0, 0.5, 2.0))
    np.testing.assert_allclose(only(small).radiance, pixels * np.float32([1.0, 0.5, 2.0]), rtol=1e-6)


def test_what_cannot_be_read_has_one_colour_and_is_said(small):
    light = UsdLux.DomeLight.Define(small.stage, "/Dome")
    light.CreateTextureFileAttr("./missing.exr")
    assert np.ptp(only(small, words=1).radiance) == 0


def test_a_picture_in_another_layout_is_brought_to_latitude_and_longitude(small):
    # An angular map whose middle fifth, 18° around +z, is bright.
    x, y = np.meshgrid(np.arange(50) - 24.5, 24.5 - np.arange(50))
    pixels = np.where(np.hypot(x, y)[..., None] < 5, (4.0, 2.0, 1.0), (0.0, 0.0, 0.0)).astype(np.float32)
    assert oiio.ImageBuf(pixels).write(str(Path(small.file).parent / "probe.exr"))
    light = UsdLux.DomeLight.Define(small.stage, "/Dome")
    light.CreateTextureFileAttr("./probe.exr")
    light.CreateTextureFormatAttr("angular")
    radiance = only(small).radiance.astype(float)
    rows = len(radiance)
    assert radiance.shape == (25, 50, 3)
    solid = np.cos(np.pi * (0.5 - (np.arange(rows) + 0.5) / rows))[:, None, None] * (np.pi / rows) ** 2
    cap = 2 * math.pi * (1 - math.cos(math.pi / 5))
    np.testing.assert_allclose((radiance * solid).sum(axis=(0, 1)), cap * np.array([4.0, 2.0, 1.0]), rtol=0.03)
    np.testing.assert_allclose(radiance[rows // 2, rows], (4.0, 2.0, 1.0), rtol=1e-5)


def test_a_layout_that_does_not_exist_is_said(small):
    assert oiio.ImageBuf(np.ones((4, 8, 3), np.float32)).write(str(Path(small.file).parent / "sky.exr"))
    light = UsdLux.DomeLight.Define(small.stage, "/Dome")
    light.CreateTextureFileAttr("./sky.exr")
    light.CreateTextureFormatAttr("folded")
    assert np.ptp(only(small, words=1).radiance) == 0


@pytest.mark.parametrize(
    ("up", "pole", "expected"), [("Y", "scene", 1), ("Z", "scene", 2), ("Z", "Y", 1), ("Y", "Z", 2)]
)
def test_the_pole_is_where_the_dome_says(small, up, pole, expected):
    UsdGeom.SetStageUpAxis(small.stage, up)
    UsdLux.DomeLight_1.Define(small.stage, "/Dome").CreatePoleAxisAttr(pole)
    axes = only(small).axes
    np.testing.assert_allclose(axes[1], np.eye(3)[expected], atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)


def test_a_turned_dome_has_turned_axes(small):
    light = UsdLux.DomeLight.Define(small.stage, "/Dome")
    light.AddRotateYOp().Set(30.0)
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    np.testing.assert_allclose(only(small).axes, [[c, 0, -s], [0, 1, 0], [s, 0, c]], atol=1e-12)


def test_an_invisible_dome_gives_no_light(small):
    UsdLux.DomeLight.Define(small.stage, "/Dome").MakeInvisible()
    scene = small.open().at(STILL)
    assert scene.domes == () and len(scene.lights) == 1


def test_with_glass_its_missing_caustics_are_said(small):
    UsdLux.DomeLight.Define(small.stage, "/Dome")
    small.preview("/Glass", opacity=0.0)
    small.bind(UsdGeom.Mesh(small.stage.GetPrimAtPath("/Mesh")), "/Glass")
    scene = small.open()
    scene.at(STILL)
    assert any("caustics" in message for message in scene.warnings.messages)
