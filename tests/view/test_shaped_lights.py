"""Cones and focus of lights, in direct light and in what photons carry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import floor, looking_down, quad, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import (
    PROFILE_COUNT,
    EmissionProfile,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    Shaping,
    Shutter,
)
from tpdwarp.settings import Settings

STILL = Shutter(0, 0, 0)
HEIGHT, SIZE = 2.0, 32
LAMP = LightAtShutter("/lamp", LightKind.POINT, (3.0, 2.0, 1.0), np.array([0.0, 0.0, HEIGHT]))
# Index one: light passes it unbent, but arrives as photons.
CLEAR = quad("/clear", (-2, -2), (2, 2), 1.0, Material(Interaction.DIELECTRIC, ior=1.0))


def expected(shaping: Shaping) -> np.ndarray:
    """Radiance of a white floor at pixel centres, shape [SIZE, SIZE]."""
    at = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    r2 = at[:, None] ** 2 + at**2 + HEIGHT**2
    cosine = HEIGHT / np.sqrt(r2)
    theta = np.arccos(cosine)
    intensity = cosine**shaping.focus * (theta < shaping.angle)
    if shaping.softness > 0:
        start = shaping.angle * (1 - shaping.softness)
        s = np.clip((theta - start) / (shaping.angle - start), 0, 1)
        intensity = intensity * (1 - s * s * (3 - 2 * s))
    if shaping.profile:
        intensity = intensity * np.interp(theta, np.linspace(0, math.pi, PROFILE_COUNT), shaping.profile)
    return intensity * cosine / r2 / math.pi


SHAPES = [
    Shaping(0.3),
    Shaping(0.4, softness=0.5),
    Shaping(2 * math.pi, focus=8.0),
    Shaping(0.35, softness=1.0, focus=2.0),
    Shaping(2 * math.pi, profile=tuple(1.0 - 0.5 * math.cos(12 * k * math.pi / 90) ** 2 for k in range(PROFILE_COUNT))),
    Shaping(0.4, 0.5, 2.0, (0.5, 1.0) * (PROFILE_COUNT // 2) + (0.5,)),
]


def render(meshes, light, photons=1 << 14):
    source = steady(meshes, (light,), looking_down(height=0.5))
    frame = render_frame(RenderContext(source, Settings(photons=photons, samples=1, threads=1)), STILL, SIZE, SIZE)
    return frame.channels["R"].astype(float) / 3.0, frame


@pytest.mark.parametrize("shaping", SHAPES)
def test_direct_light_follows_the_cone(shaping):
    found, _ = render([floor()], replace(LAMP, shaping=shaping))
    np.testing.assert_allclose(found, expected(shaping), atol=1e-5)


# A rim, and a profile that is up and down by degrees, are finer than cells.
@pytest.mark.parametrize("shaping", SHAPES[1:-1])
def test_photons_follow_the_cone(shaping):
    found, frame = render([floor(), CLEAR], replace(LAMP, shaping=shaping))
    # Cells of a 128th of the plate blur by about themselves what fades over some tenths.
    np.testing.assert_allclose(found, expected(shaping), atol=0.03 * expected(shaping).max())
    assert frame.energy.lost_total < 1e-6 * frame.energy.sent


@pytest.mark.parametrize("shaping", [SHAPES[1], SHAPES[2]])
@pytest.mark.parametrize("meshes", [[floor()], [floor(), CLEAR]])
def test_a_tube_shines_by_the_sine_to_its_axis_and_by_its_cone_about_another(meshes, shaping):
    """Its middle alone: sin of the angle to x, times the cone about −z."""
    light = replace(LAMP, profile=EmissionProfile.SINE, shaping=shaping)
    found, _ = render(meshes, light)
    at = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    sine = np.sqrt(1 - at**2 / (at[:, None] ** 2 + at**2 + HEIGHT**2))
    wanted = sine * expected(shaping)
    np.testing.assert_allclose(found, wanted, atol=(1e-5 if len(meshes) == 1 else 0.03 * wanted.max()))


def test_a_cone_sends_what_its_solid_angle_holds():
    angle = 0.3
    _, frame = render([floor(), CLEAR], replace(LAMP, shaping=Shaping(angle)), photons=1 << 16)
    solid = 2 * math.pi * (1 - math.cos(angle))
    # The rim crosses about one cell in forty, which are lit by their middle.
    assert frame.energy.sent == pytest.approx(6.0 * solid, rel=5e-3)
    assert frame.energy.deposited == pytest.approx(frame.energy.sent, rel=1e-5)


def test_a_turned_lamp_shines_along_its_axis():
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    found, _ = render([floor()], replace(LAMP, axes=axes, shaping=Shaping(0.5)))
    # Along −x: nothing comes straight down.
    assert found.max() == 0
