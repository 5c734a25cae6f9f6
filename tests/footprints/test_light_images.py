"""Footprints averaged over the image of a light with extent: flux, variance, shape, and sums of lattices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import ONE_THREAD, first_channel, grid, irradiance, photon_map, queries, shaped
from tpdwarp.footprints.footprint_map import FootprintMap, shape_footprints
from tpdwarp.footprints.light_images import principal_axes, turned_as, variance_root
from tpdwarp.footprints.plain_gather import plain_gather
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.photons.light_columns import LightImage
from tpdwarp.scene.light_places import phase_of

EXTENDED = GatherForm(extended=True)
DISC, BOX = LightImage.DISC, LightImage.PARALLELOGRAM


def lit(photons, a, b, image=DISC):
    """Photons of a light that spans ``a`` and ``b`` on the receiver."""
    count = len(photons)

    def rows(values):
        return np.broadcast_to(np.asarray(values, np.float32), (count, 3)).astype(np.float32)

    return replace(photons, dxda=rows(a), dxdb=rows(b), image=np.full(count, image, np.int32))


def one(du, dv, a, b, image=DISC, half_pixel=0.0):
    """The footprint of one photon at the origin."""
    return shaped(lit(photon_map([(0, 0, 0)], du, dv), a, b, image), half_pixel=half_pixel)


def moments(footprints, half: float, count: int = 1000) -> tuple[float, np.ndarray]:
    """∫ w and the variance [2, 2] of a footprint about the origin."""
    positions, area = grid((-half, -half), (half, half), (count, count))
    weights = first_channel(footprints, positions, EXTENDED) * area
    return weights.sum(), np.einsum("n,ni,nj->ij", weights, positions[:, :2], positions[:, :2]) / weights.sum()


CASES = {
    "disc beside a point": ((1e-3, 0, 0), (0, 1e-3, 0), (0.1, 0, 0), (0, 0.1, 0), DISC),
    "ellipse beside a point": ((1e-3, 0, 0), (0, 1e-3, 0), (0.1, 0.02, 0), (-0.01, 0.05, 0), DISC),
    "disc beside a small footprint": ((0.03, 0, 0), (0.01, 0.04, 0), (0.1, 0, 0), (0, 0.1, 0), DISC),
    "disc beside a footprint of its size": ((0.08, 0, 0), (0.0, 0.07, 0), (0.1, 0, 0), (0, 0.1, 0), DISC),
    "disc beside a large footprint": ((0.2, 0, 0), (0, 0.3, 0), (0.1, 0, 0), (0, 0.1, 0), DISC),
    "disc beside a line": ((0.4, 0.1, 0), (-0.002, 0.008, 0), (0.1, 0, 0), (0, 0.1, 0), DISC),
    "box beside a point": ((1e-3, 0, 0), (0, 1e-3, 0), (0.1, 0.02, 0), (-0.01, 0.05, 0), BOX),
    "box beside a small footprint": ((0.03, 0, 0), (0.01, 0.02, 0), (0.1, 0, 0), (0, 0.1, 0), BOX),
    "box beside a large footprint": ((0.2, 0, 0), (0, 0.3, 0), (0.1, 0, 0), (0, 0.1, 0), BOX),
    "box beside a line": ((0.4, 0.1, 0), (-0.002, 0.008, 0), (0.1, 0, 0), (0, 0.1, 0), BOX),
    "flat box beside a point": ((1e-3, 0, 0), (0, 1e-3, 0), (0.1, 0.02, 0), (0.05, 0.011, 0), BOX),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("side", [0.0, 0.02])
def test_flux_stays_and_variances_add_up(name, side):
    du, dv, a, b, image = CASES[name]
    found = one(du, dv, a, b, image, half_pixel=side / math.sqrt(12))
    reach = 1.6 * max(sum(abs(v[i]) for v in (du, dv, a, b)) for i in (0, 1)) + 2 * side
    whole, variance = moments(found, reach)
    # The rim of a disc a thousand cells across is one cell wide on this grid.
    assert whole == pytest.approx(1, abs=5e-3)
    du, dv, a, b = (np.array(v[:2]) for v in (du, dv, a, b))
    k = 0.25 if image == DISC else 1.0 / 3.0
    light = k * (np.outer(a, a) + np.outer(b, b))
    total = light + 0.25 * (np.outer(du, du) + np.outer(dv, dv)) + side**2 / 12 * np.eye(2)
    # Discs have edges of a fifth of their radius at least, which widens them by 4 %; oblique axes take up to a third.
    oblique = abs(du @ dv) > 1e-3 * np.linalg.norm(du) * np.linalg.norm(dv) and "small" not in name
    allowed = (0.3 if oblique else 0.05) * np.trace(light) + 1e-3 * np.trace(total)
    np.testing.assert_allclose(variance, total, atol=allowed)


@pytest.mark.parametrize("image", [DISC, BOX])
def test_an_image_within_a_pixel_adds_its_variance_to_that_of_its_cell(image):
    """A cell has a twelfth of its sides' squares for its variance, a B-spline three times as much."""
    du, dv, a, b, side = (0.004, 0.001, 0), (0, 0.005, 0), (0.003, 0.001, 0), (0, 0.002, 0), 0.008
    whole, variance = moments(one(du, dv, a, b, image, half_pixel=side / math.sqrt(12)), 0.03)
    du, dv, a, b = (np.array(v[:2]) for v in (du, dv, a, b))
    light = (0.25 if image == DISC else 1.0 / 3.0) * (np.outer(a, a) + np.outer(b, b))
    expected = (np.outer(du, du) + np.outer(dv, dv)) / 12 + light + side**2 / 12 * np.eye(2)
    # A grid of 500 across the pixel.
    assert whole == pytest.approx(1, abs=2e-3)
    np.testing.assert_allclose(variance, expected, atol=2e-3 * np.trace(expected))


def test_light_from_a_disc_onto_a_point_is_a_disc():
    radius = 0.1
    found = one((1e-4, 0, 0), (0, 1e-4, 0), (radius, 0, 0), (0, radius, 0))
    points = np.array([[r * math.cos(3.0), r * math.sin(3.0), 0.0] for r in np.linspace(0, 2 * radius, 81)])
    light = first_channel(found, points, EXTENDED) * math.pi * radius**2
    distance = np.linalg.norm(points, axis=1)
    # Where pixels are nothing its edge is √(12 · 0.04)/4 of the radius wide to either side, √2 of that on diagonals.
    np.testing.assert_allclose(light[distance < 0.75 * radius], 1, atol=1e-3)
    assert np.all(light[distance > 1.25 * radius] == 0)
    # By the variance of that over the diameter less than a half: the rim curves.
    assert np.interp(radius, distance, light) == pytest.approx(0.5 - 0.04 / 4 / math.sqrt(12 * 0.04), abs=0.01)


@pytest.mark.parametrize(("p", "q"), [((1.0, 0.0), (0.0, 1.0)), ((1.2, 0.5), (-0.4, 0.9))])
@pytest.mark.parametrize(("radius", "allowed"), [(1.0, 0.04), (1.3, 0.03), (2.0, 0.015)])
def test_a_disc_a_pixel_or_two_wide_is_what_pixels_have_of_it(p, q, radius, allowed):
    """Its mean over pixels by counting; a smoothstep of the same variance for its edge misses twice as much of it."""
    radius, p, q = 0.05 * radius, 0.05 * np.array(p), 0.05 * np.array(q)
    pixel = PixelSize()
    pixel.back, pixel.right, pixel.up, pixel.orthographic = wp.vec3(0, 0, 1), wp.vec3(*p, 0), wp.vec3(*q, 0), 1
    photons = lit(photon_map([(0, 0, 0)], (1e-4, 0, 0), (0, 1e-4, 0)), (radius, 0, 0), (0, radius, 0))
    found = FootprintMap.of(shape_footprints([photons], "bspline", 1.0, pixel, False, ONE_THREAD))
    positions, area = grid((-0.2, -0.2), (0.2, 0.2), (64, 64))
    light = first_channel(found, positions, EXTENDED)
    # A grid of an eighth of the pixel's side.
    assert light.sum() * area == pytest.approx(1, abs=2e-3)
    within = (np.arange(40) + 0.5) / 40 - 0.5
    sides = (within[:, None, None] * p + within[None, :, None] * q).reshape(-1, 2)
    places = positions[:, None, :2] + sides[None]
    expected = (np.einsum("nki,nki->nk", places, places) < radius**2).mean(axis=1) / (math.pi * radius**2)
    assert np.sqrt(np.mean((light - expected) ** 2) / np.mean(expected**2)) < allowed


def test_light_from_a_rectangle_onto_a_point_is_its_image():
    a, b = np.array([0.1, 0.02, 0]), np.array([-0.01, 0.05, 0])
    found = one((1e-4, 0, 0), (0, 1e-4, 0), a, b, BOX)
    places = np.random.default_rng(3).uniform(-1.5, 1.5, (500, 2))
    light = first_channel(found, places @ np.stack([a, b]), EXTENDED) * 4 * np.linalg.norm(np.cross(a, b))
    away = np.abs(np.abs(places) - 1).min(axis=1) > 0.05
    np.testing.assert_allclose(light[away], np.all(np.abs(places) < 1, axis=1)[away], atol=1e-3)


def test_a_line_under_a_disc_has_half_an_ellipse_for_its_section():
    """Two boxes of its height and variance miss it by a fifth of its height where it ends, and else by an eighth."""
    radius = 0.1
    found = one((2.0, 0, 0), (0, 1e-4, 0), (radius, 0, 0), (0, radius, 0))
    y = np.linspace(-0.15, 0.15, 301)
    points = np.stack([0 * y, y, 0 * y], axis=1)
    light = first_channel(found, points, EXTENDED)
    section = np.sqrt(np.maximum(1 - (y / radius) ** 2, 0)) * 2 / (math.pi * radius)
    light *= section.sum() / light.sum()
    missed = np.abs(light - section) / section.max()
    assert missed.max() < 0.21 and missed[np.abs(y) < 0.8 * radius].max() < 0.125
    assert light[150] == pytest.approx(section[150], rel=0.01)


@pytest.mark.parametrize("image", [DISC, BOX])
def test_pixels_share_a_line_without_rest_where_its_light_has_an_image_within_a_pixel(image):
    """Rows of pixels side by side, wherever the line lies: boxes that were wider than pixels would overlap."""
    side, radius = 0.02, 0.006
    for offset in np.linspace(0.0, side, 7):
        line = photon_map([(0, offset, 0)], (0.8, 0, 0), (0, 1e-4, 0))
        found = shaped(lit(line, (radius, 0, 0), (0, radius, 0), image), half_pixel=side / math.sqrt(12))
        rows = np.stack([np.zeros(21), side * np.arange(-10, 11), np.zeros(21)], axis=1)
        light = first_channel(found, rows, EXTENDED).sum() * side
        # The height of a B-spline in its middle, by its length.
        assert light == pytest.approx(0.75 / 0.8, rel=2e-3)


@pytest.mark.parametrize("shear", [0.0, 0.3])
@pytest.mark.parametrize("image", [DISC, BOX])
@pytest.mark.parametrize("cells", [0.5, 1.0, 2.0, 4.0])
def test_a_lattice_stays_uniform_under_any_light(cells, image, shear):
    """Translates sum to one; discs, which are no tensor products, leave a ripple where they are two cells across."""
    cell, index = 0.05, np.arange(-40, 41)
    i, j = (a.ravel() for a in np.meshgrid(index, index))
    at = np.stack([(i + shear * j) * cell, j * cell, 0.0 * i], axis=1)
    photons = photon_map(at, (cell, 0, 0), (shear * cell, cell, 0), flux=cell**2)
    light = lit(photons, (cells * cell, 0, 0), (0, cells * cell, 0), image)
    points = np.append(np.random.default_rng(4).uniform(-0.1, 0.1, (300, 2)), np.zeros((300, 1)), axis=1)
    ripple = np.abs(first_channel(shaped(light), points, EXTENDED) - 1).max()
    assert ripple < 0.02


@pytest.mark.parametrize("side", [3, 7])
@pytest.mark.parametrize("cells", [1.0, 5.0, 20.0])
def test_narrow_footprints_of_parts_whose_lattices_interleave_sum_to_one(cells, side):
    """Parts of a square light, each with a lattice as much coarser as it has fewer photons, sheared on the receiver."""
    fine, parts = 0.01, side * side
    cell, image = side * fine, cells * fine
    reach = 4 + int(image / cell)
    index = np.arange(-reach, reach + 1)
    i, j = (a.ravel() for a in np.meshgrid(index, index))
    maps = []
    for number in range(parts):
        u, v = phase_of(f"/light[{number}]")
        middle = ((np.array([number % side, number // side]) + 0.5) / side - 0.5) * image
        x, y = (i + u) * cell, (j + v) * cell
        at = np.stack([x + 0.2 * y + middle[0], y + middle[1], 0.0 * x], axis=1)
        photons = photon_map(at, (cell, 0, 0), (0.2 * cell, cell, 0), flux=cell**2 / parts)
        half = 0.5 * image / side
        maps.append(replace(lit(photons, (half, 0, 0), (0, half, 0), BOX), light_parts=parts))
    points = np.append(np.random.default_rng(4).uniform(0.0, cell, (300, 2)), np.zeros((300, 1)), axis=1)
    light = first_channel(shaped(*maps), points, EXTENDED)
    assert light.mean() == pytest.approx(1.0, abs=5e-3)
    assert light.std() < 0.02


@pytest.mark.parametrize("radius", [0.2, 0.4, 0.6, 0.9, 1.5])
def test_fine_cells_under_an_image_are_a_spline_or_copies_of_a_cell_and_sum_to_one(radius):
    """Cells of a third of a pixel, by images from well within a pixel to wider ones."""
    side, cell = 0.03, 0.01
    index = np.arange(-16, 17)
    i, j = (a.ravel() for a in np.meshgrid(index, index))
    at = np.stack([i * cell, j * cell, 0.0 * i], axis=1)
    photons = lit(
        photon_map(at, (cell, 0, 0), (0, cell, 0), flux=cell**2), (radius * side, 0, 0), (0, radius * side, 0)
    )
    footprints = shaped(photons, half_pixel=side / math.sqrt(12))
    assert footprints.count in (len(photons), 3 * len(photons))
    points = np.append(np.random.default_rng(4).uniform(-0.03, 0.03, (300, 2)), np.zeros((300, 1)), axis=1)
    allowed = 0.02 if footprints.count == len(photons) else 1e-5
    assert np.abs(first_channel(footprints, points, EXTENDED) - 1).max() < allowed


@wp.kernel
def principal_parts(
    base: int,
    matrices: wp.array(dtype=wp.mat22),
    values: wp.array(dtype=wp.vec2),
    firsts: wp.array(dtype=wp.vec2),
    roots: wp.array(dtype=wp.mat22),
    turns: wp.array(dtype=wp.mat22),
):
    i = base + wp.tid()
    variance = matrices[i] * wp.transpose(matrices[i])
    axes = principal_axes(variance)
    values[i] = wp.vec2(axes.s1, axes.s2)
    firsts[i] = axes.first
    roots[i] = variance_root(variance)
    turns[i] = turned_as(matrices[i])


def test_roots_axes_and_turns_of_footprints_are_those_of_their_singular_values():
    random = np.random.default_rng(3)
    j = random.normal(size=(200, 2, 2)) @ np.einsum("ni,ij->nij", 10.0 ** random.uniform(-2, 0, (200, 2)), np.eye(2))
    j[:3] = np.eye(2), np.diag([2.0, 1.0]), np.diag([1.0, -2.0])
    count = len(j)
    given = ONE_THREAD.array(j.astype(np.float32), wp.mat22)
    out = [ONE_THREAD.zeros(count, dtype) for dtype in (wp.vec2, wp.vec2, wp.mat22, wp.mat22)]
    ONE_THREAD(principal_parts, count, [given, *out])
    values, firsts, roots, turns = (array.numpy().astype(np.float64) for array in out)
    left, sizes, right = np.linalg.svd(j)
    large = sizes[:, :1] ** 2
    np.testing.assert_allclose(values / large, sizes**2 / large, atol=3e-6)
    np.testing.assert_allclose(np.linalg.norm(firsts, axis=1), 1, rtol=1e-6)
    along = np.einsum("ni,nij->nj", firsts, left) ** 2 @ np.array([0.0, 1.0])
    apart = 1 - (sizes[:, 1] / sizes[:, 0]) ** 2
    assert (along * apart).max() < 1e-6
    np.testing.assert_allclose(roots @ roots / large[..., None], j @ j.transpose(0, 2, 1) / large[..., None], atol=3e-6)
    np.testing.assert_allclose(turns, left @ right, atol=2e-3)


def test_light_without_extent_is_looked_up_as_it_is_without_the_columns():
    at = np.random.default_rng(1).uniform(-0.1, 0.1, (50, 3)) * [1, 1, 0]
    photons = photon_map(at, (0.03, 0, 0), (0.01, 0.02, 0))
    points = np.random.default_rng(2).uniform(-0.1, 0.1, (200, 3)) * [1, 1, 0]
    plain = first_channel(shaped(photons, half_pixel=0.004), points)
    for image, a in ((LightImage.NONE, 0.1), (DISC, 1e-4)):
        with_columns = shaped(lit(photons, (a, 0, 0), (0, a, 0), image), half_pixel=0.004)
        np.testing.assert_array_equal(first_channel(with_columns, points, EXTENDED), plain)


def test_images_that_move_and_curve_are_gathered_as_they_are_plainly():
    random = np.random.default_rng(7)
    count = 60
    at, motion = random.uniform(-0.2, 0.2, (count, 3)) * [1, 1, 0], random.normal(0, 0.05, (count, 3)) * [1, 1, 0]
    columns = random.normal(0, 0.03, (4, count, 3)) * [1, 1, 0]
    bends = [random.normal(0, size, (count, 3)) * [1, 1, 0] for size in (0.02, 0.01, 0.005, 0.005)]
    photons = photon_map(at, columns[0], columns[1], motion, trajectory=bends)
    image = random.integers(0, 3, count).astype(np.int32)
    photons = replace(photons, dxda=columns[2].astype(np.float32), dxdb=columns[3].astype(np.float32), image=image)
    footprints = shaped(photons, half_pixel=0.002, moves=True)
    points = queries(random.uniform(-0.2, 0.2, (400, 3)) * [1, 1, 0])
    found = irradiance(footprints, points, EXTENDED).irradiance[:, 0]
    plain = plain_gather(footprints, points, EXTENDED, ONE_THREAD).irradiance[:, 0]
    assert plain.max() > 0
    np.testing.assert_allclose(found, plain, rtol=2e-3, atol=2e-3 * plain.max())


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(("thin", "light", "side"), [(0.3, 0.02, 0.007), (0.01, 0.08, 0.007), (0.01, 0.02, 0.06)])
def test_what_grows_on_its_way_is_longer_where_it_ends_whichever_way_columns_point(thin, light, side, swapped, signs):
    """A footprint across its way goes one unit and grows by 0.6 of itself: (1 ± 0.24)² of its square at ± 0.4."""
    columns = [signs[0] * np.array([0.0, 0.2, 0.0]), signs[1] * np.array([0.2 * thin, 0.0, 0.0])]
    columns = columns[::-1] if swapped else columns
    photons = photon_map(
        [(0, 0, 0)], *columns, (1, 0, 0), trajectory=[(1e-3, 0, 0), (0, 0, 0), *(0.6 * column for column in columns)]
    )
    footprints = shaped(lit(photons, (light, 0, 0), (0, light, 0)), half_pixel=side / math.sqrt(12), moves=True)
    squares = []
    for x in (-0.4, 0.4):
        positions, _ = grid((x - 0.02, -0.8), (x + 0.02, 0.8), (8, 400))
        weights = first_channel(footprints, positions, EXTENDED)
        squares.append(float((weights * positions[:, 1] ** 2).sum() / weights.sum()))
    around = 0.25 * light**2 + side**2 / 12
    expected = [0.25 * (0.2 * (1.0 + 0.6 * x)) ** 2 + around for x in (-0.4, 0.4)]
    np.testing.assert_allclose(squares, expected, rtol=0.12)


@pytest.mark.parametrize("kernel", ["epanechnikov", "gaussian"])
def test_radial_kernels_are_widened_by_the_light(kernel):
    photons = lit(photon_map([(0, 0, 0)], (0.1, 0, 0), (0, 0.1, 0)), (0.1, 0, 0), (0, 0.1, 0))
    positions, area = grid((-0.6, -0.6), (0.6, 0.6), (600, 600))

    def spread(footprints, form):
        weights = first_channel(footprints, positions, form) * area
        # Kernels that are cut have an edge, which is one step of the grid wide.
        assert weights.sum() == pytest.approx(1, abs=6e-3)
        return float((weights * positions[:, 0] ** 2).sum())

    narrow = photon_map([(0, 0, 0)], (0.1, 0, 0), (0, 0.1, 0))
    added = spread(shaped(photons, kernel=kernel), GatherForm(kernel, extended=True)) - spread(
        shaped(narrow, kernel=kernel), GatherForm(kernel)
    )
    assert added == pytest.approx(0.25 * 0.1**2, rel=0.02)
