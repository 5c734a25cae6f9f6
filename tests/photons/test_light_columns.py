"""The columns D_a x, D_b x of lights with extent: against rays of the float64 oracle through the same first hit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.traced import Written, emission_of, traced
from tests.view.scenes import WATER, bumpy, floor, looking_down, quad, turned
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    SceneAtShutter,
    Shaping,
    Shutter,
)
from tpdwarp.scene.stretched_lights import ellipsoid_of
from usd_scenes.oracle import surfaces_of, trace

STILL = Shutter.still(4)
MIRROR = Material(Interaction.MIRROR, color=(1.0, 1.0, 1.0))
AXES = turned((0.3, 0.2, 0.5))
SPANS = np.array([0.2 * AXES[0], 0.1 * AXES[1]])
LAMP = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0), np.array([0.2, 0.1, 4.0]), AXES)
LIGHTS = {
    "sun": replace(LAMP, kind=LightKind.DISTANT, extent=Extent(ExtentShape.ROUND, math.radians(1.0))),
    "sphere": replace(LAMP, extent=Extent(ExtentShape.ROUND, 0.2)),
    "disk": replace(LAMP, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.DISK, 0.0, SPANS)),
    "rect": replace(LAMP, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.RECT, 0.0, SPANS)),
    "tube": replace(
        LAMP, profile=EmissionProfile.SINE, extent=Extent(ExtentShape.CYLINDER, 0.1, SPANS * [[1.0], [0.0]])
    ),
}
LIGHTS["ellipsoid"] = ellipsoid_of(LIGHTS["sphere"], 0.2, np.diag([1.5, 0.4, 1.0]) @ AXES, np.zeros((3, 3)))
# One part in so many of the light: what is left of second order is as small a part of D_a x.
STEP = 1e-4


def scene_of(light: LightAtShutter, meshes) -> SceneAtShutter:
    return SceneAtShutter(STILL, tuple(meshes), (light,), looking_down())


def water():
    return [floor(), bumpy("/water", WATER, 1.0, False)]


def water_under_a_lens():
    return [*water(), bumpy("/more", Material(Interaction.DIELECTRIC, ior=1.5), 2.0, False)]


def directions_across(light: LightAtShutter, w: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Columns D ω [n, 2, 3] of directions from the places on the light to a point, times a place's deviation."""
    extent = light.extent
    frames = np.stack([np.linalg.svd(direction[None])[2][1:] for direction in w])
    if light.kind == LightKind.DISTANT:
        return 0.5 * math.sin(extent.radius) * frames
    d = np.linalg.norm(origin - light.position, axis=1)[:, None, None]
    if extent.shape == ExtentShape.ROUND:
        return 0.5 * extent.radius * frames / d
    if extent.shape == ExtentShape.ELLIPSOID:
        # Two radii across the view where it is the unit sphere.
        views = (origin - light.position) @ np.linalg.inv(extent.spans)
        radii = np.array([np.linalg.svd(view[None])[2][1:] @ extent.spans for view in views])
        along = np.einsum("nkj,nj->nk", radii, w)[:, :, None] * w[:, None]
        return 0.5 * (along - radii) / d
    deviation = 0.5 if extent.shape == ExtentShape.DISK else 1 / math.sqrt(3)
    spans = np.broadcast_to(deviation * extent.spans, (len(w), 2, 3))
    if extent.shape == ExtentShape.CYLINDER:
        # Of one radiance, it is as bright over all angles about its axis.
        axis, (off, place) = extent.spans[0] / np.linalg.norm(extent.spans[0]), seen_of_cylinder(light, origin)
        turns = deviation * extent.radius / np.linalg.norm(off, axis=1, keepdims=True) * np.cross(w, axis)
        d = np.linalg.norm(origin - place, axis=1)[:, None]
        along = deviation * extent.spans[0]
        return np.stack([((w @ along)[:, None] * w - along) / d, turns], axis=1)
    along = np.einsum("nkj,nj->nk", spans, w)[:, :, None] * w[:, None]
    return (along - spans) / d


def seen_of_cylinder(light: LightAtShutter, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From the axis of a cylinder across it to points, and the middle of its side that is seen from there, [n, 3]."""
    axis = light.extent.spans[0] / np.linalg.norm(light.extent.spans[0])
    off = origin - light.position
    off = off - (off @ axis)[:, None] * axis
    # The mean of √(1 − b²) over chords.
    before = 0.25 * math.pi * light.extent.radius * off / np.linalg.norm(off, axis=1, keepdims=True)
    return off, light.position + before


@pytest.mark.parametrize("meshes", [water, water_under_a_lens])
@pytest.mark.parametrize("name", LIGHTS)
def test_the_light_spans_what_rays_from_its_places_through_the_first_surface_do(name, meshes):
    scene = scene_of(LIGHTS[name], meshes())
    result = traced(Written(scene), 256, shutter=STILL, place=(0.0, 0.0))
    rows = np.flatnonzero(result.masks == 0)
    photons = result.photons.rows(rows)
    surfaces = surfaces_of(scene)
    origins, w = emission_of(result, rows=rows)
    middle = trace(surfaces, origins, w, 4.0)
    first = middle.points[0]
    if name == "tube":
        w = first - seen_of_cylinder(LIGHTS[name], first)[1]
        middle = trace(surfaces, first - 0.5 * w, w, 4.0)
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    columns = directions_across(LIGHTS[name], w, first)
    kept = middle.landed & np.all(np.abs(middle.positions - photons.positions) < 1e-3, axis=1)
    moved = []
    for k in (0, 1):
        ends = []
        for sign in (1, -1):
            turned_w = w + sign * STEP * columns[:, k]
            path = trace(surfaces, first - 0.5 * turned_w, turned_w, 4.0, along=middle)
            ends.append(path.positions)
            kept &= path.landed
        moved.append((ends[0] - ends[1]) / (2 * STEP))
    truth = np.einsum("kni,knj->nij", moved, moved)
    spread = np.einsum("ni,nj->nij", photons.dxda, photons.dxda) + np.einsum("ni,nj->nij", photons.dxdb, photons.dxdb)
    box = LIGHTS[name].extent.shape in (ExtentShape.RECT, ExtentShape.CYLINDER)
    spread *= (1.0 / 3.0) if box else 0.25
    assert kept.sum() > 0.7 * len(rows) > 20
    size = np.sqrt(np.einsum("nii->n", truth))[kept, None, None]
    # Paths near the edges of triangles take the next one: few do.
    apart = np.abs(spread[kept] - truth[kept]).max(axis=(1, 2)) / size[:, 0, 0] ** 2
    assert np.quantile(apart, 0.9) < 2e-3


def test_a_flat_interface_spreads_the_sun_by_its_depth():
    light = LightAtShutter("/sun", LightKind.DISTANT, (1.0,) * 3, extent=Extent(ExtentShape.ROUND, math.radians(2.5)))
    sheet = quad("/water", (-2, -2), (2, 2), 1.0, WATER)
    result = traced(Written(scene_of(light, [floor(), sheet])), 64, shutter=STILL)
    expected = math.sin(math.radians(2.5)) / 1.33
    for column in (result.photons.dxda, result.photons.dxdb):
        np.testing.assert_allclose(np.linalg.norm(column, axis=1), expected, rtol=1e-5)
    np.testing.assert_allclose(np.einsum("ni,ni->n", result.photons.dxda, result.photons.dxdb), 0, atol=1e-9)


def test_a_plane_mirror_spreads_a_lamp_by_the_distances_after_and_before_it():
    """Through a point of the mirror, d from the lamp and d' from the floor, the lamp is seen d'/d as large."""
    extent = Extent(ExtentShape.ROUND, 0.1)
    light = LightAtShutter("/lamp", LightKind.POINT, (1.0,) * 3, np.array([0.0, 0.0, 0.5]), extent=extent)
    scene = scene_of(light, [floor(), quad("/mirror", (-0.1, -0.1), (0.1, 0.1), 2.0, MIRROR, up=False)])
    photons = traced(Written(scene), 64, shutter=STILL).photons
    np.testing.assert_allclose(np.linalg.norm(photons.dxda, axis=1), 0.1 * 2.0 / 1.5, rtol=0.02)


@pytest.mark.parametrize("radii", [(1.5, 0.4, 1.0), (3.0, 2.0, 0.05), (1.0, 1.0, 9.0)])
def test_photons_of_an_ellipsoid_bring_what_all_of_its_surface_sends_to_the_first_one(radii):
    """By the flux of its middle: equal parts of a sphere, carried along, send (N · ω) (ω · n)/d² of their area."""
    light = ellipsoid_of(LIGHTS["sphere"], 0.1, np.diag(radii) @ AXES, np.zeros((3, 3)))
    level = 2.0
    clear = quad("/clear", (-3, -3), (3, 3), level, Material(Interaction.DIELECTRIC, ior=1.0))
    scene = scene_of(light, [floor(), clear])
    middle, whole = (traced(Written(scene), 256, shutter=STILL, place=p).photons for p in ((0.0, 0.0), None))
    assert np.array_equal(middle.ids, whole.ids)
    first = LAMP.position + (middle.positions - LAMP.position) * (1.0 - level / LAMP.position[2])
    u, v = ((np.arange(200) + 0.5) / 200 for _ in range(2))
    height, turn = (axis.ravel() for axis in np.meshgrid(2.0 * u - 1.0, 2.0 * np.pi * v))
    level_of = np.sqrt(1.0 - height**2)
    outward = np.stack([level_of * np.cos(turn), level_of * np.sin(turn), height], axis=1)
    spans = light.extent.spans
    vectors = outward @ np.linalg.inv(spans).T * (4.0 * math.pi * abs(np.linalg.det(spans)) / len(outward))
    area = np.linalg.norm(vectors, axis=1).sum()
    sent = []
    for x in first:
        d = x - LAMP.position - outward @ spans
        squares = np.einsum("ni,ni->n", d, d)
        sent.append((np.maximum((vectors * d).sum(axis=1), 0.0) * np.maximum(-d[:, 2], 0.0) / squares**2).sum())
    off = first - LAMP.position
    distance = np.linalg.norm(off, axis=1)
    shown = np.linalg.norm(off @ light.shown.T, axis=1) / distance
    alone = 0.25 * area * shown * -off[:, 2] / distance**3
    np.testing.assert_allclose(whole.flux[:, 0] / middle.flux[:, 0], np.array(sent) / alone, rtol=5e-3)


@pytest.mark.parametrize("height", [0.02, 0.1, 0.15, 0.3])
@pytest.mark.parametrize("shape", [ExtentShape.DISK, ExtentShape.RECT])
def test_all_the_light_of_a_lamp_close_above_a_sheet_passes_it_once(shape, height):
    """All of its places send as much through a wide sheet as its middle does, wherever light of one direction is told
    apart from that through one point."""
    light = replace(
        LAMP,
        position=np.array([0.1, 0.05, 0.2 + height]),
        axes=np.eye(3),
        profile=EmissionProfile.COSINE,
        extent=Extent(shape, 0.0, 0.15 * np.eye(3)[:2]),
    )
    clear = quad("/clear", (-3, -3), (3, 3), 0.2, Material(Interaction.DIELECTRIC, ior=1.0))
    wide = quad("/wide", (-30, -30), (30, 30), 0.0, floor().materials[0])
    scene = scene_of(light, [wide, clear])
    middle, whole = (traced(Written(scene), 4096, shutter=STILL, place=p).photons for p in ((0.0, 0.0), None))
    assert whole.flux.sum() == pytest.approx(middle.flux.sum(), rel=5e-3)


@pytest.mark.parametrize("name", ["disk", "rect"])
def test_photons_land_where_the_middle_of_their_light_does_with_its_mean_flux(name):
    """Straight on through a sheet of index one: the mean over places, each of which sends cos θ_l cos θ / d² to it."""
    level, extent = 2.0, LIGHTS[name].extent
    clear = quad("/clear", (-3, -3), (3, 3), level, Material(Interaction.DIELECTRIC, ior=1.0))
    scene = scene_of(LIGHTS[name], [floor(), clear])
    middle, whole = (traced(Written(scene), 256, shutter=STILL, place=p).photons for p in ((0.0, 0.0), None))
    assert np.array_equal(middle.ids, whole.ids)
    landed, lamp = middle.positions, LAMP.position
    first = lamp + (landed - lamp) * ((level - lamp[2]) / (landed[:, 2:] - lamp[2]))
    moments, count = np.zeros((len(first), 7)), 0
    steps = (2 * np.arange(24) + 1) / 24 - 1
    axes = extent.spans
    for a in steps:
        for b in steps:
            if name != "rect" and a * a + b * b >= 1:
                continue
            offset = a * axes[0] + b * axes[1]
            d = first - (lamp + offset)
            distance = np.linalg.norm(d, axis=1)
            sent = -d[:, 2] / distance**3
            sent *= np.maximum(-d @ AXES[2], 0) / distance
            there = first + d * (level / -d[:, 2:])
            moments += np.column_stack([sent, sent[:, None] * there, there])
            count += 1
    d = first - lamp
    distance = np.linalg.norm(d, axis=1)
    alone = -d[:, 2] / distance**3 * np.maximum(-d @ AXES[2], 0) / distance
    kept = moments[:, 0] > 0.05 * moments[:, 0].max()
    # The light is a tenth as large as it is far off: what these orders leave is a hundredth of what they are.
    mean = moments[kept, 0] / count
    np.testing.assert_allclose(whole.flux[kept, 0] / middle.flux[kept, 0], mean / alone[kept], rtol=2e-3)
    shift = moments[kept, 1:4] / moments[kept, :1] - moments[kept, 4:] / count
    size = np.linalg.norm(shift, axis=1).max()
    assert size > 1e-3
    np.testing.assert_allclose((whole.positions - middle.positions)[kept], shift, atol=0.05 * size)


@pytest.mark.parametrize("height", [1.1, 1.6])
@pytest.mark.parametrize("shape", [ExtentShape.DISK, ExtentShape.RECT])
def test_light_of_a_lamp_nearly_as_wide_as_it_is_far_off_deviates_as_its_places_do_by_their_flux(shape, height):
    """Below its middle through a sheet of index one: flux, and second moments where light lands."""
    half, level = 0.4, 2.0
    clear = quad("/clear", (-0.1, -0.1), (0.1, 0.1), level, Material(Interaction.DIELECTRIC, ior=1.0))
    lamp = LightAtShutter(
        "/lamp", LightKind.POINT, (1.0,) * 3, np.array([0.0, 0.0, level + height]),
        profile=EmissionProfile.COSINE, extent=Extent(shape, 0.0, half * np.eye(3)[:2]),
    )  # fmt: skip
    scene = scene_of(lamp, [floor(), clear])
    middle, whole = (traced(Written(scene), 64, shutter=STILL, place=p).photons for p in ((0.0, 0.0), None))
    near = np.argmin(np.linalg.norm(whole.positions[:, :2], axis=1))
    steps = half * ((2 * np.arange(100) + 1) / 100 - 1)
    x, y = (values.ravel() for values in np.meshgrid(steps, steps))
    within = x**2 + y**2 < half**2 if shape == ExtentShape.DISK else np.ones(len(x), bool)
    x, y = x[within], y[within]
    # cos θ_l cos θ / d², and where that light lands, x/height of the level aside.
    sent = height**2 / (height**2 + x**2 + y**2) ** 2
    assert whole.flux[near, 0] / middle.flux[near, 0] == pytest.approx(sent.mean() * height**2, rel=0.015)
    width = np.sqrt(np.sum(sent * (x * level / height) ** 2) / sent.sum())
    k = 0.25 if shape == ExtentShape.DISK else 1.0 / 3.0
    derivative = math.sqrt(k) * half * level / height
    found = math.sqrt(k) * np.linalg.norm(whole.dxda[near])
    # Places spread farther by their tangents than by their chords.
    assert abs(found - width) < 0.5 * (derivative - width)


def test_spheres_and_suns_send_as_much_through_a_sheet_as_their_middles_would_and_more_where_that_grazes():
    """Irradiance of a sphere is a point's, as its places lie in its depth, too, but for what the horizon hides."""
    clear = quad("/clear", (-3, -3), (3, 3), 2.0, Material(Interaction.DIELECTRIC, ior=1.0))
    for name in ("sphere", "sun"):
        scene = scene_of(replace(LIGHTS[name], axes=np.eye(3)), [floor(), clear])
        middle, whole = (traced(Written(scene), 256, shutter=STILL, place=p).photons for p in ((0.0, 0.0), None))
        np.testing.assert_allclose(whole.flux, middle.flux, rtol=1e-5)
    # Half of a sun of 180 degrees lies above a horizon that meets its middle, and shines on it by (1 + cos θ)/2.
    tilt = math.radians(70.0)
    wide = replace(LIGHTS["sun"], axes=turned((0.0, tilt, 0.0)).T, extent=Extent(ExtentShape.ROUND, 0.5 * math.pi))
    whole, middle = (
        traced(Written(scene_of(light, [floor(), clear])), 256, shutter=STILL).photons.flux.sum()
        for light in (wide, replace(wide, extent=None))
    )
    assert whole / middle == pytest.approx(0.5 * (1.0 + math.cos(tilt)) / math.cos(tilt), rel=1e-3)


@pytest.mark.parametrize("name", ["sphere", "disk"])
def test_a_cone_lets_as_much_light_of_a_light_with_extent_through_a_sheet_as_of_its_middle(name):
    """Each place has its own cone, which is as wide where it meets the sheet: where it leaves out the light's middle,
    light from its rim may fall all the same."""
    clear = quad("/clear", (-3, -3), (3, 3), 2.0, Material(Interaction.DIELECTRIC, ior=1.0))
    cone = Shaping(math.radians(15.0), softness=0.3)
    lamp = replace(LIGHTS[name], shaping=cone, axes=np.eye(3))
    if name == "disk":
        lamp = replace(lamp, extent=replace(lamp.extent, spans=0.2 * np.eye(3)[:2]))
    soft, point = (
        traced(Written(scene_of(light, [floor(), clear])), 4096, shutter=STILL).photons
        for light in (lamp, replace(lamp, extent=None))
    )
    # Penumbras a fifth as wide as the light is far off, as five places have it.
    assert soft.flux.sum() == pytest.approx(point.flux.sum(), rel=0.02)
    assert np.ptp(soft.positions[:, 0]) > 1.1 * np.ptp(point.positions[:, 0])


def test_light_of_one_direction_comes_from_all_of_a_panel_that_lies_on_a_sheet():
    """Through one point of the sheet it would come from everywhere; each photon lands as far aside as the panel is."""
    clear = quad("/clear", (-3, -3), (3, 3), 2.0, Material(Interaction.DIELECTRIC, ior=1.0))
    spans = 0.3 * np.eye(3)[:2]
    panel = replace(LIGHTS["rect"], axes=np.eye(3), position=np.array([0.0, 0.0, 2.01]))
    panel = replace(panel, extent=Extent(ExtentShape.RECT, 0.0, spans))
    photons = traced(Written(scene_of(panel, [floor(), clear])), 256, shutter=STILL).photons
    np.testing.assert_allclose(photons.dxda, np.broadcast_to(spans[0], photons.dxda.shape), atol=1e-3)
    np.testing.assert_allclose(photons.dxdb, np.broadcast_to(spans[1], photons.dxdb.shape), atol=1e-3)


def test_scenes_without_extent_carry_no_columns():
    light = replace(LIGHTS["sun"], extent=None)
    assert len(traced(Written(scene_of(light, water())), 64, shutter=STILL).photons.dxda) == 0


def test_columns_ride_on_moving_surfaces_as_they_do_on_still_ones():
    still = scene_of(LIGHTS["sun"], water())
    moving = replace(
        still, shutter=Shutter(4, 3.5, 4.5), meshes=(still.meshes[0], bumpy("/water", WATER, 1.0, True))
    )
    one, other = (traced(Written(scene), 128, shutter=scene.shutter).photons for scene in (still, moving))
    assert len(one) == len(other)
    np.testing.assert_allclose(one.dxda, other.dxda, rtol=1e-6, atol=1e-9)
