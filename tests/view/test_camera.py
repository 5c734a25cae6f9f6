"""Camera rays and their time column against float64 formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.view.scenes import turned, view_rays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.beam import Beam
from tpdwarp.scene.description import CameraAtShutter
from tpdwarp.scene.normalization import Normalization
from tpdwarp.view.camera import Camera, camera_of, camera_ray, in_sides, pixel_size

WIDTH, HEIGHT = 40, 20
NORMALIZATION = Normalization((1.0, -2.0, 0.5), 0.25, 0.8)
# Positions of order one in the tracer's units, made of a handful of float32 operations.
ROUNDING = 16 * 2.0**-24
FILMS = np.random.default_rng(6).uniform(0, (WIDTH, HEIGHT), (200, 2)).astype(np.float32).astype(float)


def camera(orthographic: bool, moving: bool = True) -> CameraAtShutter:
    axes = turned((0.3, -0.5, 0.2))
    spin = np.cross((0.1, -0.2, 0.3), axes) if moving else np.zeros((3, 3))
    travel = np.array([0.3, 0.1, -0.4]) if moving else np.zeros(3)
    window = (-0.7, 1.1, -0.3, 0.6)
    return CameraAtShutter(
        "/cam", orthographic, np.array([2.0, 1.0, 3.0]), axes, window, position_motion=travel, axes_motion=spin
    )


@wp.kernel(module="unique", enable_backward=False)
def measure_sides(
    size: PixelSize, x: wp.array(dtype=wp.vec3), displacement: wp.array(dtype=wp.vec3), out: wp.array(dtype=wp.vec2)
):
    i = wp.tid()
    out[i] = in_sides(size, x[i], displacement[i])


def sides_of(size: PixelSize, x: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    given = [wp.array(values[None].astype(np.float32), dtype=wp.vec3, device="cpu") for values in (x, displacement)]
    out = wp.zeros(1, dtype=wp.vec2, device="cpu")
    wp.launch(measure_sides, 1, inputs=[size, *given, out], device="cpu")
    return out.numpy()[0]


@wp.kernel(module="unique", enable_backward=False)
def shoot(camera: Camera, films: wp.array(dtype=wp.vec2), time: float, out: wp.array(dtype=Beam)):
    i = wp.tid()
    out[i] = camera_ray(camera, films[i], time)


def beams(description: CameraAtShutter, time: float) -> dict[str, np.ndarray]:
    """Rays in the tracer's units."""
    out = wp.zeros(len(FILMS), dtype=Beam, device="cpu")
    films = wp.array(FILMS, dtype=wp.vec2, device="cpu")
    rays = camera_of(description, WIDTH, HEIGHT, NORMALIZATION)
    wp.launch(shoot, len(FILMS), inputs=[rays, films, time, out], device="cpu")
    found = out.numpy()
    return {name: found[name].astype(float) for name in ("x", "w", "dxdt", "dwdt")}


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("time", [-0.5, 0.0, 0.3])
def test_rays_leave_the_eye_through_their_place_on_the_film(orthographic, time):
    description = camera(orthographic)
    found = beams(description, time)
    origins, directions = view_rays(description, WIDTH, HEIGHT, FILMS, time)
    origins = (origins - np.array(NORMALIZATION.origin)) * NORMALIZATION.scale
    np.testing.assert_allclose(found["x"], origins, atol=ROUNDING)
    np.testing.assert_allclose(found["w"], directions, atol=ROUNDING)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("time", [-0.5, 0.0, 0.3])
def test_the_time_column_is_the_derivative_of_the_ray(orthographic, time):
    description, h = camera(orthographic), 1e-4
    found = beams(description, time)
    early, late = (view_rays(description, WIDTH, HEIGHT, FILMS, time + s * h) for s in (-1, 1))
    rates = [(b - a) / (2 * h) for a, b in zip(early, late, strict=True)]
    # The central difference is off by h² times a third derivative of order one.
    np.testing.assert_allclose(found["dxdt"], rates[0] * NORMALIZATION.scale, atol=ROUNDING + h**2)
    np.testing.assert_allclose(found["dwdt"], rates[1], atol=ROUNDING + h**2)


def test_a_camera_at_rest_has_no_time_column():
    for orthographic in (False, True):
        found = beams(camera(orthographic, moving=False), 0.5)
        assert not found["dxdt"].any() and not found["dwdt"].any()


def test_the_first_pixel_is_the_upper_left_one():
    upright = CameraAtShutter("/cam", True, np.zeros(3), np.eye(3), (-1, 1, -0.5, 0.5))
    origins, _ = view_rays(upright, WIDTH, HEIGHT, np.array([[0.0, 0.0], [WIDTH, HEIGHT]]), 0.0)
    np.testing.assert_allclose(origins[:, :2], [[-1, 0.5], [1, -0.5]])


@pytest.mark.parametrize(("samples", "part"), [(1, 1), (4, 1), (15, 1), (16, 1 / 2), (36, 1 / 3)])
@pytest.mark.parametrize("distance", [1.0, 3.0])
def test_queries_stand_for_a_pixel_or_with_many_samples_for_a_part_of_it(distance, samples, part):
    scale = NORMALIZATION.scale
    for orthographic in (False, True):
        description = replace(camera(orthographic, moving=False), window=(-1, 1, -0.5, 0.5))
        size = pixel_size(camera_of(description, WIDTH, HEIGHT, NORMALIZATION), samples)
        middle = np.array([[WIDTH / 2, HEIGHT / 2], [WIDTH / 2 + 1, HEIGHT / 2]])
        origins, directions = view_rays(description, WIDTH, HEIGHT, middle, 0.0)
        along = distance / (directions @ -description.axes[2])
        seen = origins + along[:, None] * directions
        # The way between the middles of pixels side by side, on a plane that faces the camera and on an oblique one.
        step = part * (seen[1] - seen[0]) * scale
        tilted = description.axes[2] + 0.7 * description.axes[0]
        at = NORMALIZATION.points(seen).astype(float)
        np.testing.assert_allclose(sides_of(size, at[0], step), [1, 0], atol=1e-4)
        hits = origins + ((seen[0] - origins) @ tilted / (directions @ tilted))[:, None] * directions
        slid = part * (hits[1] - hits[0]) * scale
        found = sides_of(size, at[0], slid)
        # Pixels farther off are larger, by their distance to first order.
        np.testing.assert_allclose(found, [1, 0], atol=2.0 / WIDTH)


def test_pixels_that_are_not_square_have_both_of_their_sides():
    tall = replace(camera(True, moving=False), window=(-1, 1, -1, 1))
    size = pixel_size(camera_of(tall, 200, 20, NORMALIZATION), 4)
    assert np.linalg.norm(size.right) == pytest.approx(2 / 200 * NORMALIZATION.scale, rel=1e-5)
    assert np.linalg.norm(size.up) == pytest.approx(2 / 20 * NORMALIZATION.scale, rel=1e-5)


def test_without_a_camera_footprints_are_not_widened():
    size = pixel_size(None, 1)
    assert size.base == 0 and size.slope == 0 and not any(size.right)


def test_clipping_distances_are_scaled_and_stay_finite():
    rays = camera_of(replace(camera(False), near=0.2, far=1e30), WIDTH, HEIGHT, NORMALIZATION)
    assert rays.near == pytest.approx(0.05) and 1e3 < rays.far < 1e30
