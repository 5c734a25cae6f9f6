"""What mirrors show of lights: those with extent as they are, and all by the lobe where the mirror is rough."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.lit_by_surfaces import LIGHTS, ellipsoid, lamp
from tests.view.scenes import SHUTTER, WATER, floor, quad, see
from tests.view.test_glossy_lights import COLOR, PLACES, WITHIN, by_quadrature, eye, lobe, radiance, viewer
from tpdwarp.scene.description import (
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    SceneAtShutter,
)

# Where the view goes that the floor mirrors.
AHEAD = viewer(0.8) * (-1.0, 1.0, 1.0)


def mirror(alpha: float = 0.0, color=COLOR) -> Material:
    return Material(Interaction.MIRROR, color=color, roughness=alpha)


def shown(material: Material, light: LightAtShutter, *others: MeshAtShutter, films=PLACES[:64], **compiled):
    return radiance([floor(material=material), *others], light, 0.8, films, **compiled)


RADIANCE = np.array([1.0, 2.0, 4.0])


def ahead(shape: ExtentShape, half: float = 0.1, offset=(0.0, 0.0, 0.0)) -> LightAtShutter:
    """A light of that radiance that faces the origin from where the mirrored view goes, or from beside it."""
    back = AHEAD
    across = np.array([0.0, 1.0, 0.0])
    axes = np.array([across, np.cross(back, across), back])
    light = lamp(shape, AHEAD + offset, sizes=(half, half), radius=half)
    # A light's intensity along its axis, by what of it is seen from there.
    area = {ExtentShape.ROUND: math.pi, ExtentShape.DISK: math.pi}.get(shape, 4.0) * half**2
    spans = light.extent.spans if shape == ExtentShape.ROUND else half * axes[:2]
    if shape == ExtentShape.CYLINDER:
        spans = np.array([half * across, np.zeros(3)])
    radius = half if shape in (ExtentShape.ROUND, ExtentShape.CYLINDER) else 0.0
    extent = replace(light.extent, spans=spans, radius=radius)
    return replace(light, power=tuple(area * RADIANCE), axes=axes, extent=extent)


def test_a_point_light_is_seen_by_the_lobe_of_a_rough_mirror_and_not_at_all_in_a_smooth_one():
    light = LightAtShutter("/lamp", LightKind.POINT, (1.0, 2.0, 4.0), np.array([-0.6, 0.1, 0.9]))
    to_light = light.position / np.linalg.norm(light.position)
    for alpha in (0.02, 0.09):
        truth = lobe(to_light[None], 0.8, alpha)[0] * light.power / (light.position @ light.position)
        found = shown(mirror(alpha), light, films=PLACES[:4])
        np.testing.assert_allclose(found, truth, rtol=5e-3)
    assert shown(mirror(), light).max() == 0


@pytest.mark.parametrize("name", [name for name in LIGHTS if name != "tube"])
def test_a_light_with_extent_is_seen_in_a_rough_mirror_as_the_integral_over_it(name):
    truth = by_quadrature(LIGHTS[name], 0.8, 0.09)
    found = shown(mirror(0.09), LIGHTS[name], films=PLACES)
    assert found[0] == pytest.approx(truth, rel=WITHIN, abs=WITHIN * 1e-3)


@pytest.mark.parametrize("shape", [ExtentShape.ROUND, ExtentShape.RECT, ExtentShape.DISK, ExtentShape.CYLINDER])
def test_a_smooth_mirror_shows_a_light_as_it_is_and_nothing_beside_it(shape):
    np.testing.assert_allclose(shown(mirror(), ahead(shape)), np.array(COLOR) * RADIANCE, rtol=1e-3)
    for aside in (0.11, -0.11):
        assert shown(mirror(), ahead(shape, offset=(0.0, aside, 0.0))).max() == 0


def test_a_smooth_mirror_shows_an_ellipsoid_by_the_radiance_of_all_its_surface():
    short, long = 0.1, 0.25
    light = ellipsoid(AHEAD, (0.3, -0.8, 0.2), (short, short, long))
    # The surface of a prolate spheroid, which sends π L from each part of it.
    eccentricity = math.sqrt(1.0 - (short / long) ** 2)
    area = 2.0 * math.pi * short**2 * (1.0 + long / (short * eccentricity) * math.asin(eccentricity))
    np.testing.assert_allclose(shown(mirror(), light), np.array(COLOR) * light.power * 4.0 / area, rtol=1e-3)
    aside = replace(light, position=light.position + np.array([0.0, 0.26, 0.0]))
    assert shown(mirror(), aside).max() == 0


@pytest.mark.parametrize("shape", [ExtentShape.RECT, ExtentShape.DISK])
def test_a_smooth_mirror_does_not_show_the_back_of_a_light(shape):
    light = ahead(shape)
    assert shown(mirror(), replace(light, axes=light.axes * np.array([[1.0], [-1.0], [-1.0]]))).max() == 0


def test_a_sun_in_a_smooth_mirror_is_its_disc():
    disc = LIGHTS["wide sun"]
    half = disc.extent.radius
    axes = ahead(ExtentShape.RECT).axes
    found = shown(mirror(), replace(disc, axes=axes))
    np.testing.assert_allclose(found, np.array(COLOR) * RADIANCE / (math.pi * math.sin(half) ** 2), rtol=1e-3)


def test_what_hides_the_light_hides_it_in_the_mirror():
    for material in (Material(color=(0.0, 0.0, 0.0)), WATER):
        board = quad("/board", (-3, -3), (3, 3), 0.4, material)
        for alpha in (0.0, 0.09):
            assert shown(mirror(alpha), ahead(ExtentShape.RECT), board).max() == 0


def test_a_white_mirror_in_a_furnace_of_one_light_gives_all_of_it_back():
    """A panel that is nearly the whole half-space above."""
    light = replace(lamp(ExtentShape.RECT, (0.0, 0.0, 0.5), sizes=(200.0, 200.0)), power=(400.0**2,) * 3)
    for alpha in (0.0, 0.02, 0.09):
        found = shown(mirror(alpha, (1.0, 1.0, 1.0)), light, films=PLACES[:1024])
        np.testing.assert_allclose(found, 1.0, rtol=0.02)


def test_a_mesh_that_shines_is_seen_once():
    """The ray sees it, and the light that stands for it is left out."""
    glow = Material(color=(0.0, 0.0, 0.0), emission=tuple(RADIANCE), lamp=True)
    ceiling = quad("/ceiling", (-9, -9), (9, 9), 0.5, glow, up=False)
    light = replace(lamp(ExtentShape.RECT, (0.0, 0.0, 0.5), sizes=(9.0, 9.0)), meshed=True)
    light = replace(light, power=tuple(18.0**2 * RADIANCE))
    for alpha in (0.0, 0.09):
        found = shown(mirror(alpha, (1.0, 1.0, 1.0)), light, ceiling)
        np.testing.assert_allclose(found, RADIANCE, rtol=0.02)


def test_paths_that_branch_beyond_the_mirror_show_its_lights_once():
    panes = [quad(f"/pane{k}", (-9, -9), (9, 9), 2.0 + 0.1 * k, WATER) for k in range(4)]
    for alpha, light in ((0.0, ahead(ExtentShape.RECT)), (0.09, LIGHTS["rectangle overhead"])):
        scene = SceneAtShutter(SHUTTER, (floor(material=mirror(alpha)), *panes), (light,), eye(0.8))
        passes = see(scene, 1, 1, PLACES[:64])
        assert len(passes) > 1
        total = sum(seen.direct.sum(axis=0) for seen in passes) / 64
        np.testing.assert_allclose(total, shown(mirror(alpha), light), rtol=1e-4)


def test_a_smooth_mirror_that_is_seen_in_a_rough_one_shows_lights_as_blurred():
    """A light without extent, which no smooth mirror shows to the camera itself."""
    light = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0), AHEAD * (1.2, 1.0, -0.5) + (0.0, 0.0, 1.0))
    board = quad("/board", (-9, -9), (9, 9), 0.9, mirror(color=(1.0, 1.0, 1.0)), up=False)
    dark = quad("/board", (-9, -9), (9, 9), 0.9, Material(color=(0.0, 0.0, 0.0)), up=False)
    white = (1.0, 1.0, 1.0)
    one, alone = (shown(mirror(0.09, white), light, other)[0] for other in (board, dark))
    assert one > 1.05 * alone
    assert shown(mirror(0.0, white), light, board).max() == 0


@pytest.mark.parametrize("alpha", [0.0, 0.09])
def test_what_is_a_mirror_in_part_shows_lights_in_that_part(alpha):
    light, whole = ahead(ExtentShape.RECT), mirror(alpha)
    diffuse = shown(Material(color=COLOR), light)
    scene = SceneAtShutter(SHUTTER, (floor(material=replace(whole, diffuse_share=0.25)),), (light,), eye(0.8))
    part = sum(seen.direct.sum(axis=0) for seen in see(scene, 1, 1, PLACES[:64])) / 64
    np.testing.assert_allclose(part, 0.25 * diffuse + 0.75 * shown(whole, light), rtol=1e-4)
