"""Lights with extent cut into parts, and into points: together they are the light."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import WATER, quad
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
    Shaping,
    Shutter,
)
from tpdwarp.scene.light_cuts import LightCuts
from tpdwarp.scene.light_places import parts_of, pieces_of_disc, place_lights, split_lights, whole_of

SPANS = np.array([[0.3, 0.1, 0.0], [-0.05, 0.2, 0.1]])
SPANS_MOTION = np.array([[0.0, 0.0, 0.1], [0.02, 0.0, 0.0]])
PLACE = np.array([1.0, 2.0, 3.0])
FLAT = (ExtentShape.RECT, ExtentShape.DISK)
TILT = 0.1


def point(extent: Extent, profile: EmissionProfile = EmissionProfile.UNIFORM) -> LightAtShutter:
    return LightAtShutter("/lamp", LightKind.POINT, (4.0, 2.0, 1.0), PLACE, profile=profile, extent=extent)


SPHERE = point(Extent(ExtentShape.ROUND, 0.5))
DISK = point(Extent(ExtentShape.DISK, 0.0, SPANS, SPANS_MOTION), EmissionProfile.COSINE)
RECT = point(Extent(ExtentShape.RECT, 0.0, SPANS, SPANS_MOTION), EmissionProfile.COSINE)
TUBE = point(Extent(ExtentShape.CYLINDER, 0.1, np.array([[0.7, 0, 0], [0, 0, 0]])), EmissionProfile.SINE)
LONG = point(Extent(ExtentShape.CYLINDER, 0.25, np.array([[0.8, 0, 0], [0, 0, 0]])), EmissionProfile.SINE)
DRUM = point(Extent(ExtentShape.CYLINDER, 0.3, np.array([[0.4, 0, 0], [0, 0, 0]])), EmissionProfile.SINE)
SUN = LightAtShutter("/sun", LightKind.DISTANT, (4.0, 2.0, 1.0), extent=Extent(ExtentShape.ROUND, TILT))
LIGHTS = {"sphere": SPHERE, "disk": DISK, "rect": RECT, "tube": TUBE, "drum": DRUM, "sun": SUN}


def scene(light: LightAtShutter) -> SceneAtShutter:
    return SceneAtShutter(Shutter.still(0), (), (light,))


def variance(light: LightAtShutter) -> np.ndarray:
    """Covariance [3, 3] of the power of a light over its places (a sun's: over the sines of its directions)."""
    extent = light.extent
    if extent is None:
        return np.zeros((3, 3))
    if light.kind == LightKind.DISTANT and extent.shape == ExtentShape.ROUND:
        return 0.25 * math.sin(extent.radius) ** 2 * np.diag([1.0, 1.0, 0.0])
    if extent.shape == ExtentShape.ROUND:
        return 0.25 * extent.radius**2 * np.eye(3)
    if extent.shape == ExtentShape.CYLINDER:
        axis = np.outer(extent.spans[0], extent.spans[0])
        # All of its surface, of which half is seen from any one side.
        return axis / 3.0 + extent.radius**2 / 2.0 * np.diag([0.0, 1.0, 1.0])
    return (0.25 if extent.shape == ExtentShape.DISK else 1.0 / 3.0) * extent.spans.T @ extent.spans


def places(lights: list[LightAtShutter]) -> np.ndarray:
    """Where lights stand, shape [n, 3]; of suns, the sines of the directions that they come from."""
    if lights[0].kind == LightKind.DISTANT:
        return np.array([light.axes[2] * [1, 1, 0] for light in lights])
    return np.array([light.position for light in lights])


@pytest.mark.parametrize("name", [name for name in LIGHTS if name not in ("tube", "drum")])
@pytest.mark.parametrize("count", [7, 19, 64])
def test_parts_have_the_power_the_middle_and_the_variance_of_the_whole(name, count):
    light = LIGHTS[name]
    parts = parts_of(light, count, np.array([PLACE - [0.0, 0.0, 3.0]] * 2))
    assert len({part.path for part in parts}) == len(parts) and {whole_of(part.path) for part in parts} == {light.path}
    there = places(parts)
    np.testing.assert_allclose(there.mean(axis=0), places([light])[0], atol=1e-12)
    spread = np.cov(there.T, bias=True) + np.mean([variance(part) for part in parts], axis=0)
    whole = variance(light)
    # Rectangles are wider than pieces of rings of their area.
    allowed = 1e-12 if name in ("rect",) else 0.03
    across = slice(None) if name == "sun" or light.extent.shape in FLAT else slice(0, 2)
    np.testing.assert_allclose(spread[across, across], whole[across, across], atol=allowed * np.trace(whole))
    if name != "sun":
        np.testing.assert_allclose(np.sum([part.power for part in parts], axis=0), light.power, rtol=1e-12)


def test_the_parts_of_a_sphere_are_a_cloud_of_its_depth():
    """As deep as wide, and no deeper on one side than on another; none lies outside."""
    for count in (7, 19, 61):
        view = np.array([0.36, -0.48, 0.8])
        there = places(parts_of(SPHERE, count, np.array([PLACE + 4.0 * view] * 2))) - PLACE
        depth, radius = there @ view, SPHERE.extent.radius
        # But for the part in the middle, which lies there.
        assert depth @ depth / count == pytest.approx(0.25 * radius**2, abs=radius**2 * 0.6 / count)
        assert np.abs(there.T @ depth - view * (depth @ depth)).max() < 1e-9
        assert np.linalg.norm(there, axis=1).max() < radius


@pytest.mark.parametrize(("light", "count"), [(TUBE, 7), (TUBE, 64), (DRUM, 19)])
def test_the_parts_of_a_cylinder_shine_as_it_does_all_around(light, count):
    """I sin α; a prism of n faces is as wide as a cylinder within 1 − cos(π/n) or so."""
    parts = parts_of(light, count)
    flat = parts[0].extent.shape == ExtentShape.RECT
    lengths = len({round(float((part.position - PLACE) @ part.axes[0]), 9) for part in parts})
    faces = len(parts) // lengths if flat else 1
    for part in parts:
        np.testing.assert_allclose(part.axes @ part.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(part.axes) > 0
        # On the surface, or along the axis.
        offset = part.position - PLACE
        assert np.linalg.norm(offset[1:]) == pytest.approx(light.extent.radius if faces > 1 else 0.0, rel=0.1)
    assert len({part.path for part in parts}) == len(parts)
    for direction in np.random.default_rng(3).normal(size=(50, 3)):
        w = direction / np.linalg.norm(direction)
        sine = math.sqrt(1 - w[0] ** 2)
        if faces == 1:
            total = sum(part.power[0] for part in parts) * sine
        else:
            total = sum(part.power[0] * max(0.0, -part.axes[2] @ w) for part in parts)
        assert total == pytest.approx(light.power[0] * sine, rel=1e-12 if faces == 1 else 1 - math.cos(math.pi / faces))


def test_prisms_along_a_cylinder_are_together_as_wide_from_all_sides():
    """Six of six faces: one of them is 9 % narrower from before an edge, and 5 % wider from before a face."""
    parts = parts_of(LONG, 19)
    assert len(parts) == 36
    for turn in np.linspace(0.0, math.pi / 3.0, 13):
        w = np.array([0.0, math.cos(turn), math.sin(turn)])
        total = sum(part.power[0] * max(0.0, -part.axes[2] @ w) for part in parts)
        assert total == pytest.approx(LONG.power[0], rel=0.015)


@pytest.mark.parametrize("light", [TUBE, DRUM])
def test_the_parts_of_a_cylinder_keep_the_axis_of_its_cone(light):
    """Faces look all around, and their own −z is their normal; the cone is that of the whole."""
    light = replace(light, shaping=Shaping(0.5), axes=np.eye(3)[[2, 0, 1]])
    parts = parts_of(light, 16)
    assert len(parts) >= 16 and all(part.shaping == light.shaping for part in parts)
    np.testing.assert_allclose([part.cone_axis[0] for part in parts], [-light.axes[2]] * len(parts), atol=1e-12)


def test_faces_of_a_cylinder_that_shine_away_from_the_glass_are_left_out():
    glass = MeshAtShutter(
        "/glass",
        np.array([[1.0, 2.0, 1.0], [2.0, 2.0, 1.0], [1.0, 3.0, 1.0]]),
        np.array([[0, 1, 2]], np.int32),
        materials=(Material(Interaction.DIELECTRIC),),
    )
    lit = split_lights(SceneAtShutter(Shutter.still(0), (glass,), (DRUM,)), LightCuts(19)).lights
    assert 0.4 * len(parts_of(DRUM, 19)) < len(lit) < 0.7 * len(parts_of(DRUM, 19))
    assert all(((glass.points - part.position) @ -part.axes[2]).max() > -1e-3 for part in lit)


@pytest.mark.parametrize(
    ("radius", "count", "part"), [(0.4, 61, 0.0), (0.4, 7, 0.0), (2.2, 169, 1.0), (2.2, 19, None), (20.0, 19, 1.0)]
)
def test_a_sphere_that_glass_sees_from_about_one_direction_is_a_flat_disc(radius, count, part):
    """From 3 away glass of that radius sees it within 10, 45 and 85°; in between discs are as deep in part."""
    glass = quad("/glass", (-radius, -radius), (radius, radius), PLACE[2] - 3.0, WATER)
    glass = replace(glass, points=glass.points + np.array([*PLACE[:2], 0.0]))
    lit = split_lights(SceneAtShutter(Shutter.still(0), (glass,), (SPHERE,)), LightCuts(count)).lights
    depths = places(lit)[:, 2] - PLACE[2]
    whole = places(parts_of(SPHERE, count, np.array([PLACE - (0.0, 0.0, 3.0)] * 2)))[:, 2] - PLACE[2]
    found = np.abs(depths).max() / np.abs(whole).max()
    assert 0.0 < found < 1.0 if part is None else found == pytest.approx(part, abs=1e-9)


@pytest.mark.parametrize(("count", "spread"), [(7, 0.1), (19, 0.2), (61, 0.3), (169, 0.1)])
def test_the_parts_of_a_sphere_send_its_irradiance_however_deep_they_are(count, spread):
    """I/d², as harmonic as that is; a flat disc at a sixth of its distance sends 1 − ¾ (R/d)², 2 % less."""
    away = 6.0 * SPHERE.extent.radius
    middle = PLACE - (0.0, 0.0, away)
    nodes = math.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
    total = 0.0
    for light in parts_of(SPHERE, count, np.array([middle] * 2), spread):
        at = [light.position + np.array([a, b]) @ light.extent.spans - middle for a in nodes for b in nodes]
        weights = np.outer([5, 8, 5], [5, 8, 5]).ravel() / 324.0
        total += light.power[0] * float(weights @ [way[2] / np.linalg.norm(way) ** 3 for way in at])
    assert total == pytest.approx(SPHERE.power[0] / away**2, rel=4e-3)


def test_parts_of_a_sphere_that_the_glass_goes_round_move_steadily_with_it():
    """By so much as they would between two shutters before and after, to second order; none jumps."""
    turns = np.linspace(0.0, 2.0 * math.pi, 33)
    ring = PLACE + np.stack([3 * np.cos(turns), 3 * np.sin(turns), np.full(33, -2.0)], axis=1)
    for opened, closed in itertools.pairwise(ring):
        views = (opened,) * 2, (opened, closed), (closed,) * 2
        parts = [parts_of(SPHERE, 19, np.array(view)) for view in views]
        first, _, last = (places(found) for found in parts)
        motion = np.array([part.position_motion for part in parts[1]])
        np.testing.assert_allclose(motion, last - first, atol=0.1 * (turns[1] * 0.5) ** 2)
        assert np.linalg.norm(motion, axis=1).max() < 2 * turns[1] * 0.5


def test_the_parts_of_a_sun_give_its_irradiance_across_its_direction():
    parts = parts_of(SUN, 32)
    total = np.sum([np.array(part.power) * part.axes[2, 2] for part in parts], axis=0)
    np.testing.assert_allclose(total, SUN.power, rtol=1e-12)
    for part in parts:
        np.testing.assert_allclose(part.axes @ part.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(part.axes) > 0


@pytest.mark.parametrize("degrees", [20.0, 90.0, 160.0, 180.0])
def test_the_parts_of_a_wide_sun_give_its_irradiance_on_any_plane_and_fill_its_part_of_the_sky(degrees):
    half = math.radians(0.5 * degrees)
    light = replace(SUN, extent=Extent(ExtentShape.ROUND, half))
    parts = parts_of(light, 397)
    towards = np.array([part.axes[2] for part in parts])
    power = np.array([part.power[0] for part in parts])
    # ---- The integral over its directions, by solid angle, and that of radiance over the whole of it
    u, v = (axis.ravel() for axis in np.meshgrid((np.arange(600) + 0.5) / 600, (np.arange(600) + 0.5) / 600))
    z = 1.0 - (1.0 - math.cos(half)) * u
    level, turn = np.sqrt(1.0 - z**2), 2.0 * np.pi * v
    sky = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1) @ light.axes
    radiance, angle = light.power[0] / (math.pi * math.sin(half) ** 2), 2.0 * math.pi * (1.0 - math.cos(half))
    for tilt in (0.0, 40.0, 80.0):
        normal = np.array([math.sin(math.radians(tilt)), 0.0, math.cos(math.radians(tilt))]) @ light.axes
        expected = radiance * angle * np.maximum(sky @ normal, 0.0).mean()
        assert power @ np.maximum(towards @ normal, 0.0) == pytest.approx(expected, rel=0.01)
    spans = np.array([part.extent.spans for part in parts])
    np.testing.assert_allclose(np.einsum("nki,ni->nk", spans, towards), 0.0, atol=1e-12)
    sizes = np.linalg.norm(np.cross(spans[:, 0], spans[:, 1]), axis=1)
    assert 4.0 * sizes[1:].sum() + math.pi * sizes[0] == pytest.approx(angle, rel=0.02)


@pytest.mark.parametrize("name", LIGHTS)
def test_places_have_the_variance_of_the_light(name):
    light, count = LIGHTS[name], 1024
    lights = [place_lights(scene(light), number, count).lights[0] for number in range(count)]
    assert all(found.extent is None and found.path == light.path for found in lights)
    there = places(lights)
    np.testing.assert_allclose(there.mean(axis=0), places([light])[0], atol=5e-3 * math.sqrt(np.trace(variance(light))))
    np.testing.assert_allclose(np.cov(there.T, bias=True), variance(light), atol=1e-2 * np.trace(variance(light)))


@pytest.mark.parametrize("axis", [(0, 0, 1), (0.6, 0, 0.8), (0.48, 0.6, 0.64)])
def test_a_sphere_looks_like_a_disc_of_one_radiance_from_everywhere(axis):
    """Places of a uniform disc lie within the radius r for the part r² of them."""
    count = 4096
    there = places([place_lights(scene(SPHERE), number, count).lights[0] for number in range(count)]) - PLACE
    across = np.linalg.norm(there - np.outer(there @ axis, axis), axis=1) / SPHERE.extent.radius
    for radius in (0.25, 0.5, 0.75, 0.9):
        assert np.mean(across < radius) == pytest.approx(radius**2, abs=0.01)


def test_a_part_moves_with_its_place_on_the_light():
    for part in parts_of(RECT, 4):
        place = np.linalg.lstsq(SPANS.T, part.position - PLACE, rcond=None)[0]
        np.testing.assert_allclose(part.position_motion, place @ SPANS_MOTION, atol=1e-12)


@pytest.mark.parametrize("count", [1, 7, 19, 37, 61])
def test_pieces_cover_a_disc_once(count):
    """Pieces are sectors of rings: rectangles of their area overlap or leave what the ring curves by."""
    pieces = pieces_of_disc(count)
    assert len(pieces) == count
    points = np.random.default_rng(2).uniform(-1, 1, (20000, 2))
    covered = np.zeros(len(points))
    for number, (place, sides) in enumerate(pieces):
        local = (points - place) @ np.linalg.inv(sides)
        covered += np.hypot(*local.T) < 1 if number == 0 else np.abs(local).max(axis=1) < 1
    inside = np.hypot(*points.T) < 0.97
    assert np.mean(np.abs(covered[inside] - 1)) < (0.17 if count > 1 else 1e-9)
    areas = [math.pi * np.linalg.det(pieces[0][1]), *(4 * abs(np.linalg.det(sides)) for _, sides in pieces[1:])]
    np.testing.assert_allclose(areas, math.pi / count, rtol=1e-12)


def test_one_part_is_the_light_itself():
    whole = scene(SPHERE)
    assert split_lights(whole, LightCuts(1)) is whole


def test_lights_without_extent_are_not_split():
    bare = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0))
    whole = SceneAtShutter(Shutter.still(0), (), (bare, SPHERE))
    assert split_lights(whole, LightCuts(7)).lights[0] is bare and len(split_lights(whole, LightCuts(7)).lights) == 8


@pytest.mark.parametrize("count", [37, 61, 127])
def test_as_much_of_an_upright_panel_stands_above_the_water_as_there_is(count):
    """Parts that the water all but touches are points, which stand at all heights."""
    half = 0.3
    extent = Extent(ExtentShape.RECT, 0.0, half * np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    light = replace(point(extent, EmissionProfile.COSINE), position=np.zeros(3), axes=axes)
    errors = []
    for level in np.linspace(-0.5, 0.5, 21):
        water = quad("/water", (-2, -2), (2, 2), level * half, WATER)
        lit = split_lights(SceneAtShutter(Shutter.still(0), (water,), (light,)), LightCuts(count)).lights
        assert any(part.extent is None for part in lit)
        above = sum(part.power[0] for part in lit if part.position[2] > level * half) / light.power[0]
        errors.append(above - 0.5 * (1.0 - level))
    # Rows of points in the middles of parts err by half of a row: .051, .035 and .024.
    assert np.sqrt(np.mean(np.square(errors))) < 0.8 / count + 0.001
