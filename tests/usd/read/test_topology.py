"""Triangulation: whole polygons, in order, facing the way they were authored to face."""

import numpy as np
import pytest

from tpdwarp.usd.read.topology import triangulate


def fan(counts, indices, holes=(), left_handed=False):
    return triangulate(np.array(counts), np.array(indices), np.array(holes, dtype=int), left_handed)


def test_polygons_become_fans_in_face_order():
    topology = fan([3, 5], [0, 1, 2, 4, 5, 6, 7, 8])
    assert topology.triangles.tolist() == [[0, 1, 2], [4, 5, 6], [4, 6, 7], [4, 7, 8]]
    assert topology.faces.tolist() == [0, 1, 1, 1]
    assert topology.corners.tolist() == [[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 7]]
    assert topology.triangles.dtype == np.int32


def test_left_handed_faces_are_turned_round():
    assert fan([4], [0, 1, 2, 3], left_handed=True).triangles.tolist() == [[0, 2, 1], [0, 3, 2]]


def test_mirroring_twice_restores_the_winding():
    topology = fan([4], [3, 1, 2, 0])
    assert topology.mirrored.triangles.tolist() == [[3, 2, 1], [3, 0, 2]]
    np.testing.assert_array_equal(topology.mirrored.mirrored.corners, topology.corners)


def test_holes_and_faces_without_area_are_left_out():
    topology = fan([3, 2, 3, 3], [0, 1, 2, 0, 1, 3, 4, 5, 6, 7, 8], holes=[2])
    assert topology.faces.tolist() == [0, 3]
    assert topology.face_count == 4 and topology.corner_count == 11


def test_triangles_that_repeat_a_point_are_dropped():
    assert fan([4], [0, 1, 1, 2]).triangles.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("interpolation", "size", "elements"),
    [
        ("constant", 1, [[0, 0, 0], [0, 0, 0], [0, 0, 0]]),
        ("uniform", 2, [[0, 0, 0], [1, 1, 1], [1, 1, 1]]),
        ("vertex", 6, [[5, 4, 3], [0, 1, 2], [0, 2, 3]]),
        ("varying", 6, [[5, 4, 3], [0, 1, 2], [0, 2, 3]]),
        ("faceVarying", 7, [[0, 1, 2], [3, 4, 5], [3, 5, 6]]),
    ],
)
def test_elements_follow_the_interpolation(interpolation, size, elements):
    topology = fan([3, 4], [5, 4, 3, 0, 1, 2, 3])
    assert topology.elements(interpolation, size, 6).tolist() == elements
    assert topology.elements(interpolation, size + 1, 6) is None
