"""Lights: UsdLux units, motion, and what is left out."""

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdShade

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import PROFILE_COUNT, EmissionProfile, ExtentShape, LightKind, Shaping, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from usd_scenes.solids import write
from usd_scenes.stage import CAMERA, FRAME


@pytest.fixture
def small(tmp_path):
    small = SmallStage(tmp_path, light=False)
    small.mesh()
    return small


def sphere(small, radius, **inputs):
    light = UsdLux.SphereLight.Define(small.stage, "/Lamp")
    light.CreateRadiusAttr(radius)
    light.CreateIntensityAttr(8.0)
    for name, value in inputs.items():
        getattr(light, f"Create{name}Attr")(value)
    return light


def distant(small, path="/Sun", angle=0.0, **inputs):
    light = UsdLux.DistantLight.Define(small.stage, path)
    light.CreateAngleAttr(angle)
    light.CreateIntensityAttr(8.0)
    for name, value in inputs.items():
        getattr(light, f"Create{name}Attr")(value)
    return light


def read(small, shutter=None):
    scene = small.open()
    (light,) = scene.at(shutter or Shutter.still(1)).lights
    return light, scene.warnings.messages


def test_distant_irradiance_is_intensity_times_exposure_times_colour(small):
    distant(small, Exposure=-2.0, Color=Gf.Vec3f(1, 0.5, 0.25))
    light, warnings = read(small)
    assert (light.kind, light.power, warnings) == (LightKind.DISTANT, (2.0, 1.0, 0.5), [])


def test_names_of_before_usd_21_count_where_there_are_no_new_ones(small):
    lamp = UsdLux.SphereLight.Define(small.stage, "/Lamp").GetPrim()
    for name, kind, value in (
        ("intensity", Sdf.ValueTypeNames.Float, 8.0),
        ("color", Sdf.ValueTypeNames.Color3f, Gf.Vec3f(1, 0.5, 0.25)),
        ("radius", Sdf.ValueTypeNames.Float, 0.0),
        ("exposure", Sdf.ValueTypeNames.Float, 1.0),
    ):
        lamp.CreateAttribute(name, kind, custom=False).Set(value)
    lamp.CreateAttribute("shaping:cone:angle", Sdf.ValueTypeNames.Float).Set(30.0)
    UsdLux.SphereLight(lamp).CreateExposureAttr(-2.0)
    light, warnings = read(small)
    assert light.power == (2.0, 1.0, 0.5) and light.extent is None
    assert light.shaping == Shaping(math.radians(30.0), 0.0, 0.0)
    assert len(warnings) == 1 and "named as before USD 21.02" in warnings[0]


@pytest.mark.parametrize("normalize", [False, True])
def test_a_distant_disc_has_its_irradiance_and_half_its_angle(small, normalize):
    distant(small, angle=60.0, Normalize=normalize)
    light, warnings = read(small)
    expected = 8.0 if normalize else 8.0 * math.pi * math.sin(math.radians(30)) ** 2
    assert light.power[0] == pytest.approx(expected, rel=1e-12)
    assert light.extent.shape == ExtentShape.ROUND and warnings == []
    assert light.extent.radius == pytest.approx(math.radians(30), rel=1e-12)


def test_a_sun_of_no_angle_is_parallel_and_one_without_is_as_wide_as_the_sun(small):
    distant(small, angle=0.0)
    assert read(small)[0].extent is None
    small.stage.GetPrimAtPath("/Sun").RemoveProperty("inputs:angle")
    assert read(small)[0].extent.radius == pytest.approx(math.radians(0.265), rel=1e-6)


@pytest.mark.parametrize(
    ("radius", "normalize", "scale", "expected"),
    [
        (0.0, False, 1, 8.0),
        (0.0, True, 1, 8.0),
        (0.5, False, 1, 8 * math.pi * 0.25),
        (0.5, False, 3, 8 * math.pi * 2.25),
        (0.5, True, 3, 2.0),
    ],
)
def test_a_sphere_gives_its_radiant_intensity(small, radius, normalize, scale, expected):
    light = sphere(small, radius, Normalize=normalize, TreatAsPoint=True)
    UsdGeom.Xformable(light).AddScaleOp().Set((scale, scale, scale))
    found, warnings = read(small)
    assert found.kind == LightKind.POINT and warnings == []
    assert found.power[0] == pytest.approx(expected, rel=1e-12) and found.extent is None


def test_a_sphere_is_as_large_as_it_is_in_the_world_unless_it_asks_to_be_a_point(small):
    light = sphere(small, 0.5)
    UsdGeom.Xformable(light).AddScaleOp().Set((3, 3, 3))
    found, warnings = read(small)
    assert (found.extent.shape, found.profile, warnings) == (ExtentShape.ROUND, EmissionProfile.UNIFORM, [])
    assert found.extent.radius == pytest.approx(1.5, rel=1e-6)
    light.CreateTreatAsPointAttr(True)
    assert read(small)[0].extent is None


def test_colour_temperature_tints_by_the_blackbody(small):
    distant(small, EnableColorTemperature=True, ColorTemperature=3000.0)
    np.testing.assert_allclose(read(small)[0].power, 8 * np.array(UsdLux.BlackbodyTemperatureAsRgb(3000.0)), rtol=1e-7)


def test_suns_of_blender_are_as_bright_wide_and_white_as_blender_means_them(small):
    light = distant(small)
    light.CreateIntensityAttr(0.75)
    light.CreateAngleAttr(4.0)
    light.CreateNormalizeAttr(True)
    light.CreateEnableColorTemperatureAttr(True)
    light.CreateColorTemperatureAttr(6500.0)
    plain, _ = read(small)
    tint = np.array(UsdLux.BlackbodyTemperatureAsRgb(6500.0))
    np.testing.assert_allclose(plain.power, 0.75 * tint, rtol=1e-6)
    small.stage.GetRootLayer().documentation = "Blender v5.0.1"
    found, warnings = read(small)
    # A sun of 3 W/m² and 8°, as Blender exports and imports it.
    np.testing.assert_allclose(found.power, 3.0, rtol=1e-6)
    assert found.extent.radius == pytest.approx(math.radians(4.0))
    assert len(warnings) == 1 and "Blender" in warnings[0]


def test_the_diffuse_multiplier_scales_the_power(small):
    distant(small, Diffuse=0.5)
    assert read(small)[0].power == (4.0, 4.0, 4.0)


@pytest.mark.parametrize(
    ("name", "value", "power"),
    [
        ("Color", Gf.Vec3f(1, -1, 0.5), (8.0, 0.0, 4.0)),
        ("Color", Gf.Vec3f(1, math.nan, 0.5), (8.0, 8.0, 8.0)),
        ("Intensity", math.nan, (50000.0,) * 3),
        ("Intensity", math.inf, (50000.0,) * 3),
        ("Exposure", math.nan, (8.0,) * 3),
        ("Diffuse", -math.inf, (8.0,) * 3),
        ("Angle", -4.0, (8.0 * math.pi * math.sin(math.radians(0.265)) ** 2,) * 3),
    ],
)
def test_inputs_that_mean_nothing_have_their_defaults_and_channels_below_0_are_0(small, name, value, power):
    light = distant(small)
    getattr(light, f"Get{name}Attr")().Set(value)
    found, warnings = read(small)
    assert found.power == pytest.approx(power, rel=1e-6)
    assert [f"{small.file}: /Sun.inputs:{name.lower()}: " in line for line in warnings] == [True]


def test_a_negative_light_takes_nothing_away(small):
    distant(small).GetIntensityAttr().Set(-8.0)
    distant(small, "/Other")
    light, warnings = read(small)
    assert light.path == "/Other"
    assert ["/Sun.inputs:intensity: holds -8, which counts as 0" in line for line in warnings] == [True]


@pytest.mark.parametrize("value", [(math.nan, 0, 0), (0, 1e40, 0)])
def test_a_light_that_is_nowhere_is_left_out_and_said(small, value):
    sphere(small, 1.0).AddTranslateOp().Set(value)
    distant(small, "/Other")
    light, warnings = read(small)
    assert light.path == "/Other"
    assert [f"{small.file}: /Lamp: " in line and "left out" in line for line in warnings] == [True]


def test_old_names_have_the_defaults_of_the_new_ones(small):
    lamp = UsdLux.SphereLight.Define(small.stage, "/Lamp").GetPrim()
    lamp.CreateAttribute("radius", Sdf.ValueTypeNames.Float).Set(math.nan)
    assert read(small)[0].extent.radius == 0.5


def test_a_moving_light_has_motion_of_its_place_and_axes(small):
    light = sphere(small, 0.0)
    translate = light.AddTranslateOp()
    rotate = light.AddRotateYOp(UsdGeom.XformOp.PrecisionDouble)
    for time in (1, 5):
        translate.Set((0, 2.0 * time, 0), time)
        rotate.Set(10.0 * time, time)
    found, _ = read(small, Shutter(2, 2, 3))
    np.testing.assert_allclose(found.position, [0, 5, 0])
    np.testing.assert_allclose(found.position_motion, [0, 2, 0])

    def z_axis(degrees):
        return np.array([math.sin(math.radians(degrees)), 0, math.cos(math.radians(degrees))])

    np.testing.assert_allclose(found.axes[2], z_axis(25), atol=1e-15)
    np.testing.assert_allclose(found.axes_motion[2], z_axis(30) - z_axis(20), atol=1e-15)
    assert found.moves


def test_axes_are_orthonormal_and_right_handed_under_any_scale(small):
    light = distant(small)
    light.AddRotateXYZOp().Set((20, 30, 40))
    light.AddScaleOp().Set((-2, 3, 0.5))
    axes = read(small)[0].axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1, abs=1e-12)


def test_lights_that_are_dark_or_invisible_are_left_out_quietly(small):
    distant(small)
    distant(small, "/Dark").GetIntensityAttr().Set(0.0)
    distant(small, "/Hidden").MakeInvisible()
    light, warnings = read(small)
    assert light.path == "/Sun" and warnings == []


@pytest.mark.parametrize(
    ("radii", "middle", "change"),
    [({1: 0.0, 2: 0.9}, 0.45, 0.9), ({1: 0.6, 1.5: 0.0, 2: 0.6}, 0.6 * math.sqrt(0.6), 0.0)],
)
def test_a_radius_that_changes_within_the_shutter_goes_along_a_line_of_its_mean_square(small, radii, middle, change):
    """The second, at mid shutter a point, is ∫ r² r² by ∫ r², of light that goes with r²."""
    lamp = sphere(small, 0.5)
    for time, radius in radii.items():
        lamp.GetRadiusAttr().Set(radius, time)
    light, _ = read(small, Shutter(1.5, 1.0, 2.0))
    assert light.extent.radius == pytest.approx(middle, rel=1e-6)
    assert light.extent.radius_motion == pytest.approx(change, abs=1e-6)


AREA_LIGHTS = [UsdLux.SphereLight, UsdLux.DiskLight, UsdLux.RectLight, UsdLux.CylinderLight]


@pytest.mark.parametrize("kind", AREA_LIGHTS)
def test_a_light_whose_sizes_change_is_as_one_that_its_transform_scales(small, kind):
    """By a half at first, by three halves at last."""
    lamp = kind.Define(small.stage, "/Lamp")
    names = [name for name in ("Radius", "Width", "Height", "Length") if hasattr(lamp, f"Create{name}Attr")]
    for name in names:
        getattr(lamp, f"Create{name}Attr")(0.4)
    scale = lamp.AddScaleOp()
    for time, factor in ((1, 0.5), (2, 1.5)):
        scale.Set((factor,) * 3, time)
    scaled, _ = read(small, Shutter(1.5, 1.0, 2.0))
    lamp.ClearXformOpOrder()
    for name in names:
        for time, factor in ((1, 0.5), (2, 1.5)):
            getattr(lamp, f"Get{name}Attr")().Set(0.4 * factor, time)
    found, _ = read(small, Shutter(1.5, 1.0, 2.0))
    assert found.extent.radius_motion + np.abs(found.extent.spans_motion).max() > 0.15
    for name in ("radius", "radius_motion", "spans", "spans_motion"):
        np.testing.assert_allclose(getattr(found.extent, name), getattr(scaled.extent, name), atol=1e-7)
    np.testing.assert_allclose(found.power, scaled.power, rtol=1e-6)


def test_the_angle_of_a_sun_changes_as_it_is_authored_and_what_only_brightens_keeps_its_own(small):
    sun = distant(small, Normalize=True)
    for time, angle in ((1, 0.0), (2, 6.0)):
        sun.GetAngleAttr().Set(angle, time)
    light, _ = read(small, Shutter(1.5, 1.0, 2.0))
    assert light.extent.radius == pytest.approx(math.radians(1.5), rel=1e-6)
    assert light.extent.radius_motion == pytest.approx(math.radians(3.0), rel=1e-6)
    sun.GetAngleAttr().Clear()
    sun.GetAngleAttr().Set(0.53)
    for time, intensity in ((1, 0.0), (2, 6.0)):
        sun.GetIntensityAttr().Set(intensity, time)
    light, _ = read(small, Shutter(1.5, 1.0, 2.0))
    assert light.extent.radius == math.radians(0.5 * float(np.float32(0.53)))


@pytest.mark.parametrize("kind", ["PortalLight", "GeometryLight"])
def test_other_lights_are_said_and_left_out(small, kind):
    distant(small)
    getattr(UsdLux, kind).Define(small.stage, "/Other")
    light, warnings = read(small)
    assert light.path == "/Sun"
    assert len(warnings) == 1 and f"/Other: a {kind}" in warnings[0]


def test_what_only_guides_or_displaces_is_said_once_with_its_first_prim_and_a_count(small):
    distant(small)
    for number in range(3):
        UsdLux.PortalLight.Define(small.stage, f"/Portal{number}")
        small.preview(f"/Cloth{number}")
        material = UsdShade.Material(small.stage.GetPrimAtPath(f"/Cloth{number}"))
        waves = UsdShade.Shader.Define(small.stage, f"/Cloth{number}/Waves")
        waves.CreateIdAttr("ND_displacement_float")
        output = material.CreateDisplacementOutput("mtlx" if number else "")
        output.ConnectToSource(waves.ConnectableAPI(), "out")
        mesh = UsdGeom.Mesh(small.stage.GetPrimAtPath("/Mesh")) if number == 0 else small.mesh(f"/Mesh{number}")
        small.bind(mesh, f"/Cloth{number}")
    _, warnings = read(small)
    assert len(warnings) == 2, warnings
    assert "/Portal0 and 2 more: a PortalLight only" in warnings[0]
    assert "/Cloth0 and 2 more: displacement is not rendered" in warnings[1]


def with_profile(small, tmp_path, **ies):
    """A sphere of radiant intensity 8 in the light of a profile of 100 cd down to 0 at 90°, and 50 at 45°."""
    (tmp_path / "lamp.ies").write_text("TILT=NONE\n1 -1 1.0 3 1 1 2 0 0 0\n1 1 50\n0 45 90\n0\n100 50 0\n")
    lamp = UsdLux.ShapingAPI.Apply(sphere(small, 0.0).GetPrim())
    lamp.CreateShapingIesFileAttr("./lamp.ies")
    for name, value in ies.items():
        getattr(lamp, f"CreateShapingIes{name}Attr")(value)
    return read(small)


def test_a_profile_of_a_luminaire_multiplies_the_light_by_its_candela(small, tmp_path):
    light, warnings = with_profile(small, tmp_path)
    assert light.power == pytest.approx((800.0,) * 3) and warnings == []
    expected = np.interp(np.linspace(0, 180, PROFILE_COUNT), [0, 45, 90], [1.0, 0.5, 0.0])
    np.testing.assert_allclose(light.shaping.profile, expected, atol=1e-12)


def test_a_profile_is_normalized_by_its_mean_and_scaled_by_angle(small, tmp_path):
    # ∫ (1 − 2θ/π) sinθ dθ from 0 to π/2 is 1 − 2/π.
    light, _ = with_profile(small, tmp_path, Normalize=True)
    assert light.power[0] == pytest.approx(8.0 / (1.0 - 2.0 / math.pi), rel=1e-3)
    light, _ = with_profile(small, tmp_path, AngleScale=0.5)
    expected = np.interp(np.linspace(0, 180, PROFILE_COUNT), [0, 22.5, 45], [1.0, 0.5, 0.0])
    np.testing.assert_allclose(light.shaping.profile, expected, atol=1e-12)


def test_a_profile_that_cannot_be_read_is_said(small):
    UsdLux.ShapingAPI.Apply(sphere(small, 0.0).GetPrim()).CreateShapingIesFileAttr("./none.ies")
    light, warnings = read(small)
    assert light.power == (8.0,) * 3 and light.shaping is None
    assert len(warnings) == 1 and "inputs:shaping:ies:file: cannot be read" in warnings[0]


def test_shaping_of_suns_filters_and_shadows_of_their_own_are_said(small):
    light = distant(small)
    UsdLux.ShapingAPI.Apply(light.GetPrim()).CreateShapingConeAngleAttr(30.0)
    light.GetFiltersRel().SetTargets([Sdf.Path("/Mesh")])
    UsdLux.ShapingAPI(light.GetPrim()).CreateShapingFocusTintAttr(Gf.Vec3f(1, 0, 0))
    shadow = UsdLux.ShadowAPI.Apply(light.GetPrim())
    shadow.CreateShadowColorAttr(Gf.Vec3f(0.1, 0, 0))
    shadow.CreateShadowDistanceAttr(2.0)
    _, warnings = read(small)
    words = ["cone", "is no light filter", "focusTint", "shadows are black", "shadow:distance"]
    assert [word for word in words if any(word in m for m in warnings)] == words and len(warnings) == len(words)


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ({}, None),
        ({"ConeAngle": 180.0}, None),
        ({"ConeAngle": 30.0}, Shaping(math.radians(30))),
        ({"ConeAngle": 30.0, "ConeSoftness": 0.25}, Shaping(math.radians(30), 0.25)),
        ({"Focus": 4.0}, Shaping(2 * math.pi, 0.0, 4.0)),
        ({"ConeAngle": 45.0, "ConeSoftness": 3.0, "Focus": 1.0}, Shaping(math.radians(45), 1.0, 1.0)),
    ],
)
def test_cones_and_focus_are_those_authored(small, inputs, expected):
    light = UsdLux.SphereLight.Define(small.stage, "/Lamp")
    light.CreateRadiusAttr(0.0)
    api = UsdLux.ShapingAPI.Apply(light.GetPrim())
    for name, value in inputs.items():
        getattr(api, f"CreateShaping{name}Attr")(value)
    found, warnings = read(small)
    assert warnings == []
    if expected is None:
        assert found.shaping is None
    else:
        values = (found.shaping.angle, found.shaping.softness, found.shaping.focus)
        assert values == pytest.approx((expected.angle, expected.softness, expected.focus))


def test_power_is_read_at_the_frame(small):
    light = distant(small)
    light.GetIntensityAttr().Set(0.0, 1)
    light.GetIntensityAttr().Set(4.0, 5)
    scene = small.open()
    assert [len(scene.at(Shutter.still(1)).lights), scene.at(Shutter.still(3)).lights[0].power[0]] == [0, 2.0]


SIZED = {
    "RectLight": (dict(Width=2.0, Height=3.0), (2, 5, 7), 6.0 * 10),
    "DiskLight": (dict(Radius=0.5), (2, 5, 7), math.pi * 0.25 * 10),
    "CylinderLight": (dict(Radius=0.5, Length=3.0), (2, 5, 5), 2 * math.pi * 0.5 * 3 * 10),
    "SphereLight": (dict(Radius=0.5), (3, 3, 3), 4 * math.pi * 0.25 * 9),
}


# Total power by the largest radiant intensity: of all directions, of a cosine over half of them, of a sine.
SENT = {
    EmissionProfile.UNIFORM: 4 * math.pi,
    EmissionProfile.COSINE: math.pi,
    EmissionProfile.SINE: math.pi**2,
    EmissionProfile.SHOWN: 4 * math.pi,
}


@pytest.mark.parametrize("kind", SIZED)
@pytest.mark.parametrize("normalize", [False, True])
def test_a_light_with_a_surface_sends_what_its_radiance_does(small, kind, normalize):
    sizes, scale, area = SIZED[kind]
    light = getattr(UsdLux, kind).Define(small.stage, "/Lamp")
    for name, value in sizes.items():
        getattr(light, f"Create{name}Attr")(value)
    light.CreateIntensityAttr(8.0)
    light.CreateNormalizeAttr(normalize)
    light.AddTranslateOp().Set((1, 2, 3))
    light.AddScaleOp().Set(scale)
    found, warnings = read(small)
    # A surface of radiance L and area A sends π L A.
    sent = SENT[found.profile] * found.power[0]
    assert sent == pytest.approx(math.pi * 8 * (1 if normalize else area), rel=1e-6)
    assert found.kind == LightKind.POINT and found.position.tolist() == [1, 2, 3] and warnings == []


HALF = {
    "RectLight": (ExtentShape.RECT, 0.0, [[2, 0, 0], [0, 7.5, 0]]),
    "DiskLight": (ExtentShape.DISK, 0.0, [[1, 0, 0], [0, 2.5, 0]]),
    "CylinderLight": (ExtentShape.CYLINDER, 2.5, [[3, 0, 0], [0, 0, 0]]),
    "SphereLight": (ExtentShape.ROUND, 1.5, [[0, 0, 0], [0, 0, 0]]),
}


@pytest.mark.parametrize("kind", SIZED)
def test_a_light_reaches_as_far_as_its_transform_makes_it(small, kind):
    sizes, scale, _ = SIZED[kind]
    light = getattr(UsdLux, kind).Define(small.stage, "/Lamp")
    for name, value in sizes.items():
        getattr(light, f"Create{name}Attr")(value)
    light.AddScaleOp().Set(scale)
    extent = read(small)[0].extent
    shape, radius, spans = HALF[kind]
    assert extent.shape == shape and extent.radius == pytest.approx(radius, rel=1e-6)
    np.testing.assert_allclose(extent.spans, spans, rtol=1e-6, atol=1e-12)


SHEARED = np.array([[1.0, 0.2, 0.0], [0.6, 1.0, 0.0], [0.8, 0.3, 1.0]])


def placed(small, kind, rows):
    light = getattr(UsdLux, kind).Define(small.stage, "/Lamp")
    matrix = np.eye(4)
    matrix[:3, :3] = rows
    UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(*map(float, matrix.ravel())))
    return light


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight"])
@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_a_sheared_flat_light_shines_along_its_normal_on_the_side_where_minus_z_was(small, kind, mirrored):
    rows = SHEARED * [[1.0], [1.0], [mirrored]]
    placed(small, kind, rows)
    light, _ = read(small)
    np.testing.assert_allclose(light.axes[2], [0.0, 0.0, mirrored], atol=1e-12)
    np.testing.assert_allclose(light.extent.spans @ light.axes[2], 0.0, atol=1e-12)


def test_a_flat_light_that_is_flattened_along_its_normal_is_itself(small):
    placed(small, "RectLight", np.diag([2.0, 1.0, 0.0]))
    light, warnings = read(small)
    np.testing.assert_array_equal(light.axes, np.eye(3))
    assert light.power[0] == pytest.approx(2.0) and warnings == []


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight", "CylinderLight"])
def test_a_light_that_is_flattened_to_a_line_is_a_point_of_the_power_that_normalize_leaves_it(small, kind):
    placed(small, kind, np.diag([0.0, 1.0, 1.0])).CreateNormalizeAttr(True)
    light, _ = read(small)
    assert light.extent is None and math.isfinite(light.power[0]) and light.power[0] > 0


@pytest.mark.parametrize(
    ("kind", "rows", "count"),
    [
        ("SphereLight", np.diag([1.0, 1.0, 0.2]), 1),
        ("SphereLight", np.diag([1.0, -1.0, 1.0]), 1),
        ("CylinderLight", np.diag([1.0, 1.0, 0.5]), 13),
        ("CylinderLight", SHEARED, 13),
        ("CylinderLight", np.diag([5.0, 2.0, -2.0]), 1),
    ],
)
@pytest.mark.parametrize("normalize", [False, True])
def test_a_stretched_sphere_is_one_light_and_a_cylinder_flat_lights_of_its_area(small, kind, rows, count, normalize):
    placed(small, kind, rows).CreateNormalizeAttr(normalize)
    lights = small.open().at(Shutter.still(1)).lights
    assert len(lights) == count
    # Vectors of the area of a fine net over the surface.
    u, v = (axis.ravel() for axis in np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400))
    turn = 2.0 * np.pi * v
    if kind == "SphereLight":
        height, area = 2.0 * u - 1.0, math.pi
        level = np.sqrt(1.0 - height**2)
        outward = np.stack([height, level * np.cos(turn), level * np.sin(turn)], axis=1)
    else:
        outward, area = np.stack([0.0 * u, np.cos(turn), np.sin(turn)], axis=1), math.pi
    stretched = np.linalg.norm(outward @ np.linalg.inv(rows).T * abs(np.linalg.det(rows)), axis=1).mean()
    sent = sum(SENT[light.profile] * light.power[0] for light in lights)
    assert sent == pytest.approx(math.pi * (1.0 if normalize else area * stretched), rel=1e-3)


def test_a_rectangle_that_turns_has_spans_that_move(small):
    light = UsdLux.RectLight.Define(small.stage, "/Lamp")
    turn = light.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble)
    for time in (1, 5):
        turn.Set(10.0 * time, time)
    extent = read(small, Shutter(2, 2, 3))[0].extent

    def half(degrees):
        angle = math.radians(degrees)
        return 0.5 * np.array([[math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0]])

    np.testing.assert_allclose(extent.spans, half(25), atol=1e-12)
    np.testing.assert_allclose(extent.spans_motion, half(30) - half(20), atol=1e-12)


def test_pictures_that_cannot_be_read_are_said_and_cylinders_have_cones_about_minus_z(small):
    UsdLux.RectLight.Define(small.stage, "/Panel").CreateTextureFileAttr("picture.exr")
    tube = UsdLux.CylinderLight.Define(small.stage, "/Tube")
    UsdLux.ShapingAPI.Apply(tube.GetPrim()).CreateShapingConeAngleAttr(30.0)
    scene = small.open()
    lights = scene.at(Shutter.still(1)).lights
    shaping = {light.path: light.shaping for light in lights}
    assert shaping == {"/Panel": None, "/Tube": Shaping(math.radians(30.0))}
    np.testing.assert_allclose(next(light for light in lights if light.shaping).cone_axis, [[0, 0, -1], [0, 0, 0]])
    (panel_said,) = scene.warnings.messages
    assert "/Panel.inputs:texture:file: cannot" in panel_said


def test_a_rectangle_with_a_picture_is_one_light_a_pixel_upright_before_it(small):
    """The picture's first pixel lies at (+x, +y), which is up and left for who looks along +z, against the light."""
    colors = np.zeros((2, 3, 3), np.float32)
    colors[0, 0], colors[1, 2], colors[1, 1] = (1.0, 0.5, 0.25), (0.0, 2.0, 0.0), (4.0, 4.0, 4.0)
    image = oiio.ImageBuf(np.ascontiguousarray(colors))
    assert image.write(str(Path(small.file).parent / "picture.exr"))
    light = UsdLux.RectLight.Define(small.stage, "/Panel")
    light.CreateTextureFileAttr("picture.exr")
    light.CreateWidthAttr(6.0)
    light.CreateHeightAttr(2.0)
    light.CreateIntensityAttr(3.0)
    scene = small.open()
    found = {light.path: light for light in scene.at(Shutter.still(1)).lights}
    assert list(found) == ["/Panel[0]", "/Panel[4]", "/Panel[5]"] and scene.warnings.messages == []
    places = [light.position.tolist() for light in found.values()]
    np.testing.assert_allclose(places, [(2.0, 0.5, 0.0), (0.0, -0.5, 0.0), (-2.0, -0.5, 0.0)], atol=1e-12)
    # A sixth of the area, 2 by 1, of radiance 3.
    np.testing.assert_allclose(found["/Panel[0]"].power, (6.0, 3.0, 1.5), rtol=1e-3)
    np.testing.assert_allclose(found["/Panel[5]"].power, (0.0, 12.0, 0.0), rtol=1e-3)
    np.testing.assert_allclose(found["/Panel[4]"].extent.spans, [(1.0, 0.0, 0.0), (0.0, 0.5, 0.0)], atol=1e-12)


@pytest.mark.parametrize(
    ("samples", "shutter", "mean"),
    [
        ({1: 0.0, 2: 2.0}, (1, 2), 1.0),
        ({1: 0.0, 2: 2.0}, (1.25, 1.5), 0.75),
        ({1: 0.125, 1.25: 0.125, 1.5: 8.125, 1.75: 0.125, 2: 0.125}, (1, 2), 2.125),
        ({1: 0.0, 2: 2.0}, (1.5, 2.5), 1.75),
    ],
)
def test_a_light_that_changes_has_its_mean_over_the_shutter(small, samples, shutter, mean):
    light = distant(small)
    for time, value in samples.items():
        light.GetIntensityAttr().Set(value, time)
    # USD interpolates in single precision.
    assert read(small, Shutter(1, *shutter))[0].power[0] == pytest.approx(mean, rel=6e-8)


def test_a_light_that_brightens_by_stops_has_the_mean_of_the_exponential(small):
    light = distant(small)
    for time, value in ((1, 0.0), (2, 1.0)):
        light.CreateExposureAttr().Set(value, time)
    # Three nodes leave ln(2)⁶ / 2016000 of the exponential.
    assert read(small, Shutter(1, 1, 2))[0].power[0] == pytest.approx(8 / math.log(2), rel=1e-7)


@pytest.mark.parametrize("above", [False, True])
def test_a_light_shines_for_the_part_of_the_shutter_in_which_it_is_visible(small, above):
    UsdGeom.Xform.Define(small.stage, "/Group")
    light = distant(small, "/Group/Sun")
    hidden = UsdGeom.Imageable(small.stage.GetPrimAtPath("/Group")) if above else light
    attribute = UsdGeom.Imageable(hidden).CreateVisibilityAttr()
    for time, value in ((1, "inherited"), (1.25, "invisible"), (1.75, "inherited")):
        attribute.Set(value, time)
    assert read(small, Shutter(1, 1, 2))[0].power[0] == pytest.approx(4.0, rel=1e-12)


def test_the_colour_of_a_light_is_averaged_too(small):
    light = distant(small)
    for time, value in ((1, Gf.Vec3f(1, 0, 0)), (2, Gf.Vec3f(0, 0, 1))):
        light.CreateColorAttr().Set(value, time)
    assert read(small, Shutter(1, 1, 2))[0].power == pytest.approx((4.0, 0.0, 4.0))


def test_frames_in_which_only_a_lamp_moves_are_no_frames_outside_the_animation(tmp_path):
    scene = StageScene.open(write("cardioid", tmp_path), Settings(camera=CAMERA))
    assert scene.at(Shutter(FRAME, FRAME, FRAME + 1)).lights[0].moves
    assert not [message for message in scene.warnings.messages if "outside the animation" in message]


def test_a_cone_is_that_of_mid_shutter_and_is_said_to_change_within_it(small):
    lamp = sphere(small, 0.1)
    angle = UsdLux.ShapingAPI.Apply(lamp.GetPrim()).CreateShapingConeAngleAttr()
    angle.Set(10.0, 1.0)
    angle.Set(30.0, 2.0)
    still, opening = (read(small, shutter)[0] for shutter in (Shutter.still(1), Shutter(1.0, 1.25, 1.75)))
    assert still.shaping.angle == pytest.approx(math.radians(10.0)) and not still.moves
    assert opening.shaping.angle == pytest.approx(math.radians(20.0)) and opening.reshaped and opening.moves
    # It may be as wide at either end.
    angle.Set(10.0, 1.25)
    angle.Set(30.0, 1.5)
    angle.Set(10.0, 1.75)
    there_and_back = read(small, Shutter(1.0, 1.25, 1.75))[0]
    assert there_and_back.reshaped and there_and_back.shaping.widest == pytest.approx(math.radians(30.0))
    assert not read(small, Shutter(1.0, 1.6, 1.6))[0].reshaped
    # What brightens and keeps its cone goes nowhere else.
    angle.Clear()
    angle.Set(30.0)
    lamp.GetIntensityAttr().Set(4.0, 1.0)
    lamp.GetIntensityAttr().Set(8.0, 2.0)
    assert not read(small, Shutter(1.0, 1.25, 1.75))[0].moves
