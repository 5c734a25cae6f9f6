"""Attributes that hold something else than they should: their defaults count, and it is said."""

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.settings import Settings

TYPES = Sdf.ValueTypeNames
GLASS = {"opacity": 0.0, "ior": 1.5, "roughness": 0.0}


@pytest.fixture
def everything(tmp_path):
    """A stage with a lamp, a camera, a ball and a subdivision surface of glass, and an instancer."""
    small = SmallStage(tmp_path)
    small.preview("/Glass", **GLASS)
    ball = UsdGeom.Sphere.Define(small.stage, "/Ball")
    UsdGeom.Xformable(ball).AddTranslateOp(opSuffix="away").Set(Gf.Vec3d(5, 0, 0))
    for prim in (small.mesh("/Surface", scheme="catmullClark"), small.mesh("/Facets"), ball):
        small.bind(prim, "/Glass")
    UsdGeom.Camera.Define(small.stage, "/Camera")
    UsdLux.SphereLight.Define(small.stage, "/Lamp")
    instancer = UsdGeom.PointInstancer.Define(small.stage, "/Instancer")
    instancer.CreatePrototypesRel().SetTargets([UsdGeom.Cube.Define(small.stage, "/Instancer/Cube").GetPath()])
    return small


def told(small, path, kind, value):
    """The scene with an attribute of a type that it does not have, what is said of it, and the scene without it."""
    layer = small.stage.GetRootLayer()
    spec = layer.GetAttributeAtPath(path)
    if spec is not None:
        spec.owner.RemoveProperty(spec)
    still = Shutter.still(1)
    without = small.open()
    expected = without.at(still)
    prim, name = path.split(".")
    Sdf.AttributeSpec(layer.GetPrimAtPath(prim), name, kind).default = value
    scene = small.open()
    found = scene.at(still)
    assert scene.shutter(1, Settings()) == still
    return found, [text for text in scene.warnings.messages if text not in without.warnings.messages], expected


@pytest.mark.parametrize(
    "path",
    [
        "/Lamp.inputs:intensity",
        "/Lamp.inputs:color",
        "/Lamp.inputs:radius",
        "/Lamp.inputs:enableColorTemperature",
        "/Lamp.inputs:shadow:enable",
        "/Light.inputs:exposure",
        "/Camera.shutter:close",
        "/Ball.radius",
        "/Glass/Surface.inputs:ior",
        "/Glass/Surface.inputs:opacityThreshold",
        "/Surface.creaseIndices",
        "/Surface.cornerIndices",
        "/Facets.holeIndices",
        "/Facets.normals",
        "/Facets.velocities",
        "/Instancer.protoIndices",
        "/Ball.xformOp:translate:away",
    ],
)
@pytest.mark.parametrize("kind, value", [(TYPES.String, "much"), (TYPES.TokenArray, ["a"])])
def test_what_cannot_be_read_counts_as_not_authored(everything, path, kind, value):
    found, said, expected = told(everything, path, kind, value)
    for ours, theirs in zip(found.meshes, expected.meshes, strict=True):
        assert ours.path == theirs.path
        np.testing.assert_array_equal(ours.points, theirs.points)
        np.testing.assert_array_equal(ours.triangles, theirs.triangles)
        assert [m.interaction for m in ours.materials] == [m.interaction for m in theirs.materials]
        assert [m.ior for m in ours.materials] == [m.ior for m in theirs.materials]
    assert any(material.interaction == Interaction.DIELECTRIC for m in found.meshes for material in m.materials)
    assert [light.power for light in found.lights] == [light.power for light in expected.lights]
    assert len(said) == 1 and path in said[0], said


def test_a_profile_that_is_no_file_name_is_none(everything):
    found, _, expected = told(everything, "/Lamp.inputs:shaping:ies:file", TYPES.Float, 3.0)
    assert [light.power for light in found.lights] == [light.power for light in expected.lights]
    assert all(light.shaping is None for light in found.lights)


def test_an_order_that_names_no_xform_op_leaves_it_out(everything):
    order = everything.stage.GetPrimAtPath("/Ball").GetAttribute("xformOpOrder")
    everything.stage.GetPrimAtPath("/Ball").CreateAttribute("a", TYPES.Float).Set(1.0)
    order.Set([*order.Get(), "a"])
    scene = everything.open()
    (ball,) = (mesh for mesh in scene.at(Shutter.still(1)).meshes if mesh.path == "/Ball")
    assert ball.points[:, 0].mean() == pytest.approx(5.0, abs=1e-6)
    assert sum("xformOpOrder" in message for message in scene.warnings.messages) == 1
