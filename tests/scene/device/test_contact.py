"""What touches is separated, by little and only there; what does not stays bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, MIRROR, box, floor, glass, quad
from tests.photons.traced import scene_of, sun
from tpdwarp.device import Launcher
from tpdwarp.scene.description import MeshAtShutter
from tpdwarp.scene.device.geometry import geometry_of
from tpdwarp.scene.normalization import Normalization

UNIT = Normalization((0.0, 0.0, 0.0), 1.0, 1.0)
LAUNCHER = Launcher("cpu", 2)


def moved(*meshes: MeshAtShutter) -> list[np.ndarray]:
    """How far the points of each mesh are moved, shape [p, 3] each."""
    points = geometry_of(scene_of(meshes, sun()), UNIT, LAUNCHER, with_motions=False).surfaces.points.numpy()
    parts = np.split(points, np.cumsum([len(mesh.points) for mesh in meshes])[:-1])
    return [part - mesh.points.astype(np.float32) for part, mesh in zip(parts, meshes, strict=True)]


def glass_box(low=(-0.3, -0.3, 0.5), high=(0.3, 0.3, 0.8)) -> MeshAtShutter:
    return box("/box", low, high, glass())


@pytest.mark.parametrize("gap", [-1e-7, 0.0, 1e-7, 1e-6])
def test_the_bottom_of_a_box_on_a_table_is_lifted_and_nothing_else(gap):
    body, table = moved(glass_box((-0.3, -0.3, 0.5 + gap)), floor(0.5, 1.0))
    bottom = glass_box().points[:, 2] < 0.6
    assert not table.any() and not body[~bottom].any() and not body[:, :2].any()
    assert np.all(body[bottom, 2] > 5e-6) and np.all(body[bottom, 2] < 4e-5)


@pytest.mark.parametrize(
    "other",
    [floor(0.4999, 1.0), floor(0.65, 1.0), quad("/wall", (0.301, 0, 0.5), (0, 1, 0), (0, 0, 1), DIFFUSE),
     floor(0.8, 1.0, glass())],
    ids=["below", "through the middle", "beside", "a sheet written over the top"],
)  # fmt: skip
def test_what_does_not_touch_stays_where_it_is(other):
    assert not any(way.any() for way in moved(glass_box(), other))


def test_a_corner_moves_off_all_that_it_touches_once_each():
    walls = [floor(0.5, 1.0), quad("/x", (0.3, 0, 0.5), (0, 1, 0), (0, 0, -1), DIFFUSE)]
    body, *_ = moved(glass_box(), *walls)
    edge = (glass_box().points[:, 0] > 0.2) & (glass_box().points[:, 2] < 0.6)
    alone = [moved(glass_box(), wall)[0][edge] for wall in walls]
    np.testing.assert_allclose(body[edge], alone[0] + alone[1], atol=1e-7)
    assert np.all(body[edge, 0] < 0) and np.all(body[edge, 2] > 0)


def test_two_boxes_of_glass_both_draw_back():
    low, high = moved(glass_box(), box("/high", (-0.2, -0.2, 0.8), (0.2, 0.2, 1.0), glass()))
    assert low[:, 2].min() < -5e-6 and high[:, 2].max() > 5e-6
    assert low[:, 2].max() == 0 == high[:, 2].min()


def test_a_mirror_comes_to_the_front_of_the_wall_it_lies_in():
    mirror = quad("/mirror", (0, 0, 0.5), (0.2, 0, 0), (0, 0.2, 0), MIRROR)
    way, wall = moved(mirror, floor(0.5, 1.0))
    assert np.all(way[:, 2] > 2e-6) and not wall.any()
