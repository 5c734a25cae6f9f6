"""Where rays meet the scene: hits, normals, colours and motion there, against the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.photons.shapes import DIFFUSE, MIRROR, floor, mesh, ripples
from tests.photons.traced import EPS, scene_of
from tpdwarp.device import Launcher
from tpdwarp.scene.device.geometry import Geometry, Surfaces, geometry_of
from tpdwarp.scene.device.intersection import closest_hit, diffuse_color, occluded, shading_normal
from usd_scenes.oracle import surfaces_of
from usd_scenes.oracle.tracer import trace

from .test_geometry import GRID, NORM, packed, striped


@wp.kernel(enable_backward=False)
def look(
    surfaces: Surfaces,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    moves: bool,
    found: wp.array2d(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.int32),
    blocked: wp.array(dtype=wp.int32),
):
    i = wp.tid()
    nothing = wp.vec3(0.0, 0.0, 0.0)
    stream = wp.rand_init(1, i)
    hit = closest_hit(surfaces, origins[i], directions[i], nothing, surfaces.magnitude, 0.0, 100.0, moves, stream)
    triangles[i] = hit.triangle
    blocked[i] = int(occluded(surfaces, origins[i], directions[i], nothing, 1.0))
    if hit.triangle >= 0:
        found[i, 0] = hit.position
        found[i, 1] = hit.n_g
        found[i, 2] = hit.beta
        found[i, 3] = hit.motion
        found[i, 4] = shading_normal(surfaces, hit, False, moves).n
        found[i, 5] = diffuse_color(surfaces, hit)


def looked(geometry: Geometry, origins: np.ndarray, directions: np.ndarray, moves: bool = False):
    """Hits of rays in the world: columns by name, triangles [n] and whether something is within one unit [n]."""
    launcher, count = Launcher("cpu", 1), len(origins)
    found = wp.zeros((count, 6), dtype=wp.vec3, device="cpu")
    triangles, blocked = launcher.zeros(count, wp.int32), launcher.zeros(count, wp.int32)
    inputs = [launcher.array(NORM.points(origins), wp.vec3), launcher.array(directions.astype(np.float32), wp.vec3)]
    wp.launch(look, dim=count, inputs=[geometry.surfaces, *inputs, moves, found, triangles, blocked], device="cpu")
    names = ("position", "n_g", "beta", "motion", "n", "color")
    columns = found.numpy().astype(np.float64).transpose(1, 0, 2)
    return dict(zip(names, columns, strict=True)), triangles.numpy(), blocked.numpy()


def rays(count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(4)
    origins = np.append(random.uniform(-0.6, 0.6, (count, 2)), np.full((count, 1), 2.5), axis=1)
    directions = np.append(random.uniform(-0.2, 0.2, (count, 2)), np.full((count, 1), -1.0), axis=1)
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("smooth", [True, False])
def test_hits_are_those_of_the_oracle(smooth):
    water = ripples(GRID, GRID, 1.0, 0.05, DIFFUSE, smooth)
    origins, directions = rays()
    hits, triangles, _ = looked(packed(water, with_motions=True), origins, directions, moves=True)
    (surface,) = surfaces_of(scene_of([water]))
    path = trace([surface], origins, directions, 4.0)
    cell = 0.25 * (GRID[1] - GRID[0])
    np.testing.assert_array_equal(triangles, path.primitives[0])
    np.testing.assert_allclose(NORM.world_points(hits["position"]), path.positions, atol=16 * EPS / NORM.scale)
    np.testing.assert_allclose(hits["beta"], path.barycentrics[0], atol=16 * EPS / cell)
    geometric, shading, _ = surface.frame(path.positions, path.primitives[0], 4.0)
    np.testing.assert_allclose(hits["n_g"], geometric, atol=16 * EPS / cell)
    np.testing.assert_allclose(hits["n"], shading, atol=16 * EPS / cell)
    motion = np.einsum("nk,nki->ni", path.barycentrics[0], water.motions[water.triangles[triangles]])
    np.testing.assert_allclose(NORM.world_vectors(hits["motion"]), motion, atol=16 * EPS / cell)


def test_what_stands_instead_of_an_earlier_scene_is_met_as_if_it_were_built_anew():
    earlier, water = (ripples(GRID, GRID, height, 0.05, DIFFUSE, True) for height in (0.5, 1.0))
    scene, launcher = scene_of([water, floor(-1.0)]), Launcher("cpu", 1)
    before, anew = packed(earlier, floor(-1.0)), packed(water, floor(-1.0))
    after = geometry_of(scene, NORM, launcher, with_motions=False, instead_of=before)
    assert after.trees is before.trees
    (found, triangles, _), (expected, known, _) = (looked(geometry, *rays()) for geometry in (after, anew))
    np.testing.assert_array_equal(triangles, known)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)
    # Other triangles have a tree of their own.
    assert geometry_of(scene, NORM, launcher, with_motions=False, instead_of=packed(water)).trees is not before.trees


def test_scenes_of_a_frame_that_share_a_tree_are_each_met_as_if_they_had_their_own(monkeypatch):
    monkeypatch.setattr("tpdwarp.scene.device.geometry.SHARED_FROM", 1)
    earlier, water = (ripples(GRID, GRID, height, 0.05, DIFFUSE, True) for height in (0.5, 1.0))
    launcher = Launcher("cpu", 1)
    options = {"with_motions": True, "beside": (before := packed(earlier, floor(-1.0), with_motions=True))}
    after = geometry_of(scene_of([water, floor(-1.0)]), NORM, launcher, **options)
    assert after.trees is before.trees
    monkeypatch.setattr("tpdwarp.scene.device.geometry.SHARED_FROM", 1 << 30)
    own_before, own_after = (packed(of, floor(-1.0), with_motions=True) for of in (earlier, water))
    for pair in ((after, own_after), (before, own_before), (after, own_after)):
        found, expected = (looked(one, *rays()) for one in pair)
        np.testing.assert_array_equal(found[1], expected[1])
        for name, values in expected[0].items():
            np.testing.assert_array_equal(found[0][name], values)
    # One that moves within the shutter is looked at by the same tree, and does not stay there.
    monkeypatch.setattr("tpdwarp.scene.device.geometry.SHARED_FROM", 1)
    assert after.at(0.5, launcher).tree.mesh == before.trees.mesh.id
    found, expected = (looked(one, *rays()) for one in (before, own_before))
    np.testing.assert_array_equal(found[0]["position"], expected[0]["position"])
    # Those of other triangles, and small ones, have a tree of their own.
    assert geometry_of(scene_of([water]), NORM, launcher, **options).trees is not before.trees
    monkeypatch.setattr("tpdwarp.scene.device.geometry.SHARED_FROM", 1 << 30)
    assert geometry_of(scene_of([water, floor(-1.0)]), NORM, launcher, **options).trees is not before.trees


def test_a_ray_meets_nothing_where_nothing_is():
    origins, directions = rays()
    _, triangles, blocked = looked(packed(floor(0.0)), origins, -directions)
    assert (triangles == -1).all() and not blocked.any()
    _, triangles, blocked = looked(packed(floor(2.0)), origins, directions)
    # One unit of the tracer is four of the scene.
    assert (triangles >= 0).all() and blocked.all()
    assert not looked(packed(floor(-2.0)), origins, directions)[2].any()


def test_rays_through_edges_and_vertices_do_not_slip_between_triangles():
    water = ripples(GRID, GRID, 1.0, 0.05, DIFFUSE, True)
    inner = np.abs(water.points[:, :2]).max(axis=1) < 0.9
    a, b, _ = water.points[water.triangles.T]
    targets = np.concatenate([water.points[inner], 0.5 * (a + b)])
    origin = np.array([0.3, -0.2, 3.0])
    directions = targets - origin
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    keep = np.abs(targets[:, :2]).max(axis=1) < 0.9
    _, triangles, _ = looked(packed(water), np.broadcast_to(origin, targets.shape)[keep], directions[keep])
    assert (triangles >= 0).all()


def test_display_colours_interpolate_and_leave_the_rest_to_the_material():
    origins = np.array([[0.5, -0.5, 1.0], [-0.5, 0.5, 1.0], [0.9, -0.8, 1.0]])
    down = np.tile([0.0, 0.0, -1.0], (3, 1))
    hits, triangles, _ = looked(packed(striped()), origins, down)
    assert triangles.tolist() == [0, 1, 0]
    colors, indices = striped().colors, striped().color_indices
    for row in (0, 2):
        np.testing.assert_allclose(hits["color"][row], hits["beta"][row] @ colors[indices[0]], atol=8 * EPS)
    np.testing.assert_allclose(hits["color"][1], MIRROR.color, atol=EPS)


def test_the_sum_of_opposite_normals_falls_back_to_the_facet():
    torn = mesh(
        "/torn",
        [[-1, -1, 0], [1, -1, 0], [0, 1, 0]],
        [[0, 1, 2]],
        DIFFUSE,
        normals=np.array([[1.0, 0, 0], [-1.0, 0, 0], [0.0, 0, 0]]),
    )
    middle = np.array([[0.0, -0.5, 1.0]])
    hits, _, _ = looked(packed(torn), middle, np.array([[0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(hits["n"], [[0, 0, 1]], atol=EPS)


def test_normals_move_with_the_time_of_the_view():
    water = ripples(GRID, GRID, 1.0, 0.05, DIFFUSE, True)
    origins, directions = rays()
    geometry = packed(water, with_motions=True)
    later = replace(geometry, packed=geometry.at(0.5, Launcher("cpu", 1)))
    hits, triangles, _ = looked(later, origins, directions, moves=True)
    (surface,) = surfaces_of(scene_of([water]))
    path = trace([surface], origins, directions, 5.0)
    np.testing.assert_array_equal(triangles, path.primitives[0])
    shading = surface.frame(path.positions, path.primitives[0], 5.0)[1]
    cell = 0.25 * (GRID[1] - GRID[0])
    np.testing.assert_allclose(hits["n"], shading, atol=16 * EPS / cell)
    still = surface.frame(path.positions, path.primitives[0], 4.0)[1]
    assert np.abs(hits["n"] - still).max() > 1e-3
