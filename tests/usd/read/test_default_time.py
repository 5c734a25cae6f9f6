import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdLux

from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.default_time import DefaultTimeScene, pin_default_time
from tpdwarp.usd.read.stage import StageScene

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)


def a_mesh(stage, path):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreatePointsAttr(SQUARE)
    return mesh


@pytest.fixture
def stage(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    UsdLux.DistantLight.Define(stage, "/Sun").CreateAngleAttr(0)
    return stage


def points_of(scene):
    return {mesh.path: mesh.points for mesh in scene.at(Shutter.still(scene.start)).meshes}


def test_sampled_points_and_transforms_give_way_to_their_defaults(stage):
    mesh = a_mesh(stage, "/Mesh")
    mesh.GetPointsAttr().Set(SQUARE + 5, 1)
    mesh.GetPointsAttr().Set(SQUARE + 9, 3)
    move = mesh.AddTranslateOp()
    move.Set((0, 0, 2))
    move.Set((0, 0, 7), 1)
    stage.Save()
    file = stage.GetRootLayer().realPath
    np.testing.assert_allclose(points_of(StageScene.open(file, Settings()))["/Mesh"], np.add(SQUARE, (5, 5, 12)))
    scene = DefaultTimeScene.open(file, Settings())
    np.testing.assert_allclose(points_of(scene)["/Mesh"], np.add(SQUARE, (0, 0, 2)))
    assert len(scene.reference_shutters()) == 1 and scene.warnings.messages == []


def test_what_has_no_default_has_no_value(stage):
    mesh = a_mesh(stage, "/Mesh")
    mesh.GetPointsAttr().ClearDefault()
    mesh.GetPointsAttr().Set(SQUARE, 1)
    pin_default_time(stage)
    assert mesh.GetPointsAttr().Get(1) is None


def test_fallbacks_count_as_defaults(stage):
    mesh = a_mesh(stage, "/Mesh")
    mesh.CreateVisibilityAttr().Set("invisible", 1)
    pin_default_time(stage)
    assert mesh.ComputeVisibility(1) == "inherited"


def test_instances_with_samples_are_pinned_too(stage):
    mesh = a_mesh(stage, "/Prototype/Mesh")
    mesh.GetPointsAttr().Set(SQUARE + 5, 1)
    instance = UsdGeom.Xform.Define(stage, "/Instance")
    instance.GetPrim().GetReferences().AddInternalReference("/Prototype")
    instance.GetPrim().SetInstanceable(True)
    instance.AddTranslateOp().Set((3, 0, 0))
    stage.Save()
    found = points_of(DefaultTimeScene.open(stage.GetRootLayer().realPath, Settings()))
    np.testing.assert_allclose(found["/Instance/Mesh"], np.add(SQUARE, (3, 0, 0)))


def test_nothing_is_written_to_the_stage_itself(stage):
    a_mesh(stage, "/Mesh").GetPointsAttr().Set(SQUARE + 5, 1)
    before = stage.GetRootLayer().ExportToString()
    pin_default_time(stage)
    assert stage.GetRootLayer().ExportToString() == before
