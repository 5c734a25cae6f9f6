"""Closed forms of optics and of moving optics, through the tracer, on meshes.

Flat surfaces are exact on a mesh, so that only float32 is in the way: ``ROUNDING``. Curved ones are off in slope by
half a facet's angle, and with them every column: tolerances are that angle times what the slope does.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import MIRROR, ball, box, cap, field, floor, glass, moving, quad, turning, upside_down
from tests.photons.traced import EPS, SHUTTER, Traced, Written, emission_of, lamp, scene_of, sun, traced
from tpdwarp.scene.description import SceneAtShutter, Shutter
from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.caustic_1d import Wave, branches, irradiance, landing, stretch, transmittance

W, THETA = 0.06, 0.5
WATER = 1.33
SLANTED = (math.sin(THETA), 0.0, -math.cos(THETA))
ROUNDING = 200 * EPS
"""Float32 positions of a scene of a few units, over a handful of interactions."""


def ceiling_and_mirror(motion: tuple[float, float, float]) -> list:
    """A mirror at z = 0 facing up; the ceiling at z = 2 catches what it reflects and does not shade it."""
    mirror = moving(floor(0.0, 0.4, MIRROR, "/mirror"), motion)
    ceiling = quad("/ceiling", (2 * math.tan(THETA), 0, 2), (0, 0.6, 0), (0.6, 0, 0), floor().materials[0])
    return [mirror, ceiling]


def vertical(count: int, *meshes, anchor: str = "surface") -> Traced:
    return traced(scene_of(meshes), count, anchor=anchor)


# 1 to 3: flat surfaces that move along their normals.


@pytest.mark.parametrize("anchor, factor", [("light", 2), ("surface", 1)])
def test_check_1_a_mirror_moving_along_its_normal_displaces_light_by_2w_tan_theta(anchor, factor):
    result = traced(scene_of(ceiling_and_mirror((0, 0, W)), sun(SLANTED)), 200, anchor=anchor)
    expected = closed_forms.mirror_displacement(W, THETA)
    assert len(result.photons) > 100
    # Riding on the mirror, the light lands nearer by one rise of the mirror instead of two.
    np.testing.assert_allclose(result.photons.dxdt, [[-expected * factor / 2, 0, 0]] * len(result.photons),
                               atol=ROUNDING)


def test_check_1_the_image_of_a_point_light_moves_by_2w():
    light = lamp((-2 * math.tan(THETA), 0, 2))
    result = traced(scene_of(ceiling_and_mirror((0, 0, W)), light), 400, anchor="light")
    image = light.position * [1, 1, -1]
    rays = result.photons.positions - image
    moved = np.array([0, 0, closed_forms.mirror_image_displacement(W)])
    # A ray of fixed direction whose origin moves by ``moved`` crosses the ceiling there minus its way along the ray.
    expected = moved - rays * (moved[2] / rays[:, 2:])
    assert len(expected) > 100
    np.testing.assert_allclose(result.photons.dxdt, expected, atol=ROUNDING)


def test_check_2_a_flat_interface_moving_along_its_normal():
    water = moving(floor(1.0, 0.5, glass(WATER), "/water"), (0, 0, W))
    result = traced(scene_of([water, floor()], sun(SLANTED)), 200, anchor="light")
    expected = closed_forms.interface_displacement(W, THETA, 1, WATER)
    np.testing.assert_allclose(result.photons.dxdt, [[expected, 0, 0]] * len(result.photons), atol=ROUNDING)


def slab(thickness: float = 0.5, half: float = 2.0) -> list:
    top = floor(1.0 + thickness, half, glass(), "/top")
    return [top, upside_down(floor(1.0, half, glass(), "/bottom"))]


@pytest.mark.parametrize("anchor, expected", [("light", 0.0), ("surface", W * math.tan(THETA))])
def test_check_3_a_slab_moving_along_its_normal_displaces_nothing(anchor, expected):
    parts = [moving(part, (0, 0, W)) for part in slab()]
    result = traced(scene_of([*parts, floor()], sun(SLANTED)), 400, anchor=anchor)
    through = (result.masks == 0) & (result.photons.bounces == 2)
    assert through.sum() > 100
    np.testing.assert_allclose(result.photons.dxdt[through], [[expected, 0, 0]] * through.sum(), atol=ROUNDING)
    origins, directions = emission_of(result)
    straight = origins - directions * (origins[:, 2:] / directions[:, 2:])
    shift = straight[through, 0] - result.photons.positions[through, 0]
    np.testing.assert_allclose(shift, closed_forms.slab_shift(0.5, THETA, 1.5), atol=ROUNDING)


# 4 to 7: motion is relative.


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_4_a_body_moving_across_collimated_light_is_galilean(anchor):
    w = np.array([W, -0.5 * W])
    body = moving(ball("/ball", (0.1, 0.2, 1.5), 0.5, 12, glass()), (*w, 0))
    result = traced(scene_of([body, floor()], sun()), 800, anchor=anchor)
    expected = np.array([closed_forms.galilean_displacement(w, j, anchor) for j in result.stretch()])
    size = 1 + np.linalg.norm(result.stretch(), axis=(1, 2))
    assert len(size) > 400
    assert (np.linalg.norm(result.photons.dxdt[:, :2] - expected, axis=1) <= 10 * ROUNDING * size).all()


WAVE = Wave(wavelength=1.3, amplitude=0.05, height=1.0, ior=WATER, speed=0.08)


def wave_mesh(wave: Wave, cells: int, half: float = 1.0):
    """The wave at time 0 with its exact rates over one frame: a strip along x, one cell wide."""
    k, a, c = wave.wave_number, wave.amplitude, wave.speed
    x = np.linspace(-half, half, cells + 1)

    def slope(x):
        return -a * k * np.sin(k * x)

    strip = field(
        "/water",
        x,
        np.array([-0.1, 0.1]),
        lambda x, y: wave.height + a * np.cos(k * x),
        lambda x, y: (slope(x), 0 * x),
        glass(wave.ior),
    )
    x = strip.points[:, 0]
    rises = np.zeros_like(strip.points)
    rises[:, 2] = -c * slope(x)
    curvature = -a * k**2 * np.cos(k * x)
    length = np.sqrt(1 + slope(x) ** 2)
    turns = -c * np.stack([-curvature / length**3, 0 * x, -slope(x) * curvature / length**3], axis=1)
    return replace(strip, motions=rises, normal_motions=turns)


def slope_error(wave: Wave, cells: int, half: float = 1.0) -> float:
    """Largest error of a facet's curvature (the slope of its normals) times the depth it acts over.

    Half a cell times the third derivative a k³, bent by (n−1)/n and thrown over the height; twice, for obliquity.
    """
    return 2 * wave.height * (1 - 1 / wave.ior) * wave.amplitude * wave.wave_number**3 * (half / cells)


def test_check_5_a_travelling_wave_moves_its_light_by_c_times_one_minus_the_stretch():
    result = traced(scene_of([wave_mesh(WAVE, 512), floor()], sun()), 600, anchor="light")
    stretches = result.stretch()[:, 0, 0]
    expected = closed_forms.travelling_wave_displacement(WAVE.speed, stretches)
    assert np.ptp(stretches) > 0.5
    np.testing.assert_allclose(result.photons.dxdt[:, 0], expected, atol=WAVE.speed * slope_error(WAVE, 512))


def test_check_5_at_a_focus_light_moves_as_fast_as_the_wave():
    height = closed_forms.cusp_depth(WAVE.amplitude, WAVE.wave_number, WATER) - WAVE.amplitude
    focused = replace(WAVE, height=height)
    result = traced(scene_of([wave_mesh(focused, 512), floor()], sun()), 2000, anchor="light")
    crest = np.abs(result.origins()[:, 0]) < 0.01
    # At the crest the stretch vanishes to second order; k²x² there, three times over by the sine and the slope.
    tolerance = focused.speed * (slope_error(focused, 512) + 3 * (focused.wave_number * 0.01) ** 2)
    assert crest.any() and tolerance < 0.1 * focused.speed
    np.testing.assert_allclose(result.photons.dxdt[crest, 0], focused.speed, atol=tolerance)


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_6_everything_moving_together_leaves_light_where_it_was(anchor):
    w = (W, 0.3 * W, -0.7 * W)
    meshes = [moving(part, w) for part in (ball("/ball", (0.1, 0.2, 1.5), 0.5, 12, glass()), floor())]
    result = traced(scene_of(meshes, lamp((0.3, 0, 4), w)), 800, anchor=anchor)
    size = 1 + np.linalg.norm(result.photons.dxdu, axis=1) * 50
    assert len(size) > 400
    assert (np.linalg.norm(result.photons.dxdt, axis=1) <= 10 * ROUNDING * size).all()


def test_check_7_a_receiver_moving_under_light_that_does_not():
    water = floor(1.0, 0.5, glass(WATER), "/water")
    along = traced(scene_of([water, moving(floor(), (0, 0, W))], sun(SLANTED)), 200).photons.dxdt
    expected = closed_forms.receiver_normal_displacement(W, closed_forms.snell(THETA, 1, WATER))
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), expected, atol=ROUNDING)
    across = traced(scene_of([water, moving(floor(), (W, 0.2 * W, 0))], sun(SLANTED)), 200).photons.dxdt
    expected = closed_forms.receiver_tangential_displacement([W, 0.2 * W, 0])
    np.testing.assert_allclose(across, np.broadcast_to(expected, across.shape), atol=ROUNDING)


# 8 to 12: curved surfaces.


def widths(result: Traced, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sagittal and tangential widths [n] across the rays [n, 3], and the height [n] over the z axis at emission."""
    origins = result.origins()[:, :2]
    heights = np.linalg.norm(origins, axis=1)
    radial = origins / heights[:, None]
    around = np.stack([-radial[:, 1], radial[:, 0]], axis=1)
    columns = np.stack([result.photons.dxdu, result.photons.dxdv], axis=2) @ np.linalg.inv(result.steps[:2])
    sagittal = np.einsum("nij,nj->ni", columns, around)
    tangential = np.einsum("nij,nj->ni", columns, radial)
    tangential -= rays * np.einsum("ni,ni->n", tangential, rays)[:, None]
    return np.linalg.norm(sagittal, axis=1), np.linalg.norm(tangential, axis=1), heights


@pytest.mark.parametrize("height", [0.3, 0.7])
def test_check_8_refraction_at_a_sphere_follows_coddington(height):
    theta, cells, half_angle = math.asin(height), 48, 0.04
    surface = cap("/ball", (0, 0, 0), 1.0, (height, 0, math.cos(theta)), half_angle, cells, glass())
    result = traced(scene_of([surface, floor(-0.2)], sun()), 400)
    _, _, heights = widths(result, np.zeros((len(result.photons), 3)))
    hits = np.append(result.origins()[:, :2], np.sqrt(1 - heights**2)[:, None], axis=1)
    rays = result.photons.positions - hits
    distances = np.linalg.norm(rays, axis=1)
    sagittal, tangential, heights = widths(result, rays / distances[:, None])
    expected = np.abs([
        closed_forms.coddington(d, 1.0, math.asin(h), 1.0, 1.5) for d, h in zip(distances, heights, strict=True)
    ])
    # A facet's slope is off by its half angle (diagonally √2), which tilts D_u x and with it the normal's drift.
    tolerance = 3 * math.sqrt(2) * half_angle / cells
    assert len(distances) > 200
    np.testing.assert_allclose(sagittal, expected[:, 0], atol=tolerance)
    np.testing.assert_allclose(tangential, expected[:, 1], atol=tolerance)


def test_check_9_a_concave_mirror_focuses_more_strongly_in_the_plane_of_incidence():
    height, distance, half_angle, cells = 0.6, 0.3, 0.03, 48
    theta = math.asin(height)
    bowl = cap("/bowl", (0, 0, 2), 1.0, (height, 0, -math.cos(theta)), half_angle, cells, MIRROR)
    out = np.array([-math.sin(2 * theta), 0, math.cos(2 * theta)])
    centre = np.array([height, 0, 2 - math.cos(theta)]) + distance * out
    screen = quad("/screen", tuple(centre), tuple(0.15 * np.cross([0, 1, 0], out)), (0, 0.15, 0), floor().materials[0])
    result = traced(scene_of([bowl, screen], sun()), 400)
    origins = result.origins()[:, :2]
    hits = np.append(origins, 2 - np.sqrt(1 - np.sum(origins**2, axis=1))[:, None], axis=1)
    rays = result.photons.positions - hits
    distances = np.linalg.norm(rays, axis=1)
    sagittal, tangential, heights = widths(result, rays / distances[:, None])
    expected = np.abs([
        closed_forms.concave_mirror(d, 1.0, math.asin(h)) for d, h in zip(distances, heights, strict=True)
    ])
    tolerance = 3 * math.sqrt(2) * half_angle / cells
    assert len(distances) > 200 and np.abs(distances - distance).max() < 0.05
    np.testing.assert_allclose(sagittal, expected[:, 0], atol=tolerance)
    np.testing.assert_allclose(tangential, expected[:, 1], atol=tolerance)


def paraxial_stretch(half_angle: float, cells: int, radius: float, spherical: float) -> float:
    """Largest stretch left at a focus: facets' slopes, and the aberration ``spherical`` times the aperture squared."""
    return math.sqrt(2) * half_angle / cells * 3 + spherical * 2 * (half_angle * radius) ** 2


def test_check_10_paraxial_light_meets_at_the_focus_of_a_surface():
    half_angle, cells, index = 0.02, 24, 2.0
    surface = cap("/ball", (0, 0, 2), 1.0, (0, 0, 1), half_angle, cells, glass(index))
    depth = closed_forms.refraction_focus(1.0, 1.0, index)
    result = traced(scene_of([surface, floor(3 - depth)], sun()), 200)
    # Coddington at the focus: the tangential stretch is below 3 h² there for n = 2.
    tolerance = paraxial_stretch(half_angle, cells, 1.0, 3.0)
    assert tolerance < 0.01
    np.testing.assert_allclose(result.stretch(), 0, atol=tolerance)


def test_check_10_paraxial_light_meets_at_half_the_radius_of_a_mirror():
    half_angle, cells = 0.02, 24
    bowl = cap("/bowl", (0, 0, 2), 1.0, (0, 0, -1), half_angle, cells, MIRROR)
    # A speck at the focus shades what falls on it and catches what the rest of the mirror sends there.
    speck = quad("/speck", (0, 0, 1 + closed_forms.mirror_focus(1.0)), (0, 0.002, 0), (0.002, 0, 0),
                 floor().materials[0])
    result = traced(scene_of([bowl, speck], sun()), 200)
    tolerance = paraxial_stretch(half_angle, cells, 1.0, 3.0)
    assert len(result.photons) > 150 and tolerance < 0.01
    np.testing.assert_allclose(result.stretch(), 0, atol=tolerance)


def thin_lens(radius: float, half: float, thickness: float, cells: int, powers: tuple[float, float]) -> list:
    """A biconvex lens at z = 0, its curvature along x and y scaled by ``powers``."""
    px, py = powers
    x = np.linspace(-half, half, cells + 1)

    def cap_of(sign: float):
        def level(x, y):
            return sign * (0.5 * thickness - (px * x**2 + py * y**2) / (2 * radius))

        return field(
            "/lens", x, x, level, lambda x, y: (-sign * px * x / radius, -sign * py * y / radius), glass()
        )

    return [cap_of(1.0), upside_down(cap_of(-1.0))]


LENS = {"radius": 4.0, "half": 0.1, "thickness": 0.01, "cells": 16}
LENS_ERROR = 4 * (0.01 / 0.5 + (0.1 / 4.0) ** 2 + 0.1 / 16 / 4.0)
"""Relative error of the thin, paraxial lens: thickness over depth, aperture over radius squared, facet's slope."""


@pytest.mark.parametrize("anchor", ["light", "surface"])
def test_check_11_a_thin_lens_moving_across_light_displaces_it_by_w_d_over_f(anchor):
    depth, w = 0.5, 0.02
    lens = [moving(part, (w, 0, 0)) for part in thin_lens(**LENS, powers=(1, 1))]
    result = traced(scene_of([*lens, floor(-depth)], sun()), 200, anchor=anchor)
    through = result.masks == 0
    focal_length = closed_forms.thin_lens_focal_length(LENS["radius"], -LENS["radius"], 1.5)
    expected = closed_forms.thin_lens_displacement(w, depth, focal_length) if anchor == "light" else w
    np.testing.assert_allclose(result.photons.dxdt[through, 0], expected, rtol=LENS_ERROR)


def test_check_11_a_turning_cylinder_lens_displaces_light_by_its_angle_times_r_d_over_f():
    depth, angle = 0.5, 0.05
    lens = [turning(part, (0, 0, 1), angle, (0, 0, 0)) for part in thin_lens(**LENS, powers=(1, 0))]
    result = traced(scene_of([*lens, floor(-depth)], sun()), 200, anchor="light")
    through = result.masks == 0
    r = np.linalg.norm(result.origins()[through, :2], axis=1)
    focal_length = closed_forms.thin_lens_focal_length(LENS["radius"], -LENS["radius"], 1.5)
    expected = closed_forms.rotating_cylinder_lens_displacement(angle, r, depth, focal_length)
    found = np.linalg.norm(result.photons.dxdt[through], axis=1)
    # Vertices cross the arc on its chord: a relative angle²/24.
    np.testing.assert_allclose(found, expected, rtol=LENS_ERROR + angle**2)


def test_check_12_a_ball_lens_focuses_at_its_focal_length_from_the_centre():
    radius, half_angle, cells = 0.5, 0.02, 24
    caps = [cap(f"/ball{z}", (0, 0, 0), radius, (0, 0, z), half_angle, cells, glass()) for z in (1, -1)]
    result = traced(scene_of([*caps, floor(-closed_forms.ball_lens_focal_length(radius, 1.5))], sun()), 200)
    tolerance = paraxial_stretch(half_angle, cells, radius, 20.0)
    assert (result.photons.bounces[result.masks == 0] == 2).all() and tolerance < 0.01
    np.testing.assert_allclose(result.stretch()[result.masks == 0], 0, atol=tolerance)


# 14 to 16: focusing surfaces.


def test_check_14_every_ray_into_an_ellipsoid_of_eccentricity_one_over_n_meets_the_far_focus():
    along, across = closed_forms.cartesian_ellipsoid(1.5, 1.5)
    half_angle, cells = 0.4, 192
    body = cap("/body", (0, 0, 0), 1.0, (0, 0, 1), half_angle, cells, glass(), (across, across, along))
    result = traced(scene_of([body, floor(along - 1.5)], sun()), 400)
    facet = math.sqrt(2) * math.tan(half_angle) / cells
    # Heights and normals are interpolated: off by the facet squared. Columns: off by the facet.
    np.testing.assert_allclose(result.photons.positions, [[0, 0, along - 1.5]] * len(result.photons), atol=facet**2)
    np.testing.assert_allclose(result.stretch(), 0, atol=3 * facet)


def test_check_15_the_first_cusp_lies_below_the_crest():
    height = closed_forms.cusp_depth(WAVE.amplitude, WAVE.wave_number, WATER) - WAVE.amplitude
    signs = []
    for level in (0.97 * height, 1.03 * height):
        focused = replace(WAVE, height=level)
        result = traced(scene_of([wave_mesh(focused, 1024), floor()], sun()), 2000)
        crest = np.abs(result.origins()[:, 0]) < 0.01
        signs.append(np.sign(result.stretch()[crest, 0, 0]))
        assert slope_error(focused, 1024) + 3 * (focused.wave_number * 0.01) ** 2 < 0.03
    assert (signs[0] == 1).all() and (signs[1] == -1).all() and len(signs[1]) > 4


FOLDED = Wave(wavelength=0.65, amplitude=0.08, height=1.0, ior=WATER, speed=0.0)


def test_check_16_every_branch_of_a_caustic_has_the_density_of_its_stretch():
    cells, half = 2048, 0.5
    result = traced(scene_of([wave_mesh(FOLDED, cells, half), floor()], sun()), 1000)
    x0 = result.origins()[:, 0]
    error = slope_error(FOLDED, cells, half)
    stretches = stretch(x0, 0.0, FOLDED)
    assert stretches.min() < -1 and stretches.max() > 1 and error < 0.02
    np.testing.assert_allclose(result.stretch()[:, 0, 0], stretches, atol=error)
    np.testing.assert_allclose(result.photons.positions[:, 0], landing(x0, 0.0, FOLDED), atol=error * half / cells)
    cell = np.prod(np.linalg.norm(result.steps, axis=0))
    np.testing.assert_allclose(result.photons.flux[:, 0] / cell, transmittance(x0, 0.0, FOLDED), atol=error)


@pytest.mark.parametrize("at, count", [(0.03, 3), (0.3, 1)])
def test_check_16_irradiance_is_the_sum_over_branches(at, count):
    cells, half = 4096, 0.5
    result = traced(scene_of([wave_mesh(FOLDED, cells, half), floor()], sun()), 40_000)
    photons, v = result.photons, np.floor(result.photons.emission[:, 1])
    row = np.flatnonzero(v == v[len(v) // 2])
    row = row[np.argsort(photons.emission[row, 0])]
    x = photons.positions[row, 0]
    area = np.linalg.norm(np.cross(photons.dxdu, photons.dxdv), axis=1)[row]
    crossings = np.flatnonzero((x[1:] > at) != (x[:-1] > at))
    found = sum(np.mean((photons.flux[row, 0] / area)[[i, i + 1]]) for i in crossings)
    x0 = branches(at, 0.0, FOLDED)
    assert len(crossings) == len(x0) == count
    # The stretch between two photons is known to its own slope times their distance.
    step = np.linalg.norm(result.steps[:, 0])
    error = slope_error(FOLDED, cells, half) * (1 + step * cells / half)
    assert error < 0.1
    expected = irradiance(np.array([at]), 0.0, FOLDED)[0]
    assert found == pytest.approx(expected, rel=error / np.abs(stretch(x0, 0.0, FOLDED)).min())


# 18, 19, 21: flux and area.


def test_check_18_a_point_light_sheds_intensity_times_cosine_over_distance_squared():
    light = lamp((-2 * math.tan(THETA), 0, 2), intensity=3.0)
    result = traced(scene_of([floor(0.0, 0.4, MIRROR, "/mirror"), ceiling_and_mirror((0, 0, 0))[1]], light), 600)
    rays = result.photons.positions - light.position * [1, 1, -1]
    r = np.linalg.norm(rays, axis=1)
    area = np.linalg.norm(np.cross(result.photons.dxdu, result.photons.dxdv), axis=1)
    solid_angle = area * (rays[:, 2] / r) / r**2
    expected = closed_forms.point_light_mean_irradiance(3.0 * solid_angle, solid_angle, r, rays[:, 2] / r)
    assert len(r) > 200
    np.testing.assert_allclose(result.photons.flux[:, 0] / area, expected, rtol=ROUNDING)
    expected = closed_forms.point_light_footprint_area(solid_angle.sum(), len(r), r, rays[:, 2] / r)
    # Cells of equal angles differ in solid angle by the fourth power of the cosine across the patch.
    np.testing.assert_allclose(area.sum(), expected.sum(), rtol=0.01)


def test_check_19_a_flat_interface_keeps_the_area_of_a_beam():
    water = floor(1.0, 0.5, glass(WATER), "/water")
    result = traced(scene_of([water, floor()], sun(SLANTED)), 200)
    area = np.linalg.norm(np.cross(result.photons.dxdu, result.photons.dxdv), axis=1)
    across = np.prod(np.linalg.norm(result.steps, axis=0))
    np.testing.assert_allclose(area, closed_forms.flat_refraction_area(across, THETA), rtol=ROUNDING)


def test_check_21_light_lands_where_snell_says():
    water = floor(1.0, 0.5, glass(WATER), "/water")
    result = traced(scene_of([water, floor()], sun(SLANTED)), 200)
    origins, directions = emission_of(result)
    met = origins + directions * ((1 - origins[:, 2:]) / directions[:, 2:])
    expected = met[:, 0] + math.tan(closed_forms.snell(THETA, 1, WATER))
    np.testing.assert_allclose(result.photons.positions[:, 0], expected, atol=ROUNDING)
    np.testing.assert_allclose(result.photons.positions[:, 1], met[:, 1], atol=ROUNDING)


@pytest.mark.parametrize("theta", [0.0, THETA, 1.2])
def test_check_21_fresnel_shares_the_flux(theta):
    light = sun((math.sin(theta), 0, -math.cos(theta)))
    parts = [floor(1.0, 0.5, glass(), "/glass"), floor(half=8.0)]
    result = traced(scene_of(parts, light), 200)
    cell = np.prod(np.linalg.norm(result.steps, axis=0))
    expected = 1 - closed_forms.fresnel_reflectance(theta, 1, 1.5)
    np.testing.assert_allclose(result.photons.flux / cell, expected, rtol=ROUNDING)
    assert result.energy.escaped / result.energy.sent == pytest.approx(1 - expected, abs=ROUNDING)


def test_check_21_internal_reflections_sum_to_the_slabs_transmittance():
    result = traced(scene_of([*slab(half=0.5), floor()], sun()), 200, smallest_branch=0.0)
    reflectance = closed_forms.fresnel_reflectance(0.0, 1, 1.5)
    expected = closed_forms.slab_transmittance(reflectance)
    # What is still between the faces after eight interactions is lost.
    assert result.energy.deposited / result.energy.sent == pytest.approx(expected, abs=reflectance**7 + ROUNDING)
    assert expected == pytest.approx(0.9231, abs=5e-5)


@pytest.mark.parametrize("degrees, leaves", [(41.5, True), (42.1, False)])
def test_check_21_light_leaves_glass_below_the_critical_angle_only(degrees, leaves):
    theta = math.radians(degrees)
    # The light meets the first face head on, and the tilted second one from inside.
    wedge = [
        floor(2.0, 0.2, glass(), "/face"),
        quad("/back", (0, 0, 1), (math.cos(theta), 0, math.sin(theta)), (0, -1, 0), glass()),
    ]
    assert wedge[1].points[:, 2].max() < 2
    result = traced(scene_of([*wedge, floor(-1.0)], sun()), 2000)
    inside = (np.abs(result.origins()[:, :2]) < 0.19).all(axis=1) & (result.masks == 0)
    assert (result.photons.bounces[inside] == 2).all() and result.energy.sent > 1
    assert (inside.sum() > 20) == inside.any() == leaves
    assert (closed_forms.critical_angle(1.5, 1.0) > theta) == leaves


# 23 and 24: the time column is first order, and absent where nothing moves.


def accelerating(shutter: Shutter) -> SceneAtShutter:
    """A mirror that falls like a stone; positions are exact at the middle, motions from shutter open to close."""

    def height(t: float) -> float:
        return -0.1 * (t - SHUTTER.middle) ** 2

    mirror, ceiling = ceiling_and_mirror((0, 0, height(shutter.close) - height(shutter.open)))
    mirror = replace(mirror, points=mirror.points + np.array([0, 0, height(shutter.middle)]))
    return scene_of([mirror, ceiling], sun(SLANTED), shutter=shutter)


@pytest.mark.parametrize("exposure", [0.4, 0.8])
def test_check_23_at_the_ends_of_the_shutter_half_the_acceleration_is_missing(exposure):
    source = Written(accelerating)
    middle = 5.0
    found = {}
    for name, shutter in {
        "open": Shutter.still(middle - exposure / 2),
        "shutter": Shutter(middle, middle - exposure / 2, middle + exposure / 2),
        "close": Shutter.still(middle + exposure / 2),
    }.items():
        photons = traced(source, 300, anchor="light", shutter=shutter).photons
        found[name] = dict(zip(photons.ids.tolist(), zip(photons.positions, photons.dxdt, strict=True), strict=True))
    # Half the exposure each way from the middle; the mirror displaces light by −2 tan θ of its own way.
    missing = closed_forms.shutter_error(exposure / 2, -2 * math.tan(THETA) * -0.2)
    common = set.intersection(*(set(rows) for rows in found.values()))
    assert len(common) > 100
    for photon in common:
        position, dxdt = found["shutter"][photon]
        for sign, end in ((-0.5, "open"), (0.5, "close")):
            error = found[end][photon][0] - (position + sign * dxdt)
            np.testing.assert_allclose(error, [missing, 0, 0], atol=2 * ROUNDING)


def test_check_24_a_still_scene_traces_the_same_with_and_without_the_time_column():
    still = [ball("/ball", (0.1, 0.2, 1.5), 0.5, 12, glass()), floor()]
    plain = traced(scene_of(still, sun()), 800)
    timed = traced(scene_of([moving(part, (0, 0, 0)) for part in still], sun()), 800)
    assert timed.scene.meshes[0].moves and not plain.scene.meshes[0].moves
    assert not plain.photons.dxdt.any() and not timed.photons.dxdt.any()
    np.testing.assert_array_equal(timed.photons.ids, plain.photons.ids)
    for name in ("positions", "dxdu", "dxdv", "flux"):
        there, here = getattr(timed.photons, name), getattr(plain.photons, name)
        size = np.maximum(np.linalg.norm(here, axis=1, keepdims=True), 1e-3)
        assert (np.abs(there - here) <= 10 * ROUNDING * size).all()


def test_check_24_the_time_column_vanishes_with_the_exposure_and_nothing_else_changes():
    def moved(shutter: Shutter) -> SceneAtShutter:
        w = shutter.exposure * np.array([W, 0.5 * W, W])
        return scene_of([moving(ball("/ball", (0.1, 0.2, 1.5), 0.5, 12, glass()), w), floor()], sun(), shutter=shutter)

    whole = traced(Written(moved), 800, shutter=Shutter(4, 3.5, 4.5))
    part = traced(Written(moved), 800, shutter=Shutter(4, 4 - 2.0**-7, 4 + 2.0**-7))
    common, here, there = np.intersect1d(whole.photons.ids, part.photons.ids, return_indices=True)
    assert len(common) > 400
    np.testing.assert_allclose(part.photons.dxdt[there] * 2.0**6, whole.photons.dxdt[here], atol=ROUNDING)
    # The lattice is fixed by the stills and the cells are the same: so is everything that is not time.
    np.testing.assert_array_equal(part.photons.positions[there], whole.photons.positions[here])
    np.testing.assert_array_equal(part.photons.dxdu[there], whole.photons.dxdu[here])


def test_a_closed_box_of_glass_is_a_slab():
    result = traced(scene_of([box("/box", (-0.5, -0.5, 1), (0.5, 0.5, 1.5), glass()), floor()], sun()), 200)
    through = result.masks == 0
    np.testing.assert_allclose(result.photons.positions[through, :2], result.origins()[through, :2], atol=ROUNDING)
    assert (result.photons.bounces[through] == 2).all()
