"""The stage as a whole: what it refuses, what it reports, what it leaves out and says so."""

import json
import os

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdVol

from tests.usd.stages import SQUARE, SmallStage
from tpdwarp.errors import InputError
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd import StageScene

CORNERS = np.array(SQUARE)


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def refused(file, **settings):
    with pytest.raises(InputError) as caught:
        StageScene.open(file, Settings(**settings))
    message = str(caught.value)
    assert message.startswith(os.fspath(file)) and "\n" not in message
    return message


def test_files_that_are_no_stages_are_refused_in_one_line(tmp_path, capfd):
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "broken.usda").write_text('#usda 1.0\ndef Mesh "x" { garbage }\n')
    (tmp_path / "broken.usdc").write_bytes(b"PXR-USDC" + b"\1" * 40)
    assert "no such file" in refused(tmp_path / "missing.usda")
    assert "folder" in refused(tmp_path)
    for name in ("notes.txt", "broken.usda", "broken.usdc"):
        refused(tmp_path / name)
    assert capfd.readouterr().err == ""


def test_missing_references_are_warnings_of_ours(small, capfd):
    small.mesh().GetPrim().GetReferences().AddReference("./nowhere.usda")
    capfd.readouterr()
    scene = small.open()
    assert len([m for m in scene.warnings.messages if "nowhere.usda" in m and "0x" not in m]) == 1
    assert "UsdStage" not in capfd.readouterr().err


def test_a_stage_that_shows_nothing_is_refused_with_what_it_holds(small):
    small.stage.Save()
    assert "no visible mesh: it holds nothing that is drawn, but 1 light (" in refused(small.file)
    mesh = small.mesh()
    mesh.CreatePurposeAttr("guide")
    small.stage.Save()
    assert "no visible mesh: it holds only 1 of purpose guide (" in refused(small.file)
    StageScene.open(small.file, Settings(purposes=("guide",)))
    mesh.GetPurposeAttr().Set("default")
    mesh.MakeInvisible()
    small.stage.Save()
    assert "no visible mesh: all of its 1 shapes are invisible (" in refused(small.file)
    mesh.GetPrim().SetActive(False)
    small.stage.DefinePrim("/Cloud", "Volume")
    small.stage.Save()
    assert "no visible mesh: it holds nothing that can be rendered, but 1 × Volume" in refused(small.file)
    small.stage.RemovePrim("/Cloud")
    small.stage.Save()
    assert "no visible mesh: all of its 1 shapes are classes, or inactive (" in refused(small.file)


def test_proxies_are_rendered_where_there_is_nothing_else(small):
    small.mesh("/Proxy").CreatePurposeAttr("proxy")
    source = small.open()
    assert [mesh.path for mesh in source.at(Shutter.still(1)).meshes] == ["/Proxy"]
    assert any("what is of purpose proxy is rendered" in message for message in source.warnings.messages)
    # Not where they were left out on purpose, or stand beside the real thing.
    with pytest.raises(InputError, match="no visible mesh: it holds only 1 of purpose proxy"):
        small.open(purposes=("guide",))
    small.mesh("/Real")
    assert [mesh.path for mesh in small.open().at(Shutter.still(1)).meshes] == ["/Real"]


def test_a_light_that_is_lit_later_is_usable(small):
    small.mesh()
    small.light.GetIntensityAttr().Set(0.0, 1)
    small.light.GetIntensityAttr().Set(1.0, 5)
    assert small.open().at(Shutter.still(5)).lights[0].power == (1, 1, 1)


@pytest.mark.parametrize("kind", ["Volume"])
def test_other_shapes_are_said_once_and_left_out(small, kind):
    small.mesh()
    small.stage.DefinePrim("/Other", kind)
    scene = small.open()
    for _ in range(2):
        assert [m.path for m in scene.at(Shutter.still(1)).meshes] == ["/Mesh"]
    assert [m for m in scene.warnings.messages if "/Other" in m] == scene.warnings.messages != []


def test_volumes_are_said_and_hidden_things_are_not(small):
    UsdVol.Volume.Define(small.stage, "/Smoke")
    small.mesh()
    UsdGeom.Sphere.Define(small.stage, "/Hidden").MakeInvisible()
    UsdGeom.Sphere.Define(small.stage, "/Guide").CreatePurposeAttr("guide")
    text = "\n".join(small.open().warnings.messages)
    assert "/Smoke" in text
    assert "/Hidden" not in text and "/Guide" not in text


def test_the_mask_restricts_the_stage(small):
    small.mesh("/World/A")
    small.mesh("/World/B")
    UsdGeom.Camera.Define(small.stage, "/Camera")
    scene = small.open(mask=("/World/B", "/Light"), camera="/Camera")
    assert [m.path for m in scene.at(Shutter.still(1)).meshes] == ["/World/B"]
    assert scene.camera_path == "/Camera"
    for wrong in ("/Nowhere", "not a path"):
        assert "correct mask" in refused(small.file, mask=(wrong,))


def test_rates_units_and_range_are_reported_and_change_nothing(small):
    small.mesh()
    UsdGeom.SetStageUpAxis(small.stage, "Z")
    UsdGeom.SetStageMetersPerUnit(small.stage, 1.0)
    small.stage.SetFramesPerSecond(12)
    scene = small.open()
    assert (scene.start, scene.end, scene.up_axis, scene.meters_per_unit) == (1, 5, "Z", 1.0)
    assert (scene.time_codes_per_second, scene.frames_per_second) == (24, 12)
    np.testing.assert_array_equal(scene.at(Shutter.still(1)).meshes[0].points, CORNERS)


@pytest.mark.parametrize(("times", "expected"), [((3, 4, 8), (3, 8)), ((), (0, 0))])
def test_an_unauthored_range_is_that_of_the_samples(tmp_path, times, expected):
    small = SmallStage(tmp_path)
    small.stage.ClearMetadata("startTimeCode")
    small.stage.ClearMetadata("endTimeCode")
    mesh = small.mesh()
    for time in times:
        mesh.GetPointsAttr().Set([Gf.Vec3f(*map(float, p)) for p in CORNERS + time], time)
    scene = small.open()
    assert (scene.start, scene.end) == expected


def test_a_range_that_ends_before_it_starts_is_that_of_the_samples_and_said(tmp_path):
    small = SmallStage(tmp_path, start=10, end=1)
    rise = small.mesh().AddTranslateOp()
    for time in (2, 6):
        rise.Set((0, 0, float(time)), time)
    scene = small.open()
    assert (scene.start, scene.end) == (2, 6)
    assert len(scene.frames()) == 5
    assert any("holds 10 … 1: that of its samples is taken" in line for line in scene.warnings.messages)


def test_reference_shutters_spread_over_what_moves(small):
    small.mesh("/Still")
    assert small.open().reference_shutters() == [Shutter.still(1)]
    small.moving("/Moving", {1: CORNERS, 5: CORNERS + 1})
    shutters = small.open().reference_shutters()
    assert shutters == [Shutter.still(1 + 0.5 * k) for k in range(9)]


def test_a_moving_camera_alone_needs_one_reference(small):
    small.mesh()
    op = UsdGeom.Camera.Define(small.stage, "/Camera").AddTranslateOp()
    op.Set((0, 0, 0), 1)
    op.Set((0, 0, 5), 5)
    assert len(small.open().reference_shutters()) == 1


def test_motion_turns_corners_at_samples_of_points_and_of_transforms_above_them_and_of_lights(small):
    small.moving("/World/Wave", {1: CORNERS, 2: CORNERS + 1, 2.5: CORNERS, 4: CORNERS + 1})
    small.mesh("/Else/Floor")
    for path, times in (("/World", (1, 3, 5)), ("/Light", (1.25, 4.5))):
        op = UsdGeom.Xformable.Get(small.stage, path) or UsdGeom.Xform.Define(small.stage, path)
        op = op.AddTranslateOp()
        for time in times:
            op.Set((0, 0, time), time)
    camera = UsdGeom.Camera.Define(small.stage, "/Camera").AddTranslateOp()
    camera.Set((0, 0, 0), 1.75)
    camera.Set((0, 0, 5), 3.75)
    source = small.open()
    assert source.motion_breaks(Shutter(2, 1, 3)) == [1.25, 2, 2.5]
    assert source.motion_breaks(Shutter(2, 2, 4.75)) == [2.5, 3, 4, 4.5]
    assert source.motion_breaks(Shutter(4, 4.75, 9)) == [5]
    assert source.motion_breaks(Shutter(2, 2, 2)) == []
    assert small.open(motion="cubic").motion_breaks(Shutter(2, 1, 5)) == []


def test_description_is_plain_json_and_tells_what_moves(small):
    small.preview("/Glass", opacity=0.0)
    small.bind(small.moving("/World/Wave", {1: CORNERS, 5: CORNERS + 1}), "/Glass")
    small.mesh("/World/Floor")
    UsdGeom.Camera.Define(small.stage, "/Camera")
    small.stage.DefinePrim("/Cloud", "Volume")
    told = json.loads(json.dumps(small.open().describe()))
    assert told["meshes"] == [
        {"path": "/World/Wave", "triangles": 2, "instances": 1, "moves": True, "interactions": ["dielectric"]},
        {"path": "/World/Floor", "triangles": 2, "instances": 1, "moves": False, "interactions": ["diffuse"]},
    ]
    assert told["lights"] == [{"path": "/Light", "kind": "distant", "power": [1, 1, 1], "unit": "W/m2", "moves": False}]
    assert told["cameras"] == [{"path": "/Camera", "used": True}]
    assert told["frames"] == {"start": 1, "end": 5}
    assert len(told["warnings"]) == 1


def test_a_retimed_sublayer_plays_at_the_stages_rate(small, tmp_path):
    """Layer offsets and other rates are USD's business: samples arrive in the stage's time codes."""
    small.moving("/Mesh", {1: CORNERS, 5: CORNERS + 4})
    small.stage.Save()
    top = Usd.Stage.CreateNew(str(tmp_path / "top.usda"))
    top.SetStartTimeCode(1)
    top.SetEndTimeCode(10)
    top.SetTimeCodesPerSecond(48)
    top.GetRootLayer().subLayerPaths.append("./scene.usda")
    top.Save()
    (mesh,) = StageScene.open(tmp_path / "top.usda", Settings()).at(Shutter(4, 4, 5)).meshes
    np.testing.assert_allclose(mesh.motions, 0.5)
    np.testing.assert_allclose(mesh.points, CORNERS + 1.25)


def test_a_stage_is_a_scene_source(small):
    small.mesh()
    scene: SceneSource = small.open()
    assert scene.file == small.file and scene.at(Shutter(1, 1, 2)).shutter == Shutter(1, 1, 2)


def test_bytes_that_are_not_utf8_are_refused_in_one_line(tmp_path):
    (tmp_path / "latin.usda").write_bytes(b'#usda 1.0\ndef Mesh "\xe9t\xe9" { \xad }\n')
    assert "UTF-8" in refused(tmp_path / "latin.usda")


@pytest.mark.parametrize("broken", ["points", "faces", "transform"])
@pytest.mark.parametrize("specular", [False, True])
def test_a_broken_mesh_is_left_out_unless_it_alone_may_carry_a_caustic(small, broken, specular):
    small.mesh("/Good")
    for name in "AB":
        mesh = small.mesh(f"/{name}")
        if broken == "points":
            mesh.GetPointsAttr().Set([Gf.Vec3f(float("nan"))] * 4)
        elif broken == "faces":
            mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 9])
        else:
            mesh.AddTranslateOp().Set(Gf.Vec3d(float("inf"), 0, 0))
        if specular:
            small.preview("/Glass", opacity=0.0)
            small.bind(mesh, "/Glass")
    scene = small.open()
    if specular:
        with pytest.raises(InputError, match="/A"):
            scene.at(Shutter.still(1))
        small.bind(small.mesh("/Pane"), "/Glass")
        scene = small.open()
    assert [mesh.path for mesh in scene.at(Shutter.still(1)).meshes] == ["/Good", "/Pane"][: 1 + specular]
    (line,) = scene.warnings.messages
    assert "/A" in line and "and 1 more" in line and "left out" in line


def test_a_stage_of_which_nothing_is_left_is_empty_and_says_why(small):
    small.mesh(indices=(0, 1, 2, 9))
    scene = small.open()
    assert scene.at(Shutter.still(1)).meshes == ()
    (line,) = scene.warnings.messages
    assert "/Mesh.faceVertexIndices" in line and line.endswith("until then the mesh is left out")


def test_a_bad_prim_is_left_out_where_the_camera_is_free_and_in_a_description(small):
    small.mesh("/Floor")
    small.mesh("/Broken", [(0, 0, 0), (1, 0, 0), (float("inf"), 1, 0), (0, 1, 0)])
    many = UsdGeom.PointInstancer.Define(small.stage, "/Many")
    small.mesh("/Many/Ball")
    many.CreatePrototypesRel().SetTargets(["/Many/Ball"])
    many.CreateProtoIndicesAttr([0, 0])
    source = small.open()
    assert source.resolution()[0] > 0
    assert [mesh.path for mesh in source.at(Shutter.still(1)).meshes] == ["/Floor"]
    triangles = {entry["path"]: entry["triangles"] for entry in source.describe()["meshes"]}
    assert triangles["/Floor"] == 2 and triangles["/Broken"] == 0
