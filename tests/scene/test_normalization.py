"""The scene brought to where float32 works, and back."""

from __future__ import annotations

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, box, floor, glass
from tests.photons.traced import EPS, lamp, scene_of, sun
from tpdwarp.errors import InputError
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
    # The box itself is known to the rounding of float64 at its distance.
    rounding = 4e-16 * (1 + offset / size) + 1e-12
    assert half_diagonal * norm.scale == pytest.approx(1, rel=rounding)
    assert norm.radius == pytest.approx(1, rel=rounding)


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


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_a_scene_in_other_units_is_the_same_scene_to_the_tracer(unit):
    points = np.random.default_rng(1).uniform(-3, 3, (100, 3))
    one, other = (Normalization.of(boxes((-3 * u, -3 * u, -3 * u), (3 * u, 3 * u, 3 * u))) for u in (1.0, unit))
    np.testing.assert_allclose(other.points(unit * points), one.points(points), atol=2 * EPS)


def test_the_centre_is_that_of_what_is_specular_where_anything_is():
    norm = Normalization.of(scene_of([floor(half=100.0), box("/box", (5, 0, 0), (6, 1, 9), glass())]))
    np.testing.assert_allclose(norm.origin, [5.5, 0.5, 4.5])
    np.testing.assert_allclose(norm.scale, 1 / np.linalg.norm([100, 100, 4.5]))
    np.testing.assert_allclose(norm.radius, np.linalg.norm([105.5, 100.5, 4.5]) * norm.scale)


def test_all_stills_count_and_those_without_meshes_do_not():
    first, last = (boxes((x, 0, 0), (x + 1, 1, 1)) for x in (0, 9))
    norm = Normalization.of(scene_of([]), first, last)
    np.testing.assert_allclose(norm.origin, [5, 0.5, 0.5])
    assert Normalization.of(scene_of([])) == Normalization((0.0, 0.0, 0.0), 1.0, 0.5)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("intensity", [1e-30, 0.3, 1e30])
def test_the_strongest_light_has_about_unit_power(intensity, unit):
    lights = (sun(irradiance=intensity), lamp((0, 0, 3), intensity=1e-3 * intensity * unit**2, path="/lamp"))
    norm = Normalization.of(scene_of([box("/box", (0, 0, 0), (unit, unit, unit), glass())], *lights))
    strongest, weaker = (norm.light_power(light).max() for light in lights)
    assert 1 <= strongest < 2 and weaker < strongest
    # Flux over area is irradiance again.
    assert strongest * norm.power * norm.scale**2 == pytest.approx(intensity)


def test_a_light_that_outshines_the_stills_beyond_all_measure_is_refused():
    norm = Normalization.of(scene_of([floor()], sun()))
    assert (norm.light_power(sun(irradiance=1e20)) > 1e20).all()
    with pytest.raises(InputError, match="/flash: outshines"):
        norm.light_power(sun(irradiance=1e30, path="/flash"))


def test_a_scene_of_no_size_is_left_as_it_is():
    flat = floor(0.0, 0.0)
    norm = Normalization.of(scene_of([flat]))
    assert norm.scale == 1 and norm.radius == 0.5


def test_everything_in_the_scene_counts():
    norm = Normalization.of(scene_of([floor(half=1.0), box("/box", (5, 0, 0), (6, 1, 9), DIFFUSE)]))
    np.testing.assert_allclose(norm.origin, [2.5, 0, 4.5])
