"""Lights that something specular passes through, and lights that it only surrounds, touches or passes by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.scene.cut_lights import cut_lights
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    SceneAtShutter,
    Shutter,
)
from usd_scenes import shapes

LAMP = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0))
GLASS = Material(Interaction.DIELECTRIC, ior=1.5)


def pane(material: Material) -> MeshAtShutter:
    """A square of side 2 in the plane z = 0."""
    points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return MeshAtShutter("/pane", points, np.array([[0, 1, 2], [0, 2, 3]], np.int32), materials=(material,))


def bulb(radius: float) -> MeshAtShutter:
    points, triangles, _ = shapes.sphere()
    return MeshAtShutter("/bulb", radius * points, np.int32(triangles), materials=(GLASS,))


def sphere(height: float, x: float = 0.0) -> LightAtShutter:
    return replace(LAMP, position=np.array([x, 0.1, height]), extent=Extent(ExtentShape.ROUND, 0.5))


def flat(shape: ExtentShape, spans: list[list[float]], height: float, radius: float = 0.0) -> LightAtShutter:
    profile = EmissionProfile.SINE if shape == ExtentShape.CYLINDER else EmissionProfile.COSINE
    return replace(
        LAMP, position=np.array([0.1, 0.2, height]), profile=profile, extent=Extent(shape, radius, np.array(spans))
    )


LYING, UPRIGHT = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]], [[0.5, 0.0, 0.0], [0.0, 0.0, 0.5]]
SUN = replace(LAMP, kind=LightKind.DISTANT, extent=Extent(ExtentShape.ROUND, 0.5))


@pytest.mark.parametrize(
    ("light", "mesh", "is_cut"),
    [
        (sphere(0.3), pane(GLASS), True),
        (sphere(-0.3), pane(GLASS), True),
        (sphere(0.0), pane(GLASS), True),
        (sphere(0.6), pane(GLASS), False),
        (sphere(0.3, x=1.6), pane(GLASS), False),
        (sphere(0.3), pane(Material(Interaction.MIRROR)), True),
        (sphere(0.3), pane(Material(Interaction.DIFFUSE)), False),
        (sphere(0.0), bulb(0.8), False),
        (sphere(0.0), bulb(0.5), True),
        (flat(ExtentShape.RECT, UPRIGHT, 0.3), pane(GLASS), True),
        (flat(ExtentShape.RECT, LYING, 0.3), pane(GLASS), False),
        (flat(ExtentShape.RECT, LYING, 0.0), pane(GLASS), False),
        (flat(ExtentShape.DISK, UPRIGHT, 0.3), pane(GLASS), True),
        (flat(ExtentShape.DISK, UPRIGHT, 0.6), pane(GLASS), False),
        (flat(ExtentShape.CYLINDER, [[0.5, 0.0, 0.0], [0.0] * 3], 0.1, radius=0.2), pane(GLASS), True),
        (flat(ExtentShape.CYLINDER, [[0.5, 0.0, 0.0], [0.0] * 3], 0.0, radius=0.2), pane(GLASS), True),
        (flat(ExtentShape.CYLINDER, [[0.5, 0.0, 0.0], [0.0] * 3], 0.3, radius=0.2), pane(GLASS), False),
        (SUN, pane(GLASS), False),
        (LAMP, pane(GLASS), False),
    ],
)  # fmt: skip
def test_lights_that_a_surface_passes_through(light, mesh, is_cut):
    other = replace(sphere(5.0), path="/other")
    scene = SceneAtShutter(Shutter(0, 0, 0), (mesh,), (other, light))
    assert cut_lights(scene) == ([light] if is_cut else [])


def test_nothing_is_cut_where_nothing_is_specular():
    assert cut_lights(SceneAtShutter(Shutter(0, 0, 0), (), (sphere(0.0),))) == []
