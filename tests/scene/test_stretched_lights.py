"""Ellipsoids and oval tubes as flat lights, against quadrature over their surfaces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.scene.description import EmissionProfile, Extent, ExtentShape, LightAtShutter, LightKind, Shaping
from tpdwarp.scene.stretched_lights import UNEVEN, area_stretched, faces_of, is_stretched

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


@pytest.mark.parametrize("name", TRANSFORMS)
@pytest.mark.parametrize("shape", [ExtentShape.ROUND, ExtentShape.CYLINDER])
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
    # An icosahedron is 4.7 % wider than a sphere of its area from over a corner, and so is its image; a prism 2 %.
    np.testing.assert_allclose(seen, expected, rtol=0.055)
    assert seen.mean() == pytest.approx(expected.mean(), rel=0.01)
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
        (ExtentShape.ROUND, np.diag([1.0, 1.0, 1.05]), False),
        (ExtentShape.ROUND, np.diag([1.0, 1.0, 1.1]), True),
        (ExtentShape.CYLINDER, np.diag([7.0, 2.0, 2.0]), False),
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
    whole = light(ExtentShape.ROUND, rows, shaping=shaping, position_motion=np.array([0.5, 0.0, 0.0]))
    opened, there, closed = (
        faces_of(whole, RADIUS, LENGTH, rows + part * moved, moved if part == 0.0 else 0.0 * moved)
        for part in (-0.5, 0.0, 0.5)
    )
    for before, face, after in zip(opened, there, closed, strict=True):
        np.testing.assert_allclose(face.position_motion, after.position - before.position + [0.5, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(face.extent.spans_motion, after.extent.spans - before.extent.spans, atol=1e-12)
        np.testing.assert_allclose(face.axes_motion, after.axes - before.axes, atol=1e-12)
        np.testing.assert_array_equal(face.cone_axis, whole.cone_axis)


@pytest.mark.parametrize("scales", [(1.0, 1.0, 1.0 + UNEVEN), (1.0 + UNEVEN, 1.0 + UNEVEN, 1.0)])
def test_what_stays_a_sphere_looks_as_wide_as_one_from_all_sides(scales):
    """The shadow of an ellipsoid along d is π √Σ (d_i s_j s_k)²."""
    directions = np.random.default_rng(3).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.prod(scales) / np.array(scales)
    shadows = np.linalg.norm(directions * across, axis=1)
    points, _ = surface(ExtentShape.ROUND, np.eye(3))
    area = area_stretched(points / RADIUS, np.full(len(points), 1.0 / len(points)), np.diag(scales))
    np.testing.assert_allclose(shadows, area, rtol=0.055)
