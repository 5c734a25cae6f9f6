"""Lights in prototypes: each instance shines as if its light were authored where it stands."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdLux, Vt

from tests.usd.stages import SmallStage
from tpdwarp.errors import InputError
from tpdwarp.scene.description import Shutter

STILL = Shutter.still(1)
# A quarter turn about x, then a place: what both the instancer and the plain prims are given.
TURN, PLACES = Gf.Quath(0.5**0.5, Gf.Vec3h(0.5**0.5, 0, 0)), [(1, 2, 3), (-4, 5, 6)]


@pytest.fixture
def small(tmp_path):
    small = SmallStage(tmp_path, light=False)
    small.mesh("/Floor")
    return small


def instancer(small, path="/Many", prototype="/Many/Lamp", places=PLACES):
    many = UsdGeom.PointInstancer.Define(small.stage, path)
    many.CreatePrototypesRel().SetTargets([prototype])
    many.CreateProtoIndicesAttr([0] * len(places))
    many.CreatePositionsAttr([Gf.Vec3f(*place) for place in places])
    many.CreateOrientationsAttr(Vt.QuathArray([TURN] * len(places)))
    return many


def lamp(small, path):
    light = UsdLux.RectLight.Define(small.stage, path)
    light.CreateWidthAttr(0.5)
    light.CreateHeightAttr(0.25)
    light.CreateIntensityAttr(3.0)
    return light


def same(light, other):
    assert light.kind == other.kind and light.profile == other.profile
    for name in ("power", "position", "axes", "position_motion", "axes_motion"):
        np.testing.assert_allclose(getattr(light, name), getattr(other, name), atol=1e-3, err_msg=name)
    np.testing.assert_allclose(light.extent.spans, other.extent.spans, atol=1e-3)


def test_instances_shine_where_plain_lights_would(small, tmp_path):
    instancer(small)
    lamp(small, "/Many/Lamp/Light")
    source = small.open()
    lights = source.at(STILL).lights
    assert [light.path for light in lights] == ["/Many[0]/Lamp/Light", "/Many[1]/Lamp/Light"]
    assert not any("prototype" in message for message in source.warnings.messages)
    (tmp_path / "plain").mkdir()
    plain = SmallStage(tmp_path / "plain", light=False)
    plain.mesh("/Floor")
    for number, place in enumerate(PLACES):
        light = lamp(plain, f"/Light{number}")
        light.AddTranslateOp().Set(Gf.Vec3d(*place))
        light.AddRotateXOp().Set(90.0)
    for light, other in zip(lights, plain.open().at(STILL).lights, strict=True):
        same(light, other)


def test_the_light_of_an_instance_moves_with_it(small):
    many = instancer(small)
    lamp(small, "/Many/Lamp/Light")
    for time, offset in ((1, 0.0), (3, 2.0)):
        many.GetPositionsAttr().Set([Gf.Vec3f(x + offset, y, z) for x, y, z in PLACES], time)
    source = small.open()
    light = source.at(Shutter(1, 1, 2)).lights[0]
    np.testing.assert_allclose(light.position, [1.5, 2, 3], atol=1e-6)
    np.testing.assert_allclose(light.position_motion, [1, 0, 0], atol=1e-6)
    # Another frame is another place of the same light.
    np.testing.assert_allclose(source.at(Shutter.still(3)).lights[0].position, [3, 2, 3], atol=1e-6)
    assert len(source.frames()) > 1


def test_lights_of_nested_instancers_shine(small):
    instancer(small, prototype="/Many/Group")
    UsdGeom.Xform.Define(small.stage, "/Many/Group")
    instancer(small, "/Many/Group/Inner", "/Many/Group/Inner/Lamp", [(0, 0, 0), (0, 0, 1)])
    lamp(small, "/Many/Group/Inner/Lamp")
    lights = small.open().at(STILL).lights
    assert [light.path for light in lights] == [f"/Many[{k}]/Group/Inner[{j}]/Lamp" for k in (0, 1) for j in (0, 1)]
    # A quarter turn about x takes z to −y.
    np.testing.assert_allclose(lights[1].position - lights[0].position, [0, -1, 0], atol=1e-3)
    # Two of them: its own and that of the instance.
    np.testing.assert_allclose(lights[0].axes[2], [0, 0, -1], atol=2e-3)


def test_meshes_of_instances_that_shine_are_lights(small):
    instancer(small, places=[(k, 0, 0) for k in range(80)])
    mesh = small.mesh("/Many/Lamp/Mesh")
    UsdLux.LightAPI(UsdLux.MeshLightAPI.Apply(mesh.GetPrim())).CreateIntensityAttr(2.0)
    scene = small.open().at(STILL)
    lights = {light.path: light for light in scene.lights}
    assert len(lights) == 80 and lights["/Many[7]/Lamp/Mesh/light0"].unlit == {"/Many[7]/Lamp/Mesh"}
    places = np.array([light.position for light in scene.lights])
    np.testing.assert_allclose(np.diff(places[:, 0]), 1, atol=1e-3)
    shown = {mesh.path: mesh for mesh in scene.meshes}
    assert shown["/Many[7]/Lamp/Mesh"].materials[0].emission == (2.0, 2.0, 2.0)


def test_masked_and_invisible_instances_are_dark(small):
    many = instancer(small)
    lamp(small, "/Many/Lamp/Light")
    many.CreateInvisibleIdsAttr([0])
    assert [light.path for light in small.open().at(STILL).lights] == ["/Many[1]/Lamp/Light"]
    many.MakeInvisible()
    source = small.open()
    assert not any(light.path.startswith("/Many") for light in source.at(STILL).lights)


def test_more_lights_than_anybody_waits_for_are_refused(small):
    instancer(small, places=[(k, 0, 0) for k in range(5000)])
    lamp(small, "/Many/Lamp/Light")
    with pytest.raises(InputError, match=r"/Many: places 5000 lights \(at most 4096"):
        small.open()
