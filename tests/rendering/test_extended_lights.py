"""Whole frames under lights with extent: closed forms, limits, and splits against sums over points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, quad, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
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
from tpdwarp.settings import Settings
from usd_scenes import brute_force
from usd_scenes.brute_force.description import DIELECTRIC, DIFFUSE
from usd_scenes.in_memory import Source
from usd_scenes.oracle.closed_forms import fresnel_reflectance

STILL, OPEN = Shutter(0, 0, 0), Shutter(0, 0, 1)
BELOW = looking_down(height=0.6)


def sun(degrees: float, **changes) -> LightAtShutter:
    return replace(SUN, extent=Extent(ExtentShape.ROUND, math.radians(0.5 * degrees)) if degrees else None, **changes)


def irradiance(source, width=48, height=40, shutter=STILL, **settings) -> np.ndarray:
    """Irradiance from photons, first channel, float64."""
    options = {"photons": 1 << 14, "samples": 4, "threads": 1, "aovs": ("irradiance",), "light_splits": 1, **settings}
    frame = render_frame(RenderContext(source, Settings(**options)), shutter, width, height)
    return frame.channels["irradiance.R"].astype(np.float64)


def beauty(source, width=48, height=40, shutter=STILL, **settings) -> np.ndarray:
    options = {"photons": 1 << 14, "samples": 4, "threads": 1, "light_splits": 1, **settings}
    return render_frame(RenderContext(source, Settings(**options)), shutter, width, height).channels["R"].astype(float)


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square of the error by that of the truth."""
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2)))


@pytest.mark.parametrize("degrees", [2.0, 6.0])
def test_the_edge_of_light_through_a_flat_interface_is_as_wide_as_the_sun_makes_it(degrees):
    """Within the penumbra, the part of the disc on one side of a chord; elsewhere as without extent."""
    depth = 1.0
    sheet = quad("/water", (-1, -1), (0, 1), depth, WATER)
    radius = depth * math.tan(math.asin(math.sin(math.radians(0.5 * degrees)) / 1.33))
    half = 2.0 * radius
    camera = looking_down((-half, half, -half / 4, half / 4), height=0.5)
    found = irradiance(steady([floor(), sheet], (sun(degrees),), camera), 64, 16, photons=1 << 18).mean(axis=0)
    x = (np.arange(64) + 0.5) / 32 - 1
    s = np.clip(-half * x / radius, -1, 1)
    # Bent towards the vertical, light meets the floor as much nearer to it, which cancels at first order.
    passed = 1 - fresnel_reflectance(0.0, 1.0, 1.33)
    expected = passed * (0.5 + (np.arcsin(s) + s * np.sqrt(1 - s**2)) / math.pi)
    # Cells of a three hundredth, and the soft edge of the disc, a fifth of its radius wide.
    np.testing.assert_allclose(found, expected, atol=0.02)
    np.testing.assert_allclose(found.mean(), expected.mean(), rtol=5e-3)


def lens(focal_length: float, aperture: float, ior: float = 1.5, rings: int = 48, sides: int = 96) -> MeshAtShutter:
    """A thin biconvex lens about the origin, its axis vertical, with smooth normals."""
    radius = 2.0 * (ior - 1.0) * focal_length
    r = aperture * np.linspace(0, 1, rings + 1)[1:]
    turn = 2 * np.pi * np.arange(sides) / sides
    x, y = (np.outer(r, f(turn)).ravel() for f in (np.cos, np.sin))
    height = np.sqrt(radius**2 - x**2 - y**2) - math.sqrt(radius**2 - aperture**2)
    top = np.concatenate([[[0, 0, radius - math.sqrt(radius**2 - aperture**2)]], np.stack([x, y, height], axis=1)])
    up = top + np.array((0, 0, math.sqrt(radius**2 - aperture**2)))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    around, next_one = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = [np.stack([0 * around, 1 + around, 1 + next_one], axis=1)]
    for ring in range(rings - 1):
        a, b = 1 + ring * sides, 1 + (ring + 1) * sides
        faces.append(np.stack([a + around, b + around, b + next_one], axis=1))
        faces.append(np.stack([a + around, b + next_one, a + next_one], axis=1))
    upper = np.concatenate(faces)
    points = np.concatenate([top, top * [1, 1, -1]])
    normals = np.concatenate([up, up * [1, 1, -1]])
    triangles = np.concatenate([upper, upper[:, ::-1] + len(top)]).astype(np.int32)
    glass = Material(Interaction.DIELECTRIC, ior=ior)
    return MeshAtShutter("/lens", points, triangles, normals=normals, normal_indices=triangles, materials=(glass,))


def test_a_thin_lens_makes_an_image_of_the_sun():
    """A disc of f · 0.53° across, all of one irradiance: that of the aperture, by the ratio of the areas."""
    focal_length, aperture, angle = 1.0, 0.04, math.radians(0.53)
    radius = focal_length * math.tan(0.5 * angle)
    body = lens(focal_length, aperture)
    body = replace(body, points=body.points + np.array((0, 0, focal_length)))
    half = 1.6 * radius
    camera = looking_down((-half, half, -half, half), height=0.5)
    found = irradiance(steady([floor(1.0), body], (sun(0.53),), camera), 48, 48, photons=1 << 14)
    passed = (1 - fresnel_reflectance(0.0, 1.0, 1.5)) ** 2
    expected = passed * (aperture / radius) ** 2
    middles = half * ((np.arange(48) + 0.5) / 24 - 1)
    distance = np.hypot(*np.meshgrid(middles, middles))
    assert found[distance < 0.7 * radius].mean() == pytest.approx(expected, rel=0.02)
    assert found[distance > 1.3 * radius].max() < 0.01 * expected
    across = 2 * math.sqrt((found > 0.5 * expected).sum() * (2 * half / 48) ** 2 / math.pi)
    assert across == pytest.approx(focal_length * angle, rel=0.02)


def water_and_lamp(light, moving=False):
    return steady([floor(), bumpy("/water", WATER, 1.0, moving)], (light,), BELOW)


LAMP = LightAtShutter("/lamp", LightKind.POINT, (4.0, 4.0, 4.0), np.array([0.3, 0.2, 3.0]))
SPANS = np.array([[0.4, 0.0, 0.0], [0.0, 0.25, 0.0]])
LIGHTS = {
    "sun": sun(5.0),
    "sphere": replace(LAMP, extent=Extent(ExtentShape.ROUND, 0.3)),
    "disk": replace(LAMP, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.DISK, 0.0, SPANS)),
    "rect": replace(LAMP, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.RECT, 0.0, SPANS)),
    "tube": replace(
        LAMP, profile=EmissionProfile.SINE, extent=Extent(ExtentShape.CYLINDER, 0.1, SPANS * [[1.0], [0.0]])
    ),
}


POINTS = {"sun": sun(0), "sphere": LAMP}


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("name", POINTS)
def test_as_a_light_shrinks_the_frame_tends_to_that_of_parallel_light_or_a_point(name, moving):
    shutter, point = OPEN if moving else STILL, POINTS[name]
    size = math.radians(2.0) if name == "sun" else 0.1
    # B-splines: footprints of points are cells where they are small, and those of images are not.
    options = {"shutter": shutter, "photons": 4096, "smoothing": 1.001}
    bare = irradiance(water_and_lamp(point, moving), **options)
    errors = []
    for part in (1.0, 0.25, 1.0 / 16):
        light = replace(point, extent=Extent(ExtentShape.ROUND, part * size))
        errors.append(relative(irradiance(water_and_lamp(light, moving), **options), bare))
    # What blurs goes with the square of the size where it is small beside cells and pixels; below a tenth of a pixel
    # it is left out.
    assert errors[1] < 0.5 * errors[0] and errors[2] < 0.5 * errors[1] and errors[2] < 0.01


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("name", POINTS)
def test_photons_of_a_light_of_no_extent_are_those_of_a_point_to_the_last_bit(name, moving):
    """Stages give such lights no extent (tests/usd/read/test_lights.py); kernels with its columns change nothing."""
    shutter, point = OPEN if moving else STILL, POINTS[name]
    nothing = replace(point, extent=Extent(ExtentShape.ROUND, 0.0))
    bare, found = (
        irradiance(water_and_lamp(light, moving), shutter=shutter, photons=4096, light_splits="auto")
        for light in (point, nothing)
    )
    assert bare.max() > 0.0
    np.testing.assert_array_equal(found, bare)


@pytest.mark.parametrize(
    ("name", "moving"), [*((name, False) for name in LIGHTS), ("sun", True), ("rect", True)]
)
def test_light_from_all_of_a_light_is_the_mean_of_that_from_its_places(name, moving):
    source, shutter = water_and_lamp(LIGHTS[name], moving), OPEN if moving else STILL
    truth = irradiance(source, 24, 20, shutter, estimator="accumulation", accumulation_times=64, photons=1 << 13)
    found = irradiance(source, 24, 20, shutter, photons=1 << 15, segments=4 if moving else 1)
    # So many places err by 1/64 or so of what the light spans; the mesh is of facets 0.5 wide.
    assert relative(found, truth) < 0.03


def test_splits_of_a_light_approach_the_mean_of_its_places():
    """A lamp that is as large as its distance from the glass."""
    near = replace(LAMP, position=np.array([0.3, 0.2, 1.8]), profile=EmissionProfile.COSINE)
    light = replace(near, extent=Extent(ExtentShape.RECT, 0.0, SPANS))
    source = water_and_lamp(light)
    truth = irradiance(source, 24, 20, estimator="accumulation", accumulation_times=256, photons=1 << 13)
    errors = [relative(irradiance(source, 24, 20, photons=1 << 16, light_splits=n), truth) for n in (1, 4, 16)]
    assert errors[1] < 0.7 * errors[0] and errors[2] < errors[1] and errors[2] < 0.03


@pytest.mark.parametrize("name", LIGHTS)
def test_splitting_a_light_changes_no_power(name):
    source = water_and_lamp(LIGHTS[name])
    context = [
        RenderContext(source, Settings(photons=1 << 14, samples=1, threads=1, light_splits=count)) for count in (1, 9)
    ]
    one, other = (render_frame(c, STILL, 16, 16).energy for c in context)
    # Light from all of a lamp goes with the mean of 1/d², which the lamp widens by (0.4/2)²/3.
    assert other.sent == pytest.approx(one.sent, rel=0.02)


def growing(name: str, shutter: Shutter) -> LightAtShutter:
    """A lamp of one radiance that is at first as large as that of ``LIGHTS``, at last three times."""
    light, known = LIGHTS[name], LIGHTS[name].extent
    light = replace(light, extent=replace(known, radius=2.0 * known.radius, spans=2.0 * known.spans))
    flat = name in ("rect", "disk")
    opens, middle, closes = (0.5 + time for time in (shutter.open, shutter.middle, shutter.close))
    power = middle if name in ("rect", "tube") else middle**2 + (closes - opens) ** 2 / 12.0
    grows = np.array([[1.0], [0.0]]) if name == "rect" else np.ones((2, 1))
    spans, motion = (1.0 + (middle - 1.0) * grows) * light.extent.spans, (closes - opens) * grows * light.extent.spans
    extent = replace(
        light.extent,
        radius=middle * light.extent.radius,
        radius_motion=(closes - opens) * light.extent.radius,
        spans=spans if flat else light.extent.spans,
        spans_motion=motion if flat else light.extent.spans_motion,
    )
    return replace(light, power=tuple(power * channel for channel in light.power), extent=extent)


@pytest.mark.parametrize(("name", "splits"), [("disk", 7), ("rect", 19), ("tube", 19), ("sphere", 1)])
def test_light_of_a_lamp_that_grows_within_the_shutter_is_the_mean_of_what_it_sends(name, splits):
    """Of one radiance, so that it brightens meanwhile; its parts are as many all the time."""
    meshes = [floor(), bumpy("/water", WATER, 1.0, False)]

    def at(shutter: Shutter) -> SceneAtShutter:
        return SceneAtShutter(shutter, tuple(meshes), (growing(name, shutter),), BELOW)

    options = {"light_splits": splits, "photons": 1 << 14}
    nodes, weights = np.polynomial.legendre.leggauss(3)
    truth = sum(
        0.5 * weight * irradiance(Source(at), 24, 20, Shutter.still(0.5 + 0.5 * node), **options)
        for node, weight in zip(nodes, weights, strict=True)
    )
    found = irradiance(Source(at), 24, 20, OPEN, **options)
    assert found.mean() == pytest.approx(truth.mean(), rel=0.005)
    # In one part, first order errs alike in both.
    assert relative(found, truth) < (0.0015 if splits == 1 else 0.005)


def test_segments_of_a_still_scene_have_the_light_of_a_lamp_that_brightens_in_each_of_them():
    def at(shutter: Shutter) -> SceneAtShutter:
        power = 4.0 * shutter.middle
        meshes = floor(), quad("/water", (-1, -1), (1, 1), 1.0, WATER)
        return SceneAtShutter(shutter, meshes, (replace(LAMP, power=(power,) * 3),), BELOW)

    one, four = (irradiance(Source(at), 16, 16, OPEN, segments=count) for count in (1, 4))
    assert one.max() > 0.0
    assert four.mean() == pytest.approx(one.mean(), rel=0.01)


def test_direct_light_and_photons_share_out_the_light_at_the_edge_of_clear_glass():
    """An index of one bends nothing: what it takes from direct light comes as photons, edges and all."""
    clear = quad("/clear", (-1, -1), (0, 1), 0.5, Material(Interaction.DIELECTRIC, ior=1.0))
    source = steady([floor(), clear], (sun(5.0),), looking_down((-0.1, 0.1, -0.1, 0.1), height=0.4))
    found = math.pi * beauty(source, 32, 32, photons=1 << 16, samples=16)
    # Sixteen samples look at 64 places, so that a pixel errs by up to 1/16 there; their means do by less.
    np.testing.assert_allclose(found.mean(axis=0), 1.0, atol=0.02)


def test_a_tube_half_in_water_lights_the_floor_as_plain_photons_from_it_do():
    """Its parts at the waterline are points: first order spread their light too far, by .29 of it all."""
    half = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    place = np.array([0.3, 0.2, 1.0])
    tube = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, place, profile=EmissionProfile.SINE)
    light = replace(tube, extent=Extent(ExtentShape.CYLINDER, 0.15, half))
    meshes = [floor(), bumpy("/water", WATER, 1.0, False)]
    found = irradiance(steady(meshes, (light,), looking_down(height=0.3)), 16, 16, light_splits="auto")
    bodies = tuple(
        brute_force.Mesh(
            mesh.path,
            (mesh.points,) * 2,
            mesh.triangles,
            DIELECTRIC if mesh.materials[0].interaction == Interaction.DIELECTRIC else DIFFUSE,
            mesh.materials[0].ior,
            normals=None if mesh.normals is None else (mesh.normals,) * 2,
        )
        for mesh in meshes
    )
    camera = brute_force.Camera(((0.0, 0.0, 0.3),) * 2, np.eye(3), 2.0, 16, 16)
    lamp = brute_force.Light("/lamp", 4.0, position=(place,) * 2, radius=0.15, spans=half)
    truth = brute_force.irradiance(brute_force.Scene("tube", bodies, (lamp,), camera), 1 << 20, threads=1)
    assert relative(found, truth.irradiance) < 0.18
