"""Bounds of what a point light sees through a face of the cube around it, against triangles that are cut one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpdwarp.photons.aiming import Specular, bounds_of, cube_axes
from tpdwarp.scene.description import LightAtShutter, LightKind
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
