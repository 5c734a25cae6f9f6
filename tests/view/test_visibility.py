"""What camera rays see: where, how it moves, how much of it, and in which light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import (
    QUAD,
    SHUTTER,
    SUN,
    WATER,
    WHITE,
    bumpy,
    floor,
    looking_down,
    quad,
    see,
    turned,
    view_rays,
)
from tpdwarp.scene.description import (
    CameraAtShutter,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    SceneAtShutter,
)
from usd_scenes import shapes
from usd_scenes.oracle import finite_differences, surfaces_of
from usd_scenes.oracle.closed_forms import critical_angle, fresnel_reflectance, snell

MIRROR = Material(Interaction.MIRROR, color=(0.9, 0.5, 0.2))
SIZE = 16
FILMS = np.random.default_rng(2).uniform(2, SIZE - 2, (60, 2)).astype(np.float32).astype(float)
MIDDLE = np.array([[SIZE / 2, SIZE / 2]])
# Hits of order one unit in scenes of a few units: float32 positions with the offsets that keep rays off surfaces.
POSITION = 2e-5


def eye(moving: bool, target_down: float = 0.2) -> CameraAtShutter:
    axes = turned((target_down, 0.1, 0.05))
    travel = np.array([0.2, -0.1, 0.15]) if moving else np.zeros(3)
    spin = np.cross((0.05, 0.08, -0.1), axes) if moving else np.zeros((3, 3))
    return CameraAtShutter(
        "/cam", False, np.array([0.1, 0.3, 2.5]), axes, (-0.3, 0.3, -0.3, 0.3), position_motion=travel, axes_motion=spin
    )


def through_mirror(moving_camera: bool) -> CameraAtShutter:
    """Looks straight up at a mirror in which the floor is seen."""
    travel = np.array([0.1, 0.05, 0.1]) if moving_camera else np.zeros(3)
    axes = np.diag([1.0, -1.0, -1.0])
    return CameraAtShutter(
        "/cam", False, np.array([0.0, 0.0, 0.6]), axes, (-0.3, 0.3, -0.3, 0.3), position_motion=travel
    )


SCENES = {
    "moving camera": lambda: ([floor()], eye(True)),
    "moving floor": lambda: ([floor(motion=(0.2, 0.1, 0.15))], eye(False)),
    "moving floor and camera": lambda: ([floor(motion=(0.2, 0.1, 0.15))], eye(True)),
    "through moving water": lambda: ([floor(), bumpy("/water", WATER, 1.0, True)], eye(False)),
    "moving camera through moving water": lambda: ([floor(), bumpy("/water", WATER, 1.0, True)], eye(True)),
    "in a moving mirror": lambda: ([floor(), bumpy("/mirror", MIRROR, 1.8, True, True)], through_mirror(False)),
    "moving camera and floor in a moving mirror": lambda: (
        [floor(motion=(0, 0.1, 0)), bumpy("/mirror", MIRROR, 1.8, True, True)],
        through_mirror(True),
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_visible_points_and_their_motion_are_those_of_the_traced_camera_ray(name):
    meshes, camera = SCENES[name]()
    scene = SceneAtShutter(SHUTTER, tuple(meshes), (), camera)
    seen = see(scene, SIZE, SIZE, FILMS, moves=True)[0]

    def rays(u, v, t):
        return view_rays(camera, SIZE, SIZE, np.stack([u, v], axis=1), (t - SHUTTER.middle) / SHUTTER.exposure)

    found = finite_differences(surfaces_of(scene), rays, FILMS[:, 0], FILMS[:, 1], SHUTTER, "light", levels=4)
    usable = found.path.landed & (seen.receivers >= 0)
    assert usable.sum() > 50
    # Normals interpolated in float32 turn rays by a few roundings, over paths of a few units.
    np.testing.assert_allclose(seen.positions[usable], found.path.positions[usable], atol=POSITION)
    size = np.abs(found.dxdt[usable]).max()
    # Triangles of a quarter unit meet rays at float32 barycentrics; edges of D_t n amplify them by 1/edge.
    np.testing.assert_allclose(seen.motions[usable], found.dxdt[usable], atol=2e-4 * size)
    np.testing.assert_allclose(seen.normals[usable], found.path.normals[usable], atol=1e-5)


@pytest.mark.parametrize("time", [-0.4, 0.3])
def test_points_seen_at_other_times_stand_and_move_as_they_do_then(time):
    meshes, camera = [floor(motion=(0.2, 0.1, 0.15))], eye(True)
    scene = SceneAtShutter(SHUTTER, tuple(meshes), (), camera)
    seen = see(scene, SIZE, SIZE, FILMS, moves=True, time=time)[0]

    def visible(t):
        origins, directions = view_rays(camera, SIZE, SIZE, FILMS, t)
        height = 0.15 * t
        return origins + ((height - origins[:, 2]) / directions[:, 2])[:, None] * directions

    h = 1e-4
    motion = (visible(time + h) - visible(time - h)) / (2 * h)
    np.testing.assert_allclose(seen.motions, motion, atol=POSITION)
    np.testing.assert_allclose(seen.positions, visible(time), atol=POSITION)


def test_nothing_but_background_is_no_query():
    scene = SceneAtShutter(SHUTTER, (quad("/card", (-1, -1), (0, 1), 0.0),), (), looking_down())
    seen = see(scene, SIZE, SIZE, [[4.0, 8.0], [12.0, 8.0]])[0]
    np.testing.assert_array_equal(seen.receivers, [0, -1])
    np.testing.assert_allclose(seen.depths, [3.0, seen.depths[1]], rtol=1e-6)
    assert seen.depths[1] < 0 and not seen.weights[1].any()


def test_clipping_hides_what_is_nearer_or_farther():
    meshes = (floor(), quad("/card", (-1, -1), (1, 1), 2.0))
    for near, far, object_seen in ((0.0, 9.0, 1), (1.5, 9.0, 0), (0.0, 0.5, -1), (1.5, 2.5, -1)):
        scene = SceneAtShutter(SHUTTER, meshes, (), looking_down(near=near, far=far))
        assert see(scene, SIZE, SIZE, MIDDLE)[0].receivers[0] == object_seen, (near, far)


def lit(light: LightAtShutter, *meshes, films=MIDDLE) -> np.ndarray:
    """Direct irradiance [n, 3] on a white floor, from its radiance."""
    scene = SceneAtShutter(SHUTTER, (floor(), *meshes), (light,), looking_down())
    return math.pi * see(scene, SIZE, SIZE, films)[0].direct


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.4])
def test_distant_light_follows_the_cosine_law(angle):
    axes = turned((angle, 0, 1e-12))
    light = LightAtShutter("/sun", LightKind.DISTANT, (1.0, 2.0, 3.0), axes=axes)
    expected = np.array([1.0, 2.0, 3.0]) * math.cos(angle)
    np.testing.assert_allclose(lit(light)[0], expected, rtol=1e-5)


def test_point_light_follows_the_inverse_square_and_the_cosine_law():
    for position in ((0, 0, 0.5), (0.6, -0.3, 2.0), (2.0, 1.0, 0.4)):
        light = LightAtShutter("/bulb", LightKind.POINT, (3.0, 1.0, 2.0), position=np.array(position, float))
        distance = np.linalg.norm(position)
        expected = np.array([3.0, 1.0, 2.0]) * position[2] / distance**3
        np.testing.assert_allclose(lit(light)[0], expected, rtol=1e-5)


def test_light_from_below_does_not_reach_the_upper_side():
    assert not lit(LightAtShutter("/sun", LightKind.DISTANT, (1.0,) * 3, axes=turned((math.pi, 0, 0)))).any()
    assert not lit(LightAtShutter("/bulb", LightKind.POINT, (1.0,) * 3, position=np.array([0, 0, -1.0]))).any()


@pytest.mark.parametrize("material", [Material(), WATER, MIRROR], ids=["diffuse", "dielectric", "mirror"])
def test_whatever_stands_in_the_light_casts_a_shadow_and_nothing_beside_it(material):
    # Light along (1, 0, −1): the card's left half, at height 0.5, shades the floor half a unit further to the right.
    light = LightAtShutter("/sun", LightKind.DISTANT, (1.0,) * 3, axes=turned((0, -math.pi / 4, 0)))
    card = quad("/card", (-1.5, -1), (-0.5, 1), 0.5, material)
    shaded = np.array([[-0.2, 0.3], [-0.02, -0.6]])
    free = np.array([[0.02, 0.3], [0.6, -0.6]])
    films = [((p + 1) * (1, -1) + (0, 2)) * SIZE / 2 for p in (shaded, free)]
    assert not lit(light, card, films=films[0]).any()
    np.testing.assert_allclose(lit(light, card, films=films[1]), math.cos(math.pi / 4), rtol=1e-5)


def test_light_is_not_shaded_by_what_lies_behind_it():
    light = LightAtShutter("/bulb", LightKind.POINT, (1.0,) * 3, position=np.array([0.0, 0, 1.0]))
    roof = quad("/roof", (-1, -1), (1, 1), 2.0, up=False)
    scene = SceneAtShutter(SHUTTER, (floor(), roof), (light,), looking_down(height=1.5))
    np.testing.assert_allclose(math.pi * see(scene, SIZE, SIZE, MIDDLE)[0].direct[0], 1.0, rtol=1e-5)


def test_radiance_is_albedo_over_pi_times_irradiance():
    ground = floor(material=Material(color=(0.2, 0.5, 0.8)))
    light = LightAtShutter("/sun", LightKind.DISTANT, (2.0,) * 3)
    seen = see(SceneAtShutter(SHUTTER, (ground,), (light,), looking_down()), SIZE, SIZE, MIDDLE)[0]
    np.testing.assert_allclose(seen.direct[0], np.array([0.2, 0.5, 0.8]) * 2 / math.pi, rtol=1e-6)
    np.testing.assert_allclose(seen.weights[0], np.array([0.2, 0.5, 0.8]) / math.pi, rtol=1e-6)


def slanted_camera(theta: float, height: float) -> CameraAtShutter:
    """Looks down at ``theta`` to the vertical, towards +x, orthographically through (0, 0, 1)."""
    axes = turned((0, -theta, 1e-12))
    return CameraAtShutter("/cam", True, np.array([0, 0, 1.0]) + (height - 1) * axes[2], axes, (-0.1, 0.1, -0.1, 0.1))


@pytest.mark.parametrize("theta", [0.0, 0.6, 1.2])
def test_check_21_seen_through_flat_water_the_floor_is_shifted_by_snell_and_dimmed_by_fresnel(theta):
    water = quad("/water", (-3, -3), (3, 3), 1.0, WATER)
    scene = SceneAtShutter(SHUTTER, (floor(), water), (), slanted_camera(theta, 2.0))
    refracted, reflected = (*see(scene, SIZE, SIZE, MIDDLE), None)[:2]
    inside = snell(theta, 1.0, 1.33)
    np.testing.assert_allclose(refracted.positions[0], [math.tan(inside), 0, 0], atol=POSITION)
    transmitted = 1 - fresnel_reflectance(theta, 1.0, 1.33)
    # In radiance the beam inside is narrower by the square of the index.
    np.testing.assert_allclose(math.pi * refracted.weights[0], transmitted / 1.33**2, rtol=1e-5)
    # The reflection is followed too; it goes up, to nothing.
    assert reflected is not None and reflected.receivers[0] == -1


@pytest.mark.parametrize("wedge", [0.1, 0.4])
def test_through_a_wedge_of_glass_radiance_keeps_its_scale_whatever_its_angle(wedge):
    """In at a tilted face, out at a level one: the square of the index cancels, Snell and Fresnel count at each."""
    glass = Material(Interaction.DIELECTRIC, ior=1.5)
    top = quad("/top", (-3, -3), (3, 3), 0.0, glass)
    top = replace(top, points=top.points @ turned((0, wedge, 0)) + (0, 0, 1.5))
    bottom = quad("/bottom", (-3, -3), (3, 3), 0.5, glass, up=False)
    scene = SceneAtShutter(SHUTTER, (floor(), top, bottom), (), looking_down(height=5.0))
    seen = see(scene, SIZE, SIZE, MIDDLE)[0]
    inside = wedge - snell(wedge, 1.0, 1.5)
    passed = (1 - fresnel_reflectance(wedge, 1.0, 1.5)) * (1 - fresnel_reflectance(inside, 1.5, 1.0))
    np.testing.assert_allclose(math.pi * seen.weights[0], passed, rtol=1e-5)


@pytest.mark.parametrize("theta", [0.3, 0.9])
def test_what_water_reflects_is_seen_with_the_rest_of_the_light(theta):
    water, roof = quad("/water", (-3, -3), (3, 3), 1.0, WATER), quad("/roof", (-9, -9), (9, 9), 1.8, up=False)
    camera = slanted_camera(theta, 1.3)
    scene = SceneAtShutter(SHUTTER, (floor(), water, roof), (), camera)
    refracted, reflected = see(scene, SIZE, SIZE, MIDDLE)[:2]
    np.testing.assert_allclose(reflected.positions[0], [0.8 * math.tan(theta), 0, 1.8], atol=POSITION)
    np.testing.assert_allclose(math.pi * (1.33**2 * refracted.weights[0] + reflected.weights[0]), 1.0, rtol=1e-5)
    np.testing.assert_allclose(math.pi * reflected.weights[0], fresnel_reflectance(theta, 1.0, 1.33), rtol=1e-5)
    assert refracted.receivers[0] == 0 and reflected.receivers[0] == 2 and reflected.items[0] == 0


def test_beyond_the_critical_angle_water_is_a_perfect_mirror():
    water = quad("/water", (-5, -5), (5, 5), 1.0, WATER)
    theta = critical_angle(1.33, 1.0) + 0.05
    axes = turned((0, -(math.pi - theta), 1e-12))
    camera = CameraAtShutter("/cam", True, np.array([0, 0, 1.0]) + 0.5 * axes[2], axes, (-0.1, 0.1, -0.1, 0.1))
    passes = see(SceneAtShutter(SHUTTER, (floor(), water), (), camera), SIZE, SIZE, MIDDLE)
    assert len(passes) == 1
    np.testing.assert_allclose(math.pi * passes[0].weights[0], 1.0, rtol=1e-6)
    np.testing.assert_allclose(passes[0].positions[0], [math.tan(theta), 0, 0], atol=1e-4)


def test_a_mirror_tints_what_it_shows():
    mirror = quad("/mirror", (-3, -3), (3, 3), 1.8, MIRROR, up=False)
    scene = SceneAtShutter(SHUTTER, (floor(), mirror), (), through_mirror(False))
    passes = see(scene, SIZE, SIZE, MIDDLE)
    assert len(passes) == 1
    np.testing.assert_allclose(math.pi * passes[0].weights[0], MIRROR.color, rtol=1e-6)
    np.testing.assert_allclose(passes[0].positions[0], [0, 0, 0], atol=POSITION)


def test_a_mirror_between_mirrors_ends_where_the_bounces_do():
    mirror = quad("/mirror", (-3, -3), (3, 3), 1.8, MIRROR, up=False)
    other = quad("/other", (-3, -3), (3, 3), 0.2, MIRROR)
    scene = SceneAtShutter(SHUTTER, (floor(), mirror, other), (), through_mirror(False))
    seen = see(scene, SIZE, SIZE, MIDDLE)[0]
    assert seen.receivers[0] == -1 and not seen.weights[0].any()


PLANES = {"z = 0": (0, 0, 0), "x = 0": (0, math.pi / 2, 0), "y = 0": (math.pi / 2, 0, 0), "tilted": (0.3, 0.2, 0.5)}


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("through_the_middle", [True, False])
def test_no_point_of_a_lone_floor_lies_in_its_own_shadow(plane, size, through_the_middle):
    """Whatever plane it lies in, at whatever angle light falls: ray offsets vanish with the coordinates there."""
    turn = turned(PLANES[plane]) if any(PLANES[plane]) else np.eye(3)
    corners = size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    corners += 0.0 if through_the_middle else size * np.array([0.3, -0.2, 0.4])
    board = MeshAtShutter("/floor", corners @ turn.T, QUAD, materials=(WHITE,))
    eye = corners.mean(axis=0) + np.array([0, 0, size])
    window = (-0.9 * size, 0.9 * size, -0.9 * size, 0.9 * size)
    camera = CameraAtShutter("/cam", True, turn @ eye, turn.T.copy(), window)
    for angle in (0.02, 0.6, 1.1, 1.5):
        to_light = turn @ np.array([math.sin(angle) * 0.8, math.sin(angle) * 0.6, math.cos(angle)])
        across = np.cross(turn[:, 2] + (0.1, 0.2, 0.3), to_light)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(to_light, across), to_light])
        sun = LightAtShutter("/sun", LightKind.DISTANT, (1.0, 1.0, 1.0), axes=axes)
        films = np.random.default_rng(5).uniform(0, 64, (2000, 2))
        (seen,) = see(SceneAtShutter(SHUTTER, (board,), (sun,), camera), 64, 64, films)
        np.testing.assert_allclose(math.pi * seen.direct[:, 0], math.cos(angle), rtol=1e-4)


@pytest.mark.parametrize("body", ["box", "ball"])
@pytest.mark.parametrize(("size", "offset"), [(1e-3, 0.0), (1.0, 0.0), (1.0, 1e3), (1.0, 1e7), (1e4, 1e8)])
def test_no_point_of_a_convex_body_or_of_what_it_stands_on_lies_in_its_own_shadow(body, size, offset):
    """Turned at random, half sunk or standing on a floor, under light that falls along that floor's normal."""
    points, triangles = shapes.box((1.0, 1.0, 1.0)) if body == "box" else shapes.sphere(32, 16)[:2]
    random, place = np.random.default_rng(3), np.array([offset, -2 * offset, 0.5 * offset])
    films = random.uniform(0, 64, (1000, 2))
    for angles in random.normal(size=(3, 3)):
        turn = turned(angles).T
        up = turn[:, 2]
        lifted = points + ((0, 0, 0.5) if body == "box" else (0, 0, 0))
        corners = 3.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
        ground = MeshAtShutter("/floor", size * corners @ turn.T + place, QUAD, materials=(WHITE,))
        solid = MeshAtShutter(
            "/body", size * lifted @ turn.T + place, triangles.astype(np.int32), materials=(WHITE,)
        )  # fmt: skip
        across = np.cross(turn[:, 0] + (0.1, 0.2, 0.3), up)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(up, across), up])
        sun = LightAtShutter("/sun", LightKind.DISTANT, (1.0, 1.0, 1.0), axes=axes)
        view = turned((0.4, 0.2, 0.0)) @ axes
        camera = CameraAtShutter("/cam", True, place + 6 * size * view[2], view, (-2 * size, 2 * size) * 2)
        (seen,) = see(SceneAtShutter(SHUTTER, (ground, solid), (sun,), camera), 64, 64, films)
        met = seen.receivers >= 0
        assert met.mean() > 0.9
        expected = np.maximum(seen.normals[met] @ up, 0.0)
        np.testing.assert_allclose(math.pi * seen.direct[met, 0], expected, atol=1e-3)


def test_surfaces_a_ten_thousandth_of_the_scene_apart_shadow_each_other():
    """A card over the left half of a floor, with light that falls steeply."""
    card = quad("/card", (-2, -2), (0, 2), 1e-4)
    films = np.random.default_rng(6).uniform((0, 0), (64, 64), (500, 2))
    below = CameraAtShutter("/cam", True, np.array([0.0, 0.0, 0.5e-4]), np.eye(3), (-1, 1, -1, 1))
    (seen,) = see(SceneAtShutter(SHUTTER, (floor(2.0), card), (SUN,), below), 64, 64, films)
    np.testing.assert_array_equal(seen.direct[:, 0] > 0, films[:, 0] > 32)


@pytest.mark.parametrize("against", [False, True])
def test_normals_shade_the_side_that_is_seen_also_where_they_were_authored_against_the_winding(against):
    normals = np.tile([[0.0, 0.0, -1.0 if against else 1.0]], (4, 1))
    board = replace(floor(), normals=normals, normal_indices=QUAD)
    (seen,) = see(SceneAtShutter(SHUTTER, (board,), (SUN,), slanted_camera(0.0, 2.0)), SIZE, SIZE, MIDDLE)
    np.testing.assert_allclose(math.pi * seen.direct[0], 1.0, rtol=1e-6)
