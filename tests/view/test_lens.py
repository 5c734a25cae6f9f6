"""Depth of field: a thin lens, sharp where it is focused, and blurred by its circle of confusion elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.view.scenes import SUN, quad, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.scene.requirements import requirements_of
from tpdwarp.settings import Settings

STILL = Shutter(0, 0, 0)
HEIGHT, SIZE, SAMPLES = 4.0, 16, 256
# Means of so many samples of a half, drawn at random, over the 16 rows of a column.
NOISE = 4 * 0.5 / math.sqrt(SAMPLES * SIZE)


def camera(radius, focus):
    return CameraAtShutter(
        "/cam", False, np.array([0.0, 0.0, HEIGHT]), np.eye(3), (-0.25, 0.25, -0.25, 0.25),
        lens_radius=radius, focus_distance=focus,
    )  # fmt: skip


def coverage(radius, focus):
    """Share of each column that sees a card whose edge is at x = 0, shape [SIZE]."""
    source = steady([quad("/card", (0, -9), (9, 9), 0.0)], (SUN,), camera(radius, focus))
    frame = render_frame(RenderContext(source, Settings(samples=SAMPLES, threads=1)), STILL, SIZE, SIZE)
    return frame.channels["A"].mean(axis=0)


def beyond(x):
    """Share of the unit disc to the right of −x."""
    x = np.clip(x, -1, 1)
    return 0.5 + (x * np.sqrt(1 - x**2) + np.arcsin(x)) / math.pi


@pytest.mark.parametrize("focus", [2.0, 8.0])
def test_an_edge_out_of_focus_is_blurred_by_the_circle_of_confusion(focus):
    radius = 0.3
    at = HEIGHT * ((np.arange(SIZE * 64) + 0.5) / (SIZE * 64) - 0.5) * 0.5
    # A point of the card is seen by a disc of the lens scaled about the focus.
    disc = radius * abs(HEIGHT / focus - 1)
    expected = beyond(at / disc).reshape(SIZE, 64).mean(axis=1)
    np.testing.assert_allclose(coverage(radius, focus), expected, atol=NOISE)


@pytest.mark.parametrize(("radius", "focus"), [(0.3, HEIGHT), (0.0, 2.0)])
def test_what_is_in_focus_or_behind_a_pinhole_is_sharp(radius, focus):
    np.testing.assert_allclose(coverage(radius, focus), np.repeat([0.0, 1.0], SIZE // 2))


def test_a_pinhole_requires_no_lens():
    for radius in (0.0, 0.1):
        scene = steady([quad("/card", (0, -9), (9, 9), 0.0)], (SUN,), camera(radius, 1.0)).at(STILL)
        assert requirements_of(scene).lens == (radius > 0)
