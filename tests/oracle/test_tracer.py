"""The oracle's tracer: paths through meshes and analytic surfaces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter, Shutter
from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.description import surfaces_of
from usd_scenes.oracle.shapes import grid_points, grid_triangles
from usd_scenes.oracle.surfaces import Ellipsoid, HeightField, Plane, TriangleMesh
from usd_scenes.oracle.tracer import trace

FLOOR = Plane("/floor", (0, 0, 0), (0, 0, 1))
GLASS = Interaction.DIELECTRIC


def slab(mesh: bool) -> list:
    if not mesh:
        return [
            Plane("/top", (0, 0, 2), (0, 0, 1), GLASS, 1.5),
            Plane("/bottom", (0, 0, 1.5), (0, 0, -1), GLASS, 1.5),
        ]
    x = np.array([-3.0, 0.4, 3.0])
    faces = grid_triangles(3, 3)
    return [
        TriangleMesh("/top", grid_points(x, x, lambda x, y: 2.0), faces, interaction=GLASS, ior=1.5),
        TriangleMesh("/bottom", grid_points(x, x, lambda x, y: 1.5), faces[:, ::-1], interaction=GLASS, ior=1.5),
    ]


@pytest.mark.parametrize("mesh", [False, True])
def test_a_slab_shifts_light_by_its_closed_form_and_takes_two_fresnel_shares(mesh):
    theta = 0.5
    direction = np.array([[math.sin(theta), 0, -math.cos(theta)]])
    path = trace([*slab(mesh), FLOOR], [[-1.5, 0.1, 3]], direction, 0.0)
    expected = -1.5 + 3 * math.tan(theta) - closed_forms.slab_shift(0.5, theta, 1.5)
    np.testing.assert_allclose(path.positions, [[expected, 0.1, 0]], atol=1e-14)
    np.testing.assert_allclose(path.directions, direction, atol=1e-15)
    assert path.throughput[0] == pytest.approx((1 - closed_forms.fresnel_reflectance(theta, 1, 1.5)) ** 2, abs=1e-14)
    assert path.bounces[0] == 2 and path.surfaces[:3, 0].tolist() == [0, 1, 2]


def test_the_orders_of_internal_reflection_sum_to_the_slabs_transmittance():
    total = 0.0
    for order in range(12):
        choices = ["refract"] + ["reflect"] * (2 * order) + ["refract"]
        total += trace([*slab(False), FLOOR], [[0, 0, 3]], [[0, 0, -1]], 0, choices, max_bounces=40).throughput[0]
    assert total == pytest.approx(closed_forms.slab_transmittance(0.04), abs=0.04**24 + 1e-14)


@pytest.mark.parametrize("degrees, reflects", [(41.8, False), (41.82, True)])
def test_light_is_totally_reflected_beyond_the_critical_angle(degrees, reflects):
    theta = math.radians(degrees)
    glass = Plane("/glass", (0, 0, 1), (0, 0, -1), GLASS, 1.5)
    ceiling = Plane("/ceiling", (0, 0, 5), (0, 0, -1))
    ray = [[0, 0, 2]], [[math.sin(theta), 0, -math.cos(theta)]]
    path = trace([glass, FLOOR, ceiling], *ray, 0.0, "auto")
    assert path.surfaces[1, 0] == (2 if reflects else 1)
    assert (path.throughput[0] == 1) == reflects
    assert trace([glass, FLOOR, ceiling], *ray, 0.0, "refract").landed[0] != reflects


def test_every_ray_has_its_own_time():
    mirror = Plane("/mirror", lambda t: (0, 0, 2 + t), (0, 0, -1), Interaction.MIRROR)
    times = np.array([0.0, 1.0, 0.5, 1.0])
    path = trace([mirror, FLOOR], np.tile([0.0, 0, 1], (4, 1)), np.tile([0.6, 0, 0.8], (4, 1)), times)
    np.testing.assert_allclose(path.positions[:, 0], 0.75 * (2 * (2 + times) - 1), atol=1e-14)


def test_rays_do_not_leak_through_edges_and_vertices_of_a_mesh():
    x = np.linspace(-1, 1, 5)
    mesh = TriangleMesh("/floor", grid_points(x, x, lambda x, y: 0.1 * x), grid_triangles(5, 5))
    a, b, _ = mesh.points[mesh.triangles.T]
    targets = np.concatenate([mesh.points, 0.5 * (a + b)])
    origin = np.array([0.3, -0.2, 2.0])
    path = trace([mesh], np.broadcast_to(origin, targets.shape), targets - origin, 0.0)
    assert path.landed.all()
    np.testing.assert_allclose(path.positions, targets, atol=1e-14)


def test_barycentrics_name_the_hit_and_interpolate_the_normal():
    normals = np.array([[0.1, 0, 1], [0, 0.2, 1], [-0.3, 0, 1]])
    mesh = TriangleMesh("/t", np.array([[0.0, 0, 1], [1, 0, 1.2], [0, 1, 0.9]]), np.array([[0, 1, 2]]), normals)
    weights = np.array([0.2, 0.5, 0.3])
    hit = weights @ mesh.points
    path = trace([mesh], hit[None] + [[0, 0, 3]], [[0, 0, -1]], 0.0)
    np.testing.assert_allclose(path.barycentrics[0, 0], weights, atol=1e-14)
    shading = mesh.frame(hit[None], np.array([0]), 0.0)[1][0]
    np.testing.assert_allclose(shading, weights @ normals / np.linalg.norm(weights @ normals), atol=1e-15)


def test_following_a_mesh_keeps_the_barycentrics():
    start, velocity = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]), np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.5]])
    mesh = TriangleMesh("/t", lambda t: start + t * velocity, np.array([[0, 1, 2]]))
    weights = np.array([0.2, 0.5, 0.3])
    moved = mesh.follow((weights @ start)[None], np.array([0]), 0.0, 2.0)[0]
    np.testing.assert_allclose(moved, weights @ (start + 2 * velocity), atol=1e-15)


def test_a_ball_refracts_in_and_out_at_the_same_angle():
    ball = Ellipsoid("/ball", (0, 0, 2), (1, 1, 1), GLASS, 1.5)
    path = trace([ball, FLOOR], [[0.6, 0, 5]], [[0, 0, -1]], 0.0)
    theta = math.asin(0.6)
    turn = 2 * (theta - closed_forms.snell(theta, 1, 1.5))
    np.testing.assert_allclose(path.directions, [[-math.sin(turn), 0, -math.cos(turn)]], atol=1e-14)
    assert path.primitives[:2, 0].tolist() == [0, 1]


def test_keeping_to_a_path_reproduces_it_and_continues_beyond_edges():
    faces = np.array([[0, 1, 2]])
    glass = TriangleMesh("/glass", np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]), faces, interaction=GLASS)
    inside = trace([glass, FLOOR], [[0.2, 0.2, 2]], [[0.1, 0, -1]], 0.0)
    again = trace([glass, FLOOR], [[0.2, 0.2, 2]], [[0.1, 0, -1]], 0.0, along=inside)
    np.testing.assert_array_equal(again.positions, inside.positions)
    beyond = trace([glass, FLOOR], [[-0.5, 0.2, 2]], [[0.1, 0, -1]], 0.0, along=inside)
    np.testing.assert_allclose(beyond.positions, inside.positions - [[0.7, 0, 0]], atol=1e-14)
    assert trace([glass, FLOOR], [[-0.5, 0.2, 2]], [[0.1, 0, -1]], 0.0).bounces[0] == 0


def test_a_height_field_is_met_where_ray_and_surface_agree():
    field = HeightField(
        "/hill",
        lambda x, y, t: 0.2 * np.sin(3 * x + t) * np.cos(2 * y),
        lambda x, y, t: (0.6 * np.cos(3 * x + t) * np.cos(2 * y), -0.4 * np.sin(3 * x + t) * np.sin(2 * y)),
        (-0.2, 0.2),
        Interaction.DIFFUSE,
    )
    random = np.random.default_rng(3)
    origins = np.append(random.uniform(-1, 1, (64, 2)), np.full((64, 1), 1.0), axis=1)
    path = trace([field], origins, random.uniform(-0.5, 0.5, (64, 3)) - [0, 0, 1], 0.7)
    x, y, z = path.positions.T
    np.testing.assert_allclose(z, field.height(x, y, 0.7), atol=1e-14)
    assert path.landed.all()


def test_a_photon_that_leaves_the_scene_does_not_land():
    path = trace([FLOOR], [[0, 0, 1]], [[0, 0, 1]], 0.0)
    assert not path.landed[0] and np.isnan(path.positions).all()


def test_an_unknown_branch_is_refused():
    with pytest.raises(ValueError, match="refract, reflect or auto"):
        trace([*slab(False), FLOOR], [[0, 0, 3]], [[0, 0, -1]], 0.0, "through")


def test_a_described_scene_moves_linearly_through_its_shutter():
    points = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 1], [4, 0, 1], [0, 4, 1]])
    mesh = MeshAtShutter(
        "/both",
        points,
        np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32),
        motions=np.repeat([[0.0, 0, 0], [0, 0, 0.5]], 3, axis=0),
        materials=(Material(), Material(Interaction.DIELECTRIC, ior=1.33)),
        triangle_materials=np.array([0, 1], dtype=np.int32),
    )
    floor, water = surfaces_of(SceneAtShutter(Shutter(10, 10, 12), (mesh,), ()))
    assert (floor.interaction, water.interaction, water.ior) == (Interaction.DIFFUSE, Interaction.DIELECTRIC, 1.33)
    path = trace([floor, water], np.tile([1.0, 1, 3], (3, 1)), np.tile([0.0, 0, -1], (3, 1)), np.array([10.0, 11, 12]))
    np.testing.assert_allclose(path.points[0, :, 2], [0.75, 1.0, 1.25], atol=1e-14)
