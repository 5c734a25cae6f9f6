"""Shallow wide water, tiny lenses on huge floors, long thin triangles, one triangle and two million."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import ball, floor, glass, mesh, moving, ripples
from tests.photons.traced import EPS, axes_along, lamp, sun
from tests.view.scenes import looking_down
from tpdwarp.scene.description import LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter
from tpdwarp.trajectories.parts import INSTANTS
from tpdwarp.trajectories.retraced import PARTS
from usd_scenes.oracle.closed_forms import fresnel_reflectance
from usd_scenes.oracle.shapes import grid_points, grid_triangles

from .cases import GRID, render, scene, strip

IOR, ALBEDO = 1.33, 0.5


def shallow(width: float, depth: float, motion: str, view: str) -> SceneAtShutter:
    """Water with three waves of a tenth of its depth across; it heaves, or slides as one piece."""
    x = np.linspace(-0.5 * width, 0.5 * width, 17)
    k = 2 * math.pi / width * 3
    points = grid_points(x, x, lambda x, y: depth * (1 + 0.1 * np.sin(k * x)))
    normals = np.stack([-0.1 * depth * k * np.cos(k * points[:, 0]), 0 * points[:, 0], np.ones(len(points))], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    motions, turns = np.zeros_like(points), np.zeros_like(points)
    if motion == "deforming":
        motions[:, 2] = 0.05 * depth * np.cos(k * points[:, 0])
        turns[:, 0] = 0.05 * depth * k * np.sin(k * points[:, 0])
    else:
        motions[:] = (1e-3 * width, 0, 0.05 * depth)
    triangles = grid_triangles(17, 17).astype(np.int32)
    water = MeshAtShutter("/water", points, triangles, motions, normals, turns, triangles, (glass(IOR),))
    half = {"all of it": 0.4 * width, "as much as it is deep": depth}[view]
    eye = looking_down((-half, half, -half, half), height=0.5 * depth)
    return scene([water, floor(half=0.6 * width)], sun((0.05, 0.02, -1)), eye=eye)


@pytest.mark.parametrize("view", ["all of it", "as much as it is deep"])
@pytest.mark.parametrize("motion", ["deforming", "rigid"])
@pytest.mark.parametrize("width", [1e2, 1e3, 1e4])
def test_wide_shallow_water_tends_to_a_flat_interface(width, motion, view):
    # Cells much larger than pixels: widened by those, footprints no longer add up to a smooth field exactly.
    frame = render(shallow(width, 1e-2, motion, view), photons=256)
    angle = math.atan(math.hypot(0.05, 0.02))
    passing = 1 - fresnel_reflectance(angle, 1.0, IOR)
    slope = 0.15 * 1e-2 * 6 * math.pi / width
    # Light that slopes turn aside gathers by as much as they change over the depth.
    assert frame.energy.deposited == pytest.approx(passing * frame.energy.sent, rel=slope + 1e-5)
    expected = math.cos(angle) * passing * ALBEDO / math.pi
    np.testing.assert_allclose(frame.channels["caustic.R"], expected, rtol=slope + 1e-3)


LENS = 0.3


def lens_on(half: float, *more: MeshAtShutter, light: LightAtShutter | None = None) -> SceneAtShutter:
    body = moving(ball("/ball", (0.1, 0.2, 0.8), LENS, 8, glass()), (0.05, 0.1, 0.02))
    return scene([body, floor(half=half), *more], *([light] if light else []))


LIGHTS = {"sun": lambda: sun((0.2, 0.1, -1)), "lamp": lambda: lamp((0.4, 0.1, 3), (0.1, 0, 0))}


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("half", [3e4, 1e5, 3e5])
def test_a_small_lens_on_a_huge_floor_is_the_lens_on_a_smaller_one(half, light):
    """Down to a millionth of the floor's size. On smaller floors some light is drawn on squares of the scene's size."""
    expected, found = (render(lens_on(h, light=LIGHTS[light]())) for h in (1e4, half))
    # A few photons at the rim and of many inner reflections take another way for a rounding.
    assert found.energy.sent == pytest.approx(expected.energy.sent, rel=1e-6)
    for part in ("deposited", "escaped", "lost_total"):
        difference = getattr(found.energy, part) - getattr(expected.energy, part)
        assert abs(difference) < 1e-3 * expected.energy.sent, part
    caustic, truth = (f.channels["caustic.R"].astype(float) for f in (found, expected))
    assert np.sqrt(np.mean((caustic - truth) ** 2)) < 2e-3 * np.sqrt(np.mean(truth**2))


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("height", [1.2, 2.0])
def test_what_stands_before_a_tiny_lens_keeps_the_light_from_it(height, light):
    roof = floor(height, 2.0, path="/roof")
    assert render(lens_on(1e5, roof, light=LIGHTS[light]())).energy.sent == 0
    # Its edge on the line from the light to the middle of the lens.
    edge = 0.1 + (height - 0.8) * {"sun": -0.2, "lamp": 0.3 / 2.2}[light]
    shifted = replace(roof, points=roof.points + np.array([2 + edge, 0, 0]))
    half = render(lens_on(1e5, shifted, light=LIGHTS[light]()))
    whole = render(lens_on(1e5, light=LIGHTS[light]()))
    assert half.energy.sent == pytest.approx(0.5 * whole.energy.sent, rel=0.1)


def test_a_camera_sees_a_tiny_lens_as_it_is():
    expected, found = (render(lens_on(half)).channels for half in (300.0, 3e5))
    for name in ("N.X", "N.Y", "N.Z", "Z", "R"):
        error = np.abs(found[name] - expected[name])
        assert np.quantile(error, 0.99) < 1e-3 * np.abs(expected[name]).max(), name


DIRECTION = np.array([2.0, 1.0, 0.7]) / np.linalg.norm([2.0, 1.0, 0.7])
ACROSS = np.array([-1.0, 1.5, 0.6]) / np.linalg.norm([-1.0, 1.5, 0.6])


@pytest.mark.parametrize("motion", ["deforming", "rigid"])
@pytest.mark.parametrize("ratio", [1e2, 1e3, 1e4, 1e5])
def test_triangles_with_edges_in_this_ratio_refract_like_the_plane_they_lie_in(ratio, motion):
    width = 2.0 / ratio
    ends = np.array([0.0, 0, 1]) + np.array([-DIRECTION, DIRECTION])
    points = ends[None] + width * np.arange(-8, 9)[:, None, None] * ACROSS
    turn = np.array([[0, 0.03, 0.05], [-0.03, 0, 0.02], [-0.05, -0.02, 0]])
    motions = np.broadcast_to([0.05, 0.02, 0.03], points.shape)
    if motion == "deforming":
        motions = motions + (points - [0, 0, 1]) @ turn.T
    down = axes_along((0, 0, -1), (*DIRECTION[:2], 0))
    light = LightAtShutter("/sun", LightKind.DISTANT, (1.0,) * 3, axes=down)
    # Along straight trajectories photons lie where they were traced, and not in the middle of cells at the border.
    frame = render(scene([strip(points, glass(), motions), floor()], light), path="straight")
    photons = frame.photons
    passing = photons.bounces == 1
    assert passing.sum() > 700

    normal = np.cross(DIRECTION, ACROSS)
    normal /= np.linalg.norm(normal)
    cosine, eta = normal[2], 1 / 1.5
    bent = eta * np.array([0, 0, -1]) + (eta * cosine - math.sqrt(1 - eta**2 * (1 - cosine**2))) * normal
    # Vertices are rounded across the strip, which turns its triangles about their long edges.
    tilt = 4 * EPS * 4 / width
    # From where a photon lies on the floor back along the refracted direction to the plane.
    hits = photons.positions[passing]
    entry = hits + (((0, 0, 1) - hits) @ normal / (bent @ normal))[:, None] * bent - (0, 0, 1)
    across = np.cross(normal, DIRECTION)
    assert np.abs(entry @ across).max() < 8 * width * (ACROSS @ across) + 64 * EPS + 2 * tilt
    assert np.abs(entry @ DIRECTION).max() > 0.9
    expected = 1 - fresnel_reflectance(math.acos(cosine), 1.0, 1.5)
    through = photons.flux[passing].sum() / frame.energy.sent
    assert through == pytest.approx(expected, rel=tilt + 1e-4)
    # A plane that turns and moves: D_t x is affine in where the photon came through.
    places = np.stack([entry @ DIRECTION, np.ones(len(entry))], axis=1)
    affine, *_ = np.linalg.lstsq(places, photons.dxdt[passing], rcond=None)
    turns = np.abs(affine[0]).max() > 0.01
    assert turns == (motion == "deforming")
    np.testing.assert_allclose(photons.dxdt[passing], places @ affine, atol=0.1 * tilt + width + 1e-5)


@pytest.mark.parametrize("motion", ["deforming", "rigid"])
def test_one_triangle_of_glass_is_enough(motion):
    motions = np.array([[0.1, 0, 0], [0.1, 0, 0], [0.1, 0, 0.2 if motion == "deforming" else 0]])
    piece = mesh("/piece", [[-1, -1, 1], [1, -1, 1], [0, 1, 1]], [[0, 1, 2]], glass(), motions=motions)
    frame = render(scene([piece, floor()], sun()))
    # Cells are counted by their middles: the slanted edges gain and lose up to one a row.
    assert frame.energy.sent == pytest.approx(3 * 2.0, rel=0.03)
    passing = 1 - fresnel_reflectance(0.0, 1.0, 1.5)
    # Light at edges counts in a part of the shutter as long as it lands, but what is reflected counts for all of it:
    # that is off by half a part of those cells at most.
    counts = frame.energy.counts
    again = counts["cells traced again in time"]
    at_edges = again / (counts["emitted"] - (INSTANTS - 1) * again)
    off = (1 - passing) * at_edges * 0.5 / PARTS
    assert frame.energy.deposited == pytest.approx(passing * frame.energy.sent, rel=1e-5 + off)


@pytest.mark.slow
def test_two_million_triangles_are_traced_in_seconds():
    grid = np.linspace(-1, 1, 1001)
    many, few = (ripples(x, x, 1.0, 0.04, glass(IOR), True) for x in (grid, GRID))
    assert len(many.triangles) == 2_000_000
    begun = time.process_time()
    found = render(scene([many, floor(half=1.5)]))
    assert time.process_time() - begun < 60
    expected = render(scene([few, floor(half=1.5)]))
    assert found.energy.deposited == pytest.approx(expected.energy.deposited, rel=2e-3)
