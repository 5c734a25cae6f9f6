"""Concave faces cover their own area and no more, whichever corner they begin with."""

import numpy as np
import pytest

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.concave_faces import concave_faces, ears
from tpdwarp.usd.read.topology import triangulate

L_SHAPE = np.array([(0, 0, 0), (1, 0, 0), (1, 0.4, 0), (0.4, 0.4, 0), (0.4, 1, 0), (0, 1, 0)])
DART = np.array([(0, 0, 0), (2, 0, 0), (0.5, 0.5, 0), (0, 2, 0)])


def areas(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def polygon_area(points):
    return 0.5 * np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)


@pytest.mark.parametrize("shape", [L_SHAPE, DART], ids=["L", "dart"])
@pytest.mark.parametrize("offset", [0.0, 1e4])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("flip", [False, True])
def test_a_concave_face_covers_its_own_area_and_no_more(shape, offset, turned, flip):
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    points = shape @ turn + offset
    points = points[::-1] if flip else points
    whole = polygon_area(points - points[0])
    for first in range(len(points)):
        around = np.roll(np.arange(len(points)), -first)
        topology = triangulate(np.array([len(points)]), around, np.zeros(0), False, points)
        parts = areas(points - points[0], topology.triangles)
        # Triangles that do not overlap add up in size as well as in direction.
        np.testing.assert_allclose(parts.sum(axis=0), whole, atol=1e-9)
        assert np.linalg.norm(parts, axis=1).sum() == pytest.approx(np.linalg.norm(whole), rel=1e-9)


def test_a_comb_is_cut_into_its_own_area():
    teeth = 200
    top = [(x, 1.0 if x % 2 else 0.25, 0.0) for x in range(2 * teeth, -1, -1)]
    points = np.array([(0.0, 0, 0), (2.0 * teeth, 0, 0), *top])
    cut = ears(points)
    assert len(cut) == len(points) - 2
    assert np.linalg.norm(areas(points, cut), axis=1).sum() == pytest.approx(np.linalg.norm(polygon_area(points)))


def test_convex_faces_stay_fans():
    circle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    points = np.stack([np.cos(circle), np.sin(circle), 0 * circle], axis=1)
    counts, indices = np.array([12, 3]), np.array([*range(12), 0, 1, 2])
    assert len(concave_faces(points, counts, indices)) == 0
    with_points, without = (triangulate(counts, indices, np.zeros(0), False, p) for p in (points, None))
    np.testing.assert_array_equal(with_points.triangles, without.triangles)


def test_only_the_concave_faces_are_cut_otherwise():
    points = np.concatenate([DART, DART + np.array([3, 0, 0])])
    points[6] = (4.5, 1.5, 0)
    topology = triangulate(np.array([4, 4]), np.arange(8), np.zeros(0), False, points)
    assert topology.faces.tolist() == [0, 0, 1, 1]
    assert topology.triangles[2:].tolist() == [[4, 5, 6], [4, 6, 7]]


def test_a_face_that_becomes_concave_keeps_its_triangles(tmp_path):
    small = SmallStage(tmp_path)
    bent = DART.copy()
    bent[2] = (2, 2, 0)
    small.moving("/Mesh", {1: DART, 5: bent}, counts=(4,), indices=(1, 2, 3, 0))
    scene = small.open()
    late, early = (scene.at(Shutter.still(time)).meshes[0] for time in (5, 1))
    np.testing.assert_array_equal(late.triangles, early.triangles)
    assert np.linalg.norm(areas(early.points, early.triangles), axis=1).sum() == pytest.approx(1.0)


def test_an_outline_so_fine_that_no_corner_turns_far_is_cut_into_ears():
    angle = np.linspace(0.0, 2.0 * np.pi, 6000, endpoint=False)
    radius = 1.0 + 0.3 * np.sin(20.0 * angle)
    star = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle]).astype(np.float32)
    counts, indices = np.array([len(star)]), np.arange(len(star))
    assert concave_faces(star, counts, indices).tolist() == [0]
    parts = areas(star.astype(float), triangulate(counts, indices, np.zeros(0), False, star).triangles)
    whole = np.linalg.norm(polygon_area(star.astype(float)))
    assert np.linalg.norm(parts, axis=1).sum() == pytest.approx(whole, rel=1e-6)
    # A circle as fine, whose corners turn inwards by rounding, stays a fan.
    disc = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]).astype(np.float32)
    assert len(concave_faces(disc, counts, indices)) == 0
