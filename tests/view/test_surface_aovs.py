"""AOVs for compositing against closed forms: albedo, what dielectrics shade, screen motion, objects."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, floor, looking_down, quad, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Extent, ExtentShape, Material, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.object_ids import MOST, object_ids

STILL, OPEN = Shutter(0, 0, 0), Shutter(0, 0, 1)
BLUE = Material(color=(0.2, 0.4, 0.6))


def render(meshes, aovs, camera=None, shutter=STILL, samples=4, light=SUN):
    source = steady(meshes, (light,), camera or looking_down())
    settings = Settings(photons=64, threads=1, aovs=aovs, samples=samples)
    return render_frame(RenderContext(source, settings), shutter, 16, 16).channels


def rgb(channels, aov):
    return np.stack([channels[f"{aov}.{c}"] for c in "RGB"], axis=-1).astype(float)


def pane(height: float = 1.0):
    return quad("/pane", (-3, -3), (0, 3), height, WATER)


def test_albedo_is_that_of_the_surface_and_not_of_what_it_is_seen_through():
    channels = render([floor(material=BLUE), pane()], ("albedo",))
    np.testing.assert_allclose(rgb(channels, "albedo"), np.broadcast_to(BLUE.color, (16, 16, 3)), rtol=1e-6)


def test_direct_light_and_what_dielectrics_shade_add_up_to_a_scene_without_them():
    # From below the pane, so that it is not seen: it lies over the left half, and an opaque card over a quarter.
    card = quad("/card", (-3, 0), (3, 3), 2.0)
    camera = looking_down(height=0.9)
    with_pane = render([floor(material=BLUE), pane(), card], ("direct", "shadow"), camera)
    without = render([floor(material=BLUE), card], ("direct", "shadow"), camera)
    np.testing.assert_allclose(rgb(without, "shadow"), 0.0)
    np.testing.assert_allclose(rgb(with_pane, "direct") + rgb(with_pane, "shadow"), rgb(without, "direct"), rtol=1e-5)
    # All of it is shade on the left, below no card: albedo/π times the sun's irradiance of 1.
    shade = np.broadcast_to(np.array(BLUE.color) / math.pi, (4, 7, 3))
    np.testing.assert_allclose(rgb(with_pane, "shadow")[-4:, :7], shade, rtol=1e-5)
    assert rgb(with_pane, "shadow")[:, 9:].max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("sun", [SUN, replace(SUN, extent=Extent(ExtentShape.ROUND, 0.001))], ids=["point", "disc"])
def test_what_dielectrics_shade_heeds_what_light_is_linked_to(sun):
    pane_, card = pane(), quad("/card", (-3, -3), (3, 3), 2.0)
    below = looking_down(height=0.9)

    def shadow(meshes, **links):
        return rgb(render([floor(material=BLUE), *meshes], ("shadow",), below, light=replace(sun, **links)), "shadow")

    apart = frozenset({"/elsewhere"})
    shaded = shadow([pane_], unlit=apart)
    np.testing.assert_allclose(shaded[:, :7], np.broadcast_to(np.array(BLUE.color) / math.pi, (16, 7, 3)), rtol=1e-4)
    # Glass that light passes, or that shades what is not lit, takes nothing away.
    np.testing.assert_array_equal(shadow([pane_], passed=frozenset({"/pane"})), 0)
    np.testing.assert_array_equal(shadow([pane_], unlit=frozenset({"/floor"})), 0)
    np.testing.assert_array_equal(shadow([pane_, card], unlit=apart), 0)
    np.testing.assert_allclose(shadow([pane_, card], passed=frozenset({"/card"})), shaded, rtol=1e-6)


@pytest.mark.parametrize("panes", [1, 2, 5])
def test_light_is_shaded_once_however_many_panes_take_it_away(panes):
    stack = [replace(pane(1.0 + 0.1 * k), path=f"/pane{k}") for k in range(panes)]
    shadow = rgb(render([floor(material=BLUE), *stack], ("shadow",), looking_down(height=0.9)), "shadow")
    np.testing.assert_allclose(shadow[:, :7], np.broadcast_to(np.array(BLUE.color) / math.pi, (16, 7, 3)), rtol=1e-5)


def test_screen_motion_is_that_of_the_surface_in_pixels_over_the_shutter():
    camera = looking_down()
    width = (camera.window[1] - camera.window[0]) / 16
    moving = quad("/card", (-9, -9), (9, 9), 0.0, motion=(0.5 * width, -2 * width, 0.0))
    for segments in (1, 3):
        source = steady([moving], (SUN,), camera)
        settings = Settings(photons=64, threads=1, aovs=("vector",), segments=segments)
        channels = render_frame(RenderContext(source, settings), OPEN, 16, 16).channels
        np.testing.assert_allclose(channels["vector.X"], 0.5, rtol=1e-4)
        np.testing.assert_allclose(channels["vector.Y"], -2.0, rtol=1e-4)


def test_screen_motion_of_what_stands_still_is_against_that_of_the_camera():
    camera = looking_down()
    width = (camera.window[1] - camera.window[0]) / 16
    camera = replace(camera, position_motion=np.array([0.0, 1.5 * width, 0.0]))
    channels = render([floor(material=BLUE)], ("vector",), camera, OPEN)
    np.testing.assert_allclose(channels["vector.X"], 0.0, atol=1e-4)
    np.testing.assert_allclose(channels["vector.Y"], -1.5, rtol=1e-4)


def test_objects_have_the_numbers_of_their_paths_and_the_nearest_names_a_pixel():
    numbers = object_ids(["/floor", "/pane"])
    channels = render([floor(material=BLUE), pane()], ("id",))
    np.testing.assert_array_equal(channels["id"][:, :8], numbers["/pane"])
    np.testing.assert_array_equal(channels["id"][:, 8:], numbers["/floor"])
    nothing = render([quad("/card", (5, 5), (6, 6), 0.0)], ("id",))
    assert nothing["id"].max() == 0.0


def test_numbers_of_objects_stay_when_others_come_and_are_exact_in_single_precision():
    paths = [f"/World/Mesh{k}" for k in range(3000)]
    numbers = object_ids(paths)
    assert len(set(numbers.values())) == 3000
    assert min(numbers.values()) >= 1 and max(numbers.values()) <= MOST
    assert object_ids(paths[:1])[paths[0]] == numbers[paths[0]]
