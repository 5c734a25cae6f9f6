"""Pictures of domes in every layout: what lies in a direction is found in that direction."""

import numpy as np
import pytest

from tpdwarp.usd.read.dome_layouts import as_latlong, layout_of

SIDE = 96


def seen(directions):
    """A smooth world: another colour in every direction."""
    return 1.0 + 0.5 * np.asarray(directions) + 0.25 * np.roll(directions, 1, axis=-1) * directions


def pixels(height, width):
    """Places −1 … 1 to the right and up of the middles of pixels."""
    x, y = (np.arange(width) + 0.5) / width * 2 - 1, 1 - (np.arange(height) + 0.5) / height * 2
    return np.meshgrid(x, y)


def ball():
    x, y = pixels(SIDE, SIDE)
    inside = np.hypot(x, y) < 1
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    view = np.array([0.0, 0.0, -1.0])
    reflected = view - 2 * (normal @ view)[..., None] * normal
    return np.where(inside[..., None], seen(reflected), 0.0)


def angular_map():
    x, y = pixels(SIDE, SIDE)
    angle, about = np.pi * np.hypot(x, y), np.arctan2(y, x)
    directions = np.stack([np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about), np.cos(angle)], axis=-1)
    return np.where((angle < np.pi)[..., None], seen(directions), 0.0)


def cross():
    """Folded by hand: from the front, whose right is −x as seen from inside, sideways, up, down, and down again."""
    x, y = pixels(SIDE, SIDE)
    one = np.ones_like(x)
    picture = np.zeros((4 * SIDE, 3 * SIDE, 3))
    folded = {
        (1, 1): (-x, y, one), (1, 0): (one, y, x), (1, 2): (-one, y, -x),
        (0, 1): (-x, one, -y), (2, 1): (-x, -one, y), (3, 1): (-x, -y, -one),
    }  # fmt: skip
    for (row, column), parts in folded.items():
        directions = np.stack(parts, axis=-1)
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        picture[row * SIDE : (row + 1) * SIDE, column * SIDE : (column + 1) * SIDE] = seen(directions)
    return picture


def expected(rows):
    latitude = np.pi * (0.5 - (np.arange(rows)[:, None] + 0.5) / rows)
    longitude = np.pi * (1 - (np.arange(2 * rows)[None] + 0.5) / rows)
    parts = np.cos(latitude) * np.sin(longitude), np.sin(latitude) + 0 * longitude, np.cos(latitude) * np.cos(longitude)
    return seen(np.stack(parts, axis=-1))


@pytest.mark.parametrize(
    ("layout", "picture", "least"),
    [("mirroredBall", ball(), -0.9), ("angular", angular_map(), -0.98), ("cubeMapVerticalCross", cross(), -2.0)],
)
def test_each_direction_has_the_colour_that_its_layout_shows_there(layout, picture, least):
    found = as_latlong(picture, layout)
    rows = len(picture) // 2
    assert found.shape == (rows, 2 * rows, 3)
    longitude = np.pi * (1 - (np.arange(2 * rows) + 0.5) / rows)
    latitude = np.pi * (0.5 - (np.arange(rows)[:, None] + 0.5) / rows)
    # Near −z a ball has no pixels to speak of: there it is near what its rim shows.
    ahead = np.cos(latitude) * np.cos(longitude) > least
    error = np.abs(found - expected(rows))
    assert error[ahead].max() < 0.02, error[ahead].max()
    assert error.max() < 0.35


def test_faces_do_not_take_the_light_of_what_lies_beside_them_in_the_picture():
    found = as_latlong(np.where(cross() > 0, 1.0, 0.0), "cubeMapVerticalCross")
    np.testing.assert_allclose(found, 1.0, atol=1e-12)


def test_what_is_automatic_is_a_cross_where_it_has_the_sides_of_one():
    assert layout_of("automatic", np.zeros((4, 3, 3))) == "cubeMapVerticalCross"
    assert layout_of("", np.zeros((4, 8, 3))) == layout_of("automatic", np.zeros((4, 4, 3))) == "latlong"
    assert layout_of("angular", np.zeros((4, 3, 3))) == "angular"
    picture = np.ones((4, 8, 3))
    assert as_latlong(picture, "latlong") is picture and as_latlong(picture, "folded") is None
