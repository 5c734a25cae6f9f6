"""Stray points: a mesh that reaches beyond all measure is left out, so that the rest has a size."""

import numpy as np
import pytest
from pxr import UsdLux

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
