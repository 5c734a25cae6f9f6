"""Laws of how far bodies turn within a shutter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, box, glass
from tests.photons.traced import sun
from tests.view.scenes import WATER, Source, bumpy, floor, looking_down
from tpdwarp.clock import Clock
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    LightAtShutter,
    LightKind,
    SceneAtShutter,
    Shaping,
    Shutter,
)
from tpdwarp.settings import Settings
from tpdwarp.trajectories.turns import largest_slide, segments_needed, turn_between, turn_of_light
from usd_scenes.shapes import rotation

BODY = box("/box", (-0.4, -0.3, 0.6), (0.4, 0.5, 1.4), glass())


@pytest.mark.parametrize("degrees", [0.0, 0.1, 30.0, 179.0])
@pytest.mark.parametrize("offset", [0.0, 1.0e4])
def test_the_turn_of_a_rigid_body_is_found_wherever_it_goes(degrees, offset):
    after = replace(BODY, points=BODY.points @ rotation((1.0, 2.0, -0.5), degrees).T + offset)
    assert np.degrees(turn_between(BODY, after)) == pytest.approx(degrees, abs=1e-3)


def test_what_bends_does_not_turn():
    twisted = np.array(
        [rotation((0, 0, 1.0), 60.0 * z) @ point for z, point in zip(BODY.points[:, 2], BODY.points, strict=True)]
    )
    assert turn_between(BODY, replace(BODY, points=twisted)) == 0.0


@pytest.mark.parametrize(("degrees", "least"), [(10.0, 1), (20.0, 1), (45.0, 2), (200.0, 7)])
def test_bodies_have_a_segment_for_each_thirty_degrees(degrees, least):
    def at(shutter: Shutter) -> SceneAtShutter:
        first, middle, last = (
            (BODY.points - [0, 0, 1]) @ rotation((0, 0, 1.0), degrees * time).T + [0, 0, 1]
            for time in (shutter.open, shutter.middle, shutter.close)
        )
        body = replace(BODY, points=middle, motions=last - first if shutter.exposure else None)
        return SceneAtShutter(shutter, (floor(), body), (sun(),), looking_down(height=0.05))

    settings = Settings(photons=16384, segments="auto")
    count = RenderContext(Source(at), settings).segmentation.count(Shutter(0, 0, 1), Clock())
    assert count >= least and (least > 1 or count == 1)


@pytest.mark.parametrize(("degrees", "aside", "least"), [(20.0, 0.0, 1), (50.0, 0.0, 2), (50.0, 3.0, 1)])
def test_what_light_falls_on_has_a_segment_for_each_thirty_degrees_too(degrees, aside, least):
    """A paddle that turns under a still box of glass; beside its light it is worth nothing."""
    paddle = box("/paddle", (-0.5, -0.3, -0.02), (0.5, 0.3, 0.02), DIFFUSE)

    def at(shutter: Shutter) -> SceneAtShutter:
        first, middle, last = (
            paddle.points @ rotation((0, 1.0, 0), degrees * (time - 0.5)).T + [aside, 0, 0.35]
            for time in (shutter.open, shutter.middle, shutter.close)
        )
        body = replace(paddle, points=middle, motions=last - first if shutter.exposure else None)
        return SceneAtShutter(shutter, (floor(), BODY, body), (sun(),), looking_down(height=0.05))

    settings = Settings(photons=16384, segments="auto")
    assert RenderContext(Source(at), settings).segmentation.count(Shutter(0, 0, 1), Clock()) == least


def turning_panel(degrees: float) -> Source:
    """A rectangle over water that tips by so much while the shutter is open."""
    panel = LightAtShutter("/panel", LightKind.POINT, (4.0,) * 3, np.array([0.3, 0.2, 3.0]))
    panel = replace(panel, profile=EmissionProfile.COSINE)
    spans = np.array([[0.4, 0.0, 0.0], [0.0, 0.25, 0.0]])

    def at(shutter: Shutter) -> SceneAtShutter:
        first, middle, last = (
            rotation((1.0, 0, 0), degrees * (time - 0.5) + 15.0).T
            for time in (shutter.open, shutter.middle, shutter.close)
        )
        extent = Extent(ExtentShape.RECT, 0.0, spans @ middle, spans @ (last - first))
        light = replace(panel, axes=middle, axes_motion=last - first, extent=extent)
        meshes = (floor(), bumpy("/water", WATER, 1.0, False))
        return SceneAtShutter(shutter, meshes, (light,), looking_down(height=0.6))

    return Source(at)


def test_a_panel_that_turns_far_has_its_mean_in_one_segment_and_in_several():
    """The mean of the cosine over a turn is less than that in its middle."""

    def light(**changes) -> np.ndarray:
        context = RenderContext(
            turning_panel(57.0), Settings(samples=1, threads=1, aovs=("irradiance",), light_splits=1, **changes)
        )
        return render_frame(context, Shutter(0, 0, 1), 16, 16).channels["irradiance.R"].astype(np.float64)

    truth = light(estimator="accumulation", accumulation_times=48, photons=1 << 12)
    one, chosen = (light(photons=1 << 14, segments=segments) for segments in (1, "auto"))
    # Its flux at mid shutter is 3 % more.
    for found in (one, chosen):
        assert found.mean() == pytest.approx(truth.mean(), rel=5e-3)
        assert np.sqrt(np.mean((found - truth) ** 2)) < 0.02 * truth.mean()


def test_lights_turn_as_far_as_it_is_seen_in_their_light():
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.zeros(3))
    spot = replace(lamp, shaping=Shaping(0.5))
    panel = replace(lamp, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.RECT, 0.0, np.eye(3)[:2]))
    tube = replace(lamp, profile=EmissionProfile.SINE)
    about_x, about_z = (rotation(axis, 30.0).T for axis in ((1.0, 0, 0), (0, 0, 1.0)))
    lights = {"/lamp": lamp, "/spot": spot, "/panel": panel, "/tube": tube, "/sun": sun()}
    lights["/tube spot"] = replace(tube, shaping=Shaping(0.5))
    turns = {
        (path, name): np.degrees(turn_of_light(light, np.eye(3), axes))
        for name, axes in (("x", about_x), ("z", about_z))
        for path, light in lights.items()
    }
    expected = {"/lamp": (0, 0), "/spot": (30, 0), "/panel": (30, 30), "/tube": (0, 30), "/sun": (0, 0)}
    expected["/tube spot"] = (30, 30)
    for path, (x, z) in expected.items():
        assert turns[path, "x"] == pytest.approx(x, abs=1e-4) and turns[path, "z"] == pytest.approx(z, abs=1e-4)


@pytest.mark.parametrize(("way", "half", "least"), [(0.5, 0.2, 1), (1.6, 0.2, 3), (1.6, 2.0, 1)])
def test_lamps_that_go_around_a_body_have_a_segment_for_each_fifteen_degrees_seen_from_it(way, half, least):
    """A lamp goes aside 2.8 above the middle of a body; from one that is larger than its way cells do not slide off."""

    def at(shutter: Shutter) -> SceneAtShutter:
        place = np.array([way * (shutter.middle - 0.5), 0.0, 3.5])
        light = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0), position=place)
        light = replace(light, position_motion=np.array([0.1 * way, 0.0, 0.0]))
        body = box("/box", (-half, -half, 0.6), (half, half, 0.8), glass())
        return SceneAtShutter(shutter, (floor(), body), (light,), looking_down(height=0.05))

    scenes = [at(Shutter(0, time, time)) for time in (0.0625, 0.5, 0.9375)]
    assert max(1, math.ceil(segments_needed(scenes, 0.875) - 1e-3)) == least


@pytest.mark.parametrize(("rise", "half", "least"), [(0.2, 0.2, 1), (1.0, 0.2, 3), (1.0, 2.0, 1)])
def test_a_lamp_that_rises_from_a_body_has_segments_in_which_that_shrinks_evenly(rise, half, least):
    """What it leaves an even growth by goes with the square of the time; what holds the lamp has all its light."""

    def at(time: float) -> SceneAtShutter:
        lamp = LightAtShutter(
            "/lamp", LightKind.POINT, (1.0,) * 3, position=np.array([0, 0, 2.2 + rise * (time - 0.5)])
        )
        body = box("/box", (-half, -half, 0.6), (half, half, 0.8), glass())
        return SceneAtShutter(Shutter(0, time, time), (floor(), body), (lamp,), looking_down(height=0.05))

    scenes = [at(time) for time in (0.0625, 0.5, 0.9375)]
    assert max(1, math.ceil(segments_needed(scenes, 0.875) - 1e-3)) == least
    if half < 1.0:
        radii = np.arcsin(np.sqrt(2 * half**2 + 0.1**2) / (1.5 + rise * np.array([-0.4375, 0.0, 0.4375])))
        slide = largest_slide([scene.lights[0].position for scene in scenes], scenes)
        assert slide == pytest.approx(0.5 * (radii[0] + radii[2] - 2 * radii[1]) / radii[1])
