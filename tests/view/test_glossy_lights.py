"""What lights send off rough metal to the camera: against quadrature over the lights, and what hides them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.lit_by_surfaces import LIGHTS, expected, lamp
from tests.view.scenes import SHUTTER, WATER, Source, floor, quad, see
from tests.view.test_ggx import albedo_once, sphere
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import (
    CameraAtShutter,
    DomeAtShutter,
    ExtentShape,
    LightAtShutter,
    LightKind,
    Material,
    SceneAtShutter,
)
from tpdwarp.settings import Settings

UP = np.array([0.0, 0.0, 1.0])
COLOR = (0.9, 0.5, 0.1)
# Places in one pixel that a camera samples, spread evenly.
COUNT = 4096
PLACES = np.stack([(np.arange(COUNT) + 0.5) / COUNT, (np.arange(COUNT) * 0.6180339887498949) % 1.0], axis=1)
POINT = np.zeros(3)
WITHIN = 0.01


def metal(alpha: float, share: float = 1.0) -> Material:
    return Material(color=COLOR, metal=share, roughness=alpha)


def viewer(cosine: float) -> np.ndarray:
    """The unit direction from the point looked at to the eye."""
    return np.array([math.sqrt(1 - cosine**2), 0.0, cosine])


def eye(cosine: float, window: float = 1e-5) -> CameraAtShutter:
    """A camera that looks at the origin, all of whose film is one point there."""
    back = viewer(cosine)
    right = np.array([0.0, 1.0, 0.0])
    axes = np.array([right, np.cross(back, right), back])
    return CameraAtShutter("/eye", False, 0.3 * back, axes, (-window, window, -window, window))


def radiance(meshes, light, cosine: float, films=PLACES, **compiled) -> np.ndarray:
    """Mean radiance [3] of the origin in direct light."""
    seen = see(SceneAtShutter(SHUTTER, tuple(meshes), (light,), eye(cosine)), 1, 1, films, **compiled)[0]
    assert np.isfinite(seen.direct).all()
    return seen.direct.mean(axis=0)


def lobe(w: np.ndarray, cosine: float, alpha: float) -> np.ndarray:
    """GGX's f cos θ_i for directions [n, 3] above a floor, by Smith's Λ (Heitz 2014), shape [n, 3]."""
    o = viewer(cosine)
    h = (w + o) / np.linalg.norm(w + o, axis=1, keepdims=True)
    i = np.maximum(w[:, 2], 1e-9)
    density = alpha**2 / (math.pi * ((alpha**2 - 1) * h[:, 2] ** 2 + 1) ** 2)
    masked = 1 + sum(0.5 * (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) for c in (i, o[2]))
    fresnel = np.array(COLOR) + (1 - np.array(COLOR)) * (1 - (h * w).sum(axis=1))[:, None] ** 5
    once = albedo_once(cosine, alpha)
    fresnel *= 1 + np.array(COLOR) * (1 - once) / once
    return np.where((w[:, 2] > 0)[:, None], fresnel * (density / masked / (4 * o[2]))[:, None], 0.0)


def by_quadrature(light: LightAtShutter, cosine: float, alpha: float) -> float:
    """Radiance in the first channel."""
    return expected(light, POINT[None], 500, lambda w: lobe(w, cosine, alpha)[:, 0])[0] * light.power[0]


def test_a_point_light_is_seen_by_the_lobe():
    light = LightAtShutter("/lamp", LightKind.POINT, (1.0, 2.0, 4.0), np.array([-0.6, 0.1, 0.9]))
    to_light = light.position / np.linalg.norm(light.position)
    for alpha in (0.1, 0.5):
        truth = lobe(to_light[None], 0.8, alpha)[0] * light.power / (light.position @ light.position)
        np.testing.assert_allclose(radiance([floor(material=metal(alpha))], light, 0.8, PLACES[:4]), truth, rtol=2e-3)


@pytest.mark.parametrize("name", [name for name in LIGHTS if name != "tube"])
@pytest.mark.parametrize("alpha", [0.1, 0.5])
def test_a_light_with_extent_is_seen_as_the_integral_over_it(name, alpha):
    truth = by_quadrature(LIGHTS[name], 0.8, alpha)
    found = radiance([floor(material=metal(alpha))], LIGHTS[name], 0.8)
    assert found[0] == pytest.approx(truth, rel=WITHIN, abs=WITHIN * 1e-3)


def test_a_light_where_the_lobe_looks_is_seen_without_much_noise():
    """A wide panel over a narrow lobe: nearly all directions of the lobe meet it, and it is as bright everywhere."""
    light = lamp(ExtentShape.RECT, (-0.5, 0.0, 0.7), sizes=(2.0, 2.0))
    seen = see(SceneAtShutter(SHUTTER, (floor(material=metal(0.1)),), (light,), eye(0.8)), 1, 1, PLACES)[0]
    values = seen.direct[:, 0]
    assert values.mean() == pytest.approx(by_quadrature(light, 0.8, 0.1), rel=WITHIN)
    assert values.std() < 0.2 * values.mean()


@pytest.mark.parametrize("radius", [0.05, 0.4])
def test_a_tube_is_seen_as_the_integral_over_its_side(radius):
    light = lamp(ExtentShape.CYLINDER, (-0.6, 0.1, 0.9), (0.1, 0.3, 0.4), (0.6, 0.0), radius)
    for alpha in (0.1, 0.5):
        truth = by_quadrature(light, 0.8, alpha)
        assert radiance([floor(material=metal(alpha))], light, 0.8)[0] == pytest.approx(truth, rel=2 * WITHIN)


def test_what_is_partly_metal_is_diffuse_in_the_rest():
    light = LIGHTS["rectangle overhead"]
    diffuse, whole, part = (
        radiance([floor(material=metal(0.4, share))], light, 0.8, metals=True) for share in (0.0, 1.0, 0.25)
    )
    np.testing.assert_allclose(part, 0.75 * diffuse + 0.25 * whole, rtol=1e-4)


def test_what_hides_the_light_hides_it_in_the_metal():
    light = LIGHTS["rectangle overhead"]
    for material in (Material(), WATER):
        board = quad("/board", (-3, -3), (3, 3), 0.4, material)
        assert radiance([floor(material=metal(0.4)), board], light, 0.8).max() == 0


def test_the_same_pixel_sees_the_same_in_every_frame():
    light = LIGHTS["rectangle overhead"]
    one, other = (radiance([floor(material=metal(0.4))], light, 0.8, PLACES[:16]) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def under_dome(dome: DomeAtShutter, alpha: float, cosine: float, *others) -> np.ndarray:
    """Radiance [3] of metal under a dome, the mean of 16² pixels that look at one point."""
    source = Source(
        lambda shutter: SceneAtShutter(shutter, (floor(material=metal(alpha)), *others), (), eye(cosine), (dome,))
    )
    frame = render_frame(RenderContext(source, Settings(samples=4, photons=64, threads=1)), SHUTTER, 16, 16)
    return np.stack([frame.channels[c] for c in "RGB"], axis=-1).astype(float).mean(axis=(0, 1))


def sky(spot: float) -> DomeAtShutter:
    """A sky that is brighter towards one side, with a ``spot`` of 12° there."""
    rows, columns = np.mgrid[:256, :512]
    latitude = np.pi * (0.5 - (rows + 0.5) / 256)
    longitude = np.pi * (1 - 2 * (columns + 0.5) / 512)
    w = np.stack([np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)], -1)
    towards = w @ np.array([-0.6, 0.0, 0.8])
    radiance = 1.0 + towards + spot * (towards > math.cos(math.radians(6)))
    return DomeAtShutter("/dome", np.repeat(radiance[..., None], 3, axis=-1).astype(np.float32))


def dome_by_quadrature(dome: DomeAtShutter, alpha: float, cosine: float) -> np.ndarray:
    w, solid_angle = sphere(1_000_000)
    local = w @ dome.axes.T
    height, width = dome.radiance.shape[:2]
    column = (0.5 - np.arctan2(local[:, 0], local[:, 2]) / (2 * math.pi)) * width
    row = (0.5 - np.arcsin(local[:, 1]) / math.pi) * height
    seen = dome.radiance[np.clip(row.astype(int), 0, height - 1), column.astype(int) % width]
    return (seen * lobe(w, cosine, alpha)).sum(axis=0) * solid_angle


@pytest.mark.parametrize("alpha", [0.1, 0.5])
@pytest.mark.parametrize("spot", [0.0, 100.0])
def test_a_dome_is_seen_as_the_integral_over_the_lobe(alpha, spot):
    # A spot narrower than what one of sixteen directions stands for spreads over it: 3 %.
    found, truth = under_dome(sky(spot), alpha, 0.8), dome_by_quadrature(sky(spot), alpha, 0.8)
    np.testing.assert_allclose(found, truth, rtol=0.03 if spot else WITHIN)


def test_what_stands_before_a_dome_is_not_lit_by_it():
    board = quad("/board", (-9, -9), (9, 9), 0.9, Material(color=(0.0, 0.0, 0.0)))
    hidden, free = (under_dome(sky(0.0), 0.3, 0.8, replace(board, points=board.points - z * UP)) for z in (0, 2))
    # It ends 6° above the horizon.
    assert np.all(hidden < 0.02 * free)


WHITE_METAL = Material(color=(1.0, 1.0, 1.0), metal=1.0, roughness=0.3)
GLOW = Material(color=(0.0, 0.0, 0.0), emission=(2.0, 1.0, 0.5))


def seen_in_metal(material: Material, *others, cosine: float = 0.8, **compiled) -> np.ndarray:
    """Mean radiance [3] of metal at the origin, on all paths of 32² pixels with four samples each."""
    ground = quad("/ground", (-400, -400), (400, 400), 0.0, material)
    scene = SceneAtShutter(SHUTTER, (ground, *others), (), eye(cosine))
    k = np.arange(4 * 32**2)
    films = np.stack([k // 4 % 32, k // 128], axis=1) + 0.25 + 0.5 * np.stack([k % 2, k // 2 % 2], axis=1)
    total = np.zeros((len(films), 3))
    for seen in see(scene, 32, 32, films, samples=4, **compiled):
        np.add.at(total, seen.items, seen.direct)
    return total.mean(axis=0)


def test_rough_metal_shows_the_surfaces_around_it():
    ceiling = quad("/ceiling", (-400, -400), (400, 400), 0.9, GLOW, up=False)
    found = seen_in_metal(WHITE_METAL, ceiling)
    # A white furnace from above, but for .002 rad above the horizon: all of it, within what the table loses.
    np.testing.assert_allclose(found, GLOW.emission, rtol=0.02)
    coloured = seen_in_metal(metal(0.3), ceiling)
    w, solid_angle = sphere(400_000)
    truth = (lobe(w, 0.8, 0.3) * np.array(GLOW.emission)).sum(axis=0) * solid_angle
    # 4096 facets, of which four each are spread evenly.
    np.testing.assert_allclose(coloured, truth, rtol=0.01)


def test_what_lights_stand_for_is_not_seen_twice_in_rough_metal():
    ceiling = quad("/ceiling", (-400, -400), (400, 400), 0.9, replace(GLOW, lamp=True), up=False)
    assert seen_in_metal(WHITE_METAL, ceiling).max() == 0


def test_under_a_uniform_dome_white_metal_is_as_bright_as_the_dome():
    """Of which its branches, which meet nothing, see nothing again."""
    dome = DomeAtShutter("/dome", np.full((32, 64, 3), 3.0, np.float32))
    source = Source(lambda shutter: SceneAtShutter(shutter, (floor(material=WHITE_METAL),), (), eye(0.8), (dome,)))
    frame = render_frame(RenderContext(source, Settings(samples=4, photons=64, threads=1)), SHUTTER, 16, 16)
    assert frame.channels["R"].mean() == pytest.approx(3.0, rel=0.02)


def test_metal_that_sees_metal_sees_what_that_sees():
    """Between two sheets of white metal light goes on until it leaves or is too faint to be followed."""
    shining = replace(WHITE_METAL, emission=(1.0, 1.0, 1.0))
    wall = quad("/wall", (-400, -400), (400, 400), 0.9, shining, up=False)
    for bounces in (1, 2, 3):
        found = seen_in_metal(shining, wall, bounces=bounces)
        # 1 + 1 + …, of which the table takes up to .02 each time.
        assert (1 + bounces) * 0.98 < found.min() and found.max() < 1 + bounces
