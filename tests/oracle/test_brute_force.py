"""The tracer of moving meshes against closed forms, and against the slow tracer in NumPy."""

import math

import numpy as np
import pytest
import warp as wp

from usd_scenes import shapes
from usd_scenes.brute_force import Camera, Light, Mesh, Scene, irradiance
from usd_scenes.brute_force.description import DIELECTRIC, DIFFUSE, MIRROR, between
from usd_scenes.brute_force.mesh_tracer import ROULETTE
from usd_scenes.brute_force.photon_histogram import clear_view
from usd_scenes.brute_force.sobol import coordinate, direction_numbers
from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.surfaces import TriangleMesh
from usd_scenes.oracle.tracer import trace

DOWN = np.array([0.0, 0.0, -1.0])
ROULETTE_SHARE = float(ROULETTE.value)


def still(name, shape, center, interaction, ior=1.5, smooth=True):
    points = shape[0] + np.asarray(center, dtype=float)
    normals = (shape[2],) * 2 if smooth and len(shape) == 3 else None
    return Mesh(name, (points, points), shape[1], interaction, ior, 1.0, normals)


def floor(size=20.0):
    return still("/floor", shapes.rectangle(size, size), (0, 0, 0), DIFFUSE)


def flat_sheet(size, height):
    return shapes.sheet(size, 4, lambda x, y: (0 * x + height, 0 * x, 0 * x))


def camera(size=1.0, pixels=16, height=0.1, center=(0.0, 0.0)):
    eye = np.array([*center, height])
    return Camera((eye, eye), np.eye(3), size, pixels, pixels)


def sun(degrees=0.0):
    angle = math.radians(degrees)
    return Light("/sun", 1.0, direction=np.array([math.sin(angle), 0.0, -math.cos(angle)]))


def scene(meshes, light, view, clear=True):
    return Scene("test", tuple(meshes), (light,), view, clear)


def roulette_error(photons):
    """Five standard deviations of a share of the flux, of which less than .08 goes by roulette (normal incidence)."""
    return 5.0 * math.sqrt(0.08 * ROULETTE_SHARE / photons)


def balance(energy):
    gone = sum(watts for name, watts in energy.items() if name not in ("sent", "direct", "roulette"))
    return energy["sent"] + energy["roulette"] - gone


def test_a_slab_lets_the_series_of_its_reflections_through():
    slab = still("/slab", shapes.box((1.0, 1.0, 0.1)), (0, 0, 1), DIELECTRIC)
    truth = irradiance(scene([floor(), slab], sun(), camera(0.8)), 1 << 16, parts=4)
    expected = closed_forms.slab_transmittance(0.04)
    assert expected == pytest.approx(12 / 13)
    assert truth.energy["/floor"] / truth.energy["sent"] == pytest.approx(expected, abs=roulette_error(1 << 16))
    assert truth.energy["sent"] == pytest.approx(1.0, rel=1e-9)
    assert truth.irradiance.mean() == pytest.approx(expected, abs=0.01)


def test_light_enters_flat_water_by_fresnel_and_snell():
    depth, degrees = 2.0, 40.0
    water = still("/water", flat_sheet(0.5, depth), (0, 0, 0), DIELECTRIC, 1.33)
    theta_t = closed_forms.snell(math.radians(degrees), 1.0, 1.33)
    middle = depth * math.tan(theta_t)
    truth = irradiance(scene([floor(), water], sun(degrees), camera(1.0, 64, center=(middle, 0.0))), 1 << 16, parts=2)
    transmitted = 1 - closed_forms.fresnel_reflectance(math.radians(degrees), 1.0, 1.33)
    # The part that goes through is never played for: nothing but the sampling of pixels' borders errs.
    assert truth.energy["/floor"] / truth.energy["sent"] == pytest.approx(transmitted, rel=1e-9)
    lit = truth.irradiance[24:40, 24:40]
    assert lit.mean() == pytest.approx(transmitted * math.cos(math.radians(degrees)), rel=0.005)
    columns = (np.arange(64) + 0.5) / 64 - 0.5
    assert truth.irradiance.sum(axis=0) @ columns / truth.irradiance.sum() == pytest.approx(0.0, abs=1e-3)


def test_all_flux_that_meets_a_ball_is_accounted_for():
    ball = still("/ball", shapes.sphere(), (0, 0, 2), DIELECTRIC)
    truth = irradiance(scene([floor(), ball], sun(), camera()), 1 << 14, parts=2)
    assert balance(truth.energy) == pytest.approx(0.0, abs=1e-9)
    # The silhouette of the mesh is a polygon of 96 sides: smaller than the disc by 2π²/3/96².
    assert truth.energy["sent"] == pytest.approx(math.pi, rel=5e-3)
    assert abs(truth.energy["roulette"]) < math.pi * roulette_error(1 << 14) * 2


def test_a_ball_gathers_light_as_its_exact_rays_say():
    """Within any radius on the floor falls the flux of the rays twice refracted that land there.

    The orders of internal reflection, which are left out, carry R (1 − R) ≈ .04 backwards and R² ≈ .0016 forwards,
    spread over the floor.
    """
    ior, distance = 1.5, 1.5  # the paraxial focus: n R / (2 (n − 1)) from the centre
    ball = still("/ball", shapes.sphere(192, 96), (0, 0, distance), DIELECTRIC, ior)
    truth = irradiance(scene([floor(), ball], sun(), camera(1.0, 64)), 1 << 17, parts=2)
    h = np.sqrt((np.arange(20000) + 0.5) / 20000)
    theta = np.arcsin(h)
    inside = np.array([closed_forms.snell(angle, 1.0, ior) for angle in theta])
    turn = 2 * (theta - inside)
    # The ray leaves the ball at this angle from the axis, and goes on turned towards it.
    polar = 2 * inside - theta
    x, z = np.sin(polar), -np.cos(polar)
    landed = np.abs(x - (distance + z) * np.tan(turn))
    reflected = np.array([closed_forms.fresnel_reflectance(angle, 1.0, ior) for angle in theta])
    flux = math.pi / len(h) * (1 - reflected) ** 2
    y, x = np.mgrid[:64, :64] / 64.0 - 0.5 + 0.5 / 64
    for radius in (0.1, 0.2, 0.4):
        found = truth.irradiance[np.hypot(x, y) < radius].sum() / 64**2
        # Pixels cut the circle within half a pixel.
        low, high = (flux[landed < radius + step].sum() for step in (-0.012, 0.012))
        assert low - 0.01 < found < high + 0.01
        assert high - low < 0.2


@pytest.mark.parametrize("moves", [False, True])
def test_a_lamp_under_a_mirror_shines_as_its_image_does(moves):
    ceiling_points, triangles = shapes.rectangle(1.6, 1.6)
    mirror = still("/mirror", (ceiling_points, triangles[:, ::-1]), (0, 0, 2), MIRROR)
    ends = (np.array([-0.4, 0.1, 1.0]), np.array([0.4 if moves else -0.4, 0.1, 1.0]))
    truth = irradiance(scene([floor(), mirror], Light("/lamp", 3.0, position=ends), camera(1.0, 4)), 1 << 20, parts=8)
    side = (np.arange(64) + 0.5) / 64 - 0.5
    x, y = np.meshgrid(side, -side)
    expected = np.zeros((4, 4))
    for s in (np.arange(32) + 0.5) / 32:
        lamp = between(ends, s)
        square = (x - lamp[0]) ** 2 + (y - lamp[1]) ** 2 + 3.0**2
        expected += (3.0 * 3.0 / square**1.5).reshape(4, 16, 4, 16).mean(axis=(1, 3)) / 32
    assert truth.error < 0.01
    assert np.sqrt(np.mean((truth.irradiance / expected - 1) ** 2)) < 2 * truth.error
    assert truth.irradiance.mean() == pytest.approx(expected.mean(), rel=truth.error)


@pytest.mark.parametrize("shape", ["sphere", "rectangle", "disc", "cylinder"])
def test_a_lamp_with_extent_shines_by_way_of_a_mirror_as_lamberts_law_has_it(shape):
    """A sphere as a point does, E = I cos θ/d²; what is flat by the sum over its places, I cos² θ/d² of each.

    A cylinder by that over its axis, I sin α cos θ/d², as a thin one does: it is, beside its distance.
    """
    points, triangles = shapes.rectangle(1.3, 1.3)
    mirror = still("/mirror", (points, triangles[:, ::-1]), (0, 0, 2), MIRROR)
    spans = np.array([[0.0, 0.4, 0.0], [0.3, 0.0, 0.0]])
    extents = {
        "sphere": {"radius": 0.4},
        "rectangle": {"spans": spans},
        "disc": {"spans": spans, "rounded": True},
        "cylinder": {"spans": spans, "radius": 0.02},
    }
    lamp = Light("/lamp", 3.0, position=(np.array([-0.2, 0.1, 1.0]),) * 2, **extents[shape])
    truth = irradiance(scene([floor(), mirror], lamp, camera(1.0, 4)), 1 << 21, parts=4)
    side = (np.arange(64) + 0.5) / 64 - 0.5
    x, y = np.meshgrid(side, -side)
    expected = np.zeros((64, 64))
    steps = (np.arange(16) + 0.5) / 8 - 1
    flat = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = {
        "sphere": np.zeros((1, 2)),
        "rectangle": flat,
        "disc": flat[np.linalg.norm(flat, axis=1) < 1],
        "cylinder": flat * (1, 0),
    }[shape]
    for u, v in places:
        place = u * spans[0] + v * spans[1] - (0.2, -0.1, 0.0)
        square = (x - place[0]) ** 2 + (y - place[1]) ** 2 + 3.0**2
        off_axis = {"sphere": 1.0, "cylinder": np.sqrt(1 - (y - place[1]) ** 2 / square)}.get(shape, 3.0 / square**0.5)
        expected += 3.0 * off_axis * 3.0 / square**1.5 / len(places)
    expected = expected.reshape(4, 16, 4, 16).mean(axis=(1, 3))
    # Pixels err alike and each by itself, so that their mean errs by a quarter of that.
    assert truth.error < 0.05
    assert truth.irradiance.mean() == pytest.approx(expected.mean(), rel=3 * truth.error / 4)
    # What 16 pixels say of their error is half as much from one seed to the next as from another.
    assert np.sqrt(np.mean((truth.irradiance / expected - 1) ** 2)) < 3 * truth.error


def test_a_sun_through_flat_water_leaves_an_edge_as_wide_as_it_is():
    """The part of its disc on one side of a chord; all of it in the middle."""
    degrees, depth = 6.0, 1.0
    water = still("/water", flat_sheet(0.3, depth), (0, 0, 0), DIELECTRIC, 1.33)
    light = Light("/sun", 1.0, direction=DOWN, angle=math.radians(degrees))
    radius = depth * math.tan(math.asin(math.sin(math.radians(0.5 * degrees)) / 1.33))
    truth = irradiance(scene([floor(), water], light, camera(4 * radius, 32, center=(0.15, 0.0))), 1 << 20, parts=2)
    s = np.clip(-((np.arange(32) + 0.5) / 8 - 2), -1, 1)
    passed = 1 - closed_forms.fresnel_reflectance(0.0, 1.0, 1.33)
    expected = passed * (0.5 + (np.arcsin(s) + s * np.sqrt(1 - s**2)) / math.pi)
    # More than 5000 photons a column, which err by no more than 1/√N, and three times that.
    np.testing.assert_allclose(truth.irradiance.mean(axis=0), expected, atol=0.04)
    assert truth.irradiance.mean() == pytest.approx(expected.mean(), rel=5e-3)


@pytest.mark.parametrize("tilt, leaves", [(-20.0, 85.0), (80.0, 45.0)])
def test_shading_normals_turn_light_unless_it_would_go_into_the_surface(tilt, leaves):
    """A mirror at x = 1, a unit above the floor, lit by light that goes towards +x and 45 degrees down.

    Turned down by 20 degrees, normals send it off 45 + 40 degrees below the level. Turned up by 80 degrees they would
    send it on into the mirror, which then reflects as it stands.
    """
    points, triangles = shapes.rectangle(0.02, 0.02)
    upright = shapes.moved(points @ shapes.rotation((0, 1, 0), -90.0).T, (1.0, 0.0, 1.0))
    angle = math.radians(tilt)
    normals = np.tile([-math.cos(angle), 0.0, math.sin(angle)], (4, 1))
    mirror = Mesh("/mirror", (upright, upright), triangles, MIRROR, 1.5, 1.0, (normals, normals))
    truth = irradiance(scene([floor(), mirror], sun(45.0), camera(3.0, 300)), 1 << 10, parts=2)
    middle = ((np.arange(300) + 0.5) / 100 - 1.5) @ truth.irradiance.sum(axis=0) / truth.irradiance.sum()
    assert middle == pytest.approx(1.0 - 1.0 / math.tan(math.radians(leaves)), abs=0.01)


def test_the_edge_of_a_moving_board_is_a_ramp():
    water = still("/water", flat_sheet(3.0, 1.0), (0, 0, 0), DIELECTRIC, 1.33)
    points, triangles = shapes.rectangle(2.0, 4.0)
    board = Mesh("/board", (shapes.moved(points, (-1.2, 0, 1.5)), shapes.moved(points, (-0.8, 0, 1.5))), triangles)
    truth = irradiance(scene([floor(), water, board], sun(), camera(1.0, 20)), 1 << 19, parts=16)
    columns = (np.arange(20) + 0.5) / 20 - 0.5
    transmitted = 1 - closed_forms.fresnel_reflectance(0.0, 1.0, 1.33)
    # The edge goes from −.2 to .2: a column's middle is lit until it comes. Borders of the ramp lie between columns.
    ramp = np.clip((columns + 0.2) / 0.4, 0.0, 1.0)
    # 20 pixels of 145 photons, more even than random ones, in a column.
    np.testing.assert_allclose(truth.irradiance.mean(axis=0) / transmitted, ramp, atol=5 / math.sqrt(20 * 145))


def test_a_sphere_under_flat_water_is_lit_by_its_shading_normals():
    water = still("/water", flat_sheet(2.0, 2.0), (0, 0, 0), DIELECTRIC, 1.33)
    shape = shapes.sphere(24, 12)
    sphere = still("/sphere", (0.5 * shape[0], shape[1], shape[2]), (0, 0, 0.6), DIFFUSE)
    looking = scene([floor(), water, sphere], sun(), camera(1.2, 24, height=1.8), clear=False)
    truth = irradiance(looking, 1 << 18, parts=2)
    side = 1.2 * ((np.arange(24) + 0.5) / 24 - 0.5)
    radius = np.hypot(*np.meshgrid(side, side))
    transmitted = 1 - closed_forms.fresnel_reflectance(0.0, 1.0, 1.33)
    on_sphere, beside = radius < 0.4, radius > 0.55
    assert truth.mask[on_sphere].all() and truth.mask[beside].all() and not truth.mask.all()
    cosines = np.sqrt(1 - (radius[on_sphere] / 0.5) ** 2)
    # Interpolated normals keep the sphere's within the square of half a side, (7.5°)², of their slope.
    np.testing.assert_allclose(truth.irradiance[on_sphere] / transmitted, cosines, atol=0.1)
    assert (truth.irradiance[on_sphere] / transmitted).mean() == pytest.approx(cosines.mean(), rel=0.01)
    assert truth.irradiance[beside].mean() == pytest.approx(transmitted, rel=0.01)


def test_pixels_that_see_glass_or_two_receivers_are_left_out():
    points, triangles = shapes.rectangle(0.5, 4.0)
    step = still("/step", (points, triangles), (-0.25, 0, 0.05), DIFFUSE)
    water = still("/water", flat_sheet(0.5, 0.07), (0.0, 0, 0), DIELECTRIC, 1.33)
    mask = clear_view(scene([floor(), step, water], sun(), camera(2.0, 16), clear=False))
    expected = np.ones((16, 16), dtype=bool)
    expected[6:10, 6:10] = False
    np.testing.assert_array_equal(mask, expected)


def test_a_camera_that_moves_with_its_scene_sees_what_a_still_one_sees():
    def made(shift):
        ends = (np.zeros(3), np.array([shift, 0.5 * shift, 0.0]))
        shape = shapes.lens(0.3, 0.6)
        points = tuple(shape[0] + [0, 0, 0.6] + end for end in ends)
        lens = Mesh("/lens", points, shape[1], DIELECTRIC, 1.5, 1.0, (shape[2],) * 2)
        eyes = tuple(np.array([0, 0, 0.1]) + end for end in ends)
        return irradiance(scene([floor(), lens], sun(), Camera(eyes, np.eye(3), 0.6, 16, 16)), 1 << 17, parts=8)

    still_view, moving_view = made(0.0), made(0.7)
    difference = np.sqrt(np.mean((still_view.irradiance - moving_view.irradiance) ** 2)) / still_view.irradiance.mean()
    assert difference < 2 * math.hypot(still_view.error, moving_view.error)
    assert still_view.irradiance.max() > 3


def slow_picture(meshes, choices, view, rays, instants):
    """Irradiance by the slow tracer along given branches, under parallel light of 1 W/m² straight down on [−½, ½]²."""
    surfaces = [
        TriangleMesh(
            mesh.name,
            points=lambda t, mesh=mesh: between(mesh.points, t),
            triangles=mesh.triangles,
            normals=None if mesh.normals is None else lambda t, mesh=mesh: unit_between(mesh.normals, t),
            interaction=mesh.interaction,
            ior=mesh.ior,
        )
        for mesh in meshes
    ]
    random = np.random.default_rng(7)
    side = math.isqrt(rays)
    picture = np.zeros((view.height, view.width))
    for instant in range(instants):
        cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
        xy = (cells + random.random(cells.shape)) / side - 0.5
        origins = np.concatenate([xy, np.full((len(xy), 1), 5.0)], axis=1)
        path = trace(surfaces, origins, np.tile(DOWN, (len(xy), 1)), (instant + random.random()) / instants, choices)
        kept = path.landed & (path.bounces == len(choices))
        column = np.floor((path.positions[kept, 0] / view.size + 0.5) * view.width)
        row = np.floor((0.5 - path.positions[kept, 1] / view.size) * view.height)
        seen = (row >= 0) & (row < view.height) & (column >= 0) & (column < view.width)
        pixels = (row * view.width + column)[seen].astype(int)
        picture += np.bincount(pixels, path.throughput[kept][seen], picture.size).reshape(picture.shape)
    return picture / (instants * side**2) / view.pixel**2


def unit_between(normals, t):
    found = between(normals, t)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_moving_water_agrees_with_the_slow_tracer():
    def waves(phase):
        return shapes.sheet(
            1.0, 6, lambda x, y: (1 + 0.05 * np.cos(6 * x + phase), -0.3 * np.sin(6 * x + phase), 0 * y)
        )

    opened, closed = waves(0.0), waves(1.0)
    water = Mesh("/water", (opened[0], closed[0]), opened[1], DIELECTRIC, 1.33, 1.0, (opened[2], closed[2]))
    view = camera(0.8, 8)
    meshes = [floor(), water]
    truth = irradiance(scene(meshes, sun(), view), 1 << 17, parts=8)
    slow = slow_picture(meshes, ["refract"], view, 64**2, 8)
    # 512 photons a pixel in the slow picture, one a cell of the light's plane: less than random ones' 4.4 %.
    assert np.sqrt(np.mean((truth.irradiance - slow) ** 2)) < 0.044
    assert truth.irradiance.std() > 0.2
    assert truth.irradiance.mean() == pytest.approx(slow.mean(), rel=0.01)


def test_turning_glass_agrees_with_the_slow_tracer():
    points, triangles, _ = shapes.sphere(6, 4)
    turned = points @ shapes.rotation((1, 1, 0), 20.0).T
    glass = Mesh("/glass", tuple(0.4 * end + [0, 0, 1] for end in (points, turned)), triangles, DIELECTRIC, 1.5)
    view = camera(3.0, 10)
    meshes = [floor(), glass]
    truth = irradiance(scene(meshes, sun(), view), 1 << 18, parts=8)
    orders = [["reflect"], *(["refract", *["reflect"] * order, "refract"] for order in range(10))]
    slow = sum(slow_picture(meshes, choices, view, 32**2, 8) for choices in orders)
    # Light that is reflected inside ten times or more, less than .01 of what lands, is missing from the slow picture.
    weight = 1 / (8 * 32**2 * view.pixel**2)
    noise = math.sqrt(slow.mean() * weight)
    assert np.sqrt(np.mean((truth.irradiance - slow) ** 2)) < 2 * noise
    assert truth.irradiance.mean() == pytest.approx(slow.mean(), rel=0.03)


@wp.kernel(enable_backward=False)
def _points(directions: wp.array2d(dtype=wp.uint32), seed: int, found: wp.array2d(dtype=wp.float64)):
    point = wp.tid()
    for dimension in range(5):
        found[point, dimension] = coordinate(directions, point, dimension, seed)


@pytest.mark.parametrize("seed", [0, 1, 77])
def test_scrambled_points_are_spread_evenly_in_every_dimension_and_pair(seed):
    directions = wp.array(direction_numbers(), dtype=wp.uint32, device="cpu")
    found = wp.zeros((256, 5), dtype=wp.float64, device="cpu")
    wp.launch(_points, dim=256, inputs=[directions, seed, found], device="cpu")
    points = found.numpy()
    for dimension in range(5):
        np.testing.assert_array_equal(np.sort(np.floor(256 * points[:, dimension])), np.arange(256))
    # The first two dimensions are a (0, 2)-sequence: one point in every elementary interval of area 1/256.
    for k in range(9):
        cells = np.floor(points[:, 0] * 2**k) * 2 ** (8 - k) + np.floor(points[:, 1] * 2 ** (8 - k))
        np.testing.assert_array_equal(np.sort(cells), np.arange(256))


def test_sequences_of_different_seeds_differ():
    directions = wp.array(direction_numbers(), dtype=wp.uint32, device="cpu")
    found = [wp.zeros((64, 5), dtype=wp.float64, device="cpu") for _ in range(2)]
    for seed in range(2):
        wp.launch(_points, dim=64, inputs=[directions, seed, found[seed]], device="cpu")
    assert np.abs(found[0].numpy() - found[1].numpy()).mean() > 0.2
