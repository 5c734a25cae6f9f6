"""Background light: what is faint is gathered on rasters, keeps its flux, and errs by no more than it is faint."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import ONE_THREAD, grid, photon_map, pixel, queries, shaped
from tpdwarp.footprints.background import FAINT, split_light
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.light import FootprintLight
from tpdwarp.footprints.light_images import spline_over_image
from tpdwarp.footprints.plain_gather import plain_gather
from tpdwarp.footprints.shaping import LightImageArrays, TangentFrame, light_on_plane
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.photons.light_columns import LightImage

FINE, COARSE = 0.02, 0.05
HALF_PIXEL = 0.001
# Of the irradiance of the other light, which is one.
DIM = 0.05


def sheet(cell: float, irradiance: float, half: float = 0.5, **columns):
    """Photons on a lattice over a square of the plane z = 0, which make it as bright as that."""
    x = np.arange(-half + 0.5 * cell, half, cell)
    at = np.stack([a.ravel() for a in np.meshgrid(x, x, [0.0])], axis=1)
    # As inner reflections, those that are faint have left most of their light elsewhere.
    share = min(1.0, irradiance)
    return photon_map(at, (cell, 0, 0), (0, cell, 0), flux=irradiance * cell**2, **{"share": share, **columns})


def light_of(*maps, moves: bool = False) -> FootprintLight:
    return FootprintLight(list(maps), GatherForm(), 1.0, pixel(HALF_PIXEL), moves, ONE_THREAD)


def looked_up(light: FootprintLight, points, **columns) -> np.ndarray:
    return light.irradiance(queries(points, **columns), Lookup()).irradiance[:, 0].astype(np.float64)


def scattered(reach: float, count: int = 2000) -> np.ndarray:
    return np.append(np.random.default_rng(4).uniform(-reach, reach, (count, 2)), np.zeros((count, 1)), axis=1)


@pytest.mark.parametrize(("part", "is_background"), [(0.9 * FAINT, True), (1.1 * FAINT, False)])
def test_what_is_less_than_a_part_of_other_light_is_background(part, is_background):
    maps = [sheet(FINE, 1.0, half=1.0), sheet(COARSE, part, half=0.3, share=0.05)]
    split = split_light(maps, 1.0, pixel(HALF_PIXEL), ONE_THREAD)
    assert sum(len(photons) for photons in split.fine) == len(maps[0]) + (0 if is_background else len(maps[1]))
    assert bool(split.coarse) == is_background


@pytest.mark.parametrize("what", ["a receiver that moves", "few photons", "pixels as large as squares"])
def test_there_is_no_background_where_rasters_gain_nothing_or_are_wrong(what):
    motion = (0.1, 0, 0) if what == "a receiver that moves" else (0, 0, 0)
    dim = sheet(COARSE, DIM, half=0.2 if what == "few photons" else 0.5, receiver_motion=motion)
    size = pixel(0.05 if what == "pixels as large as squares" else HALF_PIXEL)
    assert not split_light([sheet(FINE, 1.0), dim], 1.0, size, ONE_THREAD).coarse


def test_paths_that_do_not_branch_make_no_background():
    maps = [sheet(FINE, 1.0, half=1.0), sheet(COARSE, DIM, half=0.3, share=1.0)]
    assert not split_light(maps, 1.0, pixel(HALF_PIXEL), ONE_THREAD).coarse


def soft(photons, radius: float):
    """Photons of a lamp whose image is a disc."""
    a, b = (np.tile(np.float32(axis) * np.float32(radius), (len(photons), 1)) for axis in ((1, 0, 0), (0, 1, 0)))
    return replace(photons, dxda=a, dxdb=b, image=np.full(len(photons), LightImage.DISC, np.int32))


@pytest.mark.parametrize("radius", [0.0, 0.1])
def test_faint_light_of_fine_cells_is_background_where_the_images_of_lamps_are_wide(radius):
    bright, dim = sheet(FINE, 1.0, half=1.0), sheet(COARSE / 8, DIM, half=0.4)
    none = np.zeros((len(bright), 3), np.float32)
    maps = [replace(bright, dxda=none, dxdb=none, image=np.zeros(len(bright), np.int32)), soft(dim, radius)]
    split = split_light(maps, 1.0, pixel(HALF_PIXEL), ONE_THREAD)
    assert sum(len(rows) for levels in split.coarse.values() for rows in levels) == (len(dim) if radius else 0)
    points = scattered(0.2, 300)
    # Squares add a tenth of its variance to a disc that is as bright all over these points.
    np.testing.assert_allclose(looked_up(light_of(*maps), points), 1.0 + DIM, rtol=1e-3)


@wp.kernel(module="unique", enable_backward=False)
def over_images(base: int, j: wp.array(dtype=wp.mat22), images: LightImageArrays, out: wp.array(dtype=wp.mat22)):
    i = base + wp.tid()
    frame = TangentFrame()
    frame.e1 = wp.vec3(1.0, 0.0, 0.0)
    frame.e2 = wp.vec3(0.0, 1.0, 0.0)
    out[i] = spline_over_image(j[i], light_on_plane(images, i, frame))


@pytest.mark.parametrize(("image", "part"), [(LightImage.PARALLELOGRAM, 1 / 3), (LightImage.DISC, 1 / 4)])
def test_cells_that_stand_for_images_have_the_variance_of_both_along_their_axes(image, part):
    random = np.random.default_rng(6)
    j, light = random.normal(0, 0.1, (2, 100, 2, 2)).astype(np.float32)
    images = LightImageArrays()
    flat = np.append(light, np.zeros((100, 1, 2), np.float32), axis=1)
    sides = [np.ascontiguousarray(flat[:, :, k]) for k in (0, 1)]
    images.dxda, images.dxdb = (wp.array(side, dtype=wp.vec3, device="cpu") for side in sides)
    images.image = wp.array(np.full(100, int(image), np.int32), dtype=wp.int32, device="cpu")
    out = wp.zeros(100, wp.mat22, device="cpu")
    ONE_THREAD(over_images, 100, [wp.array(j, dtype=wp.mat22, device="cpu"), images, out])
    found = out.numpy().astype(np.float64)
    expected = j @ j.transpose(0, 2, 1) / 4 + part * light @ light.transpose(0, 2, 1)
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1) / 4, expected, rtol=1e-4, atol=1e-7)
    assert np.abs(np.einsum("ni,ni->n", found[:, :, 0], found[:, :, 1])).max() < 1e-6


@pytest.mark.parametrize("aspect", [1.0, 4.0, 16.0])
@pytest.mark.parametrize("way", [0.0, 0.5])
def test_four_squares_lie_across_the_narrow_side_of_footprints_and_64_in_them(aspect, way):
    """Footprints of three cells along either side, long along x, that go along y or nowhere."""
    dim = sheet(COARSE, DIM, half=0.3)
    dim.dxdu[:, 0], dim.dxdv[:, 1], dim.dxdt[:, 1] = aspect * COARSE, COARSE / aspect, way
    sides = split_light([sheet(FINE, 1.0, half=1.0), dim], 1.0, pixel(1e-4), ONE_THREAD).coarse
    (side,) = sides
    sides = np.array([3 * COARSE / aspect + way, 3 * COARSE * aspect])
    largest = min(sides.min() / 4, np.sqrt(sides.prod()) / 8)
    assert largest / 2 < side <= largest


def test_a_lattice_of_background_photons_stays_uniform():
    found = looked_up(light_of(sheet(FINE, 1.0), sheet(COARSE, DIM)), scattered(0.35))
    # Translates sum to one, whatever box they are averaged over, and so do bilinear weights.
    np.testing.assert_allclose(found, 1.0 + DIM, rtol=1e-5)


@pytest.mark.parametrize("way", [(0, 0, 0), (0.1, 0.06, 0)])
def test_background_errs_by_no_more_than_it_is_bright_and_keeps_its_flux(way):
    maps = [sheet(FINE, 1.0, dxdt=way), sheet(COARSE, DIM, dxdt=way)]
    points, area = grid((-0.8, -0.8), (0.8, 0.8), (160, 160))
    found = looked_up(light_of(*maps, moves=any(way)), points)
    everything = shaped(*maps, half_pixel=HALF_PIXEL, moves=any(way))
    plain = plain_gather(everything, queries(points), GatherForm(), ONE_THREAD).irradiance[:, 0]
    assert np.abs(found - plain).max() <= DIM
    assert np.abs(found - plain).max() > 0
    # Two points a fine cell either way see all of its light; coarse ones see what three squares and more to a cell do.
    np.testing.assert_allclose(found.sum() * area, sum(photons.flux[:, 0].sum() for photons in maps), rtol=1e-3)


def test_what_lies_off_the_raster_sees_background_too():
    """On planes that face a little elsewhere, which a mesh's neighbouring triangles do."""
    maps = [sheet(FINE, 1.0), sheet(COARSE, DIM)]
    points = scattered(0.3)
    tilted = looked_up(light_of(*maps), points, normals=(0.0, np.sin(0.1), np.cos(0.1)))
    np.testing.assert_allclose(tilted, 1.0 + DIM, rtol=1e-4)


def test_other_objects_see_none_of_it():
    found = looked_up(light_of(sheet(FINE, 1.0), sheet(COARSE, DIM)), scattered(0.3), receiver=1)
    assert not found.any()


def test_it_does_not_depend_on_who_looks_first():
    maps = [sheet(FINE, 1.0), sheet(COARSE, DIM)]
    points = scattered(0.6)
    whole = looked_up(light_of(*maps[1:], maps[0]), points)
    light = light_of(*maps[1:], maps[0])
    turned = np.concatenate([looked_up(light, part) for part in np.array_split(points[::-1], 7)])[::-1]
    fine = looked_up(FootprintLight([maps[0]], GatherForm(), 1.0, pixel(HALF_PIXEL), False, ONE_THREAD), points)
    # Corners are the same numbers; only the sums of the fine footprints begin anew with each batch.
    np.testing.assert_allclose(turned, whole, atol=1e-6 * fine.max())


def test_motion_and_number_count_what_is_in_the_background():
    way = (0.05, 0, 0)
    light = light_of(sheet(FINE, 1.0, dxdt=way), sheet(COARSE, DIM, dxdt=way), moves=True)
    found = light.irradiance(queries(scattered(0.3)), Lookup(with_motion=True))
    np.testing.assert_allclose(found.motion / found.weight[:, None], np.broadcast_to(way, (2000, 3)), atol=1e-5)
    everything = shaped(sheet(FINE, 1.0, dxdt=way), sheet(COARSE, DIM, dxdt=way), half_pixel=HALF_PIXEL, moves=True)
    assert found.photons.min() > 0 and everything.count == light.count
    np.testing.assert_allclose(found.weight, 3 * (1.0 + DIM), rtol=1e-3)
