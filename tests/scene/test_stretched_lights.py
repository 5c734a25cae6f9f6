"""Ellipsoids, and oval tubes as flat lights, against quadrature over their surfaces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import looking_down
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    LightAtShutter,
    LightKind,
    SceneAtShutter,
    Shaping,
    Shutter,
)
from tpdwarp.scene.light_places import parts_of, place_lights
from tpdwarp.scene.stretched_lights import UNEVEN_TUBE, area_stretched, ellipsoid_of, faces_of, is_stretched

RADIUS, LENGTH = 0.3, 0.9
TRANSFORMS = {
    "as it is": np.eye(3),
    "wide": np.diag([1.6, 0.7, 1.2]),
    "flat": np.diag([1.0, 0.9, 0.05]),
    "mirrored": np.diag([-1.5, 1.0, 0.8]),
    "sheared": np.array([[1.0, 0.0, 0.2], [0.5, 1.0, 0.0], [0.8, 0.3, 1.0]]),
}
DIRECTIONS = np.random.default_rng(3).normal(size=(40, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def surface(shape: ExtentShape, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, 3] of a surface and the vectors of its area there [n, 3], by the definition of both."""
    u, v = (values.ravel() for values in np.meshgrid((np.arange(300) + 0.5) / 300, (np.arange(300) + 0.5) / 300))
    turn = 2.0 * np.pi * v
    if shape == ExtentShape.ROUND:
        height = 2.0 * u - 1.0
        level = np.sqrt(1.0 - height**2)
        outward = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)
        points, area = RADIUS * outward, 4.0 * np.pi * RADIUS**2
    else:
        outward = np.stack([0.0 * u, np.cos(turn), np.sin(turn)], axis=1)
        points = RADIUS * outward + np.outer(LENGTH * (u - 0.5), [1.0, 0.0, 0.0])
        area = 2.0 * np.pi * RADIUS * LENGTH
    vectors = outward @ np.linalg.inv(rows).T * abs(np.linalg.det(rows))
    return points @ rows, vectors * area / len(u)


def light(shape: ExtentShape, rows: np.ndarray, **changes: object) -> LightAtShutter:
    """A light of radiance 1 of that shape under a transform."""
    area = float(np.linalg.norm(surface(shape, rows)[1], axis=1).sum())
    if shape == ExtentShape.ROUND:
        power, profile, extent = area / 4.0, EmissionProfile.UNIFORM, Extent(shape, RADIUS)
    else:
        half = np.array([[0.5 * LENGTH, 0.0, 0.0], [0.0, 0.0, 0.0]])
        power, profile, extent = area / math.pi, EmissionProfile.SINE, Extent(shape, RADIUS, half)
    found = LightAtShutter("/lamp", LightKind.POINT, (power,) * 3, np.array([0.1, 0.2, 2.0]))
    return replace(found, profile=profile, extent=extent, **changes)


def irradiance(points: np.ndarray, vectors: np.ndarray, x: np.ndarray, n: np.ndarray) -> float:
    """Irradiance at x of normal n from a convex surface of radiance 1."""
    off = x - points
    squares = (off**2).sum(axis=1)
    sent = np.maximum((vectors * off).sum(axis=1), 0.0)
    return float((sent * np.maximum(-off @ n, 0.0) / squares**2).sum())


def scene_of(whole: LightAtShutter) -> SceneAtShutter:
    return SceneAtShutter(Shutter(0.0, 0.0, 0.0), (), (whole,), looking_down())


@pytest.mark.parametrize("name", TRANSFORMS)
def test_an_ellipsoid_and_its_parts_and_places_send_what_its_surface_does_in_every_direction(name):
    rows = TRANSFORMS[name]
    sphere = light(ExtentShape.ROUND, rows)
    whole = ellipsoid_of(sphere, RADIUS, rows, np.zeros((3, 3)))
    _, vectors = surface(ExtentShape.ROUND, rows)
    expected = np.maximum(vectors @ DIRECTIONS.T, 0.0).sum(axis=0)
    found = whole.power[0] * np.linalg.norm(DIRECTIONS @ whole.shown.T, axis=1)
    np.testing.assert_allclose(found, expected, rtol=2e-3)
    for part in parts_of(whole, 7, np.tile(whole.position - [0.3, 0.4, 5.0], (2, 1))):
        np.testing.assert_array_equal(part.shown, whole.shown)
        assert part.profile == EmissionProfile.SHOWN and part.power[0] == pytest.approx(whole.power[0] / 7)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_places_in_an_ellipsoid_light_what_its_surface_does_nearby(name):
    """A cloud of points that shine by the area that all of it shows has the radiance of its surface, ray by ray."""
    rows = TRANSFORMS[name]
    whole = ellipsoid_of(light(ExtentShape.ROUND, rows), RADIUS, rows, np.zeros((3, 3)))
    points, vectors = surface(ExtentShape.ROUND, rows)
    count = 512
    scenes = [place_lights(scene_of(whole), number, count) for number in range(count)]
    for direction in DIRECTIONS[:6]:
        x = 0.9 * direction
        found = 0.0
        for scene in scenes:
            (place,) = scene.lights
            off = x - (place.position - whole.position)
            d = np.linalg.norm(off)
            shown = np.linalg.norm(place.shown @ off / d)
            found += place.power[0] / count * shown * max(off @ direction, 0) / d**3
        assert found == pytest.approx(irradiance(points, vectors, x, -direction), rel=0.01)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_parts_of_an_ellipsoid_lie_as_its_places_do(name):
    """The same middle, and nearly the same width about it along any direction, from wherever it is seen."""
    rows = TRANSFORMS[name]
    whole = ellipsoid_of(light(ExtentShape.ROUND, rows), RADIUS, rows, np.zeros((3, 3)))
    truth = 0.25 * whole.extent.spans.T @ whole.extent.spans
    for seen_from in (np.array([0.0, 0.0, -4.0]), np.array([5.0, 1.0, 2.0])):
        parts = parts_of(whole, 37, np.tile(seen_from, (2, 1)))
        middles = np.array([part.position - whole.position for part in parts])
        inner = [(0.25 if part.extent.shape == ExtentShape.DISK else 1.0 / 3.0, part.extent.spans) for part in parts]
        spread = np.mean([k * spans.T @ spans for k, spans in inner], axis=0) + middles.T @ middles / len(parts)
        np.testing.assert_allclose(middles.mean(axis=0), 0.0, atol=0.02 * RADIUS)
        np.testing.assert_allclose(spread, truth, atol=0.06 * np.abs(truth).max())


@pytest.mark.parametrize("name", TRANSFORMS)
@pytest.mark.parametrize("shape", [ExtentShape.CYLINDER])
def test_faces_send_what_the_stretched_surface_does(shape, name):
    """From afar by projected areas, and from three times as far as the light is long by irradiance."""
    rows = TRANSFORMS[name]
    whole = light(shape, rows)
    points, vectors = surface(shape, rows)
    faces = faces_of(whole, RADIUS, LENGTH, rows, np.zeros((3, 3)))
    normals = np.array([-face.axes[2] for face in faces])
    sent = np.array([face.power[0] for face in faces])
    # A face of area A and radiance 1 sends A along its normal, so that all of them have all of the surface's area.
    assert sent.sum() == pytest.approx(np.linalg.norm(vectors, axis=1).sum(), rel=1e-6)
    np.testing.assert_allclose(sent @ normals, 0.0, atol=1e-9 * sent.sum())
    seen = np.maximum(normals @ DIRECTIONS.T, 0.0).T @ sent
    expected = np.maximum(vectors @ DIRECTIONS.T, 0.0).sum(axis=0)
    # A prism of 13 faces is .5 % narrower than a tube of its area from before a face, and so is its image.
    np.testing.assert_allclose(seen, expected, rtol=0.006)
    assert seen.mean() == pytest.approx(expected.mean(), rel=0.002)
    steps = (np.arange(12) + 0.5) / 6 - 1.0
    found, truth = [], []
    for direction in DIRECTIONS[:6]:
        x = 3.0 * direction
        near = 0.0
        for face in faces:
            a, b = np.meshgrid(steps, steps)
            within = a**2 + b**2 < 1.0 if face.extent.shape == ExtentShape.DISK else np.ones_like(a, bool)
            a, b = a[within], b[within]
            places = face.position - whole.position + np.stack([a, b], axis=1) @ face.extent.spans
            near += irradiance(places, np.tile(-face.axes[2] * face.power[0] / len(a), (len(a), 1)), x, -direction)
        found.append(near)
        truth.append(irradiance(points, vectors, x, -direction))
    np.testing.assert_allclose(found, truth, rtol=0.05, atol=0.02 * max(truth))


@pytest.mark.parametrize("name", TRANSFORMS)
def test_areas_are_those_of_the_stretched_surface(name):
    rows = TRANSFORMS[name]
    points, vectors = surface(ExtentShape.ROUND, np.eye(3))
    normals = points / RADIUS
    found = area_stretched(normals, np.full(len(normals), 1.0 / len(normals)), rows)
    stretched = np.linalg.norm(surface(ExtentShape.ROUND, rows)[1], axis=1).sum()
    assert found == pytest.approx(stretched / np.linalg.norm(vectors, axis=1).sum(), rel=1e-9)


@pytest.mark.parametrize(
    ("shape", "rows", "stretched"),
    [
        (ExtentShape.ROUND, 3.0 * np.eye(3), False),
        (ExtentShape.ROUND, np.diag([1.0, -1.0, 1.0]), False),
        (ExtentShape.ROUND, np.diag([1.0, 1.0, 1.0005]), False),
        (ExtentShape.ROUND, np.diag([1.0, 1.0, 1.05]), True),
        (ExtentShape.CYLINDER, np.diag([7.0, 2.0, 2.0]), False),
        (ExtentShape.CYLINDER, np.diag([1.0, 1.05, 1.0]), False),
        (ExtentShape.CYLINDER, np.diag([1.0, 2.0, 1.0]), True),
        (ExtentShape.CYLINDER, np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), True),
    ],
)
def test_what_stays_a_sphere_or_a_tube_is_not_stretched(shape, rows, stretched):
    assert is_stretched(shape, rows) is stretched


def test_faces_move_with_the_transform_and_keep_the_axis_of_a_cone():
    shaping = Shaping(0.6, 0.0, 0.0)
    moved = np.array([[0.4, 0.1, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, -0.3]])
    rows = TRANSFORMS["wide"]
    whole = light(ExtentShape.CYLINDER, rows, shaping=shaping, position_motion=np.array([0.5, 0.0, 0.0]))
    opened, there, closed = (
        faces_of(whole, RADIUS, LENGTH, rows + part * moved, moved if part == 0.0 else 0.0 * moved)
        for part in (-0.5, 0.0, 0.5)
    )
    for before, face, after in zip(opened, there, closed, strict=True):
        np.testing.assert_allclose(face.position_motion, after.position - before.position + [0.5, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(face.extent.spans_motion, after.extent.spans - before.extent.spans, atol=1e-12)
        np.testing.assert_allclose(face.axes_motion, after.axes - before.axes, atol=1e-12)
        np.testing.assert_array_equal(face.cone_axis, whole.cone_axis)


def test_what_stays_a_tube_looks_as_wide_as_one_from_all_sides():
    """The shadow of an ellipse along a unit d is √Σ (d_i s_j)², times two."""
    turn = np.linspace(0.0, np.pi, 200)
    shadows = np.hypot((1.0 + UNEVEN_TUBE) * np.cos(turn), np.sin(turn))
    np.testing.assert_allclose(shadows, math.sqrt(1.0 + UNEVEN_TUBE), rtol=0.055)


def test_an_ellipsoid_moves_and_turns_with_the_transform():
    moved = np.array([[0.4, 0.1, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, -0.3]])
    rows = TRANSFORMS["wide"]
    whole = light(ExtentShape.ROUND, rows)
    opened, there, closed = (
        ellipsoid_of(whole, RADIUS, rows + part * moved, moved if part == 0.0 else 0.0 * moved).extent
        for part in (-0.5, 0.0, 0.5)
    )
    for part, alone in ((-0.5, opened), (0.5, closed)):
        spans = there.spans + part * there.spans_motion
        np.testing.assert_allclose(spans.T @ spans, alone.spans.T @ alone.spans, atol=1e-12)
