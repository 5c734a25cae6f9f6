"""Subdivision surfaces against what is known of their limits: polynomials, B-splines, symmetries, creases."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, Vt

from tests.usd.stages import SmallStage, face_normals
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.subdivision.connectivity import Connectivity
from tpdwarp.usd.read.subdivision.rules import CatmullClark, Loop
from tpdwarp.usd.read.subdivision.surface import FINEST_CAGE, MOST_FACES, Surface, levels_for

CUBE = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
CUBE_FACES = np.ravel([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
NO_HOLES = np.zeros(0, dtype=int)


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def grid(size, triangles=False):
    """A square grid [size × size] of whole coordinates, as quadrilaterals or halved along one diagonal."""
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(size * size)], axis=1).astype(float)
    i = np.arange(size * size).reshape(size, size)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    quads = np.stack([a, b, c, d], axis=1)
    halves = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    faces = halves if triangles else quads
    return points, np.full(len(faces), faces.shape[1]), faces.ravel()


def surface(scheme, points, counts, indices, levels, **cage):
    made = Surface(scheme, Connectivity.of(counts, indices, len(points), **cage), levels, NO_HOLES, False)
    refined = made.refined(points)
    return made, made.points(refined), made.normals(refined)


def edges_around(face):
    return [(min(a, b), max(a, b)) for a, b in zip(face, [*face[1:], face[0]], strict=True)]


def cube(levels, **cage):
    return surface("catmullClark", CUBE, np.full(6, 4), CUBE_FACES, levels, **cage)


@pytest.mark.parametrize("levels", [1, 3])
def test_catmull_clark_over_a_grid_is_the_bicubic_b_spline(levels):
    """Away from the border x² in control points is x² + 1/3 on the surface (uniform cubic B-splines), xy is xy."""
    points, counts, indices = grid(9)
    x, y = points[:, 0], points[:, 1]
    points[:, 2] = x * x - 2 * x * y + 3 * y
    _, limit, normals = surface("catmullClark", points, counts, indices, levels)
    inner = ((limit[:, :2] > 2) & (limit[:, :2] < 6)).all(axis=1)
    assert inner.sum() >= 9
    u, v, z = limit[inner].T
    np.testing.assert_allclose(z, u * u + 1 / 3 - 2 * u * v + 3 * v, atol=1e-12)
    expected = np.stack([-(2 * u - 2 * v), -(-2 * u + 3), np.ones_like(u)], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[: len(limit)][inner], expected, atol=1e-12)


@pytest.mark.parametrize("levels", [1, 2])
def test_loop_over_a_regular_grid_is_the_quartic_box_spline(levels):
    """The three-direction box spline reproduces quadratics up to a constant, by the second moments of its mask.

    Its limit mask gives 1/12 to each of six neighbours; along x these are at ±1, ±1 (the diagonals) and 0: the mean of
    x² is 4/12, and of xy (of the diagonals alone) 2/12.
    """
    points, counts, indices = grid(9, triangles=True)
    x, y = points[:, 0], points[:, 1]
    points[:, 2] = x * x - 2 * x * y + 3 * y
    _, limit, normals = surface("loop", points, counts, indices, levels)
    inner = ((limit[:, :2] > 2) & (limit[:, :2] < 6)).all(axis=1)
    assert inner.sum() >= 9
    u, v, z = limit[inner].T
    np.testing.assert_allclose(z, u * u + 4 / 12 - 2 * (u * v + 2 / 12) + 3 * v, atol=1e-12)
    expected = np.stack([-(2 * u - 2 * v), -(-2 * u + 3), np.ones_like(u)], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[: len(limit)][inner], expected, atol=1e-12)


@pytest.mark.parametrize(("scheme", "triangles"), [("catmullClark", False), ("loop", True)])
def test_the_border_is_a_cubic_b_spline_of_its_own(scheme, triangles):
    points, counts, indices = grid(9, triangles)
    points[:, 2] = points[:, 0] ** 2
    _, limit, _ = surface(scheme, points, counts, indices, 2)
    border = (limit[:, 1] == 0) & (limit[:, 0] > 2) & (limit[:, 0] < 6)
    assert border.sum() > 8
    np.testing.assert_allclose(limit[border, 2], limit[border, 0] ** 2 + 1 / 3, atol=1e-12)


def test_limits_do_not_depend_on_how_often_a_cage_is_refined():
    _, once, normals = cube(1)
    _, often, finer = cube(4)
    # The points of a level come first among those of the next.
    np.testing.assert_allclose(often[: len(once)], once, atol=1e-12)
    np.testing.assert_allclose(finer[: len(once)], normals[: len(once)], atol=1e-12)


def test_a_cubes_corners_and_faces_end_where_the_limit_masks_say():
    _, limit, normals = cube(1)
    # Valence 3: (9 V + 4 ΣE + ΣF) / 24 = (9 + 4 + (−1)) / 24 of a corner's coordinates on the cage itself.
    np.testing.assert_allclose(limit[:8], 0.5 * CUBE, atol=1e-12)
    np.testing.assert_allclose(normals[:8], CUBE / math.sqrt(3), atol=1e-12)
    # The middle of a face, valence 4 after one level: (16 V + 4 ΣE + ΣF) / 36, with edges at 3/4 and vertices at 5/9.
    centres = limit[-6:]
    np.testing.assert_allclose(abs(centres).max(axis=1), (16 + 16 * 0.75 + 4 * 5 / 9) / 36, atol=1e-12)


def test_normals_are_those_of_the_surface_that_refined_faces_come_near_to():
    made, limit, normals = cube(5)
    a, b, c = (limit[made.topology.triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    corners = normals[made.normal_elements(made.topology)]
    # Faces are 1/32 of the cube's: normals turn by about a tenth from one to the next at most.
    assert np.einsum("ik,ijk->ij", flat, corners).min() > math.cos(0.1)


@pytest.mark.parametrize("rules", [CatmullClark, Loop])
def test_refinement_and_limits_move_with_affine_maps(rules):
    rng = np.random.default_rng(5)
    points, counts, indices = grid(4, triangles=rules is Loop)
    points[:, 2] = rng.normal(size=len(points))
    matrix, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    made = rules(Connectivity.of(counts, indices, len(points)))
    for step in (made.refined_points, made.limit_points):
        np.testing.assert_allclose(step(points @ matrix + shift), step(points) @ matrix + shift, atol=1e-12)


def test_infinitely_sharp_edges_keep_the_cube_a_cube():
    creases = dict.fromkeys((edge for face in CUBE_FACES.reshape(6, 4).tolist() for edge in edges_around(face)), 10.0)
    made, limit, normals = cube(3, creases=creases)
    np.testing.assert_allclose(abs(limit).max(axis=1), 1, atol=1e-12)
    a, b, c = (limit[made.topology.triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    assert np.linalg.norm(areas, axis=1).sum() / 2 == pytest.approx(24)
    faces = np.repeat((areas / np.linalg.norm(areas, axis=1, keepdims=True))[:, None], 3, axis=1)
    # Normals turn at the edges and not before.
    corners = normals[made.normal_elements(made.topology)]
    np.testing.assert_allclose(corners, faces, atol=1e-12)


def test_a_crease_around_a_face_makes_a_b_spline_curve_of_it():
    """Infinite creases: a square's closed cubic B-spline has its vertices at (4 V + A + B) / 6 = 2/3 of the corners."""
    top = [4, 5, 7, 6]
    creases = dict.fromkeys(edges_around(top), 10.0)
    _, limit, _ = cube(2, creases=creases)
    np.testing.assert_allclose(limit[top], CUBE[top] * [2 / 3, 2 / 3, 1], atol=1e-12)


def test_a_crease_of_finite_sharpness_is_sharp_for_so_many_levels():
    top = [4, 5, 7, 6]
    edges = edges_around(top)

    def refined(sharpness, levels):
        mesh, points = Connectivity.of(np.full(6, 4), CUBE_FACES, 8, dict.fromkeys(edges, sharpness)), CUBE
        for _ in range(levels):
            rules = CatmullClark(mesh)
            points, mesh = rules.refined_points(points), rules.refined()[0]
        return points

    np.testing.assert_allclose(refined(1.0, 1), refined(10.0, 1), atol=1e-12)
    np.testing.assert_allclose(refined(2.0, 2), refined(10.0, 2), atol=1e-12)
    assert abs(refined(1.0, 2) - refined(10.0, 2)).max() > 0.01
    # Half a level: half way between what is sharp and what is smooth.
    np.testing.assert_allclose(refined(0.5, 1), 0.5 * (refined(10.0, 1) + refined(0.0, 1)), atol=1e-12)


def test_sharp_corners_stay_where_they_are():
    corners = np.zeros(8)
    corners[7] = 10.0
    _, limit, _ = cube(3, corner_sharpness=corners)
    np.testing.assert_allclose(limit[7], CUBE[7], atol=1e-12)
    assert np.linalg.norm(limit[6]) < 1


def test_an_octahedron_of_loop_is_as_symmetric_as_it_was():
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(a * 1, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    faces = [f if np.linalg.det(points[list(f)]) > 0 else (f[0], f[2], f[1]) for f in faces]
    _, limit, normals = surface("loop", points, np.full(8, 3), np.ravel(faces), 3)
    # Valence 4: β = (5/8 − (3/8)²) / 4 = 31/256, ω = 1 / (4 + 3/(8β)); neighbours cancel.
    omega = 1 / (4 + 0.375 * 256 / 31)
    np.testing.assert_allclose(limit[:6], points * (1 - 4 * omega), atol=1e-12)
    np.testing.assert_allclose(normals[:6], points, atol=1e-12)
    np.testing.assert_allclose(np.sort(limit @ [1, 2, 3]), np.sort(-limit @ [1, 2, 3]), atol=1e-12)


def author_cube(small, **attributes):
    mesh = small.mesh("/Cube", CUBE, (4,) * 6, CUBE_FACES.tolist(), "catmullClark")
    for name, value in attributes.items():
        getattr(mesh, f"Create{name}Attr")(value)
    return mesh


def only(scene, shutter):
    (mesh,) = scene.at(shutter).meshes
    return mesh


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("left_handed", [False, True])
def test_a_cube_of_the_stage_is_round_with_its_front_outside(small, mirror, left_handed):
    mesh = author_cube(small)
    if left_handed:
        mesh.CreateOrientationAttr("leftHanded")
        mesh.GetFaceVertexIndicesAttr().Set(CUBE_FACES.reshape(6, 4)[:, ::-1].ravel().tolist())
    mesh.AddScaleOp().Set((mirror, 1, 1))
    scene = small.open()
    found = only(scene, Shutter.still(1))
    assert scene.warnings.messages == []
    corners = found.normals[found.normal_indices]
    assert np.einsum("ik,ijk->ij", face_normals(found), corners).min() > 0.9
    assert np.einsum("ik,ik->i", face_normals(found), found.points[found.triangles].mean(axis=1)).min() > 0


def test_a_moving_cage_carries_its_surface_along(small):
    mesh = author_cube(small)
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    for time, points in ((1, CUBE), (2, 2 * CUBE @ turn)):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), time)
    scene = small.open()
    start, end, over = (only(scene, s) for s in (Shutter.still(1), Shutter.still(2), Shutter(1, 1, 2)))
    np.testing.assert_allclose(end.points, 2 * start.points @ turn, atol=1e-6)
    np.testing.assert_allclose(end.normals, start.normals @ turn, atol=1e-6)
    np.testing.assert_allclose(over.motions, end.points - start.points, atol=1e-6)
    assert start.triangles is end.triangles


def test_creases_corners_and_holes_of_the_stage_are_read(small):
    author_cube(
        small,
        CreaseIndices=[4, 5, 7, 6, 4],
        CreaseLengths=[5],
        CreaseSharpnesses=[10.0],
        CornerIndices=[0],
        CornerSharpnesses=[10.0],
        HoleIndices=[0],
    )
    found = only(small.open(), Shutter.still(1))
    np.testing.assert_allclose(found.points[[4, 5, 7, 6]], CUBE[[4, 5, 7, 6]] * [2 / 3, 2 / 3, 1], atol=1e-6)
    np.testing.assert_allclose(found.points[0], CUBE[0], atol=1e-6)
    small.stage.RemovePrim("/Cube")
    author_cube(small)
    whole = only(small.open(), Shutter.still(1))
    assert len(whole.triangles) * 5 == len(found.triangles) * 6


@pytest.mark.parametrize(
    ("boundary", "kept", "corner"), [("none", 4, None), ("edgeOnly", 16, (1 / 6, 1 / 6)), ("edgeAndCorner", 16, (0, 0))]
)
def test_borders_follow_their_rule(small, boundary, kept, corner):
    points, counts, indices = grid(5)
    mesh = small.mesh("/Grid", points, counts.tolist(), indices.tolist(), "catmullClark")
    mesh.CreateInterpolateBoundaryAttr(boundary)
    found = only(small.open(), Shutter.still(1))
    sides = np.diff(found.points[found.triangles], axis=1)
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2
    if corner is None:
        assert area == pytest.approx(kept, rel=1e-6)
    else:
        # A corner that is not sharp ends at (4 V + A + B) / 6.
        np.testing.assert_allclose(found.points[0, :2], corner, atol=1e-6)


@pytest.mark.parametrize("interpolation", ["constant", "uniform", "vertex", "varying", "faceVarying"])
def test_colours_of_the_cage_are_spread_over_the_surface(small, interpolation):
    points, counts, indices = grid(3)
    mesh = small.mesh("/Grid", points, counts.tolist(), indices.tolist(), "catmullClark")
    of_vertex = points[:, 0] / 2
    values = {
        "constant": [0.25],
        "uniform": [0.1, 0.2, 0.3, 0.4],
        "vertex": of_vertex,
        "varying": of_vertex,
        "faceVarying": of_vertex[indices],
    }[interpolation]
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, interpolation)
    primvar.Set([Gf.Vec3f(float(v), 0, 0) for v in values])
    found = only(small.open(), Shutter.still(1))
    shown = found.colors[found.color_indices][..., 0]
    if interpolation == "constant":
        np.testing.assert_allclose(shown, 0.25)
    elif interpolation == "uniform":
        assert np.unique(shown.round(6)).tolist() == [0.1, 0.2, 0.3, 0.4] and (np.ptp(shown, axis=1) == 0).all()
    else:
        # Linear along the grid's lines, whose places on the surface the border's rule moves by less than a cell's 1/6.
        assert abs(shown - found.points[found.triangles][..., 0] / 2).max() < 1 / 6 / 2 + 1e-6
        assert (shown.min(), shown.max()) == (0, 1)


def test_complexity_adds_levels(small):
    author_cube(small)
    counts = [len(only(small.open(complexity=c), Shutter.still(1)).triangles) for c in (1.0, 1.1, 1.2)]
    assert counts[1:] == [4 * counts[0], 16 * counts[0]]


def test_levels_are_bounded_by_what_they_cost():
    for faces in (6, 1000, 100_000):
        for surfaces in (1, 100, 10_000):
            levels = levels_for(faces, True, surfaces, 1.0)
            assert levels >= 1 and (levels == 1 or faces * 4.0**levels <= MOST_FACES / surfaces)
    assert levels_for(FINEST_CAGE + 1, True, 1, 2.0) == 0
    assert levels_for(6, True, 1, 1.0) > levels_for(6, False, 1, 1.0)


def test_faces_that_a_scheme_does_not_take_are_rendered_as_they_are_and_said(small):
    small.mesh("/Quads", scheme="loop")
    scene = small.open()
    assert len(only(scene, Shutter.still(1)).triangles) == 2
    assert len([m for m in scene.warnings.messages if "control polygons" in m]) == 1


def test_creases_that_do_not_fit_are_said(small):
    author_cube(small, CreaseIndices=[0, 99], CreaseLengths=[2], CreaseSharpnesses=[1.0])
    scene = small.open()
    assert len(only(scene, Shutter.still(1)).triangles) > 12
    assert len([m for m in scene.warnings.messages if "creaseIndices" in m]) == 1
