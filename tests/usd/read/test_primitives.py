"""Primitives: points on the surface, exact normals, the front outside, sizes that change with time."""

import math

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdShade

from tests.usd.stages import SmallStage, face_normals
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.primitives import MOST_TRIANGLES, segments_for

STILL = Shutter.still(1)
# Volumes of the unit sizes below.
SOLIDS = {
    "Sphere": (dict(radius=2.0), 4 / 3 * math.pi * 8),
    "Cube": (dict(size=3.0), 27.0),
    "Cylinder": (dict(radius=2.0, height=3.0), math.pi * 4 * 3),
    "Cylinder_1": (dict(radiusBottom=2.0, radiusTop=1.0, height=3.0), math.pi * (4 + 2 + 1)),
    "Cone": (dict(radius=2.0, height=3.0), math.pi * 4),
    "Capsule": (dict(radius=2.0, height=3.0), 4 / 3 * math.pi * 8 + math.pi * 4 * 3),
    "Capsule_1": (dict(radiusBottom=2.0, radiusTop=1.0, height=3.0), 2 / 3 * math.pi * 9 + math.pi * 7),
}


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def define(small, kind, path="/Shape", **sizes):
    shape = getattr(UsdGeom, kind).Define(small.stage, path)
    for name, value in sizes.items():
        shape.GetPrim().GetAttribute(name).Set(value)
    return shape


def only(small, shutter=STILL):
    scene = small.open()
    (mesh,) = scene.at(shutter).meshes
    assert scene.warnings.messages == []
    return mesh


def volume(mesh):
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


@pytest.mark.parametrize("kind", SOLIDS)
@pytest.mark.parametrize("mirror", [1, -1])
def test_solids_are_closed_and_have_their_volume_with_the_front_outside(small, kind, mirror):
    sizes, expected = SOLIDS[kind]
    define(small, kind, **sizes).AddScaleOp().Set((mirror, 1, 1))
    mesh = only(small)
    areas = np.cross(*(mesh.points[mesh.triangles[:, k]] - mesh.points[mesh.triangles[:, 0]] for k in (1, 2)))
    np.testing.assert_allclose(areas.sum(axis=0), 0, atol=1e-10)
    # A polygon of n corners lacks 2π²/(3n²) of its circle, and a sphere turned from one π²/n² beside that.
    assert -5 * math.pi**2 / (3 * 64**2) < volume(mesh) / expected - 1 < 1e-12


def gradient(kind, sizes, points):
    """Outward normals of the implicit surfaces with z as axis, by their own formulae."""
    x, y, z = points.T
    around = np.stack([x, y, 0 * z], axis=1)
    if kind == "Sphere":
        return points
    half = 0.5 * sizes["height"]
    if kind == "Capsule":
        return points - np.stack([0 * x, 0 * y, np.clip(z, -half, half)], axis=1)
    side = around / np.linalg.norm(around, axis=1, keepdims=True)
    return side * sizes["height"] + [0, 0, sizes["radius"]] if kind == "Cone" else around


@pytest.mark.parametrize("kind", ["Sphere", "Capsule", "Cylinder", "Cone"])
def test_normals_are_those_of_the_surface(small, kind):
    sizes, _ = SOLIDS[kind]
    define(small, kind, **sizes, **({} if kind == "Sphere" else {"axis": "Z"}))
    mesh = only(small)
    at, normals = mesh.points[mesh.triangles].reshape(-1, 3), mesh.normals[mesh.normal_indices].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)
    # Caps are flat, and their normals along the axis; a cone's tip has none of its own.
    curved = (abs(normals[:, 2]) < 1 - 1e-9) & (np.hypot(at[:, 0], at[:, 1]) > 1e-9)
    assert curved.sum() > 0.2 * len(at)
    expected = gradient(kind, sizes, at[curved])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[curved], expected, atol=1e-7)
    corners = np.repeat(face_normals(mesh), 3, axis=0)
    assert (np.einsum("ij,ij->i", corners, normals) > 0.9).all()


@pytest.mark.parametrize("axis", "XYZ")
def test_axes_are_turned_and_not_mirrored(small, axis):
    define(small, "Cone", radius=1.0, height=4.0, axis=axis)
    mesh = only(small)
    tip = mesh.points[np.argmax(mesh.points[:, "XYZ".index(axis)])]
    np.testing.assert_allclose(tip, 2.0 * np.eye(3)["XYZ".index(axis)], atol=1e-12)
    assert volume(mesh) > 0


@pytest.mark.parametrize(("axis", "extent"), [("X", (0, 3, 2)), ("Y", (2, 0, 3)), ("Z", (2, 3, 0))])
def test_planes_have_width_and_length_where_usd_says(small, axis, extent):
    define(small, "Plane", width=2.0, length=3.0, axis=axis)
    mesh = only(small)
    np.testing.assert_array_equal(np.ptp(mesh.points, axis=0), extent)
    np.testing.assert_array_equal(face_normals(mesh), [np.eye(3)["XYZ".index(axis)]] * 2)


def test_sizes_that_change_move_the_points(small):
    radius = define(small, "Sphere").GetRadiusAttr()
    radius.Set(1.0, 1)
    radius.Set(3.0, 3)
    mesh = only(small, Shutter(1, 1, 2))
    np.testing.assert_allclose(np.linalg.norm(mesh.points, axis=1), 1.5, atol=1e-12)
    np.testing.assert_allclose(mesh.motions, mesh.points / 1.5, atol=1e-12)
    np.testing.assert_allclose(mesh.normals, mesh.points / 1.5, atol=1e-12)
    assert small.open().motion_breaks(Shutter(2, 2, 4)) == [3.0]


def test_a_sphere_without_size_or_with_none_that_is_a_number_is_left_out(small):
    small.mesh()
    define(small, "Sphere", "/Nothing", radius=0.0)
    define(small, "Sphere", "/NoNumber", radius=math.nan)
    scene = small.open()
    assert [mesh.path for mesh in scene.at(Shutter.still(1)).meshes] == ["/Mesh"]
    assert len(scene.warnings.messages) == 2


def test_glass_is_finer_and_many_are_coarser(small):
    define(small, "Sphere", "/A")
    define(small, "Sphere", "/B")
    small.preview("/Glass", opacity=0.0)
    UsdShade.MaterialBindingAPI.Apply(small.stage.GetPrimAtPath("/B")).Bind(
        UsdShade.Material(small.stage.GetPrimAtPath("/Glass"))
    )
    a, b = small.open().at(Shutter.still(1)).meshes
    assert len(b.triangles) == pytest.approx(9 * len(a.triangles), rel=0.1)
    for count in (1, 100, 1000, 5000):
        assert count * segments_for(True, count) ** 2 <= MOST_TRIANGLES


def test_primitives_take_display_colour_and_stand_in_instancers(small):
    instancer = UsdGeom.PointInstancer.Define(small.stage, "/Many")
    instancer.CreatePrototypesRel().SetTargets(["/Many/Ball"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0), Gf.Vec3f(3, 0, 0)])
    define(small, "Sphere", "/Many/Ball").CreateDisplayColorAttr([Gf.Vec3f(0.5, 0, 0)])
    first, second = small.open().at(Shutter.still(1)).meshes
    np.testing.assert_array_equal(first.colors, [[0.5, 0, 0]])
    np.testing.assert_allclose(second.points - first.points, np.broadcast_to([3, 0, 0], first.points.shape), atol=1e-12)


def test_a_shape_of_infinite_size_is_left_out_and_said_by_attribute(small):
    shape = define(small, "Sphere")
    shape.GetRadiusAttr().Set(math.inf)
    scene = small.open()
    assert scene.at(Shutter.still(1)).meshes == ()
    assert "/Shape.radius" in scene.warnings.messages[0]
