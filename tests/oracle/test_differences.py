"""Finite differences of the oracle's tracer against closed forms, and their order of convergence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpdwarp.scene.description import Interaction, Shutter
from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.differences import COLUMNS, finite_differences
from usd_scenes.oracle.emission import beam_around, central_beam, parallel_beam
from usd_scenes.oracle.optics import dot, unit
from usd_scenes.oracle.shapes import grid_points, grid_triangles
from usd_scenes.oracle.surfaces import Ellipsoid, HeightField, Plane, TriangleMesh
from usd_scenes.oracle.tracer import trace

FLOOR = Plane("/floor", (0, 0, 0), (0, 0, 1))
GLASS, MIRROR = Interaction.DIELECTRIC, Interaction.MIRROR
SHUTTER = Shutter(3, 3, 5)
W, THETA = 0.06, 0.4
ZERO = np.zeros(1)
EXACT = 1e-8
"""Ridders' table of a smooth function of order-one size: rounding 1e-16 over a step of 1e-3, with room for growth."""


def moving(start, velocity):
    """A point that is at ``start`` at mid shutter and moves by ``velocity`` over the exposure."""
    return lambda t: np.asarray(start) + (t - SHUTTER.middle) / SHUTTER.exposure * np.asarray(velocity)


def slanted(theta=THETA, height=5.0):
    """A beam at ``theta`` to the vertical in the xz plane, with unit emission steps along x and y."""
    return parallel_beam((0, 0, height), (1, 0, 0), (0, 1, 0), (math.sin(theta), 0, -math.cos(theta)))


def wave_field(amplitude=0.08, c=0.0, k=2.0, height=1.0, ior=1.33):
    """A crest at x = 0 at mid shutter that travels by ``c`` over the exposure."""

    def angle(x, t):
        return k * (x - c * (t - SHUTTER.middle) / SHUTTER.exposure)

    return HeightField(
        "/wave",
        lambda x, y, t: height + amplitude * np.cos(angle(x, t)) + 0 * y,
        lambda x, y, t: (-amplitude * k * np.sin(angle(x, t)), 0 * y),
        (height - amplitude, height + amplitude),
        GLASS,
        ior,
    )


def bumpy_glass(cells=8):
    """A mesh whose vertices and normals move linearly and unevenly; first surface of a two-surface lens."""
    x = np.linspace(-1, 1, cells + 1)
    points = grid_points(x, x, lambda x, y: 2 + 0.1 * np.sin(2 * x + y) + 0.05 * y**2)
    random = np.random.default_rng(7)
    motions = random.normal(0, 0.04, points.shape)
    normals = unit(np.append(random.normal(0, 0.1, (len(points), 2)), np.ones((len(points), 1)), axis=1))
    turns = random.normal(0, 0.1, points.shape)
    top = TriangleMesh(
        "/top", moving(points, motions), grid_triangles(cells + 1, cells + 1), moving(normals, turns), None, GLASS, 1.5
    )
    bottom = Plane("/bottom", moving((0, 0, 1.2), (0, 0, 0.1)), (0.1, 0, -1), GLASS, 1.5)
    return [top, bottom, Plane("/floor", moving((0, 0, 0), (0.1, 0.02, -0.05)), (0.1, 0.2, 1))]


def some_photons(count=24):
    random = np.random.default_rng(11)
    return random.uniform(-0.6, 0.6, count), random.uniform(-0.6, 0.6, count)


def test_check_1_a_mirror_moving_along_its_normal_displaces_light_by_2w_tan_theta():
    mirror = Plane("/mirror", moving((0, 0, 2), (0, 0, W)), (0, 0, -1), MIRROR)
    light = parallel_beam((0, 0, 1), (1, 0, 0), (0, 1, 0), (math.sin(THETA), 0, math.cos(THETA)))
    found = finite_differences([mirror, FLOOR], light, ZERO, ZERO, SHUTTER, "light")
    np.testing.assert_allclose(found.dxdt, [[closed_forms.mirror_displacement(W, THETA), 0, 0]], atol=EXACT)


def test_check_1_the_image_of_a_point_moves_by_2w():
    mirror = Plane("/mirror", lambda t: (0, 0, 2 + W * t), (0, 0, -1), MIRROR)
    light = central_beam((0.3, 0, 1), (0, 0, 1), (0.1, 0, 0), (0, 0.1, 0))

    def image(t):
        origins, directions = light(np.array([-2.0, 1, 3]), np.array([1.0, -2, 2]), t)
        path = trace([mirror, FLOOR], origins, directions, t)
        across = np.eye(3) - path.directions[:, :, None] * path.directions[:, None]
        return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, path.positions))

    moved = image(1.0) - image(0.0)
    np.testing.assert_allclose(moved, [0, 0, closed_forms.mirror_image_displacement(W)], atol=1e-12)


def test_check_2_a_flat_interface_moving_along_its_normal():
    water = Plane("/water", moving((0, 0, 2), (0, 0, W)), (0, 0, 1), GLASS, 1.33)
    found = finite_differences([water, FLOOR], slanted(), ZERO, ZERO, SHUTTER, "light")
    expected = closed_forms.interface_displacement(W, THETA, 1, 1.33)
    np.testing.assert_allclose(found.dxdt, [[expected, 0, 0]], atol=EXACT)


def test_check_3_a_slab_moving_along_its_normal_displaces_nothing():
    top = Plane("/top", moving((0, 0, 2), (0, 0, W)), (0, 0, 1), GLASS)
    bottom = Plane("/bottom", moving((0, 0, 1.5), (0, 0, W)), (0, 0, -1), GLASS)
    found = finite_differences([top, bottom, FLOOR], slanted(), ZERO, ZERO, SHUTTER, "light")
    np.testing.assert_allclose(found.dxdt[:, 0], closed_forms.slab_displacement(), atol=EXACT)
    np.testing.assert_allclose(found.domegadt, 0, atol=EXACT)


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_4_a_body_moving_across_collimated_light_is_galilean(anchor):
    w = np.array([W, -0.5 * W])
    ball = Ellipsoid("/ball", moving((0.1, 0.2, 2), (*w, 0)), (1, 0.8, 0.9), GLASS, 1.5)
    u, v = some_photons()
    found = finite_differences([ball, FLOOR], slanted(0.0), 0.6 * u, 0.6 * v, SHUTTER, anchor)
    stretches = np.stack([found.dxdu[:, :2], found.dxdv[:, :2]], axis=2)
    expected = [closed_forms.galilean_displacement(w, stretch, anchor) for stretch in stretches]
    assert found.path.landed.all()
    np.testing.assert_allclose(found.dxdt[:, :2], expected, atol=EXACT)


def test_check_5_a_travelling_wave_moves_its_light_by_c_times_one_minus_the_stretch():
    u, v = some_photons()
    found = finite_differences([wave_field(c=0.16), FLOOR], slanted(0.0), u, v, SHUTTER, "light")
    expected = closed_forms.travelling_wave_displacement(0.16, found.dxdu[:, 0])
    np.testing.assert_allclose(found.dxdt[:, 0], expected, atol=EXACT)


def test_check_5_a_height_field_under_vertical_light_is_ridden_by_its_emission_point():
    u, v = some_photons(6)
    scene = [wave_field(c=0.16), FLOOR]
    fixed = finite_differences(scene, slanted(0.0), u, v, SHUTTER, "light")
    riding = finite_differences(scene, slanted(0.0), u, v, SHUTTER, "surface")
    np.testing.assert_allclose(riding.dxdt, fixed.dxdt, atol=EXACT)


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_6_everything_moving_rigidly_leaves_the_receiver_as_it_was(anchor):
    w = np.array([W, 0.3 * W, -0.7 * W])
    ball = Ellipsoid("/ball", moving((0.1, 0.2, 2), w), (1, 0.8, 0.9), GLASS, 1.5)
    floor = Plane("/floor", moving((0, 0, 0), w), (0.1, 0, 1))
    light = central_beam(moving((0, 0, 6), w), (0, 0, -1), (0.1, 0, 0), (0, 0.1, 0))
    u, v = some_photons(8)
    found = finite_differences([ball, floor], light, u, v, SHUTTER, anchor)
    np.testing.assert_allclose(found.receiver_motion, np.broadcast_to(w, (8, 3)), atol=EXACT)
    np.testing.assert_allclose(found.dxdt_relative, 0, atol=EXACT)


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_7_a_receiver_moving_under_still_light(anchor):
    water = Plane("/water", (0, 0, 2), (0, 0, 1), GLASS, 1.33)
    along = Plane("/floor", moving((0, 0, 0), (0, 0, W)), (0, 0, 1))
    found = finite_differences([water, along], slanted(), ZERO, ZERO, SHUTTER, anchor)
    expected = closed_forms.receiver_normal_displacement(W, closed_forms.snell(THETA, 1, 1.33))
    assert np.linalg.norm(found.dxdt_relative) == pytest.approx(expected, abs=EXACT)
    across = Plane("/floor", moving((0, 0, 0), (W, 0.2 * W, 0)), (0, 0, 1))
    found = finite_differences([water, across], slanted(), ZERO, ZERO, SHUTTER, anchor)
    expected = closed_forms.receiver_tangential_displacement([W, 0.2 * W, 0])
    np.testing.assert_allclose(found.dxdt_relative, [expected], atol=EXACT)


def beam_widths(surface, height, after, distance):
    """(sagittal, tangential) widths at ``distance`` behind a vertical beam's first surface, across the beam."""
    hit = trace([surface, FLOOR], [[height, 0, after]], [[0, 0, -1]], 0.0)
    out = unit(hit.points[1] - hit.points[0])[0]
    screen = Plane("/screen", hit.points[0, 0] + distance * out, out)
    light = parallel_beam((height, 0, after), (1, 0, 0), (0, 1, 0), (0, 0, -1))
    found = finite_differences([surface, screen], light, ZERO, ZERO, Shutter.still(0))
    tangential = dot(found.dxdu, np.cross([0, 1, 0], out)[None])
    return found.dxdv[0, 1], abs(tangential[0])


@pytest.mark.parametrize("height", [0.0, 0.3, 0.7])
def test_check_8_refraction_at_a_sphere_follows_coddington(height):
    ball = Ellipsoid("/ball", (0, 0, 0), (1, 1, 1), GLASS, 1.5)
    found = beam_widths(ball, height, 3.0, 0.8)
    expected = closed_forms.coddington(0.8, 1.0, math.asin(height), 1.0, 1.5)
    np.testing.assert_allclose(found, expected, atol=EXACT)


@pytest.mark.parametrize("height", [0.0, 0.3, 0.6])
def test_check_9_a_concave_mirror_focuses_more_strongly_in_the_plane_of_incidence(height):
    bowl = Ellipsoid("/bowl", (0, 0, 2), (1, 1, 1), MIRROR)
    found = beam_widths(bowl, height, 2.05 - math.cos(math.asin(height)), 0.3)
    np.testing.assert_allclose(found, closed_forms.concave_mirror(0.3, 1.0, math.asin(height)), atol=EXACT)


def on_axis_widths(surfaces, depth):
    """∂x/∂u and ∂y/∂v on the axis of vertical light, at z = −depth."""
    screen = Plane("/screen", (0, 0, -depth), (0, 0, 1))
    found = finite_differences([*surfaces, screen], slanted(0.0, 3.0), ZERO, ZERO, Shutter.still(0), max_bounces=4)
    return found.dxdu[0, 0], found.dxdv[0, 1]


def test_check_10_paraxial_light_meets_at_the_focus():
    ball = Ellipsoid("/ball", (0, 0, -1), (1, 1, 1), GLASS, 2.5)
    np.testing.assert_allclose(on_axis_widths([ball], closed_forms.refraction_focus(1, 1, 2.5)), 0, atol=EXACT)
    assert closed_forms.concave_mirror(closed_forms.mirror_focus(1), 1, 0) == (0, 0)


def parabolic_lens(radius, thickness, center):
    """A biconvex lens of glass at z = 0: two paraboloids of vertex radius ``radius``."""

    def cap(sign, ior):
        def offsets(x, y, t):
            cx, cy = center(t)
            return x - cx, y - cy

        def height(x, y, t):
            dx, dy = offsets(x, y, t)
            return sign * (0.5 * thickness - (dx**2 + dy**2) / (2 * radius))

        def slopes(x, y, t):
            dx, dy = offsets(x, y, t)
            return -sign * dx / radius, -sign * dy / radius

        return HeightField("/cap", height, slopes, (-0.1, 0.1), GLASS, ior)

    # Both fronts look up: the lower one from air into glass.
    return [cap(1, 1.5), cap(-1, 1 / 1.5)]


def test_check_11_a_thin_lens_moving_across_light_displaces_it_by_w_d_over_f():
    radius, thickness, depth = 10.0, 1e-5, 2.0
    lens = parabolic_lens(radius, thickness, lambda t: (W * (t - SHUTTER.middle) / SHUTTER.exposure, 0.0))
    screen = Plane("/screen", (0, 0, -depth), (0, 0, 1))
    small = (1e-3, 1e-3, 1e-3)
    found = finite_differences([*lens, screen], slanted(0.0), ZERO, ZERO, SHUTTER, "light", steps=small)
    focal_length = closed_forms.thin_lens_focal_length(radius, -radius, 1.5)
    expected = closed_forms.thin_lens_displacement(W, depth, focal_length)
    assert found.dxdt[0, 0] == pytest.approx(expected, rel=2 * thickness / depth)


def test_check_11_a_turning_cylinder_lens_displaces_light_by_its_angle_times_r_d_over_f():
    radius, r, depth, angle = 10.0, 1e-3, 2.0, 0.05

    def across(t):
        phi = angle * (t - SHUTTER.middle) / SHUTTER.exposure
        return math.cos(phi), math.sin(phi)

    def slopes(x, y, t):
        c, s = across(t)
        return -(c * x + s * y) * c / radius, -(c * x + s * y) * s / radius

    lens = HeightField(
        "/lens", lambda x, y, t: -((across(t)[0] * x + across(t)[1] * y) ** 2) / (2 * radius), slopes, (-1, 0.1), GLASS
    )
    # A plano-convex lens in oil-like contact with air below: one refracting surface, then a flat one just beneath it.
    flat = Plane("/flat", (0, 0, -1e-5), (0, 0, -1), GLASS, lens.ior)
    screen = Plane("/screen", (0, 0, -depth), (0, 0, 1))
    light = parallel_beam((0, 0, 5), (1, 0, 0), (0, 1, 0), (0, 0, -1))
    u, v = np.array([r, 0.0, 0.6 * r]), np.array([0.0, r, 0.8 * r])
    found = finite_differences([lens, flat, screen], light, u, v, SHUTTER, "light", steps=(1e-4, 1e-4, 0.05))
    expected = closed_forms.rotating_cylinder_lens_displacement(angle, r, depth, radius / (lens.ior - 1))
    np.testing.assert_allclose(np.linalg.norm(found.dxdt, axis=1), expected, rtol=2e-5)


def test_check_12_a_ball_lens_focuses_at_its_focal_length_from_the_centre():
    ball = Ellipsoid("/ball", (0, 0, 0), (0.5, 0.5, 0.5), GLASS, 1.5)
    found = on_axis_widths([ball], closed_forms.ball_lens_focal_length(0.5, 1.5))
    np.testing.assert_allclose(found, 0, atol=EXACT)


def test_check_13_light_from_afar_keeps_the_lagrange_invariant_at_zero():
    u, v = some_photons()
    field = HeightField(
        "/water",
        lambda x, y, t: 1 + 0.1 * np.sin(2 * x + y) * np.cos(x - y),
        lambda x, y, t: (
            0.1 * (2 * np.cos(2 * x + y) * np.cos(x - y) - np.sin(2 * x + y) * np.sin(x - y)),
            0.1 * (np.cos(2 * x + y) * np.cos(x - y) + np.sin(2 * x + y) * np.sin(x - y)),
        ),
        (0.9, 1.1),
    )
    found = finite_differences([field, FLOOR], slanted(), u - 2, v, Shutter.still(0))
    invariant = closed_forms.lagrange_invariant(found.dxdu, found.dxdv, found.domegadu, found.domegadv, 1.33)
    np.testing.assert_allclose(invariant, 0, atol=EXACT)
    assert np.abs(np.sum(found.domegadu * found.dxdv, axis=1)).max() > 1e-3


def test_check_14_every_ray_into_an_ellipsoid_of_eccentricity_one_over_n_meets_the_far_focus():
    along, across = closed_forms.cartesian_ellipsoid(1.5, 1.5)
    body = Ellipsoid("/body", (0, 0, 0), (across, across, along), GLASS, 1.5)
    screen = Plane("/screen", (0, 0, along - 1.5), (0, 0, 1))
    u, v = some_photons()
    found = finite_differences([body, screen], slanted(0.0), 0.7 * u, 0.7 * v, Shutter.still(0))
    np.testing.assert_allclose(found.path.positions, np.broadcast_to([0, 0, along - 1.5], (24, 3)), atol=1e-14)
    np.testing.assert_allclose([found.dxdu, found.dxdv], 0, atol=EXACT)


def test_check_15_the_first_cusp_lies_below_the_crest():
    amplitude, k, ior = 0.08, 2 * math.pi / 1.3, 1.33
    depth = closed_forms.cusp_depth(amplitude, k, ior)
    water = wave_field(amplitude, 0.0, k, depth - amplitude, ior)
    found = finite_differences([water, FLOOR], slanted(0.0), ZERO, ZERO, Shutter.still(SHUTTER.middle))
    assert found.dxdu[0, 0] == pytest.approx(0, abs=EXACT)


def test_check_18_and_19_areas_of_footprints_on_a_plane():
    theta, n = 0.7, 1.33
    axis = np.array([math.sin(theta), 0, -math.cos(theta)])
    light = central_beam((0, 0, 3), axis, 0.1 * np.cross(axis, [0, 1, 0]), (0, 0.1, 0))
    direct = finite_differences([FLOOR], light, ZERO, ZERO, SHUTTER)
    area = np.linalg.norm(np.cross(direct.dxdu, direct.dxdv))
    expected = closed_forms.point_light_footprint_area(0.01, 1, 3 / math.cos(theta), math.cos(theta))
    assert area == pytest.approx(expected, abs=EXACT)
    steps = (0.1 * np.cross(axis, [0, 1, 0]), (0, 0.2, 0))
    water = Plane("/water", (0, 0, 2), (0, 0, 1), GLASS, n)
    refracted = finite_differences([water, FLOOR], parallel_beam((0, 0, 3), *steps, axis), ZERO, ZERO, SHUTTER)
    area = np.linalg.norm(np.cross(refracted.dxdu, refracted.dxdv))
    assert area == pytest.approx(closed_forms.flat_refraction_area(0.02, theta), abs=EXACT)


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_22_central_differences_converge_with_order_two_in_every_column(anchor):
    scene, (u, v) = bumpy_glass(), some_photons(12)
    light = central_beam((0, 0, 6), (0.05, 0, -1), (0.2, 0, 0), (0, 0.2, 0))
    exact = finite_differences(scene, light, u, v, SHUTTER, anchor)
    assert exact.path.landed.all() and (exact.path.bounces == 2).all()
    errors = []
    for h in (0.04, 0.02):
        coarse = finite_differences(scene, light, u, v, SHUTTER, anchor, steps=(h, h, h), levels=1)
        errors.append([np.linalg.norm(getattr(coarse, name) - getattr(exact, name)) for name in COLUMNS[:6]])
    orders = np.log2(np.array(errors[0]) / errors[1])
    # The next term of the error is smaller by h²: the order is 2 up to a few times 0.04².
    np.testing.assert_allclose(orders, 2, atol=0.02)
    for name in COLUMNS:
        assert exact.errors[name].max() < EXACT


def test_riding_is_the_shear_that_keeps_the_material_point_to_first_order():
    (top, bottom, floor), (u, v) = bumpy_glass(), some_photons()
    light = central_beam((0, 0, 6), (0.05, 0, -1), (0.2, 0, 0), (0, 0.2, 0))
    receiving = TriangleMesh(top.name, top.points, top.triangles, top.normals)
    first = finite_differences([receiving], light, u, v, SHUTTER, "light")
    fixed = finite_differences([top, bottom, floor], light, u, v, SHUTTER, "light")
    riding = finite_differences([top, bottom, floor], light, u, v, SHUTTER, "surface")
    for i in range(len(u)):
        columns = np.stack([first.dxdu[i], first.dxdv[i]], axis=1)
        a, b = np.linalg.lstsq(columns, first.receiver_motion[i] - first.dxdt[i], rcond=None)[0]
        expected = fixed.dxdt[i] + a * fixed.dxdu[i] + b * fixed.dxdv[i]
        np.testing.assert_allclose(riding.dxdt[i], expected, atol=10 * EXACT)
        expected = fixed.domegadt[i] + a * fixed.domegadu[i] + b * fixed.domegadv[i]
        np.testing.assert_allclose(riding.domegadt[i], expected, atol=10 * EXACT)


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_a_beam_is_known_by_its_first_order_columns(anchor):
    scene, (u, v) = bumpy_glass(), some_photons(8)
    step_u, step_v, w = np.array([0.2, 0, 0]), np.array([0, 0.2, 0.0]), np.array([0.03, 0.01, 0])
    light = central_beam(moving((0, 0, 6), w), (0.05, 0, -1), step_u, step_v)
    origins, directions = light(u, v, SHUTTER.middle)
    length = np.linalg.norm(np.array([0.05, 0, -1]) + np.outer(u, step_u) + np.outer(v, step_v), axis=1)[:, None]
    domegadu, domegadv = (
        (step - (directions @ step)[:, None] * directions) / length for step in (step_u, step_v)
    )
    around = beam_around(origins, directions, 0, 0, domegadu, domegadv, w, 0, SHUTTER)
    expected = finite_differences(scene, light, u, v, SHUTTER, anchor)
    found = finite_differences(scene, around, np.zeros(8), np.zeros(8), SHUTTER, anchor)
    for name in COLUMNS:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=EXACT)


def test_columns_stay_in_their_planes():
    scene, (u, v) = bumpy_glass(), some_photons()
    light = central_beam((0, 0, 6), (0.05, 0, -1), (0.2, 0, 0), (0, 0.2, 0))
    found = finite_differences(scene, light, u, v, SHUTTER)
    for column in (found.dxdu, found.dxdv, found.dxdt_relative):
        np.testing.assert_allclose(dot(column, found.path.normals), 0, atol=EXACT)
    for column in (found.domegadu, found.domegadv, found.domegadt):
        np.testing.assert_allclose(dot(column, found.path.directions), 0, atol=EXACT)
    assert np.linalg.norm(found.dxdt_relative, axis=1).min() > 1e-3


def test_check_23_a_prediction_from_shutter_open_misses_half_the_acceleration():
    exposure, acceleration = 0.5, 0.3
    mirror = Plane("/mirror", lambda t: (0, 0, 2 + 0.5 * acceleration * t**2), (0, 0, -1), MIRROR)
    light = parallel_beam((0, 0, 1), (1, 0, 0), (0, 1, 0), (math.sin(THETA), 0, math.cos(THETA)))
    around_open = Shutter(1, 1 - exposure / 2, 1 + exposure / 2)
    at_open = finite_differences([mirror, FLOOR], light, ZERO, ZERO, around_open, "light")
    closed = trace([mirror, FLOOR], *light(ZERO, ZERO, 1.5), 1 + exposure)
    missed = closed.positions - at_open.path.positions - at_open.dxdt
    expected = closed_forms.shutter_error(exposure, 2 * acceleration * math.tan(THETA))
    assert missed[0, 0] == pytest.approx(expected, abs=EXACT)


def test_a_still_has_no_time_column():
    scene, (u, v) = bumpy_glass(), some_photons(4)
    found = finite_differences(scene, slanted(0.1), u - 0.3, v, Shutter.still(3.5))
    assert not found.dxdt.any() and not found.domegadt.any()


def test_an_unknown_anchor_is_refused():
    with pytest.raises(ValueError, match="rides on its light or a surface"):
        finite_differences([FLOOR], slanted(), ZERO, ZERO, SHUTTER, "lens")
