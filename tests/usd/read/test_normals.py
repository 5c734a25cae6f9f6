"""Normals: independent of how polygons are cut, and perpendicular after any transform."""

import numpy as np
import pytest

from tpdwarp.usd.read.normals import area_vectors, smooth_normals, transform_normals, unit
from tpdwarp.usd.read.topology import triangulate

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
CUBE_FACES = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]


def test_smooth_normals_of_a_cube_are_its_diagonals_however_its_faces_are_cut():
    topology = triangulate(np.full(6, 4), np.array(CUBE_FACES), np.zeros(0), False)
    np.testing.assert_allclose(smooth_normals(CUBE, topology), CUBE / np.sqrt(3), atol=1e-15)


def test_smooth_normals_turn_with_the_winding():
    topology = triangulate(np.full(6, 4), np.array(CUBE_FACES), np.zeros(0), True)
    np.testing.assert_allclose(smooth_normals(CUBE, topology), -CUBE / np.sqrt(3), atol=1e-15)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_transformed_normals_stay_perpendicular_and_in_front(mirror):
    rng = np.random.default_rng(4)
    points, triangles = rng.normal(size=(3, 3)), np.array([[0, 1, 2]])
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))
    matrix[0, :3] *= mirror * np.sign(np.linalg.det(matrix[:3, :3]))
    normal = transform_normals(unit(area_vectors(points, triangles)), matrix[None])
    moved = area_vectors(points @ matrix[:3, :3], triangles)
    np.testing.assert_allclose(normal, mirror * unit(moved), atol=1e-12)


def test_a_transform_that_flattens_still_has_normals_across_the_plane():
    flat = np.diag([1.0, 1.0, 0.0, 1.0])[None]
    np.testing.assert_allclose(transform_normals(np.array([[0.6, 0.0, 0.8]]), flat), [[0, 0, 1]])


def test_unit_of_nothing_is_still_a_unit_vector():
    np.testing.assert_array_equal(unit(np.zeros((1, 3))), [[0, 0, 1]])
