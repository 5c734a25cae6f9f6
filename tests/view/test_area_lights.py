"""Direct light from lights with extent: closed forms against quadrature, and penumbras."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.lit_by_surfaces import LIGHTS, expected, lamp, sun
from tests.view.scenes import SHUTTER, WATER, floor, looking_down, quad, see
from tpdwarp.scene.description import (
    PROFILE_COUNT,
    ExtentShape,
    LightAtShutter,
    LightKind,
    SceneAtShutter,
    Shaping,
)

SIZE = 16
FILMS = np.random.default_rng(5).uniform(0, SIZE, (200, 2))
# Of the camera, below whatever stands between the lights and the floor.
BELOW = 0.4
# What tests ask of closed forms in single precision, and of the polygon that stands for a disk which is cut.
WITHIN = 5e-3


def irradiance(meshes, light: LightAtShutter, films=FILMS, size: int = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Direct irradiance of a white floor in the first channel, and where, from the middle pass of the camera."""
    camera = looking_down(height=BELOW)
    (seen,) = see(SceneAtShutter(SHUTTER, tuple(meshes), (light,), camera), size, size, films)
    found = seen.direct * math.pi
    np.testing.assert_allclose(found[:, 1:], found[:, :1] * [2, 4], rtol=1e-5)
    return found[:, 0], seen.positions


@pytest.mark.parametrize("name", LIGHTS)
def test_unshadowed_irradiance_is_that_of_the_whole_surface(name):
    light = LIGHTS[name]
    found, points = irradiance([floor()], light, FILMS[:40])
    truth = expected(light, points)
    assert truth.max() > 0
    # A line stands for a cylinder, which errs by the square of its radius over the distance, 3e-3.
    np.testing.assert_allclose(found, truth, rtol=WITHIN, atol=WITHIN * 0.1 * truth.max())


TUBES = {
    "its axis lies in the floor": lamp(ExtentShape.CYLINDER, (-1.6, 0.1, 0.0), sizes=(0.4, 0.0), radius=0.2),
    "a quarter below the horizon": lamp(ExtentShape.CYLINDER, (0.2, 1.7, 0.1), (0.0, 0.0, 0.2), (0.5, 0.0), 0.2),
    "upright, half below it": lamp(ExtentShape.CYLINDER, (-1.7, 0.1, 0.0), (0.0, math.pi / 2, 0.0), (0.4, 0.0), 0.2),
    "wide and near": lamp(ExtentShape.CYLINDER, (0.2, 0.1, 1.1), (0.0, 0.2, 0.4), (0.9, 0.0), 0.3),
    "far off": lamp(ExtentShape.CYLINDER, (0.2, 0.1, 30.0), (0.1, 0.3, 0.4), (0.6, 0.0), 0.2),
}


@pytest.mark.parametrize("name", TUBES)
def test_tubes_light_what_their_side_that_is_above_the_horizon_does(name):
    light = TUBES[name]
    found, points = irradiance([floor()], light, FILMS[:40])
    truth = expected(light, points)
    # Ends are those of what is seen on average: tubes as thick and near as this err by a percent, upright ones by two.
    np.testing.assert_allclose(found, truth, rtol=0.02, atol=0.04 * truth.max())
    assert found.mean() == pytest.approx(truth.mean(), rel=0.025)


def test_flat_lights_shine_to_one_side():
    for shape in (ExtentShape.RECT, ExtentShape.DISK):
        assert irradiance([floor()], lamp(shape, (0, 0, 1), (math.pi, 0, 0)))[0].max() == 0


@pytest.mark.parametrize("light", [sun(5.0, 0.0), lamp(ExtentShape.ROUND, (0, 0, 4.0), radius=0.4)])
def test_a_light_that_something_hides_in_part_is_seen_for_the_part_of_its_disc_that_is_left(light):
    """The edge of a board at height h hides what lies beyond a chord of the disc."""
    height, count, pixels = 0.5, 4000, 1 << 15
    random = np.random.default_rng(1)
    # Lines along the edge, each as many times as it takes to see what its mean is.
    lines = np.linspace(-0.9, 0.9, 7)
    rest = []
    board = quad("/board", (0, -3), (3, 3), height)
    for line in lines:
        distance = light.position[2] if light.kind == LightKind.POINT else None
        sine = math.sin(light.extent.radius) if distance is None else light.extent.radius / distance
        # At x on the floor the edge is seen x/h off the vertical, and the middle of a lamp x/distance.
        x = -line * height * sine / math.sqrt(1 - sine**2) / (1 - height / (distance or math.inf))
        # In pixels of their own, which look at places of their own.
        films = np.stack([np.full(count, (x + 1) / 2), random.uniform(0.4, 0.6, count)], axis=1) * pixels
        found, _ = irradiance([floor(), board], light, films, pixels)
        free, _ = irradiance([floor()], light, films, pixels)
        rest.append(np.mean(found / free))
    share = 0.5 + (np.arcsin(lines) + lines * np.sqrt(1 - lines**2)) / math.pi
    # Four strata: a stratum is hidden or not with a deviation of at most 1/2, of 4 · 4000 of them. A lamp's chord lies
    # a little aside where the camera looks along the edge: 0.2² of half of it.
    np.testing.assert_allclose(rest, share, atol=4 * 0.5 / math.sqrt(4 * count) + 5e-3)


def test_there_is_no_noise_but_in_penumbras():
    light = sun(5.0, 0.0)
    found, points = irradiance([floor(), quad("/board", (0, -3), (3, 3), 0.5)], light)
    penumbra = 0.5 * math.tan(light.extent.radius)
    np.testing.assert_allclose(found[points[:, 0] < -penumbra], 1.0, rtol=1e-5)
    assert np.all(found[points[:, 0] > penumbra] == 0)


def test_the_same_pixel_looks_at_the_same_places_in_every_frame():
    board = quad("/board", (0, -3), (3, 3), 0.5)
    one, other = (irradiance([floor(), board], sun(20.0, 0.0))[0] for _ in range(2))
    np.testing.assert_array_equal(one, other)
    assert np.std(one[(one > 0) & (one < 1)]) > 0


def test_a_cone_narrows_a_light_with_extent():
    wide = lamp(ExtentShape.ROUND, (0, 0, 2.0), radius=0.05)
    narrow = replace(wide, shaping=Shaping(math.radians(15)))
    found, points = irradiance([floor()], narrow)
    free, _ = irradiance([floor()], wide)
    angle = np.degrees(np.arctan2(np.hypot(points[:, 0], points[:, 1]), 2.0))
    # The lamp is seen 1.4° wide to either side.
    np.testing.assert_allclose(found[angle < 13], free[angle < 13], rtol=1e-5)
    assert np.all(found[angle > 17] == 0)


def test_a_profile_dims_a_light_with_extent():
    wide = lamp(ExtentShape.ROUND, (0, 0, 2.0), radius=0.05)
    half = replace(wide, shaping=Shaping(2 * math.pi, profile=(0.5,) * PROFILE_COUNT))
    np.testing.assert_allclose(irradiance([floor()], half)[0], 0.5 * irradiance([floor()], wide)[0], rtol=1e-5)


def test_what_is_specular_hides_light_with_extent_as_it_hides_points():
    found, _ = irradiance([floor(), quad("/water", (-3, -3), (3, 3), 0.5, WATER)], sun(5.0, 0.0))
    assert found.max() == 0
