"""Lights: UsdLux units, motion, and what is left out."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux

from tests.usd.stages import SmallStage
from tpdwarp.errors import InputError
from tpdwarp.scene.description import LightKind, Shutter


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


@pytest.mark.parametrize("normalize", [False, True])
def test_a_distant_disc_keeps_its_irradiance_and_is_said(small, normalize):
    distant(small, angle=60.0, Normalize=normalize)
    light, warnings = read(small)
    expected = 8.0 if normalize else 8.0 * math.pi * math.sin(math.radians(30)) ** 2
    assert light.power[0] == pytest.approx(expected, rel=1e-12)
    assert len(warnings) == 1 and "/Sun.inputs:angle" in warnings[0]


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
    assert found.power[0] == pytest.approx(expected, rel=1e-12)


def test_a_sphere_that_does_not_ask_to_be_a_point_is_said(small):
    sphere(small, 0.5)
    assert "/Lamp.inputs:radius" in read(small)[1][0]


def test_colour_temperature_tints_by_the_blackbody(small):
    distant(small, EnableColorTemperature=True, ColorTemperature=3000.0)
    np.testing.assert_allclose(read(small)[0].power, 8 * np.array(UsdLux.BlackbodyTemperatureAsRgb(3000.0)), rtol=1e-7)


def test_the_diffuse_multiplier_scales_the_power(small):
    distant(small, Diffuse=0.5)
    assert read(small)[0].power == (4.0, 4.0, 4.0)


@pytest.mark.parametrize(
    ("name", "value"), [("Intensity", -1.0), ("Color", Gf.Vec3f(0, -1, 0)), ("Intensity", math.nan)]
)
def test_negative_or_undefined_light_is_refused(small, name, value):
    light = distant(small)
    getattr(light, f"Get{name}Attr")().Set(value)
    with pytest.raises(InputError, match=rf"/Sun\.inputs:{name.lower()}"):
        small.open()


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


@pytest.mark.parametrize("kind", ["PortalLight", "GeometryLight"])
def test_other_lights_are_said_and_left_out(small, kind):
    distant(small)
    getattr(UsdLux, kind).Define(small.stage, "/Other")
    light, warnings = read(small)
    assert light.path == "/Sun"
    assert len(warnings) == 1 and f"/Other: a {kind}" in warnings[0]


def test_shaping_filters_and_linking_are_said(small):
    light = distant(small)
    UsdLux.ShapingAPI.Apply(light.GetPrim()).CreateShapingConeAngleAttr(30.0)
    light.GetFiltersRel().SetTargets([Sdf.Path("/Mesh")])
    UsdLux.LightAPI(light).GetLightLinkCollectionAPI().CreateExcludesRel().SetTargets([Sdf.Path("/Mesh")])
    _, warnings = read(small)
    assert [word for word in ("cone", "filters", "linking") if any(word in m for m in warnings)] == [
        "cone",
        "filters",
        "linking",
    ]


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


@pytest.mark.parametrize("kind", SIZED)
@pytest.mark.parametrize("normalize", [False, True])
def test_a_light_with_a_surface_is_the_point_that_sends_as_much(small, kind, normalize):
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
    assert 4 * math.pi * found.power[0] == pytest.approx(math.pi * 8 * (1 if normalize else area), rel=1e-6)
    assert found.kind == LightKind.POINT and found.position.tolist() == [1, 2, 3]
    assert len(warnings) == 1 and "/Lamp" in warnings[0]


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
