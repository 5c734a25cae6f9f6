"""Bounds of what a point light sees through a face of the cube around it, against triangles that are cut one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.photons.aiming import Specular, bounds_of, cube_axes
from tpdwarp.scene.description import EmissionProfile, Extent, ExtentShape, LightAtShutter, LightKind, Shaping
from tpdwarp.scene.normalization import Normalization

UNIT = Normalization(np.zeros(3), 1.0, 1.0)
LAMP = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0))
FACE = math.pi / 4


def seen(corners: np.ndarray, axes: np.ndarray, limit: float) -> np.ndarray:
    """Angles (u, v) of the corners of triangles that are cut by one side of a face after the other, [n, 2]."""
    slope = math.tan(limit)
    left: list[np.ndarray] = []
    for triangle in corners @ axes.T:
        polygon = list(triangle)
        for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
            inside = [slope * p[2] - sign * p[axis] for p in polygon]
            kept = []
            for i, p in enumerate(polygon):
                before, a, b = polygon[i - 1], inside[i - 1], inside[i]
                if (a < 0.0) != (b < 0.0):
                    kept.append(before + a / (a - b) * (p - before))
                if b >= 0.0:
                    kept.append(p)
            polygon = kept
        left += polygon
    if not left:
        return np.zeros((0, 2))
    return np.arctan2(np.array(left)[:, :2], np.array(left)[:, 2:])


def specular_of(corners: np.ndarray) -> Specular:
    return Specular(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


@pytest.mark.parametrize("size", [0.05, 1.0, 6.0, 100.0])
@pytest.mark.parametrize("shape", [(1.0, 1.0), (1.0, 0.01)], ids=["wide", "slivers"])
@pytest.mark.parametrize("limit", [FACE, math.radians(75.0)])
def test_bounds_are_those_of_what_a_face_shows_of_triangles(size, shape, limit):
    random = np.random.default_rng(8)
    for _ in range(20):
        centres = random.normal(0.0, 1.0, (random.integers(1, 12), 3))
        sides = size * random.normal(0.0, 1.0, (len(centres), 2, 3)) * np.array(shape)[None, :, None]
        corners = np.stack([centres, centres + sides[:, 0], centres + sides[:, 1]], axis=1)
        for axes in cube_axes(np.array([0.2, 0.3, -1.0])):
            uv = seen(corners, axes, limit)
            found = bounds_of(LAMP, axes, limit, specular_of(corners), UNIT)
            if len(uv):
                expected = [*zip(uv.min(axis=0), uv.max(axis=0), strict=True)]
                np.testing.assert_allclose(np.reshape(found, (2, 2)), expected, atol=1e-9)
            else:
                assert found is None


def test_a_lamp_on_a_vertex_sees_its_triangle_by_the_others():
    corners = np.array([[[0.0, 0.0, 0.0], [0.1, 0.2, 1.0], [-0.2, 0.1, 1.0]]])
    found = bounds_of(LAMP, np.eye(3), FACE, specular_of(corners), UNIT)
    np.testing.assert_allclose(found, np.arctan([-0.2, 0.1, 0.1, 0.2]), atol=1e-12)


def test_a_sliver_in_the_plane_of_a_lamp_is_seen_as_a_line():
    sliver = np.array([[[-0.4, 0.0, 1e-20], [1.0, 1e-20, 1e-20], [0.4, 0.0, 1e-20]]])
    found = bounds_of(LAMP, np.eye(3), FACE, specular_of(sliver), UNIT)
    assert found is None or np.isfinite(found).all()


@pytest.mark.parametrize("radius", [0.0, 0.3])
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_a_cone_bounds_what_its_light_sees(tilt, radius):
    """All that any place on a light lights of a floor two below it lies within, and little else does."""
    angle = math.radians(20.0)
    cosine, sine = math.cos(tilt), math.sin(tilt)
    axes = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    light = replace(LAMP, position=np.array([0.0, 0.0, 2.0]), axes=axes, shaping=Shaping(angle))
    if radius:
        extent = Extent(ExtentShape.DISK, 0.0, radius * axes[:2])
        light = replace(light, profile=EmissionProfile.COSINE, extent=extent)
    floor = np.array([[[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0]], [[-9, -9, 0], [9, 9, 0], [-9, 9, 0]]])
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    whole = bounds_of(replace(light, shaping=None), down, FACE, specular_of(floor), UNIT)
    found = bounds_of(light, down, FACE, specular_of(floor), UNIT)

    # ---- Points of the floor that are lit from anywhere, seen from the middle
    random = np.random.default_rng(1)
    r, turn = radius * np.sqrt(random.uniform(0, 1, 500)), random.uniform(0, 2 * math.pi, 500)
    places = light.position + np.stack([r * np.cos(turn), r * np.sin(turn)], axis=1) @ axes[:2]
    points = np.append(random.uniform(-2.0, 2.0, (4000, 2)), np.zeros((4000, 1)), axis=1)
    ways = points[:, None] - places[None]
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    lit = points[(ways @ -axes[2] > math.cos(angle)).any(axis=1)] - light.position
    seen_from_middle = np.arctan((lit @ down.T)[:, :2] / 2.0)
    seen_from_middle = seen_from_middle[np.abs(seen_from_middle).max(axis=1) <= FACE]
    low, high = seen_from_middle.min(axis=0), seen_from_middle.max(axis=0)
    assert found[0] <= low[0] and found[1] >= high[0] and found[2] <= low[1] and found[3] >= high[1]
    size = np.array([found[1] - found[0], found[3] - found[2]])
    assert (size < 1.35 * (high - low)).all()
    assert size.prod() < 0.7 * (whole[1] - whole[0]) * (whole[3] - whole[2])


def test_a_cone_that_meets_nothing_specular_emits_nothing():
    floor = np.array([[[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0]]])
    turned = np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]])
    light = replace(LAMP, position=np.array([0.0, 0.0, 2.0]), axes=turned, shaping=Shaping(math.radians(10.0)))
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    assert bounds_of(light, down, FACE, specular_of(floor), UNIT) is None
