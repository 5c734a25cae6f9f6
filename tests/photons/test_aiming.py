"""Bounds of what a point light sees through a face of the cube around it, against directions drawn from triangles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpdwarp.photons.aiming import FINEST_ANGLE, bounds_of, cube_axes, seen_from
from tpdwarp.scene.description import LightAtShutter, LightKind
from tpdwarp.scene.normalization import Normalization

UNIT = Normalization(np.zeros(3), 1.0, 1.0)
LAMP = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0))
FACE = math.pi / 4


def drawn(corners: np.ndarray, axes: np.ndarray, limit: float) -> np.ndarray:
    """Angles (u, v) of points and corners of the triangles that lie within ``limit`` of the face, shape [n, 2]."""
    weights = np.random.default_rng(3).dirichlet(np.ones(3), (len(corners), 400))
    weights[:, :3] = np.eye(3)
    local = np.einsum("kns,ksc->knc", weights, corners).reshape(-1, 3) @ axes.T
    uv = np.arctan2(local[:, :2], local[:, 2:])
    return uv[(np.abs(uv) <= limit).all(axis=1)]


@pytest.mark.parametrize("size", [0.05, 1.0, 6.0])
@pytest.mark.parametrize("shape", [(1.0, 1.0), (1.0, 0.01)], ids=["wide", "slivers"])
def test_bounds_hold_what_is_inside_a_face_and_little_else(size, shape):
    random = np.random.default_rng(8)
    centres = random.normal(0.0, 1.0, (12, 3))
    sides = size * random.normal(0.0, 1.0, (12, 2, 3)) * np.array(shape)[None, :, None]
    corners = np.stack([centres, centres + sides[:, 0], centres + sides[:, 1]], axis=1)
    seen = seen_from(LAMP, corners, UNIT)
    for axes in cube_axes(np.array([0.2, 0.3, -1.0])):
        uv = drawn(corners, axes, FACE)
        found = bounds_of(LAMP, axes, FACE, corners, UNIT)
        assert found == bounds_of(LAMP, axes, FACE, corners, UNIT, seen=seen)
        if not len(uv):
            continue
        low, high = np.array(found[::2]), np.array(found[1::2])
        assert (uv.min(axis=0) >= low - 1e-12).all() and (uv.max(axis=0) <= high + 1e-12).all()
        assert (np.abs(low) <= FACE).all() and (np.abs(high) <= FACE).all()
        if size == 0.05:
            # What is cut no finer may lie just outside of the face; corners of small triangles are their ends.
            around = np.clip(drawn(corners, axes, FACE + 2 * FINEST_ANGLE), -FACE, FACE)
            assert (low >= around.min(axis=0) - 1e-12).all() and (high <= around.max(axis=0) + 1e-12).all()
