"""Instances: native and point instances stand and move where USD puts them."""

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom

from tests.usd.stages import SQUARE, SmallStage, mesh_named
from tpdwarp.errors import InputError
from tpdwarp.scene.description import Shutter

CORNERS = np.array(SQUARE)


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def instancer(small, positions=((0, 0, 0), (5, 0, 0)), prototypes=("/Many/Ball",), path="/Many"):
    many = UsdGeom.PointInstancer.Define(small.stage, path)
    many.GetPrototypesRel().SetTargets([Sdf.Path(p) for p in prototypes])
    many.CreateProtoIndicesAttr([0] * len(positions))
    many.CreatePositionsAttr([Gf.Vec3f(*p) for p in positions])
    return many


def test_native_instances_share_a_shape_and_keep_their_own_place(small):
    small.mesh("/Library/Thing/Mesh")
    small.stage.GetPrimAtPath("/Library").SetSpecifier(Sdf.SpecifierClass)
    for k in range(2):
        xform = UsdGeom.Xform.Define(small.stage, f"/Instance{k}")
        xform.GetPrim().GetReferences().AddInternalReference("/Library/Thing")
        xform.GetPrim().SetInstanceable(True)
        op = xform.AddTranslateOp()
        op.Set((k, 0, 0), 1)
        op.Set((k, 0, 4.0 * k), 5)
    scene = small.open().at(Shutter(1, 1, 2))
    assert [m.path for m in scene.meshes] == ["/Instance0/Mesh", "/Instance1/Mesh"]
    np.testing.assert_allclose(scene.meshes[1].points, CORNERS + np.array([1, 0, 0.5]))
    np.testing.assert_allclose(scene.meshes[1].motions, np.tile([0, 0, 1.0], (4, 1)))
    assert scene.meshes[0].motions is None
    assert scene.meshes[0].triangles is scene.meshes[1].triangles


def test_point_instances_are_placed_and_named_by_index(small):
    many = instancer(small)
    many.AddTranslateOp().Set((0, 10, 0))
    ball = small.mesh("/Many/Ball")
    ball.AddTranslateOp().Set((0, 0, 1))
    scene = small.open().at(Shutter.still(1))
    assert [m.path for m in scene.meshes] == ["/Many[0]/Ball", "/Many[1]/Ball"]
    np.testing.assert_allclose(scene.meshes[1].points, CORNERS + np.array([5, 10, 1]))


def test_orientation_and_scale_of_instances_are_usds(small):
    many = instancer(small)
    small.mesh("/Many/Ball")
    many.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0), Gf.Quath(0, 0, 0, 1)])
    many.CreateScalesAttr([Gf.Vec3f(1, 1, 1), Gf.Vec3f(2, 2, -2)])
    found = mesh_named(small.open().at(Shutter.still(1)), "/Many[1]/Ball")
    np.testing.assert_allclose(found.points, CORNERS * [-2, -2, -2] + [5, 0, 0], atol=1e-6)
    # Mirrored: the triangles are turned so that the front stays where it was.
    assert found.triangles.tolist() == [[0, 2, 1], [0, 3, 2]]


@pytest.mark.parametrize("cubic", [False, True])
def test_instances_move_between_samples_and_past_the_end(small, cubic):
    many = instancer(small)
    small.mesh("/Many/Ball")
    for time in (1, 2, 3, 4, 5):
        many.GetPositionsAttr().Set([Gf.Vec3f(0, 0, 0), Gf.Vec3f(5, 0, 2 * time)], time)
    scene = small.open(motion="cubic" if cubic else "linear")
    for frame in (2, 5):
        found = scene.at(Shutter(frame, frame, frame + 1))
        moving = mesh_named(found, "/Many[1]/Ball")
        np.testing.assert_allclose(moving.points[0], [5, 0, 2 * frame + 1], rtol=1e-6)
        # USD computes instances in single precision: 1e-6 of positions of order 10, over a step of 2e-3.
        np.testing.assert_allclose(moving.motions[:, 2], 2.0, rtol=1e-2 if cubic else 1e-6)
        assert mesh_named(found, "/Many[0]/Ball").motions is None
    assert len(scene.reference_shutters()) == 9


def test_instances_move_along_velocities(small):
    many = instancer(small, positions=())
    small.mesh("/Many/Ball")
    many.GetProtoIndicesAttr().Set([0], 1)
    many.GetProtoIndicesAttr().Set([0, 0], 2)
    many.GetPositionsAttr().Set([Gf.Vec3f(0, 0, 0)], 1)
    many.GetPositionsAttr().Set([Gf.Vec3f(0, 0, 1), Gf.Vec3f(5, 0, 0)], 2)
    many.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 24)], 1)
    many.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 24), Gf.Vec3f(0, 24, 0)], 2)
    scene = small.open()
    first = scene.at(Shutter(1, 1, 2))
    assert len(first.meshes) == 1
    np.testing.assert_allclose(first.meshes[0].motions, np.tile([0, 0, 1.0], (4, 1)), rtol=1e-6)
    np.testing.assert_allclose(scene.at(Shutter(2, 1, 2)).meshes[1].motions, np.tile([0, 1.0, 0], (4, 1)), rtol=1e-6)


def test_instances_fly_on_by_velocities_where_the_animation_is_one_moment(small):
    many = instancer(small, positions=())
    small.mesh("/Many/Ball")
    many.CreateProtoIndicesAttr([0])
    many.GetPositionsAttr().Set([Gf.Vec3f(0, 0, 1)], 1)
    many.GetVelocitiesAttr().Set([Gf.Vec3f(48, 0, 0)], 1)
    small.stage.SetStartTimeCode(1)
    small.stage.SetEndTimeCode(1)
    wanted = many.ComputeInstanceTransformsAtTime(1.5, 1)[0].ExtractTranslation()
    (found,) = small.open().at(Shutter(1, 1, 2)).meshes
    np.testing.assert_allclose(found.points, CORNERS + np.array(wanted), atol=1e-6)
    np.testing.assert_allclose(found.motions, np.tile([2.0, 0, 0], (4, 1)), atol=1e-6)


def test_instances_that_change_in_number_without_velocities_are_held_and_said(small):
    many = instancer(small, positions=())
    small.mesh("/Many/Ball")
    for time, count in ((1, 1), (2, 2)):
        many.GetProtoIndicesAttr().Set([0] * count, time)
        many.GetPositionsAttr().Set([Gf.Vec3f(0, 0, time)] * count, time)
    scene = small.open()
    found = scene.at(Shutter(1, 1, 2))
    assert len(found.meshes) == 1 and found.meshes[0].motions is None
    assert any("/Many" in m and "velocities" in m for m in scene.warnings.messages)


def test_masked_instances_are_left_out_and_the_others_keep_their_index(small):
    many = instancer(small, positions=((0, 0, 0), (1, 0, 0), (2, 0, 0)))
    small.mesh("/Many/Ball")
    many.CreateIdsAttr([10, 20, 30])
    many.CreateInvisibleIdsAttr().Set([20])
    many.DeactivateId(10)
    assert [m.path for m in small.open().at(Shutter.still(1)).meshes] == ["/Many[2]/Ball"]


def test_nested_instancers_multiply(small):
    instancer(small, ((0, 0, 0), (100, 0, 0)), ("/Many/Group",))
    UsdGeom.Xform.Define(small.stage, "/Many/Group").AddTranslateOp().Set((0, 10, 0))
    instancer(small, ((0, 0, 1), (0, 0, 2)), ("/Many/Group/Inner/Ball",), "/Many/Group/Inner")
    small.mesh("/Many/Group/Inner/Ball")
    scene = small.open().at(Shutter.still(1))
    assert [m.path for m in scene.meshes] == [f"/Many[{i}]/Group/Inner[{k}]/Ball" for i in range(2) for k in range(2)]
    np.testing.assert_allclose(scene.meshes[3].points, CORNERS + np.array([100, 10, 2]))


def test_abstract_prototypes_are_drawn_only_where_they_are_instanced(small):
    small.mesh("/Library/Ball")
    small.stage.GetPrimAtPath("/Library").SetSpecifier(Sdf.SpecifierClass)
    instancer(small, prototypes=("/Library/Ball",))
    assert [m.path for m in small.open().at(Shutter.still(1)).meshes] == ["/Many[0]/Ball", "/Many[1]/Ball"]


def test_prototypes_that_an_over_hides_are_drawn_only_where_they_are_instanced(small):
    instancer(small, prototypes=("/Hidden/Inner",), path="/Outer")
    instancer(small, positions=((0, 0, 0), (0, 5, 0)), prototypes=("/Hidden/Ball",), path="/Hidden/Inner")
    small.mesh("/Hidden/Ball/Mesh")
    small.stage.GetPrimAtPath("/Hidden").SetSpecifier(Sdf.SpecifierOver)
    found = small.open().at(Shutter.still(1)).meshes
    assert [mesh.path for mesh in found] == [f"/Outer[{k}]/Inner[{j}]/Ball/Mesh" for k in (0, 1) for j in (0, 1)]
    np.testing.assert_allclose(found[3].points, CORNERS + np.array([5, 5, 0]))


def test_still_instances_are_the_same_objects_again(small):
    instancer(small)
    small.mesh("/Many/Ball")
    scene = small.open()
    first, second = scene.at(Shutter(1, 1, 2)).meshes, scene.at(Shutter(3, 3, 4)).meshes
    assert all(a is b for a, b in zip(first, second, strict=True))


def test_positions_that_do_not_fit_leave_the_instancer_out(small):
    many = instancer(small)
    small.mesh("/Many/Ball")
    small.mesh("/Floor")
    many.GetPositionsAttr().Set([(0, 0, 0)])
    scene = small.open()
    assert [m.path for m in scene.at(Shutter.still(1)).meshes] == ["/Floor"]
    assert len([m for m in scene.warnings.messages if "/Many.positions: " in m]) == 1


@pytest.mark.parametrize("wrong", [3, -1])
def test_instances_of_prototypes_that_do_not_exist_are_left_out(small, wrong):
    many = instancer(small)
    small.mesh("/Many/Ball")
    many.GetProtoIndicesAttr().Set([0, wrong])
    scene = small.open()
    assert [m.path for m in scene.at(Shutter.still(1)).meshes] == ["/Many[0]/Ball"]
    assert len([m for m in scene.warnings.messages if "/Many.protoIndices: " in m]) == 1


def test_an_instancer_without_prototypes_is_left_out(small):
    instancer(small).GetPrototypesRel().SetTargets([])
    small.mesh("/Floor")
    scene = small.open()
    assert [m.path for m in scene.at(Shutter.still(1)).meshes] == ["/Floor"]
    assert len([m for m in scene.warnings.messages if "/Many: has no prototypes" in m]) == 1


def test_only_the_instance_whose_place_is_no_number_is_left_out(small):
    many = instancer(small)
    small.mesh("/Many/Ball")
    many.GetPositionsAttr().Set([(float("nan"), 0, 0), (1, 0, 0)])
    assert [m.path for m in small.open().at(Shutter.still(1)).meshes] == ["/Many[1]/Ball"]


def crowd(small, count=300):
    """Instances of two prototypes that move; some are mirrored, and each has a colour of its own."""
    rng = np.random.default_rng(3)
    many = instancer(small, positions=(), prototypes=("/Many/Ball", "/Many/Box"))
    many.AddTranslateOp().Set((0, 10, 0))
    small.mesh("/Many/Ball").AddTranslateOp().Set((0, 0, 1))
    box = small.mesh("/Many/Box")
    box.CreateNormalsAttr([Gf.Vec3f(0, 0, 1), Gf.Vec3f(1, 0, 1)] * 2)
    many.GetProtoIndicesAttr().Set(rng.integers(0, 2, count).tolist())
    for time in (1, 3):
        many.GetPositionsAttr().Set([Gf.Vec3f(*p) for p in rng.normal(size=(count, 3))], time)
    many.CreateScalesAttr([Gf.Vec3f(-1 if k % 3 else 1, 1, 1 + k % 2) for k in range(count)])
    primvar = UsdGeom.PrimvarsAPI(many).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex")
    primvar.Set([Gf.Vec3f(*c) for c in rng.random((count, 3))])
    return many


def test_many_instances_together_stand_and_move_where_usd_puts_each(small):
    many = crowd(small)
    scene = small.open().at(Shutter(1, 1, 2))
    assert len(scene.meshes) == 4
    found = {mesh.path: mesh for mesh in scene.objects()}
    opening, closing = (np.array(many.ComputeInstanceTransformsAtTime(time, 1)) for time in (1, 2))
    for index, number in enumerate(many.GetProtoIndicesAttr().Get()):
        mesh = found.pop(f"/Many[{index}]/{('Ball', 'Box')[number]}")
        before, after = (CORNERS @ m[index, :3, :3] + m[index, 3, :3] + [0, 10, 0] for m in (opening, closing))
        # USD computes instances in single precision.
        np.testing.assert_allclose(mesh.points, 0.5 * (before + after), atol=1e-5)
        np.testing.assert_allclose(mesh.motions, after - before, atol=1e-5)
    assert not found


def test_many_instances_together_look_as_each_does_alone(small):
    crowd(small)
    together = small.open()
    alone = [mesh for of in together._instancers for placed in of.apart(1) if (mesh := placed.over(Shutter(1, 1, 2)))]
    found = {mesh.path: mesh for mesh in together.at(Shutter(1, 1, 2)).objects()}
    assert len(alone) == len(found)
    for mesh in alone:
        other = found[mesh.path]
        np.testing.assert_array_equal(other.triangles, mesh.triangles)
        np.testing.assert_array_equal(other.points, mesh.points)
        np.testing.assert_array_equal(other.colors[other.color_indices], mesh.colors[mesh.color_indices])
        if mesh.normals is not None:
            np.testing.assert_array_equal(other.normals[other.normal_indices], mesh.normals[mesh.normal_indices])
        assert other.materials == mesh.materials


def test_of_many_only_the_instance_whose_place_is_no_number_is_left_out(small):
    many = crowd(small)
    positions = list(many.GetPositionsAttr().Get(1))
    positions[7] = Gf.Vec3f(float("nan"), 0, 0)
    many.GetPositionsAttr().Clear()
    many.GetPositionsAttr().Set(positions)
    scene = small.open()
    paths = [mesh.path for mesh in scene.at(Shutter.still(1)).objects()]
    assert len(paths) == 299 and not any(path.startswith("/Many[7]") for path in paths)
    assert len([m for m in scene.warnings.messages if "/Many[7]" in m]) == 1


def test_glass_instances_stay_apart_however_many(small):
    instancer(small, positions=[(k, 0, 0) for k in range(80)])
    small.preview("/Glass", opacity=0.0, ior=1.5)
    small.bind(small.mesh("/Many/Ball"), "/Glass")
    meshes = small.open().at(Shutter.still(1)).meshes
    assert len(meshes) == 80 and not any(mesh.copies for mesh in meshes)


def test_an_instancer_counts_as_geometry_and_an_empty_one_does_not(small):
    instancer(small)
    with pytest.raises(InputError, match="no visible mesh"):
        small.open()
    small.mesh("/Many/Ball")
    assert len(small.open().at(Shutter.still(1)).meshes) == 2


@pytest.mark.parametrize("hidden", ["itself", "ancestor", "prototype"])
def test_instances_of_what_is_invisible_are_not_drawn(small, hidden):
    small.mesh("/Floor")
    small.mesh("/Library/Ball")
    UsdGeom.Xform.Define(small.stage, "/Group")
    many = UsdGeom.PointInstancer.Define(small.stage, "/Group/Many")
    many.CreatePrototypesRel().SetTargets(["/Library/Ball"])
    many.CreateProtoIndicesAttr([0])
    many.CreatePositionsAttr([Gf.Vec3f(1, 0, 0)])
    small.stage.GetPrimAtPath("/Library").SetSpecifier(Sdf.SpecifierClass)
    paths = {"itself": "/Group/Many", "ancestor": "/Group", "prototype": "/Library/Ball"}
    visibility = UsdGeom.Imageable(small.stage.GetPrimAtPath(paths[hidden])).CreateVisibilityAttr()
    visibility.Set("invisible", 1)
    visibility.Set("inherited", 3)
    scene = small.open()
    drawn = [[m.path for m in scene.at(Shutter.still(time)).meshes] for time in (2, 3)]
    assert drawn == [["/Floor"], ["/Floor", "/Group/Many[0]/Ball"]]
    assert len(scene.reference_shutters()) > 1


def test_prototypes_below_an_invisible_scope_are_drawn_where_they_are_placed(small):
    UsdGeom.Scope.Define(small.stage, "/Library").CreateVisibilityAttr("invisible")
    small.mesh("/Library/Ball")
    instancer(small, prototypes=("/Library/Ball",))
    assert [m.path for m in small.open().at(Shutter.still(1)).meshes] == ["/Many[0]/Ball", "/Many[1]/Ball"]


def test_colours_authored_by_instance_are_those_of_the_instances(small):
    many = instancer(small)
    small.mesh("/Many/Ball")
    primvar = UsdGeom.PrimvarsAPI(many).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex")
    for time, (first, second) in {1: (0, 1), 5: (1, 0)}.items():
        primvar.Set([Gf.Vec3f(first, 0, 0), Gf.Vec3f(0, second, 0)], time)
    scene = small.open()
    for time, (first, second) in {1: (0, 1), 2: (0.25, 0.75)}.items():
        a, b = scene.at(Shutter.still(time)).meshes
        np.testing.assert_allclose(a.colors[a.color_indices], np.broadcast_to([first, 0, 0], (2, 3, 3)))
        np.testing.assert_allclose(b.colors[b.color_indices], np.broadcast_to([0, second, 0], (2, 3, 3)))


def test_a_colour_of_the_prototypes_own_comes_first(small):
    many = instancer(small)
    small.mesh("/Many/Ball").CreateDisplayColorAttr([Gf.Vec3f(0, 0, 1)])
    primvar = UsdGeom.PrimvarsAPI(many).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex")
    primvar.Set([Gf.Vec3f(1, 0, 0)] * 2)
    for mesh in small.open().at(Shutter.still(1)).meshes:
        np.testing.assert_array_equal(mesh.colors, [[0, 0, 1]])


def test_an_opacity_for_display_is_how_much_is_there_unless_a_material_says(small):
    small.mesh().CreateDisplayOpacityAttr([0.5])
    small.preview("/Plastic", diffuseColor=(1.0, 0.0, 0.0))
    bound = small.mesh("/Bound")
    bound.CreateDisplayOpacityAttr([0.25])
    small.bind(bound, "/Plastic")
    uneven = small.mesh("/Uneven")
    UsdGeom.PrimvarsAPI(uneven).CreatePrimvar("displayOpacity", Sdf.ValueTypeNames.FloatArray, "vertex").Set(
        [0.0, 0.5, 0.5, 1.0]
    )
    scene = small.open()
    found = {mesh.path: mesh.materials[0].presence for mesh in scene.at(Shutter.still(1)).meshes}
    assert found == {"/Mesh": 0.5, "/Bound": 1.0, "/Uneven": 0.5}
    assert len(scene.warnings.messages) == 1 and "/Uneven.primvars:displayOpacity" in scene.warnings.messages[0]
