"""Of a faint branch one sample of a pixel stands for others, and their light is all there."""

from __future__ import annotations

import numpy as np
import pytest

from tests.view.scenes import SHUTTER, WATER, floor, looking_down, quad, see
from tpdwarp.scene.description import SceneAtShutter
from usd_scenes.oracle.closed_forms import fresnel_reflectance

SIZE = 16
# Water reflects 2 % of light that falls straight, and four times that is less than a tenth.
REFLECTANCE = fresnel_reflectance(0.0, 1.0, 1.33)


def seen_over_water(samples: int, pixels: np.ndarray, rays: int = 1):
    """Paths through water to the floor, and by it to a roof above the camera, pass by pass."""
    meshes = floor(), quad("/water", (-1, -1), (1, 1), 0.5, WATER), quad("/roof", (-1, -1), (1, 1), 2.0, up=False)
    scene = SceneAtShutter(SHUTTER, meshes, (), looking_down(height=1.5))
    within = (np.arange(samples * rays)[:, None] + 0.5) / (samples * rays) * (1.0, 0.0) + (0.0, 0.5)
    films = (pixels[:, None] + within).reshape(-1, 2)
    return see(scene, SIZE, SIZE, films, samples=samples, rays=rays)


@pytest.mark.parametrize(("samples", "served"), [(1, 1), (2, 2), (3, 1), (4, 4), (6, 2), (8, 4)])
def test_one_sample_follows_for_as_many_as_keep_it_below_a_tenth_and_carries_their_light(samples, served):
    pixels = SIZE // 2 + np.stack(np.meshgrid(*2 * [np.arange(-2, 3)]), axis=-1).reshape(-1, 2)
    through, reflected = seen_over_water(samples, pixels)[:2]
    assert len(through.items) == samples * len(pixels)
    followers = np.bincount(reflected.items // samples, minlength=len(pixels))
    np.testing.assert_array_equal(followers, samples // served)
    if served > 1:
        assert set(reflected.items % served) == set(range(served))
    # A few degrees off the normal reflect as much to a part in a thousand.
    carried = reflected.weights.sum(axis=0) / through.weights.sum(axis=0)
    # Radiance in water is 1.33² times that above.
    np.testing.assert_allclose(carried, 1.33**2 * REFLECTANCE / (1 - REFLECTANCE), rtol=5e-3)


def test_many_rays_of_a_sample_follow_faint_branches_as_seldom_as_it_does():
    pixels = SIZE // 2 + np.stack(np.meshgrid(*2 * [np.arange(-2, 3)]), axis=-1).reshape(-1, 2)
    through, reflected = seen_over_water(4, pixels, rays=16)[:2]
    assert len(through.items) == 64 * len(pixels)
    np.testing.assert_array_equal(np.bincount(reflected.items // 64, minlength=len(pixels)), 1)
    carried = reflected.weights.sum(axis=0) / through.weights.sum(axis=0)
    np.testing.assert_allclose(carried, 1.33**2 * REFLECTANCE / (1 - REFLECTANCE), rtol=5e-3)


def test_those_that_follow_lie_in_different_parts_of_the_pixel():
    """Of 64 positions every sixteenth lies in one part of sixteen; of those that follow no two do."""
    pixels = SIZE // 2 + np.stack(np.meshgrid(*2 * [np.arange(-2, 3)]), axis=-1).reshape(-1, 2)
    reflected = seen_over_water(64, pixels)[1]
    served = 64 * len(pixels) // len(reflected.items)
    assert served == 4
    parts = (reflected.items % 16).reshape(len(pixels), 16)
    assert all(len(set(row)) == 16 for row in parts)
