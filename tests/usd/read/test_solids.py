"""Solids of tetrahedra."""

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from tests.usd.stages import SmallStage, face_normals
from tpdwarp.scene.description import Shutter

STILL = Shutter.still(1)
CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def solid(small, tets=((0, 1, 2, 3), (1, 2, 3, 4)), faces=()):
    prim = UsdGeom.TetMesh.Define(small.stage, "/Solid")
    prim.CreatePointsAttr([Gf.Vec3f(*p) for p in CORNERS])
    prim.CreateTetVertexIndicesAttr([Gf.Vec4i(*t) for t in tets])
    if faces:
        prim.CreateSurfaceFaceVertexIndicesAttr([Gf.Vec3i(*f) for f in faces])
    return prim


def volume(mesh):
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    return np.einsum("mi,mi->", a, np.cross(b, c)) / 6


def test_faces_between_two_tetrahedra_are_no_surface(small):
    # The second one's corners are ordered so that it is not inside out: (2 − 1) × (3 − 1) · (4 − 1) is above 0.
    solid(small)
    (mesh,) = small.open().at(STILL).meshes
    assert len(mesh.triangles) == 6 and mesh.normals is None
    # A corner of a cube is a sixth, the tetrahedron over its face a third.
    np.testing.assert_allclose(volume(mesh), 1 / 6 + 1 / 3, rtol=1e-6)


def test_authored_surface_faces_come_first(small):
    prim = solid(small, faces=[(0, 2, 1)])
    (mesh,) = small.open().at(STILL).meshes
    np.testing.assert_allclose(face_normals(mesh), [[0, 0, -1]], atol=1e-6)
    prim.CreateOrientationAttr("leftHanded")
    (mesh,) = small.open().at(STILL).meshes
    np.testing.assert_allclose(face_normals(mesh), [[0, 0, 1]], atol=1e-6)


def test_faces_that_do_not_fit_are_left_out(small):
    solid(small, faces=[(0, 2, 1), (0, 1, 9)])
    source = small.open()
    (mesh,) = source.at(STILL).meshes
    assert len(mesh.triangles) == 1
    assert any("has faces of points that are not there" in message for message in source.warnings.messages)
