"""Texture coordinates of receivers lie on the triangles that are rendered, whatever the mesh."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom

from tests.usd.stages import SQUARE, SmallStage, mesh_named
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.uv import planar_coordinates

STILL = Shutter.still(1.0)
CORNERS = [(x, y) for x, y, _ in SQUARE]


def author(mesh: UsdGeom.Mesh, values, interpolation: str = "vertex", name: str = "st") -> None:
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    primvar.Set([Gf.Vec2f(*map(float, value)) for value in values])


def read(small: SmallStage, path: str = "/Mesh", name: str = "st") -> tuple[np.ndarray, np.ndarray]:
    """Positions and coordinates of the triangles' corners, shapes [m, 3, 3] and [m, 3, 2]."""
    source = small.open()
    mesh = mesh_named(source.at(STILL), path)
    return mesh.points[mesh.triangles], source.coordinates(path, name, STILL).values


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "faceVarying"])
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_each_corner_has_the_coordinates_of_its_point(tmp_path, interpolation, orientation):
    small = SmallStage(tmp_path)
    mesh = small.mesh()
    mesh.CreateOrientationAttr(orientation)
    author(mesh, CORNERS, interpolation)
    corners, found = read(small)
    np.testing.assert_array_equal(found, corners[..., :2])


def test_a_mesh_that_is_turned_inside_out_keeps_its_coordinates(tmp_path):
    small = SmallStage(tmp_path)
    mesh = small.mesh()
    UsdGeom.Xformable(mesh).AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    author(mesh, CORNERS)
    corners, found = read(small)
    np.testing.assert_array_equal(found, corners[..., :2] * [-1, 1])


def test_triangles_that_are_cut_out_have_none(tmp_path):
    small = SmallStage(tmp_path)
    points = [*SQUARE, (2, 0, 0), (2, 1, 0)]
    mesh = small.mesh(points=points, counts=(4, 4), indices=(0, 1, 2, 3, 1, 4, 5, 2))
    mesh.CreateHoleIndicesAttr([0])
    author(mesh, [point[:2] for point in points])
    corners, found = read(small)
    assert len(found) == 2
    np.testing.assert_array_equal(found, corners[..., :2])


@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying"])
def test_a_subdivision_surface_covers_the_coordinates_of_its_cage(tmp_path, interpolation):
    small = SmallStage(tmp_path)
    author(small.mesh(scheme="catmullClark"), CORNERS, interpolation)
    corners, found = read(small)
    assert len(found) == len(corners) > 100
    sides = found[:, 1:] - found[:, :1]
    area = 0.5 * (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    # Linear over each face of the cage: the whole square, once, and no triangle turned over.
    assert area.min() > 0 and area.sum() == pytest.approx(1.0, rel=1e-6)


def test_instances_share_the_coordinates_of_their_prototype(tmp_path):
    small = SmallStage(tmp_path)
    instancer = UsdGeom.PointInstancer.Define(small.stage, "/Many")
    author(small.mesh("/Many/Protos/Card"), CORNERS)
    instancer.CreatePrototypesRel().SetTargets(["/Many/Protos/Card"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(0, 0, 0), (5, 0, 0)])
    corners, found = read(small, "/Many[1]/Card")
    np.testing.assert_allclose(found, corners[..., :2] - [5, 0], atol=1e-6)


def test_a_mesh_without_is_projected_along_its_thinnest_axis_and_that_is_said(tmp_path, caplog):
    small = SmallStage(tmp_path)
    small.mesh(points=[(0, 3 * x, 2 * y) for x, y in CORNERS])
    corners, found = read(small)
    np.testing.assert_allclose(found, corners[..., 1:] / [3, 2], atol=1e-7)
    assert any("/Mesh" in line and "has no st" in line for line in caplog.messages)


def test_what_moves_is_projected_as_it_stood_first(tmp_path):
    small = SmallStage(tmp_path)
    square = np.array(SQUARE)
    small.moving("/Mesh", {1: square, 5: square * [3, 1, 1] + [0, 0, 2]})
    source = small.open()
    found = [source.coordinates("/Mesh", "st", Shutter.still(time)).values for time in (1.0, 4.0)]
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_projections_face_along_their_axis(axis):
    # Counter-clockwise seen against the axis, and over all of the square.
    others = [(axis + 1) % 3, (axis + 2) % 3]
    points = np.zeros((4, 3))
    points[:, others] = np.array(CORNERS) * 7 - 2
    np.testing.assert_allclose(planar_coordinates(points), CORNERS, atol=1e-12)
