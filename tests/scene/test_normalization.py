"""The scene brought to where float32 works, and back."""

from __future__ import annotations

import numpy as np
import pytest
from photons.shapes import box, floor, glass
from photons.traced import EPS, scene_of

from tpdwarp.scene.normalization import Normalization


def boxes(low, high):
    return scene_of([box("/box", low, high, glass())])


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("size", [1e-3, 1.0, 3.7, 1e5])
def test_the_scene_comes_to_unit_size_about_its_centre(size, offset):
    low = np.array([offset, -offset, 0.5 * offset])
    norm = Normalization.of(boxes(low, low + size * np.array([1, 0.5, 0.2])))
    np.testing.assert_allclose(norm.origin, low + 0.5 * size * np.array([1, 0.5, 0.2]), rtol=1e-15)
    half_diagonal = 0.5 * size * np.sqrt(1 + 0.25 + 0.04)
    assert 0.5 < half_diagonal * norm.scale <= 1
    # The box itself is known to the rounding of float64 at its distance.
    assert norm.radius == pytest.approx(max(0.5, half_diagonal * norm.scale), rel=4e-16 * (1 + offset / size) + 1e-12)
    assert np.log2(norm.scale) == np.round(np.log2(norm.scale))


def test_positions_far_from_the_origin_keep_their_digits():
    low = np.array([1e6, -3e6, 2e6])
    norm = Normalization.of(boxes(low, low + 2.0))
    points = low + np.random.default_rng(1).uniform(0, 2, (100, 3))
    back = norm.world_points(norm.points(points))
    # Half a unit in the last place at the size of the scene, not at its distance (where it would be 0.1).
    np.testing.assert_allclose(back, points, atol=2 * EPS / norm.scale)


def test_vectors_scale_and_do_not_shift():
    norm = Normalization.of(boxes((10, 10, 10), (14, 13, 12)))
    vectors = np.random.default_rng(1).normal(size=(10, 3))
    np.testing.assert_array_equal(norm.vectors(vectors), (vectors * norm.scale).astype(np.float32))
    np.testing.assert_allclose(norm.world_vectors(norm.vectors(vectors)), vectors, rtol=2 * EPS)


def test_scaling_by_a_power_of_two_rounds_nothing():
    norm = Normalization.of(boxes((-3, -3, -3), (3, 3, 3)))
    points = np.random.default_rng(1).uniform(-3, 3, (100, 3)).astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(norm.world_points(norm.points(points)), points)


def test_a_scene_of_no_size_is_left_as_it_is():
    flat = floor(0.0, 0.0)
    norm = Normalization.of(scene_of([flat]))
    assert norm.scale == 1 and norm.radius == 0.5


def test_everything_in_the_scene_counts():
    norm = Normalization.of(scene_of([floor(half=1.0), box("/box", (5, 0, 0), (6, 1, 9), glass())]))
    np.testing.assert_allclose(norm.origin, [2.5, 0, 4.5])
