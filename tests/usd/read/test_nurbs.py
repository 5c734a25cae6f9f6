"""NURBS curves and patches against closed forms: circles, spheres, Bezier surfaces."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import UsdGeom, Vt

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.nurbs import fitting_knots, rational, spans

STILL = Shutter.still(1)
HALF = math.sqrt(0.5)
# A circle of nine control vertices of order 3 [Piegl and Tiller, The NURBS Book, example 7.3].
CIRCLE = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)], float)
CIRCLE_WEIGHTS = np.array([1, HALF, 1, HALF, 1, HALF, 1, HALF, 1])
CIRCLE_KNOTS = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], float)
# Half a circle in the plane of x and z, from pole to pole.
ARC = np.array([(0, -1), (1, -1), (1, 0), (1, 1), (0, 1)], float)
ARC_WEIGHTS = np.array([1, HALF, 1, HALF, 1])
ARC_KNOTS = np.array([0, 0, 0, 1, 1, 2, 2, 2], float)


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def only(small, words=0):
    source = small.open()
    (mesh,) = source.at(STILL).meshes
    assert len([m for m in source.warnings.messages if "camera" not in m]) == words, source.warnings.messages
    return mesh


def floats(values):
    return Vt.DoubleArray([float(v) for v in np.ravel(values)])


def curve(small, points, order, knots, weights=None, limits=None):
    prim = UsdGeom.NurbsCurves.Define(small.stage, "/Curve")
    prim.CreatePointsAttr([tuple(map(float, p)) for p in points])
    prim.CreateCurveVertexCountsAttr([len(points)])
    prim.CreateOrderAttr([order])
    prim.CreateKnotsAttr(floats(knots))
    prim.CreateWidthsAttr([0.02])
    if weights is not None:
        prim.CreatePointWeightsAttr(floats(weights))
    if limits is not None:
        prim.CreateRangesAttr([limits])
    return prim


def patch(small, points, sizes, orders, knots, weights=None):
    prim = UsdGeom.NurbsPatch.Define(small.stage, "/Patch")
    prim.CreatePointsAttr([tuple(map(float, p)) for p in points])
    for axis, size, order, along in zip("UV", sizes, orders, knots, strict=True):
        getattr(prim, f"Create{axis}VertexCountAttr")(size)
        getattr(prim, f"Create{axis}OrderAttr")(order)
        getattr(prim, f"Create{axis}KnotsAttr")(floats(along))
    if weights is not None:
        prim.CreatePointWeightsAttr(floats(weights))
    return prim


def middles(mesh, sides=12):
    return mesh.points.reshape(-1, sides, 3).mean(axis=1)


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_b_splines_sum_to_one_and_their_slopes_are_their_derivatives(order):
    knots = np.sort(np.random.default_rng(order).uniform(0, 1, 8 + order))
    for span in spans(order, knots, np.array([knots[order - 1], knots[8]]), 4096):
        np.testing.assert_allclose(span.values.sum(axis=1), 1, atol=1e-12)
        places = np.linspace(knots[span.first + order - 1], knots[span.first + order], 4097)
        inner = slice(100, -100)
        numeric = np.gradient(span.values, places, axis=0)[inner]
        # A cubic's third derivative is of the order of the cube of its slopes.
        np.testing.assert_allclose(span.slopes[inner], numeric, atol=1e-4 * abs(span.slopes).max())


def test_weights_of_their_own_make_the_slope_of_a_quotient():
    # Of a straight line with weights 1 and w, R = w t/(1 − t + w t) and R' = w/(1 − t + w t)².
    (span,) = spans(2, np.array([0, 0, 1, 1.0]), np.array([0, 1.0]), 8)
    values, slopes = rational(span.values, span.slopes, np.array([1.0, 3.0]))
    t = np.linspace(0, 1, 9)
    np.testing.assert_allclose(values[:, 1], 3 * t / (1 + 2 * t), atol=1e-12)
    np.testing.assert_allclose(slopes[1:-1, 1], 3 / (1 + 2 * t[1:-1]) ** 2, rtol=1e-12)
    np.testing.assert_allclose(slopes.sum(axis=1), 0, atol=1e-12)


def test_a_rational_curve_is_a_circle(small):
    curve(small, np.pad(CIRCLE, ((0, 0), (0, 1))), 3, CIRCLE_KNOTS, CIRCLE_WEIGHTS)
    found = middles(only(small))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)
    assert abs(found[:, 2]).max() < 1e-6
    # All the way round: nine places in each quarter.
    assert len(found) == 36
    quarters = np.floor(np.arctan2(found[:, 1], found[:, 0]) / (0.5 * math.pi) + 1e-9) % 4
    assert set(quarters.astype(int)) == {0, 1, 2, 3}


def test_a_curve_ends_where_its_range_does(small):
    curve(small, np.pad(CIRCLE, ((0, 0), (0, 1))), 3, CIRCLE_KNOTS, CIRCLE_WEIGHTS, (0, 2))
    found = middles(only(small))
    np.testing.assert_allclose(found[[0, -1], 0], [1, -1], atol=1e-6)
    assert found[:, 1].min() > -1e-6


def test_knots_that_do_not_fit_are_replaced_and_said(small):
    curve(small, [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], 4, [0, 1, 2])
    found = middles(only(small, words=1))
    # Bezier then, which keeps evenly spaced points on a line.
    np.testing.assert_allclose(found[:, 0], np.linspace(0, 3, 9), atol=1e-6)


def test_a_patch_turned_about_an_axis_is_a_sphere(small):
    # u about the axis, v from pole to pole.
    points = [(r * x, r * y, z) for r, z in ARC for x, y in CIRCLE]
    weights = np.outer(ARC_WEIGHTS, CIRCLE_WEIGHTS)
    patch(small, points, (9, 5), (3, 3), (CIRCLE_KNOTS, ARC_KNOTS), weights)
    mesh = only(small)
    np.testing.assert_allclose(np.linalg.norm(mesh.points, axis=1), 1, atol=1e-6)
    # Outwards, at the poles too: slopes are taken a thousandth of a span further in, along both axes.
    np.testing.assert_allclose((mesh.normals * mesh.points).sum(axis=1), 1, atol=1e-5)
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    volume = np.einsum("mi,mi->", a, np.cross(b, c)) / 6
    # Steps of h = 2π/64 leave out h²/6 of a circle's area, and along the meridian h²/12 of the radius three times; the
    # parameter runs unevenly by some hundredths.
    np.testing.assert_allclose(volume, 4 / 3 * math.pi, rtol=1.02 * (1 / 6 + 1 / 4) * (2 * math.pi / 64) ** 2)


def test_a_left_handed_patch_faces_the_other_way(small):
    points = [(x, y, 0) for y in (0, 1) for x in (0, 1, 2)]
    made = patch(small, points, (3, 2), (3, 2), ([0, 0, 0, 1, 1, 1], [0, 0, 1, 1]))
    np.testing.assert_allclose(only(small).normals[:, 2], 1, atol=1e-9)
    made.CreateOrientationAttr("leftHanded")
    mesh = only(small)
    np.testing.assert_allclose(mesh.normals[:, 2], -1, atol=1e-9)
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].max() < 0


def test_a_patch_moves_as_its_points_do(small):
    points = np.array([(x, y, 0) for y in (0, 1) for x in (0, 1, 2)], float)
    made = patch(small, points, (3, 2), (3, 2), ([0, 0, 0, 1, 1, 1], [0, 0, 1, 1]))
    for time, height in ((1, 0.0), (2, 0.5)):
        made.GetPointsAttr().Set([tuple(p + np.array([0, 0, height])) for p in points], time)
    (mesh,) = small.open().at(Shutter(1, 1, 2)).meshes
    np.testing.assert_allclose(mesh.points[:, 2], 0.25, atol=1e-9)
    np.testing.assert_allclose(mesh.motions, np.broadcast_to((0, 0, 0.5), mesh.points.shape), atol=1e-9)


@pytest.mark.parametrize("size", [(2, 2), (3, 3)])
def test_a_patch_whose_points_do_not_fit_is_left_out(small, size):
    small.mesh("/Floor", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    patch(small, [(0, 0, 0)] * 6, size, (2, 2), ([0, 0, 1, 1], [0, 0, 1, 1]))
    source = small.open()
    assert [mesh.path for mesh in source.at(STILL).meshes] == ["/Floor"]
    assert any("/Patch.uVertexCount: is a patch of" in message for message in source.warnings.messages)


def test_limits_outside_of_the_knots_are_brought_within_them():
    knots = np.array([0, 0, 1, 2, 2.0])
    np.testing.assert_array_equal(fitting_knots(2, 3, knots, np.array([-5, 1.5]))[1], [0, 1.5])
    np.testing.assert_array_equal(fitting_knots(2, 3, knots, np.array([3, 4.0]))[1], [0, 2])


@pytest.mark.parametrize("order", [None, -3, 9])
def test_curves_of_no_order_are_cubic_and_those_of_an_impossible_one_are_left_out(small, order):
    small.mesh("/Floor")
    made = curve(small, [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], 4, [0, 0, 0, 0, 1, 1, 1, 1])
    if order is None:
        made.GetOrderAttr().Clear()
    else:
        made.GetOrderAttr().Set([order])
    meshes = [mesh.path for mesh in small.open().at(STILL).meshes]
    assert meshes == (["/Floor", "/Curve"] if order is None else ["/Floor"])
