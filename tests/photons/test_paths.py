"""Paths of photons: straight from the light, bent where Snell's law says, to where their photons land."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.small_stage import write_stage
from tpdwarp.jobs.opening import chosen_settings, open_scene, shutter_of
from tpdwarp.photons.photon_map import MOST_VERTICES
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import trace_frame

FRAME, TILT = 2, 25.0


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory):
    """Photons of a pane that light falls on obliquely."""
    stage = Usd.Stage.Open(write_stage(tmp_path_factory.mktemp("small") / "small.usda"))
    sun = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Sun"))
    sun.AddRotateXYZOp().Set(Gf.Vec3f(TILT, 0, 0))
    # A still, whose edges are not traced finer: elsewhere photons of parts of cells or of the shutter stand for them.
    settings = chosen_settings({"photons": 4096, "threads": 1, "exposure": 0.0, "path": "straight"})
    context = RenderContext(open_scene(stage, settings, False), settings)
    return trace_frame(context, shutter_of(context.source, FRAME, settings), paths=100)


def test_no_more_paths_are_recorded_than_asked_for_and_they_are_spread(traced):
    count = len(traced.paths.counts)
    assert 50 < count <= 100 and len(traced.paths.photons) == count
    landed = traced.paths.photons.positions[:, :2]
    quadrants = np.bincount((landed > np.median(traced.photons.positions[:, :2], axis=0)) @ [1, 2], minlength=4)
    assert quadrants.min() > count / 8


def test_vertices_are_the_light_the_pane_and_the_place_on_the_floor(traced):
    paths = traced.paths
    np.testing.assert_array_equal(paths.counts, paths.photons.bounces + 2)
    ends = np.cumsum(paths.counts) - 1
    # Single precision of a scene of four units.
    np.testing.assert_allclose(paths.points[ends], paths.photons.positions, atol=1e-5)
    single = np.flatnonzero(paths.counts == 3)
    assert len(single)
    pane = paths.points[ends[single] - 1]
    np.testing.assert_allclose(pane[:, 2], 1.0, atol=1e-5)
    arriving, leaving = pane - paths.points[ends[single] - 2], paths.points[ends[single]] - pane
    sines = [np.hypot(d[:, 0], d[:, 1]) / np.linalg.norm(d, axis=1) for d in (arriving, leaving)]
    np.testing.assert_allclose(sines[0], np.sin(np.radians(TILT)), atol=1e-5)
    # One interface, from outside into what is below.
    np.testing.assert_allclose(sines[1], sines[0] / 1.5, atol=1e-5)


def test_paths_are_those_of_photons_of_the_frame(traced):
    known = dict(zip(traced.photons.ids.tolist(), traced.photons.positions, strict=True))
    found = np.array([known[number] for number in traced.paths.photons.ids.tolist()])
    np.testing.assert_allclose(found, traced.paths.photons.positions, atol=1e-5)
    assert traced.paths.counts.max() <= MOST_VERTICES


def test_photons_say_which_light_they_come_from(traced):
    assert traced.photons.light_paths == ("/World/Sun",)
    assert not traced.photons.lights.any() and len(traced.photons.lights) == len(traced.photons)
