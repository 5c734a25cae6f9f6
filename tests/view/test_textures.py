"""Textures on what the camera sees: looked up where they lie, averaged over what each sample stands for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, looking_down, quad, steady
from tpdwarp.io.resampling import area_averaged, part_reaching, pyramid
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Material, Shutter, Texture, Wrap
from tpdwarp.scene.requirements import requirements_of
from tpdwarp.settings import Settings

# Texels are kept in half precision: eleven bits, of colours up to one.
HALF = 2.0**-11
# Positions and texture coordinates in single precision, times the steepest slope below: 64 texels a unit.
POSITION = 1e-5 * 64
RANDOM = np.random.default_rng(5)


def card(texture: Texture, st=((0, 0), (1, 0), (1, 1), (0, 1))):
    """The square (−1, −1) … (1, 1) with texture coordinates at its corners."""
    mesh = quad("/card", (-1, -1), (1, 1), 0.0, Material(color=(0.5, 0.5, 0.5), texture=texture))
    corners = np.round((mesh.points[:, :2] + 1) / 2).astype(int)
    order = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}
    coordinates = np.array([st[order[tuple(corner)]] for corner in corners.tolist()], float)
    return replace(mesh, coordinates=coordinates, coordinate_indices=mesh.triangles)


def albedo(mesh, size=16, samples=1, camera=None):
    """Albedo as the camera sees it, shape [size, size, 3]."""
    source = steady([mesh], (SUN,), camera or looking_down())
    frame = render_frame(RenderContext(source, Settings(samples=samples, threads=1)), Shutter(0, 0, 0), size, size)
    white = steady([replace(mesh, materials=(Material(color=(1.0, 1.0, 1.0)),))], (SUN,), camera or looking_down())
    reference = render_frame(RenderContext(white, Settings(samples=1, threads=1)), Shutter(0, 0, 0), size, size)
    return np.stack([frame.channels[c] / np.maximum(reference.channels["R"], 1e-30) for c in "RGB"], axis=-1)


def pixels_of(height: int, width: int) -> np.ndarray:
    return RANDOM.uniform(0.05, 0.95, (height, width, 3)).astype(np.float16)


def test_a_pixel_on_each_texel_shows_its_colour():
    pixels = pixels_of(16, 16)
    np.testing.assert_allclose(albedo(card(Texture({(0, 0): pixels}))), pixels, atol=POSITION)


def test_between_texels_colours_are_linear():
    ramp = np.repeat(np.linspace(0, 1, 5)[None, :, None], 3, axis=2).repeat(5, axis=0).astype(np.float16)
    found = albedo(card(Texture({(0, 0): ramp}, (Wrap.CLAMP, Wrap.CLAMP))), size=64)
    expected = np.clip(((np.arange(64) + 0.5) / 64 * 5 - 0.5) / 4, 0, 1)
    np.testing.assert_allclose(found, np.broadcast_to(expected[None, :, None], found.shape), atol=HALF + POSITION)


def test_a_pixel_over_many_texels_shows_their_mean():
    pixels = pixels_of(64, 64)
    means = pixels.astype(float).reshape(8, 8, 8, 8, 3).mean(axis=(1, 3))
    # Aligned with the pixel, a square of texels is a texel of a coarser picture.
    found = albedo(card(Texture({(0, 0): pixels})), size=8)
    np.testing.assert_allclose(found, means, atol=4 * HALF + POSITION)


def test_samples_stand_for_parts_of_their_pixel():
    pixels = pixels_of(64, 64)
    blurred, sharp = (albedo(card(Texture({(0, 0): pixels})), size=8, samples=n) for n in (1, 64))
    means = pixels.astype(float).reshape(8, 8, 8, 8, 3).mean(axis=(1, 3))
    # 64 samples a pixel of 64 texels: their mean is the pixel's, but for what lies outside their own squares.
    assert np.sqrt(np.mean((sharp - means) ** 2)) < 0.26 / 8
    np.testing.assert_allclose(blurred.mean(), sharp.mean(), atol=0.01)


def test_a_fine_pattern_seen_at_a_slant_is_grey_and_not_aliased():
    checker = ((np.arange(256)[:, None] + np.arange(256)) % 2).astype(np.float16)[..., None].repeat(3, axis=2)
    camera = looking_down((-1, 1, -0.05, 0.05))
    tilt = math.radians(87)
    axes = np.array([[1, 0, 0], [0, math.cos(tilt), math.sin(tilt)], [0, -math.sin(tilt), math.cos(tilt)]])
    camera = replace(camera, axes=axes, position=3 * axes[2])
    found = albedo(card(Texture({(0, 0): checker})), size=16, camera=camera)
    inner = found[4:12, 2:14]
    # Within a texel of level 4, 16 texels wide, there are as many black ones as white.
    np.testing.assert_allclose(inner, 0.5, atol=0.02)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [
        (Wrap.REPEAT, lambda i, n: i % n),
        (Wrap.CLAMP, lambda i, n: np.clip(i, 0, n - 1)),
        (Wrap.MIRROR, lambda i, n: np.minimum(i % (2 * n), 2 * n - 1 - i % (2 * n))),
        (Wrap.BORDER, lambda i, n: np.where((i >= 0) & (i < n), i, -1)),
    ],
)
def test_beyond_its_edges_a_texture_goes_on_as_it_says(wrap, expected):
    pixels = pixels_of(4, 4)
    border = (0.1, 0.2, 0.3)
    mesh = card(Texture({(0, 0): pixels}, (wrap, wrap), border), ((-2, -2), (2, -2), (2, 2), (-2, 2)))
    place = expected(np.arange(-8, 8), 4)
    padded = np.full((5, 5, 3), border)
    padded[:4, :4] = pixels
    # Rows go from t = 1 down.
    rows = np.where(place < 0, 4, 3 - place)[::-1]
    np.testing.assert_allclose(albedo(mesh), padded[rows][:, place], atol=POSITION)


def test_tiles_lie_side_by_side_and_missing_ones_show_the_border():
    left, above = pixels_of(8, 8), pixels_of(8, 8)
    texture = Texture({(0, 0): left, (1, 1): above}, border=(0.25, 0.5, 0.75))
    found = albedo(card(texture, ((0, 0), (2, 0), (2, 2), (0, 2))))
    whole = np.full((16, 16, 3), (0.25, 0.5, 0.75))
    whole[8:, :8], whole[:8, 8:] = left, above
    np.testing.assert_allclose(found, whole, atol=POSITION)


def test_a_mesh_without_coordinates_has_the_materials_colour_and_needs_no_textures():
    material = Material(color=(0.5, 0.4, 0.3), texture=Texture({(0, 0): pixels_of(2, 2)}))
    mesh = quad("/card", (-1, -1), (1, 1), 0.0, material)
    np.testing.assert_allclose(albedo(mesh), np.broadcast_to((0.5, 0.4, 0.3), (16, 16, 3)), rtol=1e-5)
    assert not requirements_of(steady([mesh]).at(Shutter.still(0))).textures


@pytest.mark.parametrize(("height", "width"), [(8, 8), (7, 5), (1, 9), (640, 3)])
def test_every_level_has_the_mean_of_the_picture(height, width):
    pixels = RANDOM.uniform(size=(height, width, 2)).astype(np.float32)
    levels = pyramid(pixels)
    assert levels[-1].shape == (1, 1, 2)
    for level in levels:
        np.testing.assert_allclose(level.mean(axis=(0, 1)), pixels.mean(axis=(0, 1)), rtol=1e-5)


@pytest.mark.parametrize("steps", [(0.0, 0.1), (0.2, 0.0), (0.0, -0.3), (0.0, 0.0)])
def test_the_part_that_reaches_a_threshold_is_an_area(steps):
    # Upright and level ramps that cross .35 between texels; beside the ends, each texel goes on half a step either way.
    rows, columns = np.mgrid[:4, :6]
    ramp = (0.35 + steps[0] * (rows - 1.3) + steps[1] * (columns - 2.4))[..., None]
    finer = (np.arange(1000) + 0.5) / 1000 - 0.5
    expected = (ramp + finer * sum(steps) >= 0.35).mean(axis=-1, keepdims=True)
    np.testing.assert_allclose(part_reaching(ramp, 0.35), expected, atol=1 / 1000)


def test_averages_are_over_areas():
    np.testing.assert_allclose(area_averaged(np.array([[[3.0], [6.0], [9.0]]]), 1, 2)[0, :, 0], (4.0, 8.0))
