"""Cameras: the window of the image, frames in motion, and the matrices written into images."""

import math

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from tests.usd.stages import SmallStage
from tpdwarp.errors import InputError
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings


@pytest.fixture
def small(tmp_path):
    small = SmallStage(tmp_path)
    small.mesh()
    return small


def camera(small, path="/Camera", width=30.0, height=20.0, focal=50.0, **attributes):
    found = UsdGeom.Camera.Define(small.stage, path)
    found.CreateHorizontalApertureAttr(width)
    found.CreateVerticalApertureAttr(height)
    found.CreateFocalLengthAttr(focal)
    for name, value in attributes.items():
        getattr(found, f"Create{name}Attr")(value)
    return found


def read(small, shutter=None, **settings):
    scene = small.open(**settings)
    return scene.at(shutter or Shutter.still(1)).camera, scene.warnings.messages


def test_perspective_window_is_aperture_over_focal_length(small):
    camera(small, HorizontalApertureOffset=5.0)
    found, warnings = read(small)
    assert found.window == pytest.approx((-0.2, 0.4, -0.2, 0.2), rel=1e-6)
    assert (found.path, found.orthographic, found.exposure_scale, warnings) == ("/Camera", False, 1.0, [])


def test_orthographic_window_is_in_scene_units(small):
    camera(small, Projection="orthographic", ClippingRange=Gf.Vec2f(0.5, 40))
    found, _ = read(small)
    assert found.orthographic
    assert found.window == pytest.approx((-1.5, 1.5, -1.0, 1.0), rel=1e-6)
    assert (found.near, found.far) == (0.5, 40)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_matrices_are_those_of_usds_own_frustum(small, projection):
    made = camera(small, Projection=projection, ClippingRange=Gf.Vec2f(0.5, 40))
    made.AddTranslateOp().Set((1, 2, 3))
    made.AddRotateXYZOp().Set((10, 20, 30))
    made.AddScaleOp().Set((2, 2, 2))
    found, _ = read(small)
    frustum = made.GetCamera(1).frustum
    np.testing.assert_allclose(found.world_to_camera, np.array(frustum.ComputeViewMatrix()), atol=1e-6)
    expected = np.array(frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix())
    np.testing.assert_allclose(found.world_to_ndc, expected, atol=1e-5 * np.abs(expected).max())
    ahead = found.position - 2.0 * found.axes[2]
    np.testing.assert_allclose((np.append(ahead, 1) @ found.world_to_ndc)[:2], 0, atol=1e-12)


def test_a_camera_that_turns_and_travels_has_both_motions(small):
    made = camera(small)
    translate = made.AddTranslateOp()
    rotate = made.AddRotateYOp(UsdGeom.XformOp.PrecisionDouble)
    for time in (1, 5):
        translate.Set((3.0 * time, 0, 0), time)
        rotate.Set(10.0 * time, time)
    found, _ = read(small, Shutter(2, 2, 3))
    np.testing.assert_allclose(found.position, [7.5, 0, 0])
    np.testing.assert_allclose(found.position_motion, [3, 0, 0])
    angles = [math.radians(a) for a in (20, 30)]
    expected = [math.sin(angles[1]) - math.sin(angles[0]), 0, math.cos(angles[1]) - math.cos(angles[0])]
    np.testing.assert_allclose(found.axes_motion[2], expected, atol=1e-15)


def test_a_camera_moving_at_the_last_frame_moves_on(small):
    translate = camera(small).AddTranslateOp()
    for time in range(1, 6):
        translate.Set((time * time, 0, 0), time)
    np.testing.assert_allclose(read(small, Shutter(5, 5, 6))[0].position_motion, [9, 0, 0])


def test_exposure_attributes_scale_radiance_where_authored(small):
    made = camera(small, Exposure=2.0)
    made.CreateExposureTimeAttr(0.5)
    assert read(small)[0].exposure_scale == pytest.approx(2.0, rel=1e-6)


def test_an_f_stop_is_the_focal_length_by_the_lenss_diameter(small):
    made = camera(small, FStop=2.0, FocusDistance=12.0, FocalLength=50.0)
    found, warnings = read(small)
    # 50 tenths of a unit by 2: 2.5 units across.
    assert (found.lens_radius, found.focus_distance) == pytest.approx((1.25, 12.0)) and warnings == []
    made.GetFStopAttr().Set(0.0)
    assert read(small)[0].lens_radius == 0.0


@pytest.mark.parametrize("change", [{"Projection": "orthographic", "FocusDistance": 5.0}, {}])
def test_without_a_focus_or_a_perspective_everything_is_sharp_and_that_is_said(small, change):
    camera(small, FStop=2.0, **change)
    found, warnings = read(small)
    assert found.lens_radius == 0.0 and any("/Camera.fStop" in m for m in warnings)


def test_clipping_planes_are_those_of_the_camera_but_those_that_are_none(small):
    camera(small, ClippingPlanes=[Gf.Vec4f(0, 0, -1, -2), Gf.Vec4f(0, 0, 0, 1), Gf.Vec4f(1, 0, 0, float("nan"))])
    found, warnings = read(small)
    np.testing.assert_array_equal(found.clipping_planes, [[0, 0, -1, -2]])
    assert len(warnings) == 1 and "/Camera.clippingPlanes" in warnings[0]


def test_zoom_is_said(small):
    made = camera(small)
    made.GetFocalLengthAttr().Set(50, 1)
    made.GetFocalLengthAttr().Set(90, 5)
    found, warnings = read(small, Shutter(2, 2, 4))
    assert found.window[1] == pytest.approx(15 / 70, rel=1e-6)
    assert any("zooms" in m for m in warnings)


@pytest.mark.parametrize(
    ("change", "attribute"),
    [({"width": 0.0}, "horizontalAperture"), ({"height": -1.0}, "verticalAperture"), ({"focal": 0.0}, "focalLength")],
)
def test_of_an_impossible_lens_the_default_counts_for_what_is_impossible(small, change, attribute):
    made = camera(small, **change)
    found, warnings = read(small)
    made.GetPrim().RemoveProperty(attribute)
    expected, _ = read(small)
    assert found.window == expected.window
    assert len(warnings) == 1 and f"{small.file}: /Camera.{attribute}: " in warnings[0] and "default" in warnings[0]


@pytest.mark.parametrize(
    ("width", "height", "pixels"), [(30, 20, 640), (20.955, 15.2908, 700), (16, 9, 540), (1, 960, 921600)]
)
def test_the_image_is_960_wide_and_as_high_as_the_aperture(small, width, height, pixels):
    camera(small, width=width, height=height)
    assert small.open().resolution() == (960, pixels)


def test_image_width_wins(small):
    camera(small)
    assert small.open(image_width=99).resolution() == (99, 66)


def test_shutter_is_relative_to_the_frame_and_the_command_line_wins(small):
    camera(small, ShutterOpen=-0.25, ShutterClose=0.5)
    scene = small.open()
    settings = Settings()
    assert scene.shutter(3, settings) == Shutter(3, 2.75, 3.5)
    assert scene.shutter(3, Settings(exposure=2.0)) == Shutter(3, 3, 5)
    assert scene.shutter(3, Settings(exposure=2.0, shutter=(-1.0, 0.0))) == Shutter(3, 2, 3)


@pytest.mark.parametrize(
    ("opens", "closes", "blamed"),
    [(0.5, 0.0, "close"), (math.nan, 0.0, "open"), (0.0, math.inf, "close"), (-1e30, 0.0, "open"), (0.0, 1e7, "close")],
)
def test_a_shutter_that_means_nothing_is_a_still_and_said(small, opens, closes, blamed):
    camera(small, ShutterOpen=opens, ShutterClose=closes)
    scene = small.open()
    assert scene.shutter(3, Settings()) == Shutter.still(3)
    assert [f"/Camera.shutter:{blamed}" in line for line in scene.warnings.messages] == [True]


def test_apertures_that_make_no_window_together_are_those_of_the_schema(small):
    camera(small, focal=1e-30, HorizontalApertureOffset=2.0)
    found, warnings = read(small)
    size = 0.5 * np.array([20.955, 15.2908]) / 50
    assert found.window == pytest.approx((-size[0], size[0], -size[1], size[1]), rel=1e-2)
    assert len(warnings) == 1 and "/Camera: its apertures" in warnings[0]


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, math.nan, 1)])
def test_a_camera_that_is_nowhere_is_a_free_one(small, scale):
    expected, _ = read(small)
    camera(small).AddScaleOp().Set(scale)
    found, warnings = read(small)
    np.testing.assert_array_equal(found.position, expected.position)
    assert [f"{small.file}: /Camera: " in line and "free camera" in line for line in warnings] == [True]


def test_the_camera_is_found_by_path_and_by_name(small):
    camera(small, "/Rig/Left")
    camera(small, "/Rig/Right")
    assert small.open(camera="/Rig/Right").camera_path == "/Rig/Right"
    assert small.open(camera="Right").camera_path == "/Rig/Right"
    scene = small.open()
    assert scene.camera_path == "/Rig/Left"
    assert any("/Rig/Left" in m and "first of 2" in m for m in scene.warnings.messages)


@pytest.mark.parametrize(
    ("wanted", "why"), [("/Mesh", "is no camera"), ("/Nowhere", "no such"), ("Nobody", "named"), ("/a b", "no such")]
)
def test_what_is_no_camera_is_refused(small, wanted, why):
    camera(small)
    with pytest.raises(InputError, match=why) as caught:
        small.open(camera=wanted)
    assert f"{small.file}: {wanted}: " in str(caught.value)
