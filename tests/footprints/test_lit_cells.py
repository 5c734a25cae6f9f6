"""Cells under lights with extent: sums of lattices, as the light of a sun through still water is, and moments."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import ONE_THREAD, photon_map
from tests.footprints.test_light_images import BOX, DISC, lit
from tests.rendering.test_extended_lights import irradiance, sun
from tests.view.scenes import WATER, floor, looking_down, quad, steady
from tpdwarp.footprints.cell_parts import MeasuredCells
from tpdwarp.footprints.lit_cells import LEAST_ASIDE, spread_over_images
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.photon_map import PhotonMap
from usd_scenes.oracle.closed_forms import fresnel_reflectance


def spread(photons: PhotonMap, pixel: float = 0.25) -> list[PhotonRows]:
    """What stands for the cells of photons, as wide as they are, beside pixels so wide."""
    size = PixelSize()
    size.back, size.orthographic = wp.vec3(0, 0, 1), 1
    size.right, size.up = wp.vec3(pixel, 0, 0), wp.vec3(0, pixel, 0)
    cells = [PhotonRows(photons)]
    measured = MeasuredCells.of(cells, size, ONE_THREAD)
    rows = np.arange(len(photons), dtype=np.int32)
    return spread_over_images(cells, rows, measured.copies, measured.columns, size, ONE_THREAD)


@pytest.mark.parametrize("photons", [1 << 14, 1 << 15, 1 << 17, 1 << 18, 1 << 20])
@pytest.mark.parametrize("degrees", [0.53, 1.0])
def test_light_of_a_sun_through_still_water_is_even_however_fine_its_cells_are(degrees, photons):
    """Its image is .3 and .6 of a pixel across here, and cells are .6 to .08 of one: cells of the variance of both are
    1.1 to 4 cells of the lattice wide, and rippled by .002 to .023."""
    sheet = quad("/water", (-1, -1), (1, 1), 1.0, WATER)
    camera = looking_down((-0.8, 0.8, -0.8, 0.8), height=0.5)
    found = irradiance(steady([floor(), sheet], (sun(degrees),), camera), 64, 64, photons=photons)
    passed = 1 - fresnel_reflectance(0.0, 1.0, 1.33)
    np.testing.assert_allclose(found, passed, rtol=2e-4)


@pytest.mark.parametrize("pixel", [0.25, 0.05])
@pytest.mark.parametrize("image", [DISC, BOX])
@pytest.mark.parametrize(
    ("du", "dv"),
    [((0.3, 0, 0), (0, 0.2, 0)), ((0.25, 0.1, 0), (-0.05, 0.3, 0)), ((0.02, 0, 0), (0, 0.5, 0))],
)
@pytest.mark.parametrize(
    ("a", "b"), [((0.15, 0, 0), (0, 0.15, 0)), ((0.3, 0.1, 0), (0, 0.05, 0)), ((0.02, 0, 0), (0.3, 0.3, 0))]
)
def test_copies_of_a_cell_have_its_flux_middle_and_variance_with_that_of_its_image(du, dv, a, b, image, pixel):
    photons = lit(photon_map([(0.1, 0.2, 0)], du, dv), a, b, image)
    found = spread(photons, pixel)
    part = stacked(found, "flux")[:, 0] / photons.flux[0, 0]
    assert part.sum() == pytest.approx(1, rel=1e-6)
    place, sides = stacked(found, "position")[:, :2], [stacked(found, name)[:, :2] for name in ("dxdu", "dxdv")]
    np.testing.assert_allclose(part @ place, (0.1, 0.2), atol=1e-6)
    off = place - (0.1, 0.2)
    variance = np.einsum("n,ni,nj->ij", part, off, off)
    variance += sum(np.einsum("n,ni,nj->ij", part, side, side) for side in sides) / 12
    du, dv, a, b = (np.array(v[:2]) for v in (du, dv, a, b))
    light = (0.25 if image == DISC else 1.0 / 3.0) * (np.outer(a, a) + np.outer(b, b))
    expected = (np.outer(du, du) + np.outer(dv, dv)) / 12 + light
    # A cell of less than half of a pixel is a whole number of cells wide: at most half of one off, here by .004.
    narrow = np.linalg.norm(du) < 0.5 * pixel
    # Copies that lie aside by next to nothing of a pixel are left out, with their variance.
    alone = (LEAST_ASIDE * pixel) ** 2
    np.testing.assert_allclose(variance, expected, atol=0.02**2 * 10 if narrow else 1e-6 + alone)


def test_no_seam_shows_where_ever_longer_cells_go_over_to_another_whole_number():
    """Cells .04 to .08 of a pixel long that fill a strip evenly, under an image that makes them 3 to 5 cells wide.

    The sum over pixels is off by .0004, and by .009 where one number goes over to the next at once.
    """
    sizes = np.linspace(0.04, 0.08, 700) * 0.25
    ends = np.concatenate([[0.0], np.cumsum(sizes)])
    places = np.stack([0.5 * (ends[1:] + ends[:-1]), np.zeros(700), np.zeros(700)], axis=1)
    du = np.stack([sizes, np.zeros(700), np.zeros(700)], axis=1)
    flux = np.repeat(sizes[:, None] / 0.25, 3, axis=1)
    photons = lit(photon_map(places, du, (0, 0.02, 0), flux=flux), (0.03, 0, 0), (0, 1e-4, 0))
    found = spread(photons)
    x, half = (stacked(found, name)[:, 0].astype(np.float64) for name in ("position", "dxdu"))
    half, part = 0.5 * half, stacked(found, "flux")[:, 0].astype(np.float64)
    np.testing.assert_allclose(stacked(found, "dxdv"), np.tile([0, 0.02, 0], (len(x), 1)), atol=1e-6)
    worst = 0.0
    # Edges of pixels wherever they come to lie.
    for start in np.arange(0.5, ends[-1] / 0.25 - 2.0, 0.05):
        low, high = 0.25 * start, 0.25 * (start + 1.0)
        inside = np.clip(np.minimum(x + half, high) - np.maximum(x - half, low), 0.0, None) / (2.0 * half)
        worst = max(worst, abs(part @ inside - 1.0))
    assert worst < 2e-3


def test_a_cell_whose_light_has_no_image_stays_alone():
    photons = lit(photon_map([(0, 0, 0)], (0.3, 0, 0), (0, 0.2, 0)), (1e-3, 0, 0), (0, 1e-3, 0))
    found = spread(photons)
    assert sum(map(len, found)) == 1
    np.testing.assert_array_equal(stacked(found, "position"), photons.position)
    np.testing.assert_allclose(stacked(found, "dxdu"), photons.dxdu, rtol=1e-6)
