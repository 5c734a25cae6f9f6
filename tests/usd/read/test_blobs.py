"""Points are spheres and curves are tubes, where and as wide as USD says."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom

from tests.usd.stages import SmallStage, face_normals
from tpdwarp.scene.description import Shutter

STILL = Shutter.still(1)


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def only(small, shutter=STILL, words=0):
    scene = small.open()
    (mesh,) = scene.at(shutter).meshes
    assert len(scene.warnings.messages) == words
    return mesh


def vectors(rows):
    return [Gf.Vec3f(*map(float, row)) for row in rows]


def points_prim(small, centres, widths=None):
    prim = UsdGeom.Points.Define(small.stage, "/Points")
    prim.CreatePointsAttr(vectors(centres))
    if widths is not None:
        prim.CreateWidthsAttr(widths)
    return prim


def curves_prim(small, points, counts=None, kind="linear", basis="bezier", wrap="nonperiodic", widths=(0.5,)):
    prim = UsdGeom.BasisCurves.Define(small.stage, "/Curves")
    prim.CreatePointsAttr(vectors(points))
    prim.CreateCurveVertexCountsAttr([len(points)] if counts is None else counts)
    prim.CreateTypeAttr(kind)
    prim.CreateBasisAttr(basis)
    prim.CreateWrapAttr(wrap)
    prim.CreateWidthsAttr(list(widths))
    if len(widths) == 1:
        prim.SetWidthsInterpolation("constant")
    return prim


def volume(mesh):
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def test_points_are_spheres_of_their_widths(small):
    centres = np.array([(0, 0, 0), (5, 0, 0), (0, 7, 1)])
    points_prim(small, centres, [2.0, 1.0, 0.5])
    mesh = only(small)
    balls = mesh.points.reshape(3, -1, 3) - centres[:, None]
    np.testing.assert_allclose(np.linalg.norm(balls, axis=2), np.repeat([[1.0], [0.5], [0.25]], balls.shape[1], 1))
    np.testing.assert_allclose(mesh.normals, (balls / [[[1.0]], [[0.5]], [[0.25]]]).reshape(-1, 3), atol=1e-12)
    corners = mesh.normals[mesh.normal_indices]
    assert np.einsum("ik,ijk->ij", face_normals(mesh), corners).min() > 0.9
    # Between the ball that touches the faces and the one through the corners.
    nearest = np.einsum("ik,ik->i", face_normals(mesh), mesh.points[mesh.triangles[:, 0]])[:320].min()
    assert nearest > 0.95
    assert nearest**3 < volume(mesh) / (4 / 3 * math.pi * (1 + 1 / 8 + 1 / 64)) < 1


def test_points_move_along_their_velocities(small):
    prim = UsdGeom.Points.Define(small.stage, "/Points")
    prim.CreateWidthsAttr([1.0])
    prim.SetWidthsInterpolation("constant")
    for time, count in ((1, 2), (2, 3)):
        prim.GetPointsAttr().Set([Gf.Vec3f(k, 0, time) for k in range(count)], time)
        prim.GetVelocitiesAttr().Set([Gf.Vec3f(0, 24 * k, 0) for k in range(count)], time)
    mesh = only(small, Shutter(1, 1, 2))
    moved = mesh.motions.reshape(2, -1, 3)
    np.testing.assert_allclose(moved[1], np.broadcast_to([0, 1, 0], moved[1].shape), atol=1e-6)
    np.testing.assert_allclose(moved[0], 0, atol=1e-6)


def test_points_have_colours_one_each(small):
    prim = points_prim(small, [(0, 0, 0), (5, 0, 0)], [1.0, 1.0])
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex")
    primvar.Set(vectors([(1, 0, 0), (0, 1, 0)]))
    mesh = only(small)
    shown = mesh.colors[mesh.color_indices]
    first = mesh.points[mesh.triangles].mean(axis=1)[:, 0] < 2.5
    assert (shown[first] == [1, 0, 0]).all() and (shown[~first] == [0, 1, 0]).all()


def test_points_without_widths_are_said(small):
    points_prim(small, [(0, 0, 0)])
    mesh = only(small, words=1)
    np.testing.assert_allclose(np.linalg.norm(mesh.points, axis=1), 0.5)


@pytest.mark.parametrize("count", [10, 5000])
def test_many_points_are_coarser(small, count):
    points_prim(small, np.arange(3 * count).reshape(-1, 3), [1.0] * count)
    assert len(only(small).triangles) == count * {10: 320, 5000: 80}[count]


def test_a_straight_curve_is_a_tube(small):
    curves_prim(small, [(0, 0, 0), (0, 0, 2), (0, 0, 5)])
    mesh = only(small)
    np.testing.assert_allclose(np.hypot(mesh.points[:, 0], mesh.points[:, 1]), 0.25)
    assert (mesh.points[:, 2].min(), mesh.points[:, 2].max()) == (0, 5)
    np.testing.assert_allclose(mesh.normals, mesh.points * [4, 4, 0], atol=1e-12)
    assert np.einsum("ik,ijk->ij", face_normals(mesh), mesh.normals[mesh.normal_indices]).min() > 0.9


def centres_of(mesh, sides=12):
    return mesh.points.reshape(-1, sides, 3).mean(axis=1)


@pytest.mark.parametrize(
    ("basis", "start", "end"),
    # Where the uniform cubic segment of these control points begins and ends.
    [("bezier", 0.0, 27.0), ("bspline", (0 + 4 * 1 + 8) / 6, (1 + 4 * 8 + 27) / 6), ("catmullRom", 1.0, 8.0)],
)
def test_cubic_curves_run_where_their_basis_says(small, basis, start, end):
    curves_prim(small, [(0, 0, 0), (1, 0, 1), (8, 0, 2), (27, 0, 3)], kind="cubic", basis=basis)
    centres = centres_of(only(small))
    assert centres[[0, -1], 0] == pytest.approx([start, end])


@pytest.mark.parametrize(("basis", "wrap"), [("bspline", "periodic"), ("catmullRom", "periodic")])
def test_periodic_curves_close(small, basis, wrap):
    angles = np.linspace(0, 2 * math.pi, 12, endpoint=False)
    curves_prim(small, np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1), kind="cubic", basis=basis, wrap=wrap)
    rows = centres_of(only(small)).reshape(12, -1, 3)
    np.testing.assert_allclose(rows[:, -1], np.roll(rows, -1, axis=0)[:, 0], atol=1e-6)


@pytest.mark.parametrize("basis", ["bspline", "catmullRom"])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_pinned_curves_are_those_of_their_phantom_points(small, basis, count):
    points = np.array([(0, 0, 0), (1, 0, 0), (2, 1, 0), (3, 0, 0), (3, 0, 1)])[:count]
    # P[-1] = 2 P[0] - P[1] and P[n] = 2 P[n-1] - P[n-2], by the schema of UsdGeomBasisCurves.
    unpacked = np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])
    prim = curves_prim(small, unpacked, kind="cubic", basis=basis)
    expected = centres_of(only(small))
    prim.GetWrapAttr().Set("pinned")
    prim.GetPointsAttr().Set(vectors(points))
    prim.GetCurveVertexCountsAttr().Set([count])
    centres = centres_of(only(small))
    np.testing.assert_allclose(centres, expected, atol=1e-6)
    np.testing.assert_allclose(centres[[0, -1]], [points[0], points[-1]], atol=1e-6)


def test_curves_have_colours_and_widths_of_their_own(small):
    prim = curves_prim(small, [(0, 0, 0), (0, 0, 1), (5, 0, 0), (5, 0, 1)], [2, 2], widths=(1.0, 0.5))
    prim.SetWidthsInterpolation("uniform")
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "uniform")
    primvar.Set(vectors([(1, 0, 0), (0, 1, 0)]))
    mesh = only(small)
    second = mesh.points[:, 0] > 2.5
    assert np.ptp(mesh.points[~second], axis=0)[0] == pytest.approx(1.0)
    assert np.ptp(mesh.points[second], axis=0)[0] == pytest.approx(0.5)
    shown = mesh.colors[mesh.color_indices]
    assert (shown[second[mesh.triangles[:, 0]]] == [0, 1, 0]).all()


def test_hermite_curves_go_through_their_points_along_their_tangents(small):
    prim = UsdGeom.HermiteCurves.Define(small.stage, "/Curves")
    prim.CreatePointsAttr(vectors([(0, 0, 0), (1, 0, 0), (2, 0, 0)]))
    prim.CreateTangentsAttr(vectors([(1, 3, 0), (1, 0, 0), (1, -3, 0)]))
    prim.CreateCurveVertexCountsAttr([3])
    prim.CreateWidthsAttr([0.1])
    prim.SetWidthsInterpolation("constant")
    rows = centres_of(only(small)).reshape(2, -1, 3)
    t = np.linspace(0, 1, rows.shape[1])
    # The cubic h(t) = t (1 − t)² of unit slope at its start, and its mirror image.
    np.testing.assert_allclose(rows[0, :, 1], 3 * t * (1 - t) ** 2, atol=1e-12)
    np.testing.assert_allclose(rows[1, :, 1], 3 * t**2 * (1 - t), atol=1e-12)
    np.testing.assert_allclose(rows[0, :, 0], t, atol=1e-12)


def test_curves_whose_counts_do_not_fit_are_left_out_and_said_by_attribute(small):
    curves_prim(small, [(0, 0, 0), (0, 0, 1)], [3])
    scene = small.open()
    assert scene.at(STILL).meshes == ()
    assert "/Curves.curveVertexCounts" in scene.warnings.messages[0]
