"""Thin walls, rough surfaces, dispersion, absorption in nested media and linked lights, against closed forms.

All of them are traced by one kernel, which is compiled for everything that is tested here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, MIRROR, box, floor, glass, quad
from tests.photons.traced import Traced, scene_of, sun, traced
from tpdwarp.photons.dispersion import LINE_C, LINE_D, LINE_F, WAVELENGTHS, band_colors, index_at
from usd_scenes.oracle.closed_forms import fresnel_reflectance, snell

EVERYTHING = {
    "refraction": True,
    "reflection": True,
    "nested": True,
    "tinted": True,
    "linked": True,
    "thin_walls": True,
    "rough": True,
}
SLOPE = 0.4
THETA = np.arctan(SLOPE)
# Positions of a scene of radius six in single precision.
ROUNDING = 1e-5
GLASS = glass(1.5)


def through(*meshes, photons: int = 1024, direction=(SLOPE, 0, -1), **light) -> Traced:
    return traced(scene_of(meshes, replace(sun(direction), **light)), photons, **EVERYTHING)


def straight(result: Traced) -> np.ndarray:
    """Rows of the photons that nothing reflected."""
    return np.flatnonzero(result.masks == 0)


def cell(result: Traced) -> float:
    """Flux of a cell of the sun."""
    return float(np.linalg.norm(np.cross(*result.steps.T)))


def test_a_thin_wall_reflects_what_both_of_its_sides_do_and_passes_the_rest_unbent():
    sheet = floor(1.0, 1.0, replace(GLASS, thin_walled=True), "/sheet")
    result = through(floor(half=9.0), sheet)
    rows = straight(result)
    start = result.origins()[rows]
    landed = start[:, :2] + np.outer(start[:, 2], (SLOPE, 0))
    np.testing.assert_allclose(result.photons.positions[rows, :2], landed, atol=ROUNDING)
    reflectance = fresnel_reflectance(THETA, 1.0, 1.5)
    passed = (1 - reflectance) / (1 + reflectance)
    np.testing.assert_allclose(result.photons.flux[rows, 0], passed * cell(result), rtol=1e-5)
    assert result.energy.deposited == pytest.approx(passed * result.energy.sent, rel=1e-5)
    assert result.energy.escaped == pytest.approx((1 - passed) * result.energy.sent, rel=1e-4)
    np.testing.assert_allclose(result.stretch()[rows][:, 1, 1], 1, atol=ROUNDING)


def test_a_thin_wall_is_the_same_from_behind():
    sheet = replace(GLASS, thin_walled=True)
    up, down = (
        through(floor(half=9.0), quad("/sheet", (0, 0, 1), (1, 0, 0), (0, side, 0), sheet)) for side in (1.0, -1.0)
    )
    assert up.energy.deposited == pytest.approx(down.energy.deposited, rel=1e-6)


def lobe_of(roughness: float, material, direction, seed: int, count: int = 200_000) -> np.ndarray:
    """Where light through the origin of the plane z = 1 lands on z = 0 (or z = 2 for a mirror) by GGX's facets, [n, 2].

    Facets are drawn from D(m) cos θ_m; light whose facet would turn it to the wrong side is left out.
    """
    random = np.random.default_rng(seed)
    u, turn = random.random(count), 2 * np.pi * random.random(count)
    slope = roughness * np.sqrt(u / (1 - u))
    m = np.stack([slope * np.cos(turn), slope * np.sin(turn), np.ones(count)], axis=1)
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    w = np.asarray(direction, float) / np.linalg.norm(direction)
    cosine = -(m @ w)
    if material is MIRROR:
        out = w + 2 * cosine[:, None] * m
        good = (cosine > 0) & (out[:, 2] > 0)
        return (out[:, :2] / out[:, 2:])[good]
    eta = 1 / 1.5
    square = 1 - eta**2 * (1 - cosine**2)
    out = eta * w + (eta * cosine - np.sqrt(square))[:, None] * m
    good = (cosine > 0) & (out[:, 2] < 0)
    return (out[:, :2] / -out[:, 2:])[good]


@pytest.mark.parametrize("material", [GLASS, MIRROR], ids=["glass", "metal"])
@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_a_rough_surface_spreads_light_as_far_as_facets_drawn_at_random_do(material, roughness, slope):
    """Half of the light lies as near to where the smooth surface sends it, along either axis, as by Monte Carlo."""
    width = roughness**2
    plate = floor(1.0, 1.0, replace(material, roughness=width), "/plate")
    # The wall lets light come in, and takes what comes back.
    receiver = floor(half=9.0) if material is GLASS else quad("/wall", (0, 0, 2), (9, 0, 0), (0, -9, 0), DIFFUSE)
    result = through(receiver, plate, direction=(slope, 0, -1), photons=256, passed=frozenset({"/wall"}))
    rows = straight(result)
    columns = np.stack([result.photons.dxda[rows[0]], result.photons.dxdb[rows[0]]])[:, :2]
    deviations = np.sqrt(np.sum(columns**2, axis=0))
    offsets = lobe_of(width, material, (slope, 0, -1), seed=0)
    middle = np.median(offsets, axis=0)
    drawn = np.median(np.abs(offsets - middle), axis=0)
    # Half of a Gaussian lies within .6745 deviations, half of GGX's slopes within α/√3: that is .8 % less. Beyond first
    # order the lobe bends by its width; the median of 200 000 is known within .4 %.
    np.testing.assert_allclose(0.67449 * deviations, drawn, rtol=0.015 + 2 * width)


def test_two_rough_surfaces_spread_light_by_the_sum_of_their_variances():
    """Far below a slab; of the light that both spread, directions count alone."""
    width = 0.01
    rough = box("/slab", (-1, -1, 9.99), (1, 1, 10), replace(GLASS, roughness=width))
    half = box("/slab", (-1, -1, 9.99), (1, 1, 10), GLASS)
    result = through(floor(half=12.0), rough, direction=(0, 0, -1), photons=64)
    one = through(floor(half=12.0), half, direction=(0, 0, -1), photons=64)
    row = straight(result)[0]
    variance = np.sum(np.stack([result.photons.dxda[row], result.photons.dxdb[row]])[:, :2] ** 2, axis=0)
    deviation = width / np.sqrt(2 * np.log(2))
    # Going in bends by (1 − 1/n) of the facet's slope, and out again by n times that; going out by n − 1 of its own.
    expected = 100.0 * deviation**2 * 2 * 0.5**2
    np.testing.assert_allclose(variance, expected, rtol=5e-3)
    assert result.energy.deposited == pytest.approx(one.energy.deposited, rel=1e-6)


def test_a_rough_sheet_spreads_light_by_both_of_its_sides():
    width = 0.04
    sheet = floor(1.0, 1.0, replace(GLASS, thin_walled=True, roughness=width), "/sheet")
    result = through(floor(half=9.0), sheet, direction=(0, 0, -1), photons=64)
    row = straight(result)[0]
    variance = np.sum(np.stack([result.photons.dxda[row], result.photons.dxdb[row]])[:, :2] ** 2, axis=0)
    deviation = width / np.sqrt(2 * np.log(2))
    np.testing.assert_allclose(variance, 2 * (0.5 * deviation) ** 2, rtol=1e-4)


def test_light_of_each_wavelength_refracts_by_its_own_index():
    prism = replace(GLASS, abbe=30.0)
    result = through(floor(half=9.0), floor(1.0, 1.0, prism, "/water"), photons=256)
    bands = result.masks % len(WAVELENGTHS)
    assert set(bands) == set(range(len(WAVELENGTHS)))
    for number, wavelength in enumerate(WAVELENGTHS):
        rows = np.flatnonzero(bands == number)
        index = index_at(prism, wavelength)
        start = result.origins()[rows]
        entry = start[:, 0] + (start[:, 2] - 1.0) * SLOPE
        landed = entry + np.tan(snell(THETA, 1.0, index))
        np.testing.assert_allclose(result.photons.positions[rows, 0], landed, atol=ROUNDING)
        passed = (1 - fresnel_reflectance(THETA, 1.0, index)) * band_colors()[number]
        np.testing.assert_allclose(result.photons.flux[rows], passed * np.full((len(rows), 3), cell(result)), rtol=1e-5)


def test_the_abbe_number_is_that_of_the_lines_which_define_it():
    prism = glass(1.7)
    prism = replace(prism, abbe=25.0)
    d, f, c = (index_at(prism, line) for line in (LINE_D, LINE_F, LINE_C))
    assert d == pytest.approx(1.7, rel=1e-12) and (d - 1) / (f - c) == pytest.approx(25.0, rel=1e-12)


def test_colours_of_wavelengths_make_white():
    np.testing.assert_allclose(band_colors().sum(axis=0), 1, rtol=1e-12)
    assert (band_colors() >= 0).all() and len(WAVELENGTHS) >= 3


def test_nested_media_absorb_along_the_way_that_light_takes_in_each():
    tea, amber = (0.5, 0.2, 0.1), (0.1, 0.4, 0.9)
    water = box("/water", (-2, -2, 0.5), (2, 2, 1.5), replace(glass(1.33), absorption=tea))
    block = box("/block", (-1.9, -1.9, 0.8), (1.9, 1.9, 1.2), replace(GLASS, absorption=amber))
    result = through(floor(half=9.0), water, block, direction=(0, 0, -1))
    inside = np.abs(result.origins()[:, :2]).max(axis=1) < 1.8
    rows = np.flatnonzero((result.masks == 0) & inside)
    assert len(rows) > 100
    passed = 1.0
    for one, other in ((1.0, 1.33), (1.33, 1.5), (1.5, 1.33), (1.33, 1.0)):
        passed *= 1 - fresnel_reflectance(0.0, one, other)
    expected = passed * np.exp(-0.6 * np.array(tea) - 0.4 * np.array(amber)) * cell(result)
    np.testing.assert_allclose(result.photons.flux[rows], np.broadcast_to(expected, (len(rows), 3)), rtol=1e-4)
    energy = result.energy
    whole = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert whole == pytest.approx(energy.sent, rel=1e-5) and energy.absorbed > 0


def test_light_makes_no_caustic_where_it_is_not_to_shine():
    slab = box("/slab", (-1, -1, 0.8), (1, 1, 1.2), GLASS)
    everywhere = through(floor(half=9.0), slab)
    assert everywhere.energy.deposited > 0
    on_glass = through(floor(half=9.0), slab, unlit=frozenset({"/slab"}))
    assert len(on_glass.photons) == 0 and on_glass.energy.sent == 0
    on_floor = through(floor(half=9.0), slab, unlit=frozenset({"/floor"}))
    assert len(on_floor.photons) == 0
    assert on_floor.energy.absorbed == pytest.approx(everywhere.energy.deposited, rel=1e-5)
    assert on_floor.energy.sent == pytest.approx(everywhere.energy.sent, rel=1e-6)


def test_light_passes_what_throws_no_shadow():
    slab = box("/slab", (-1, -1, 0.8), (1, 1, 1.2), GLASS)
    roof = quad("/roof", (0, 0, 2), (9, 0, 0), (0, 9, 0), DIFFUSE)
    open_sky = through(floor(half=9.0), slab)
    under_roof = through(floor(half=9.0), slab, roof, passed=frozenset({"/roof"}))
    # What the glass reflects lights the roof from below.
    on_floor = under_roof.photons.positions[:, 2] < 0.1
    assert (~on_floor).any()
    np.testing.assert_allclose(under_roof.photons.positions[on_floor], open_sky.photons.positions, atol=ROUNDING)
    np.testing.assert_allclose(under_roof.photons.flux[on_floor], open_sky.photons.flux, rtol=1e-6)
    assert len(through(floor(half=9.0), slab, roof).photons) == 0
    # What throws no shadow is lit all the same, by light that glass has bent.
    on_floor = through(floor(half=9.0), slab, passed=frozenset({"/floor"}))
    assert on_floor.energy.deposited == pytest.approx(open_sky.energy.deposited, rel=1e-6)
    assert len(through(floor(half=9.0), slab, passed=frozenset({"/slab"})).photons) == 0
