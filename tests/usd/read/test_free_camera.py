"""A stage without camera or light is framed and lit as by usdrecord; one in which nothing changes is one frame."""

import math

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade

from tests.usd.stages import SmallStage
from tpdwarp.jobs.live_scene import render_frame
from tpdwarp.scene.description import LightKind, Shutter
from tpdwarp.settings import Settings

BOX = ((1.0, 2.0, 3.0), (4.0, 4.0, 9.0), (1.0, 4.0, 5.0), (2.0, 2.0, 3.0))
LOW, HIGH = np.array([1.0, 2.0, 3.0]), np.array([4.0, 4.0, 9.0])


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def messages(scene, text):
    return [message for message in scene.warnings.messages if text in message]


@pytest.mark.parametrize(("up", "across", "depth"), [("Y", (0, 1), 2), ("Z", (0, 2), 1)])
def test_the_front_face_lies_in_the_circle_of_the_horizontal_field_of_view(small, up, across, depth):
    UsdGeom.SetStageUpAxis(small.stage, up)
    small.mesh(points=BOX)
    camera = small.open().at(Shutter.still(1)).camera
    corners = np.array([[(LOW, HIGH)[(k >> a) & 1][a] for a in range(3)] for k in range(8)])
    near = HIGH[2] if up == "Y" else LOW[1]
    front = corners[corners[:, depth] == near]
    seen = (front - camera.position) @ camera.axes.T
    radii = np.hypot(seen[:, 0], seen[:, 1]) / -seen[:, 2]
    # The lens of a GfCamera: an aperture 20.955 wide at a focal length of 50.
    np.testing.assert_allclose(radii, 0.5 * 20.955 / 50.0, rtol=1e-6)
    # The image has whole rows, 700 of them, and the window is widened to fit.
    np.testing.assert_allclose(camera.window[1], 0.5 * 20.955 / 50.0, rtol=1 / 700)
    np.testing.assert_allclose(camera.position[list(across)], 0.5 * (LOW + HIGH)[list(across)], atol=1e-12)


def test_what_holds_itself_is_framed_by_what_is_drawn_of_it(small):
    small.mesh(points=BOX)
    many = UsdGeom.PointInstancer.Define(small.stage, "/Many")
    many.CreatePrototypesRel().SetTargets([many.GetPath()])
    many.CreateProtoIndicesAttr([0])
    many.CreatePositionsAttr([Gf.Vec3f(0, 0, 50)])
    scene = small.open()
    camera = scene.at(Shutter.still(1)).camera
    assert messages(scene, "holds itself")
    # USD's own bounds of it end the process.
    np.testing.assert_allclose(camera.position[:2], 0.5 * (LOW + HIGH)[:2], atol=1e-12)


FLAT = {
    # Up axis, the axis along which a square has no thickness, and where its picture's right and upper sides point.
    ("Y", 1): ((1, 0, 0), (0, 0, -1)),
    ("Y", 0): ((0, 0, -1), (0, 1, 0)),
    ("Y", 2): ((1, 0, 0), (0, 1, 0)),
    ("Z", 2): ((1, 0, 0), (0, 1, 0)),
    ("Z", 0): ((0, 1, 0), (0, 0, 1)),
    ("Z", 1): ((1, 0, 0), (0, 0, 1)),
}


@pytest.mark.parametrize(("up", "thin"), FLAT)
def test_what_is_flat_is_not_looked_at_from_its_edge(small, up, thin):
    UsdGeom.SetStageUpAxis(small.stage, up)
    square = [Gf.Vec3f(*(0.0 if axis == thin else (k >> (axis > thin)) & 1 for axis in range(3))) for k in range(4)]
    mesh = small.mesh(points=[square[k] for k in (0, 1, 3, 2)])
    # A lamp beside it makes the bounds thick that usdrecord frames, but not what is seen.
    UsdLux.SphereLight.Define(small.stage, "/Lamp").AddTranslateOp().Set(Gf.Vec3d(*(0.2 * np.eye(3)[thin])))
    mesh.CreateExtentAttr([Gf.Vec3f(0), Gf.Vec3f(*(0.0 if axis == thin else 1.0 for axis in range(3)))])
    camera = small.open().at(Shutter.still(1)).camera
    right, above = FLAT[up, thin]
    np.testing.assert_array_equal(camera.axes[:2], [right, above])
    np.testing.assert_allclose(np.cross(camera.axes[0], camera.axes[1]), camera.axes[2])
    corners = (np.array(square) - camera.position) @ camera.axes.T
    assert (np.hypot(*corners[:, :2].T) / -corners[:, 2] < 0.5 * 20.955 / 50.0 * (1 + 1e-6)).all()


@pytest.mark.parametrize(
    "extent",
    [(0.0, 0.0), (100.0, 101.0), (1.0, 1.01), (-99.0, 9.0), (1.0, 8.0)],
    ids=["none", "elsewhere", "too small", "too large", "too short"],
)
def test_extents_that_do_not_hold_what_is_drawn_are_passed_over(small, extent):
    mesh = small.mesh(points=BOX)
    right = small.open().at(Shutter.still(1)).camera.position
    mesh.CreateExtentAttr([Gf.Vec3f(bound) for bound in extent])
    np.testing.assert_allclose(small.open().at(Shutter.still(1)).camera.position, right, atol=1e-6)


def test_the_free_camera_is_an_authored_one_of_the_same_place(small):
    small.mesh(points=BOX)
    free = small.open(image_width=100)
    placed = free.at(Shutter.still(1)).camera
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    camera.CreateClippingRangeAttr(Gf.Vec2f(placed.near, placed.far))
    camera.AddTranslateOp().Set(Gf.Vec3d(*map(float, placed.position)))
    authored = small.open(image_width=100)
    assert authored.resolution() == free.resolution()
    seen = authored.at(Shutter.still(1)).camera
    # Clipping distances are authored in single precision.
    np.testing.assert_allclose(placed.world_to_ndc, seen.world_to_ndc, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(placed.window, seen.window)


def test_the_stages_own_camera_and_the_one_asked_for_come_first(small):
    small.mesh()
    scene = small.open()
    scene.resolution()
    assert len(messages(scene, "free camera")) == 1
    assert scene.describe()["cameras"] == [{"path": "free camera", "used": True}]
    UsdGeom.Camera.Define(small.stage, "/A")
    UsdGeom.Camera.Define(small.stage, "/B")
    for wanted, path in (("", "/A"), ("/B", "/B")):
        scene = small.open(camera=wanted)
        scene.resolution()
        assert scene.at(Shutter.still(1)).camera.path == path and messages(scene, "free camera") == []


def test_a_free_camera_sees_a_still_unless_asked_otherwise(small):
    small.mesh()
    scene = small.open()
    assert scene.shutter(2, Settings()) == Shutter.still(2)
    assert scene.shutter(2, Settings(exposure=0.5)) == Shutter(2, 2, 2.5)


def test_without_a_light_that_shines_a_white_surface_that_faces_the_camera_has_radiance_one(small):
    small.mesh()
    for change in (
        lambda: small.light.GetIntensityAttr().Set(0.0),
        lambda: (small.light.GetIntensityAttr().Set(1.0), small.light.MakeInvisible()),
        lambda: small.stage.RemovePrim("/Light"),
    ):
        change()
        scene = small.open()
        at = scene.at(Shutter.still(1))
        (light,) = at.lights
        assert light.kind == LightKind.DISTANT and light.power == (math.pi,) * 3
        np.testing.assert_array_equal(light.axes, at.camera.axes)
        assert len(messages(scene, "light at the camera")) == 1
        assert scene.describe()["lights"][-1]["path"] == "camera light"


def test_the_camera_light_comes_from_the_camera_and_not_from_what_lies_behind_it(tmp_path):
    small = SmallStage(tmp_path, light=False)
    small.mesh("/Seen")
    room = UsdGeom.Cube.Define(small.stage, "/Room")
    room.CreateSizeAttr(8.0)
    UsdGeom.Camera.Define(small.stage, "/Camera").AddTranslateOp().Set(Gf.Vec3d(0.5, 0.5, 2))
    (light,) = small.open().at(Shutter.still(1)).lights
    assert light.passed == {"/Room"}
    frame = render_frame(small.file, 1, image_width=8, samples=1, threads=1)
    # The square of radiance .18 that stands before the camera, and the wall of the room behind it.
    np.testing.assert_allclose(frame.beauty[..., :3], 0.18, rtol=1e-5)


def test_of_several_cameras_the_primary_one_of_usd_comes_first(small):
    small.mesh()
    for path in ("/A", "/Rig/main_cam", "/Rig/other"):
        UsdGeom.Camera.Define(small.stage, path)
    scene = small.open()
    assert scene.at(Shutter.still(1)).camera.path == "/Rig/main_cam" and messages(scene, "of 3 cameras") == []


def test_the_camera_light_turns_with_the_camera(tmp_path):
    small = SmallStage(tmp_path, light=False)
    small.mesh()
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    turn = camera.AddRotateYOp()
    turn.Set(0.0, 1)
    turn.Set(10.0, 2)
    scene = small.open()
    at = scene.at(Shutter(1, 1, 2))
    (light,) = at.lights
    assert light.moves
    np.testing.assert_array_equal(light.axes_motion, at.camera.axes_motion)
    assert len(scene.reference_shutters()) > 1


def test_a_stage_in_which_nothing_changes_is_one_frame(tmp_path):
    small = SmallStage(tmp_path, start=0, end=1_000_000)
    small.mesh()
    assert small.open().frames() == (0,)


@pytest.mark.parametrize("what", ["points", "camera", "colour", "light", "material", "visibility"])
def test_whatever_changes_gives_the_range(small, what):
    mesh = small.mesh()
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    shader = small.preview("/Material", diffuseColor=(1.0, 0.0, 0.0))
    small.bind(mesh, "/Material")
    assert small.open().frames() == (1,)
    attribute, values = {
        "points": (mesh.GetPointsAttr(), [[Gf.Vec3f(0)] * 4, [Gf.Vec3f(1)] * 4]),
        "camera": (camera.GetFocalLengthAttr(), [50, 51]),
        "colour": (mesh.CreateDisplayColorAttr(), [[Gf.Vec3f(0)], [Gf.Vec3f(1)]]),
        "light": (small.light.GetIntensityAttr(), [1, 2]),
        "material": (UsdShade.Shader(shader).GetInput("diffuseColor").GetAttr(), [Gf.Vec3f(0), Gf.Vec3f(1)]),
        "visibility": (mesh.CreateVisibilityAttr(), ["inherited", "invisible"]),
    }[what]
    for time, value in enumerate(values, 1):
        attribute.Set(value, time)
    assert small.open().frames() == (1, 2, 3, 4, 5)


def test_what_changes_within_an_instance_counts(small):
    other = Usd.Stage.CreateNew(small.file.replace("scene", "other"))
    colour = UsdGeom.Mesh.Define(other, "/Root/Inner").CreateDisplayColorAttr()
    for time in (1, 2):
        colour.Set([Gf.Vec3f(time)], time)
    other.Save()
    small.mesh()
    prim = small.stage.DefinePrim("/Instance")
    prim.GetReferences().AddReference("./other.usda", "/Root")
    prim.SetInstanceable(True)
    assert small.open().frames() == (1, 2, 3, 4, 5)
