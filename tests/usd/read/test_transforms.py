"""Transforms: USD's own where motion is linear, smooth where it is cubic, the same at the samples."""

import numpy as np
import pytest
from pxr import Gf, Ts, Usd, UsdGeom

from tpdwarp.errors import InputError
from tpdwarp.usd.read.transforms import Transforms, transform_points, union

ROTATIONS = ("X", "Y", "Z", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def stage_with_every_op():
    stage = Usd.Stage.CreateInMemory()
    parent = UsdGeom.Xform.Define(stage, "/Parent")
    for name in ("X", "Y", "Z", ""):
        value = 0.3 if name else Gf.Vec3d(1, 2, 3)
        for kind in ("Translate", "Scale"):
            op = getattr(parent, f"Add{kind}{name}Op")(UsdGeom.XformOp.PrecisionDouble, "own")
            for time in (1, 2, 4):
                op.Set(value * time, time)
    child = UsdGeom.Xform.Define(stage, "/Parent/Child")
    for order in ROTATIONS:
        op = getattr(child, f"AddRotate{order}Op")(UsdGeom.XformOp.PrecisionDouble, "own")
        for time in (1, 2, 4):
            op.Set(10.0 * time * time if len(order) == 1 else Gf.Vec3d(5, 7, 11) * time * time, time)
    pivot = child.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble, "pivot")
    pivot.Set(Gf.Vec3d(1, 0, 0), 1)
    pivot.Set(Gf.Vec3d(1, 3, 0), 4)
    child.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble, "pivot", isInverseOp=True)
    matrix = child.AddTransformOp()
    matrix.Set(Gf.Matrix4d(1), 1)
    matrix.Set(Gf.Matrix4d(2), 4)
    orient = child.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    orient.Set(Gf.Quatd(1, 0, 0, 0), 1)
    orient.Set(Gf.Quatd(0.6, 0, 0.8, 0), 4)
    return stage


def test_cubic_meets_usd_at_every_sample_of_every_op():
    stage = stage_with_every_op()
    child, parent = stage.GetPrimAtPath("/Parent/Child"), stage.GetPrimAtPath("/Parent")
    transforms = Transforms(cubic=True)
    for time in (1.0, 4.0):
        expected = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(child))
        np.testing.assert_allclose(transforms.world(child, time), expected, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(
            transforms.below(child, parent, time),
            np.array(UsdGeom.Xformable(child).GetLocalTransformation(time)),
            atol=1e-9,
        )


def test_linear_is_what_usd_computes():
    stage = stage_with_every_op()
    child = stage.GetPrimAtPath("/Parent/Child")
    expected = np.array(UsdGeom.XformCache(1.7).GetLocalToWorldTransform(child))
    np.testing.assert_array_equal(Transforms(cubic=False).world(child, 1.7), expected)


def test_cubic_follows_an_accelerating_translation_where_linear_cuts_the_corner():
    stage = Usd.Stage.CreateInMemory()
    xform = UsdGeom.Xform.Define(stage, "/X")
    op = xform.AddTranslateOp()
    for time in range(1, 6):
        op.Set(Gf.Vec3d(time * time, 0, 0), time)
    assert Transforms(cubic=True).world(xform.GetPrim(), 2.5)[3, 0] == pytest.approx(6.25, abs=1e-12)
    assert Transforms(cubic=False).world(xform.GetPrim(), 2.5)[3, 0] == 6.5


@pytest.mark.parametrize("cubic", [False, True])
def test_a_reset_stack_forgets_the_parents_and_their_motion(cubic):
    stage = stage_with_every_op()
    child = UsdGeom.Xform.Define(stage, "/Parent/Free")
    child.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    child.SetResetXformStack(True)
    transforms = Transforms(cubic)
    np.testing.assert_array_equal(transforms.world(child.GetPrim(), 2.0)[3, :3], [1, 2, 3])
    assert transforms.span(child.GetPrim()) is None


def test_span_covers_the_ancestors_samples_and_splines():
    stage = stage_with_every_op()
    transforms = Transforms(cubic=False)
    child, parent = stage.GetPrimAtPath("/Parent/Child"), stage.GetPrimAtPath("/Parent")
    assert transforms.span(child) == (1, 4)
    assert transforms.span(child, parent) == (1, 4)
    assert transforms.span(UsdGeom.Xform.Define(stage, "/Still").GetPrim()) is None
    moved = UsdGeom.Xform.Define(stage, "/Spline")
    spline = Ts.Spline("double")
    for time, value in ((1, 0.0), (10, 9.0)):
        spline.SetKnot(Ts.Knot("double", time=time, value=value, nextInterp=Ts.InterpLinear))
    moved.AddTranslateXOp().GetAttr().SetSpline(spline)
    assert transforms.span(moved.GetPrim()) == (1, 10)
    for cubic in (False, True):
        assert Transforms(cubic).world(moved.GetPrim(), 4.0)[3, 0] == pytest.approx(3.0, abs=1e-12)


def test_union_of_spans_holds_both():
    assert union(None, None) is None
    assert union((1, 2), None) == (1, 2)
    assert union((1, 2), (0, 1.5)) == (0, 2)


@pytest.mark.parametrize("cubic", [False, True])
@pytest.mark.parametrize(
    "parent, child, what",
    [
        ((float("nan"), 0, 0), (0, 0, 0), "NaN or infinity"),
        ((0, 0, 0), (0, float("inf"), 0), "NaN or infinity"),
        ((2e30, 0, 0), (0, 0, 0), "numbers beyond 1e+30"),
        ((0, 0, -0.6e30), (0, 0, -0.6e30), "numbers beyond 1e+30"),
    ],
)
def test_transforms_that_no_geometry_survives_are_refused_in_the_same_words(cubic, parent, child, what):
    stage = Usd.Stage.CreateInMemory()
    for path, value in (("/Parent", parent), ("/Parent/Child", child)):
        UsdGeom.Xform.Define(stage, path).AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*value))
    with pytest.raises(InputError) as caught:
        Transforms(cubic).world(stage.GetPrimAtPath("/Parent/Child"), 3.0)
    assert caught.value.prim in ("/Parent", "/Parent/Child")
    assert caught.value.message == f"its transform holds {what} at time code 3 (author finite xformOps)"


def test_points_are_carried_by_each_matrix_in_turn_as_usd_carries_them():
    points = np.random.default_rng(3).uniform(-1, 1, (5, 3))
    turned = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, 3), 40)) * Gf.Matrix4d().SetTranslate((4, 5, 6))
    matrices = np.array([np.array(turned), np.eye(4), 2 * np.eye(4)])
    matrices[2, 3, 3] = 1
    expected = [[turned.Transform(Gf.Vec3d(*point)) for point in points], points, 2 * points]
    np.testing.assert_allclose(transform_points(points, matrices), np.concatenate(expected), atol=1e-14)
    assert transform_points(points, matrices[1:2]) is points
