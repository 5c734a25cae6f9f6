"""Meshes in the world over a shutter: positions, motions, facing, normals, sharing of what stands still."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom

from tests.usd.stages import SQUARE, SmallStage, face_normals, mesh_named
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.appearances import PRIORITY

CORNERS = np.array(SQUARE)
UP = np.array([0.0, 0.0, 1.0])


def square_at_height(height):
    return CORNERS + height * UP


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def only(scene):
    (mesh,) = scene.meshes
    return mesh


def test_points_and_transforms_move_together(small):
    mesh = small.moving("/Mesh", {t: square_at_height(t * t) for t in range(1, 6)})
    op = mesh.AddTranslateOp()
    op.Set((0, 0, 0), 1)
    op.Set((8, 0, 0), 5)
    found = only(small.open().at(Shutter(2, 2, 3)))
    np.testing.assert_allclose(found.points, square_at_height(6.5) + np.array([3, 0, 0]), rtol=1e-15)
    np.testing.assert_allclose(found.motions, np.tile([2.0, 0, 5], (4, 1)), rtol=1e-15)


def test_cubic_motion_passes_through_the_parabola_of_the_samples(small):
    small.moving("/Mesh", {t: square_at_height(t * t) for t in range(1, 6)})
    found = only(small.open(motion="cubic").at(Shutter(2, 2, 3)))
    np.testing.assert_allclose(found.points, square_at_height(6.25), rtol=1e-14)
    # The central difference divides rounding of order 1e-15 by 2e-3.
    np.testing.assert_allclose(found.motions, np.tile([0, 0, 5.0], (4, 1)), atol=1e-11)


def test_cubic_motion_takes_velocities_as_tangents(small):
    mesh = small.moving("/Mesh", {t: square_at_height(0) for t in (1, 2)})
    mesh.CreateVelocitiesAttr()
    for time in (1, 2):
        mesh.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 24)] * 4, time)
    found = only(small.open(motion="cubic").at(Shutter(1, 1.25, 1.75)))
    # The Hermite with equal ends and unit slopes has slope −½ half way, at value 0.
    np.testing.assert_allclose(found.points, square_at_height(0), atol=1e-15)
    np.testing.assert_allclose(found.motions[:, 2], -0.25, atol=1e-6)


def test_motion_at_the_last_frame_is_the_backward_difference(small):
    small.moving("/Mesh", {t: square_at_height(t * t) for t in range(1, 6)})
    found = only(small.open().at(Shutter(5, 5, 6)))
    np.testing.assert_allclose(found.motions[:, 2], 9.0)
    np.testing.assert_allclose(found.points[:, 2], 29.5)


def test_a_mesh_sampled_past_the_stage_end_moves_by_its_samples(small):
    small.moving("/Mesh", {t: square_at_height(t * t) for t in range(1, 8)})
    np.testing.assert_allclose(only(small.open().at(Shutter(5, 5, 6))).motions[:, 2], 11.0)


def test_a_frame_outside_the_animation_is_held_and_said_once(small):
    small.moving("/Mesh", {t: square_at_height(t) for t in range(1, 6)})
    scene = small.open()
    for frame in (9.0, 10.0):
        assert only(scene.at(Shutter(frame, frame, frame + 1))).motions is None
    assert len([m for m in scene.warnings.messages if "1 … 5" in m]) == 1


def test_what_stands_still_is_the_same_object_on_every_call(small):
    small.mesh("/Still")
    small.moving("/Moving", {t: square_at_height(t) for t in range(1, 6)})
    scene = small.open()
    first, second = scene.at(Shutter(1, 1, 2)), scene.at(Shutter(2, 2, 3))
    still = mesh_named(first, "/Still")
    assert still is mesh_named(second, "/Still")
    assert still.motions is None and still.normal_motions is None and not still.moves
    assert mesh_named(first, "/Moving") is not mesh_named(second, "/Moving")
    assert mesh_named(first, "/Moving").triangles is mesh_named(second, "/Moving").triangles


def test_a_mesh_that_pauses_over_a_shutter_has_no_motion(small):
    small.moving("/Mesh", {1: square_at_height(0), 2: square_at_height(0), 3: square_at_height(1)})
    scene = small.open()
    assert only(scene.at(Shutter(1, 1, 2))).motions is None
    assert only(scene.at(Shutter(2, 2, 3))).moves


def test_blur_scale_shrinks_motion_about_the_frame(small):
    mesh = small.moving("/Parent/Mesh", {t: square_at_height(t) for t in range(1, 6)})
    UsdGeom.MotionAPI.Apply(mesh.GetPrim().GetParent()).CreateMotionBlurScaleAttr(0.5)
    found = only(small.open().at(Shutter(2, 2, 3)))
    np.testing.assert_allclose(found.motions[:, 2], 0.5)
    np.testing.assert_allclose(found.points[:, 2], 2.25)


@pytest.mark.parametrize(("speed", "height"), [(0.0, 1.0), (0.5, 0.0)])
def test_velocities_say_how_points_move_on_and_not_the_next_sample(small, speed, height):
    """UsdGeomPointBased: what ComputePointsAtTimes makes of velocities that are sampled with the points."""
    mesh = small.moving("/Mesh", {1: CORNERS, 2: CORNERS + height * UP, 3: CORNERS + 2 * height * UP})
    for time in (1, 2, 3):
        mesh.GetVelocitiesAttr().Set([Gf.Vec3f(*map(float, 24 * speed * UP))] * 4, time)
    scene = small.open()
    for frame in (1, 2):
        shutter = Shutter(frame, frame, frame + 1)
        found = only(scene.at(shutter))
        opened, middle, closed = UsdGeom.PointBased(mesh).ComputePointsAtTimes([frame, frame + 0.5, frame + 1], frame)
        np.testing.assert_allclose(found.points, middle, atol=1e-7)
        motions = np.zeros((4, 3)) if found.motions is None else found.motions
        np.testing.assert_allclose(motions, np.array(closed) - np.array(opened), atol=1e-7)


def test_velocities_that_are_not_sampled_with_the_points_do_not_count(small):
    mesh = small.moving("/Mesh", {1: CORNERS, 2: CORNERS + UP})
    mesh.GetVelocitiesAttr().Set([Gf.Vec3f(0)] * 4, 0)
    np.testing.assert_allclose(only(small.open().at(Shutter(1, 1, 2))).motions, np.tile(UP, (4, 1)))


def test_changing_topology_moves_along_velocities_of_the_frame(small):
    mesh = small.mesh(points=None)
    triangle = CORNERS[:3]
    for time, points, counts, indices in ((1, triangle, [3], [0, 1, 2]), (2, CORNERS, [4], [0, 1, 2, 3])):
        mesh.GetPointsAttr().Set([Gf.Vec3f(*map(float, p)) for p in points], time)
        mesh.GetFaceVertexCountsAttr().Set(counts, time)
        mesh.GetFaceVertexIndicesAttr().Set(indices, time)
        mesh.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 24 * time)] * len(points), time)
    scene = small.open()
    forward = only(scene.at(Shutter(1, 1, 2)))
    assert len(forward.points) == 3
    np.testing.assert_allclose(forward.points, triangle + 0.5 * UP)
    np.testing.assert_allclose(forward.motions, np.tile(UP, (3, 1)))
    trailing = only(scene.at(Shutter(2, 1, 2)))
    assert len(trailing.triangles) == 2
    np.testing.assert_allclose(trailing.points, CORNERS - UP)
    np.testing.assert_allclose(trailing.motions, np.tile(2 * UP, (4, 1)))


def test_faces_that_change_at_the_same_point_count_are_not_mixed(small):
    mesh = small.moving("/Mesh", {1: CORNERS, 2: CORNERS[[1, 2, 3, 0]] + UP})
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], 1)
    mesh.GetFaceVertexIndicesAttr().Set([3, 0, 1, 2], 2)
    scene = small.open()
    found = only(scene.at(Shutter(1, 1, 2)))
    np.testing.assert_array_equal(found.points, CORNERS)
    assert found.motions is None
    assert any("/Mesh" in m and "velocities" in m for m in scene.warnings.messages)


def test_faces_authored_alike_at_every_frame_count_as_constant(small):
    mesh = small.moving("/Mesh", {t: square_at_height(t) for t in range(1, 6)})
    for time in range(1, 6):
        mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], time)
        mesh.GetFaceVertexCountsAttr().Set([4], time)
    scene = small.open()
    first, second = only(scene.at(Shutter(1, 1, 2))), only(scene.at(Shutter(2, 2, 3)))
    np.testing.assert_allclose(first.motions[:, 2], 1.0)
    assert first.triangles is second.triangles


def test_a_single_sample_with_velocities_moves(small):
    mesh = small.moving("/Mesh", {1: CORNERS})
    mesh.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 48)] * 4, 1)
    found = only(small.open().at(Shutter(2, 2, 2.5)))
    np.testing.assert_allclose(found.points[:, 2], 2 * 1.25)
    np.testing.assert_allclose(found.motions[:, 2], 1.0)


def test_accelerations_bend_the_path(small):
    mesh = small.moving("/Mesh", {1: CORNERS})
    mesh.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 0)] * 4, 1)
    mesh.GetAccelerationsAttr().Set([Gf.Vec3f(0, 0, 2 * 24 * 24)] * 4, 1)
    np.testing.assert_allclose(only(small.open().at(Shutter(1, 1, 2))).motions[:, 2], 1.0)


@pytest.mark.parametrize("left_handed", [False, True])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_the_front_stays_outside_whatever_the_handedness(small, left_handed, mirror):
    """The outside of the square is where its authored orientation says, carried by the transform."""
    mesh = small.mesh()
    mesh.CreateOrientationAttr("leftHanded" if left_handed else "rightHanded")
    mesh.AddScaleOp().Set((mirror, 1, 1))
    expected = -UP if left_handed else UP
    np.testing.assert_allclose(face_normals(only(small.open().at(Shutter.still(1)))), [expected, expected], atol=1e-15)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_authored_normals_agree_with_the_front_under_any_transform(small, mirror):
    mesh = small.mesh()
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, 2)] * 4)
    mesh.AddRotateXYZOp().Set((20, 30, 40))
    mesh.AddScaleOp().Set((mirror * 2, 1, 0.5))
    found = only(small.open().at(Shutter.still(1)))
    np.testing.assert_allclose(found.normals[found.normal_indices[:, 0]], face_normals(found), atol=1e-6)


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "faceVarying", "uniform", "constant"])
@pytest.mark.parametrize("indexed", [False, True])
def test_normals_of_every_interpolation_reach_their_corners(small, interpolation, indexed):
    mesh = small.mesh(counts=(3, 3), indices=(0, 1, 2, 0, 2, 3))
    count = {"vertex": 4, "varying": 4, "faceVarying": 6, "uniform": 2, "constant": 1}[interpolation]
    rng = np.random.default_rng(2)
    values = rng.normal(size=(count, 3)).astype(np.float32)
    values[:, 2] = abs(values[:, 2])
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, interpolation)
    order = rng.permutation(count) if indexed else np.arange(count)
    stored = np.empty_like(values)
    stored[order] = values
    primvar.Set([Gf.Vec3f(*map(float, v)) for v in stored])
    if indexed:
        primvar.SetIndices(order.tolist())
    mesh.CreateNormalsAttr([Gf.Vec3f(1, 0, 0)] * 4)
    found = only(small.open().at(Shutter.still(1)))
    element = {
        "vertex": [[0, 1, 2], [0, 2, 3]],
        "varying": [[0, 1, 2], [0, 2, 3]],
        "faceVarying": [[0, 1, 2], [3, 4, 5]],
        "uniform": [[0, 0, 0], [1, 1, 1]],
        "constant": [[0, 0, 0], [0, 0, 0]],
    }[interpolation]
    expected = values[np.array(element)].astype(float)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(found.normals[found.normal_indices], expected, atol=1e-12)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_normals_against_the_winding_are_turned_to_the_front_and_said(small, mirror):
    mesh = small.mesh(counts=(3, 3), indices=(0, 1, 2, 2, 3, 0))
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, -1), Gf.Vec3f(0, 0, 1), Gf.Vec3f(0, 0.6, -0.8), Gf.Vec3f(0, 0, 1)])
    mesh.AddScaleOp().Set((mirror, 1, 1))
    scene = small.open()
    found = only(scene.at(Shutter.still(1)))
    np.testing.assert_allclose(found.normals, [[0, 0, 1], [0, 0, 1], [0, -0.6, 0.8], [0, 0, 1]], atol=1e-7)
    assert [m for m in scene.warnings.messages if "/Mesh.normals: " in m] == scene.warnings.messages != []


def test_one_normal_for_a_closed_body_is_left_as_it_is(small):
    tetrahedron = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    mesh = small.mesh(points=tetrahedron, counts=(3,) * 4, indices=(0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3))
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, 1)])
    mesh.SetNormalsInterpolation("constant")
    scene = small.open()
    np.testing.assert_array_equal(only(scene.at(Shutter.still(1))).normals, [[0, 0, 1]])
    assert scene.warnings.messages == []


def test_indices_of_normals_may_change_with_time(small):
    mesh = small.mesh()
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, "vertex")
    primvar.GetAttr().Set([Gf.Vec3f(0, 0, 1)], 1)
    primvar.GetAttr().Set([Gf.Vec3f(0, 0, 1), Gf.Vec3f(0, 1, 0)], 2)
    primvar.CreateIndicesAttr().Set([0, 0, 0, 0], 1)
    primvar.GetIndicesAttr().Set([0, 1, 0, 1], 2)
    found = only(small.open().at(Shutter(1, 1, 2)))
    np.testing.assert_allclose(found.normal_motions[1], [0, 1, -1])
    np.testing.assert_array_equal(found.normal_motions[0], 0)
    np.testing.assert_array_equal(found.motions, 0)


def test_normal_motion_follows_a_rotation(small):
    mesh = small.mesh()
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, 1)] * 4)
    op = mesh.AddRotateXOp(UsdGeom.XformOp.PrecisionDouble)
    op.Set(0.0, 1)
    op.Set(40.0, 5)
    found = only(small.open().at(Shutter(2, 2, 3)))
    angle = [math.radians(a) for a in (10, 15, 20)]
    np.testing.assert_allclose(found.normals[0], [0, -math.sin(angle[1]), math.cos(angle[1])], atol=1e-12)
    change = [0, math.sin(angle[0]) - math.sin(angle[2]), math.cos(angle[2]) - math.cos(angle[0])]
    np.testing.assert_allclose(found.normal_motions[0], change, atol=1e-12)


def test_zero_normals_are_replaced_by_those_of_their_faces(small):
    small.moving("/Mesh", {1: CORNERS, 2: CORNERS @ [[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]]}).CreateNormalsAttr(
        [Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 0, 0), Gf.Vec3f(1, 0, 0), Gf.Vec3f(1, 0, 0)]
    )
    found = only(small.open().at(Shutter(1, 1, 2)))
    corner = found.normals[found.normal_indices]
    np.testing.assert_allclose(corner[0, 1], face_normals(found)[0], atol=1e-12)
    np.testing.assert_allclose(corner[0, 0], [1, 0, 0], atol=1e-15)
    # Float32 points put 0.6 and 0.8 off by 6e-8.
    np.testing.assert_allclose(found.normal_motions[found.normal_indices[0, 1]], [0, -0.6, -0.2], atol=1e-7)


def test_authored_normals_of_subdivision_surfaces_are_ignored_as_usd_asks(small):
    mesh = small.mesh(scheme="catmullClark")
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 1, 0)] * 4)
    scene = small.open()
    np.testing.assert_allclose(unit_normals_of(only(scene.at(Shutter.still(1)))), [[0, 0, 1]])
    assert scene.warnings.messages == []


def unit_normals_of(mesh):
    return np.unique(mesh.normals[mesh.normal_indices].reshape(-1, 3).round(12), axis=0)


def test_bilinear_surfaces_are_their_polygons(small):
    mesh = small.mesh(scheme="bilinear")
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 1, 0)] * 4)
    scene = small.open()
    found = only(scene.at(Shutter.still(1)))
    assert len(found.triangles) == 2 and found.normals is None and scene.warnings.messages == []


def test_polygons_without_normals_are_flat(small):
    small.mesh()
    found = only(small.open().at(Shutter.still(1)))
    assert found.normals is None and found.normal_indices is None


def test_normals_that_do_not_fit_are_said_and_ignored(small):
    small.mesh().CreateNormalsAttr([Gf.Vec3f(0, 0, 1)] * 3)
    scene = small.open()
    assert only(scene.at(Shutter.still(1))).normals is None
    assert any("/Mesh.normals" in m for m in scene.warnings.messages)


@pytest.mark.parametrize(
    ("attribute", "change"),
    [
        ("points", {"points": [(0, 0, 0), (1, 0, 0), (math.nan, 1, 0), (0, 1, 0)]}),
        ("points", {"points": [(0, 0, 0), (1, 0, 0), (math.inf, 1, 0), (0, 1, 0)]}),
        ("faceVertexIndices", {"indices": (0, 1, 2, 9)}),
        ("faceVertexIndices", {"indices": (0, 1, 2, -1)}),
        ("faceVertexCounts", {"counts": (3,)}),
        ("faceVertexCounts", {"counts": (5, -1)}),
    ],
)
def test_broken_geometry_is_left_out_and_said_by_file_prim_and_attribute(small, attribute, change):
    small.mesh("/World/Broken", **change)
    assert left_out(small.open(), 1).startswith(f"{small.file}: /World/Broken.{attribute}: ")


def left_out(scene, time):
    """What is said of the only mesh, which is left out at a time."""
    assert scene.at(Shutter.still(time)).meshes == ()
    (line,) = scene.warnings.messages
    assert line.endswith("until then the mesh is left out")
    return line


def test_broken_points_are_left_out_only_by_the_frames_that_need_them(small):
    bad = CORNERS.copy()
    bad[0, 0] = math.nan
    small.moving("/Mesh", {1: CORNERS, 2: CORNERS, 5: bad})
    scene = small.open()
    assert len(scene.at(Shutter.still(1.5)).meshes) == 1 and scene.warnings.messages == []
    assert "at time code 5" in left_out(scene, 4)


def test_too_few_points_at_one_time_are_left_out_then(small):
    small.moving("/Mesh", {1: CORNERS, 2: CORNERS[:3]})
    scene = small.open()
    assert len(scene.at(Shutter.still(1)).meshes) == 1
    assert "/Mesh.faceVertexIndices" in left_out(scene, 2)


def test_a_mesh_of_an_infinite_transform_is_left_out(small):
    small.mesh().AddTranslateOp().Set((math.inf, 0, 0))
    assert "/Mesh: its transform" in left_out(small.open(), 1)


@pytest.mark.parametrize("change", [{"points": ()}, {"points": None}, {"counts": (), "indices": ()}])
def test_empty_meshes_are_left_out_and_said_once(small, change):
    small.mesh("/Empty", **{"counts": (), "indices": (), **change})
    small.mesh("/Full")
    scene = small.open()
    assert [m.path for m in scene.at(Shutter.still(1)).meshes] == ["/Full"]
    scene.at(Shutter.still(2))
    assert len([m for m in scene.warnings.messages if "/Empty" in m]) == 1


def test_visibility_is_asked_at_the_frame(small):
    small.mesh("/Always")
    parent = UsdGeom.Xform.Define(small.stage, "/Parent")
    small.mesh("/Parent/Sometimes")
    parent.CreateVisibilityAttr().Set("invisible", 1)
    parent.GetVisibilityAttr().Set("inherited", 3)
    scene = small.open()
    assert [len(scene.at(Shutter.still(t)).meshes) for t in (1, 2, 3, 4)] == [1, 1, 2, 2]
    assert len(scene.reference_shutters()) == 9


def test_priorities_are_inherited_and_must_be_whole_numbers(small):
    xform = UsdGeom.Xform.Define(small.stage, "/glass")
    small.mesh("/glass/ice", SQUARE)
    small.mesh("/water", SQUARE)
    UsdGeom.PrimvarsAPI(xform.GetPrim()).CreatePrimvar(PRIORITY, Sdf.ValueTypeNames.Int).Set(2)
    primvars = UsdGeom.PrimvarsAPI(small.stage.GetPrimAtPath("/water"))
    primvars.CreatePrimvar(PRIORITY, Sdf.ValueTypeNames.Float).Set(1.5)
    opened = small.open()
    found = {mesh.path: mesh.priority for mesh in opened.at(Shutter(1, 1, 2)).meshes}
    assert found == {"/glass/ice": 2, "/water": 0}
    assert sum("author an int" in line for line in opened.warnings.messages) == 1
