"""Skeletons and blend shapes: a skinned stage is what ``UsdSkel.BakeSkinning`` makes of it."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from tests.usd.stages import SmallStage, mesh_named
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

# UsdSkel works in single precision: a few units in the last place of coordinates up to 4.
POSITION = 2e-6
NORMAL = 1e-6
TIMES = (1.0, 2.0, 4.0)
SHUTTERS = (Shutter.still(1), Shutter.still(3.3), Shutter(2, 2, 2.5), Shutter(3, 2.5, 3.5))
COLUMN = [(x, y, z) for y in (0.0, 1.0, 2.0, 3.0) for x, z in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
SIDES = [
    4 * y + corner
    for y in range(3)
    for s in range(4)
    for corner in (s, s + 4, (s + 1) % 4 + 4, (s + 1) % 4)
]


def vectors(rows):
    return Vt.Vec3fArray([Gf.Vec3f(*map(float, row)) for row in rows])


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def skeleton(small, turns=True):
    """A skeleton of two joints whose upper one bends, below a moving root."""
    root = UsdSkel.Root.Define(small.stage, "/Root")
    move = root.AddTranslateOp()
    for time in (1, 5):
        move.Set(Gf.Vec3d(0.3 * time, 0, 0), time)
    found = UsdSkel.Skeleton.Define(small.stage, "/Root/Skeleton")
    found.AddRotateYOp().Set(30.0)
    found.CreateJointsAttr(["low", "low/high"])
    rest = [Gf.Matrix4d(1), Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 1.5, 0))]
    found.CreateBindTransformsAttr(rest)
    found.CreateRestTransformsAttr(rest)
    animation = UsdSkel.Animation.Define(small.stage, "/Root/Animation")
    animation.CreateJointsAttr(["low", "low/high"])
    animation.CreateTranslationsAttr(vectors([(0, 0, 0), (0, 1.5, 0)]))
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1), Gf.Vec3h(1, 1.2, 1)]))
    rotations = animation.CreateRotationsAttr()
    for time in TIMES if turns else TIMES[:1]:
        bend = Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), 20.0 * time).GetQuat())
        rotations.Set(Vt.QuatfArray([Gf.Quatf(1), bend]), time)
    UsdSkel.BindingAPI.Apply(found.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return found, animation


def bound(small, path="/Root/Mesh", influences=None, scheme="none"):
    """A column bound to the skeleton, its points by their height."""
    mesh = small.mesh(path, COLUMN, [4] * 12, SIDES, scheme)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/Root/Skeleton"])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d().SetTranslate(Gf.Vec3d(0.1, 0, -0.2)))
    if influences is None:
        upper = np.clip([p[1] / 3 for p in COLUMN], 0, 1)
        binding.CreateJointIndicesPrimvar(False, 2).Set(Vt.IntArray([0, 1] * len(COLUMN)))
        weights = np.stack([1 - upper, upper], axis=1).ravel()
        binding.CreateJointWeightsPrimvar(False, 2).Set(Vt.FloatArray(weights.tolist()))
    else:
        binding.CreateJointIndicesPrimvar(True, 1).Set(Vt.IntArray([influences]))
        binding.CreateJointWeightsPrimvar(True, 1).Set(Vt.FloatArray([1.0]))
    UsdGeom.Xformable(mesh).AddTranslateOp().Set(Gf.Vec3d(0, 0, 0.4))
    return mesh, binding


def blended(small, animation, mesh, binding):
    """Two blend shapes, the second with an in-between, weighted over time."""
    names = ["wide", "tall"]
    animation.CreateBlendShapesAttr(names)
    weights = animation.CreateBlendShapeWeightsAttr()
    for time in TIMES:
        weights.Set(Vt.FloatArray([0.2 * time, 0.25 * time]), time)
    wide = UsdSkel.BlendShape.Define(small.stage, f"{mesh.GetPath()}/wide")
    wide.CreateOffsetsAttr(vectors([(x, 0, 0) for x, _, _ in COLUMN]))
    wide.CreateNormalOffsetsAttr(vectors([(0, 0.5, 0)] * len(COLUMN)))
    tall = UsdSkel.BlendShape.Define(small.stage, f"{mesh.GetPath()}/tall")
    tall.CreateOffsetsAttr(vectors([(0, 1, 0)] * 4))
    tall.CreatePointIndicesAttr([12, 13, 14, 15])
    half = tall.CreateInbetween("half")
    half.SetWeight(0.5)
    half.SetOffsets(vectors([(0, 0.7, 0.3)] * 4))
    binding.CreateBlendShapesAttr(names)
    binding.CreateBlendShapeTargetsRel().SetTargets([wide.GetPath(), tall.GetPath()])


def agree(small, paths=("/Root/Mesh",), words=0, **settings):
    """Compares the stage with its baked self over several shutters."""
    ours = small.open(**settings)
    file = small.file.replace("scene.usda", "baked.usda")
    small.stage.Export(file)
    baked = Usd.Stage.Open(file)
    UsdSkel.BakeSkinning(baked.Traverse())
    baked.Save()
    theirs = StageScene.open(file, Settings(**settings))
    for shutter in SHUTTERS:
        ours_now, theirs_now = ours.at(shutter), theirs.at(shutter)
        for path in paths:
            mine, other = mesh_named(ours_now, path), mesh_named(theirs_now, path)
            np.testing.assert_allclose(mine.points, other.points, atol=POSITION)
            np.testing.assert_array_equal(mine.triangles, other.triangles)
            assert (mine.motions is None) == (other.motions is None)
            if mine.motions is not None:
                np.testing.assert_allclose(mine.motions, other.motions, atol=2 * POSITION)
            if mine.normals is not None:
                shading, baked_shading = (m.normals[m.normal_indices] for m in (mine, other))
                np.testing.assert_allclose(shading, baked_shading, atol=NORMAL)
    assert len(ours.warnings.messages) == words
    return ours


def test_a_bent_column_is_what_baking_makes_of_it(small):
    skeleton(small)
    bound(small)
    ours = agree(small)
    # It does bend: the top leans over by more than its rest position has.
    top = mesh_named(ours.at(Shutter.still(4)), "/Root/Mesh").points[12:].mean(axis=0)
    rest = np.mean(COLUMN[12:], axis=0)
    assert np.linalg.norm(top - rest) > 1


def test_a_subdivided_column_is_what_baking_makes_of_it(small):
    skeleton(small)
    bound(small, scheme="catmullClark")
    agree(small)


def test_one_joint_for_all_points_moves_them_rigidly_as_baking_does(small):
    skeleton(small)
    bound(small, influences=1)
    # Baking writes a transform here: its linear interpolation is not that of points, but at samples they agree.
    ours = small.open()
    file = small.file.replace("scene.usda", "baked.usda")
    small.stage.Export(file)
    baked = Usd.Stage.Open(file)
    UsdSkel.BakeSkinning(baked.Traverse())
    baked.Save()
    theirs = StageScene.open(file, Settings())
    for time in TIMES:
        mine, other = (mesh_named(s.at(Shutter.still(time)), "/Root/Mesh") for s in (ours, theirs))
        np.testing.assert_allclose(mine.points, other.points, atol=POSITION)


def test_dual_quaternions_are_as_in_baking(small):
    skeleton(small)
    _, binding = bound(small)
    binding.CreateSkinningMethodAttr(UsdSkel.Tokens.dualQuaternion)
    agree(small)


@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying"])
def test_authored_normals_are_skinned_as_in_baking(small, interpolation):
    skeleton(small)
    mesh, _ = bound(small)
    outward = [(x, 0.3, z) for x, _, z in COLUMN]
    mesh.CreateNormalsAttr(vectors(outward if interpolation == "vertex" else [outward[k] for k in SIDES]))
    mesh.SetNormalsInterpolation(interpolation)
    agree(small)


def test_blend_shapes_with_inbetweens_are_as_in_baking(small):
    _, animation = skeleton(small)
    mesh, binding = bound(small)
    mesh.CreateNormalsAttr(vectors([(x, 0.3, z) for x, _, z in COLUMN]))
    mesh.SetNormalsInterpolation("vertex")
    blended(small, animation, mesh, binding)
    agree(small)


def test_joints_in_another_order_are_mapped(small):
    skeleton(small)
    _, binding = bound(small)
    binding.CreateJointsAttr(["low/high", "low"])
    agree(small)


def test_a_pose_that_never_changes_is_still(small):
    skeleton(small, turns=False)
    bound(small)
    scene = agree(small)
    small.stage.GetPrimAtPath("/Root").GetAttribute("xformOp:translate").Clear()
    assert scene is not None
    still = small.open()
    assert mesh_named(still.at(Shutter(2, 2, 3)), "/Root/Mesh").motions is None
    assert still.frames() == (1.0,)


def test_motion_breaks_at_frames_and_where_the_skeleton_has_samples(small):
    skeleton(small)
    bound(small)
    assert small.open().motion_breaks(Shutter(2, 1.5, 4.5)) == [2.0, 3.0, 4.0]


def test_instances_have_the_poses_of_their_own_skeletons(small):
    skeleton(small)
    bound(small)
    for k, path in enumerate(("/A", "/B")):
        UsdGeom.Xform.Define(small.stage, path).AddTranslateOp().Set(Gf.Vec3d(0, 0, 5 * k))
        prim = small.stage.DefinePrim(f"{path}/Instance")
        prim.GetReferences().AddInternalReference("/Root")
        prim.SetInstanceable(True)
    scene = small.open().at(Shutter.still(3))
    rows = [mesh_named(scene, f"{path}/Instance/Mesh").points for path in ("/A", "/B")]
    original = mesh_named(scene, "/Root/Mesh").points
    np.testing.assert_allclose(rows[1] - rows[0], np.broadcast_to((0, 0, 5), rows[0].shape), atol=1e-12)
    np.testing.assert_allclose(rows[0] - rows[0][0], original - original[0], atol=POSITION)


def test_what_is_bound_outside_a_skel_root_is_not_skinned(small):
    skeleton(small)
    bound(small, path="/Alone")
    mesh = mesh_named(small.open().at(Shutter.still(3)), "/Alone")
    np.testing.assert_allclose(mesh.points, np.add(COLUMN, (0, 0, 0.4)), atol=POSITION)


@pytest.mark.parametrize("kind", ["Points", "BasisCurves"])
def test_points_and_curves_follow_their_skeleton_as_baking_has_it(small, kind):
    skeleton(small)
    prim = getattr(UsdGeom, kind).Define(small.stage, "/Root/Mesh")
    prim.CreatePointsAttr(vectors(COLUMN))
    prim.CreateWidthsAttr([0.1])
    prim.SetWidthsInterpolation("constant")
    if kind == "BasisCurves":
        prim.CreateTypeAttr("linear")
        prim.CreateCurveVertexCountsAttr([8, 8])
    binding = UsdSkel.BindingAPI.Apply(prim.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/Root/Skeleton"])
    upper = np.clip([p[1] / 3 for p in COLUMN], 0, 1)
    binding.CreateJointIndicesPrimvar(False, 2).Set(Vt.IntArray([0, 1] * len(COLUMN)))
    weights = np.stack([1 - upper, upper], axis=1).ravel()
    binding.CreateJointWeightsPrimvar(False, 2).Set(Vt.FloatArray(weights.tolist()))
    agree(small)
