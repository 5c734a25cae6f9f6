"""Stray points: a mesh that reaches beyond all measure is left out, so that the rest has a size."""

import numpy as np
import pytest
from pxr import UsdGeom, UsdLux

from tests.usd.stages import SQUARE, SmallStage
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings


@pytest.mark.parametrize("glass", [False, True])
@pytest.mark.parametrize("far", [2e10, 1e30])
def test_a_stray_point_takes_its_mesh_and_no_more(tmp_path, glass, far):
    small = SmallStage(tmp_path)
    small.mesh("/Floor")
    small.mesh("/Wall", np.roll(SQUARE, 1, axis=1))
    if glass:
        small.preview("/Clear", opacity=0.0)
        small.bind(small.mesh("/Pane", np.add(SQUARE, (0, 0, 0.5))), "/Clear")
    expected = {mesh.path for mesh in small.open().at(Shutter.still(1)).meshes}
    small.mesh("/Stray", [*SQUARE[:3], (0, far, 0)])
    scene = small.open(image_width=16)
    assert {mesh.path for mesh in scene.at(Shutter.still(1)).meshes} == expected
    (line,) = (line for line in scene.warnings.messages if "left out" in line)
    assert "/Stray: reaches" in line
    settings = Settings(photons=64, samples=1)
    frame = render_frame(RenderContext(scene, settings), Shutter.still(1), *scene.resolution())
    assert frame.channels["R"].max() > 0 and np.isfinite(frame.channels["R"]).all()


@pytest.mark.parametrize("far, kept", [(1e5, True), (2e6, False), (1e20, False)])
def test_a_lamp_beyond_where_rays_end_is_left_out(tmp_path, far, kept):
    small = SmallStage(tmp_path)
    small.mesh("/Floor")
    lamp = UsdLux.SphereLight.Define(small.stage, "/Lamp")
    lamp.AddTranslateOp().Set((0, 0, far))
    scene = small.open(image_width=16)
    assert {light.path for light in scene.at(Shutter.still(1)).lights} == {"/Light"} | ({"/Lamp"} if kept else set())
    assert ["/Lamp: lies" in line for line in scene.warnings.messages if "left out" in line] == [True] * (not kept)
    frame = render_frame(RenderContext(scene, Settings(photons=64, samples=1)), Shutter.still(1), *scene.resolution())
    assert frame.channels["R"].max() > 0


def test_what_is_wide_or_small_stays(tmp_path):
    small = SmallStage(tmp_path)
    small.mesh("/Sea", 1e5 * np.array(SQUARE))
    small.mesh("/Drop", 1e-3 * np.array(SQUARE))
    small.mesh("/Point", np.zeros((4, 3)))
    small.mesh("/Away", np.array(SQUARE) + 1e6)
    assert len(small.open().at(Shutter.still(1)).meshes) == 4


def seen_from_afar(tmp_path, far, projection):
    small = SmallStage(tmp_path)
    small.mesh("/Floor")
    camera = UsdGeom.Camera.Define(small.stage, "/Far")
    camera.CreateProjectionAttr(projection)
    camera.CreateClippingRangeAttr((1e-3, 1e30))
    # In tenths of scene units.
    camera.CreateHorizontalApertureAttr(30.0)
    camera.CreateVerticalApertureAttr(30.0)
    camera.AddTranslateOp().Set((0.25, 0, far))
    scene = small.open(image_width=16)
    frame = render_frame(RenderContext(scene, Settings(photons=64, samples=1)), Shutter.still(1), *scene.resolution())
    return scene, frame.channels["R"], [line for line in scene.warnings.messages if "/Far: lies" in line]


@pytest.mark.parametrize("far", [2e10, 1e20])
def test_parallel_rays_from_beyond_all_measure_see_what_they_see_from_nearby(tmp_path, far):
    (tmp_path / "near").mkdir()
    _, near, nothing = seen_from_afar(tmp_path / "near", 3.0, "orthographic")
    _, found, said = seen_from_afar(tmp_path, far, "orthographic")
    assert near.max() > 0 and nothing == [] and len(said) == 1
    np.testing.assert_allclose(found, near, rtol=1e-5)


@pytest.mark.parametrize("far", [2e10, 1e30])
def test_a_camera_that_is_beyond_all_measure_sees_an_empty_frame(tmp_path, far):
    scene, found, said = seen_from_afar(tmp_path, far, "perspective")
    assert found.max() == 0 and len(said) == 1
    # The middle of the scene lies where it lay, as far as anybody can tell.
    place = scene.at(Shutter.still(1)).camera.position - (0.5, 0.5, 0)
    assert place[2] > 1e8 and place[0] / place[2] == pytest.approx(-0.25 / far, abs=1e-12)


def test_a_stage_of_which_nothing_is_left_is_an_empty_frame_and_says_why(tmp_path):
    small = SmallStage(tmp_path)
    small.mesh("/Lost", [(float("nan"), 0, 0), *SQUARE[1:]])
    scene = small.open(image_width=16)
    frame = render_frame(RenderContext(scene, Settings(photons=64, samples=1)), Shutter.still(1), *scene.resolution())
    assert not frame.channels["R"].any() and not frame.channels["A"].any()
    (line,) = (line for line in scene.warnings.messages if "/Lost" in line)
    assert "NaN" in line and "the mesh is left out" in line
