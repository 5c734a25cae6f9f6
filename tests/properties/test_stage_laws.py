"""Laws of stages: a frame is that of the world, whatever units, axes and order of prims it is written in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.small_stage import write_stage
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

from .scenes import law, numbers, rotations, vectors

PIXELS = 12
stage_law = examples(law, max_examples=10)


def pixels(file: str | Path) -> np.ndarray:
    """The beauty of frame 2 of a stage, exposed for half a frame, shape [3, h, w]."""
    settings = Settings(photons=300, samples=1, threads=1, image_width=PIXELS, exposure=0.5)
    source = StageScene.open(file, settings)
    frame = render_frame(RenderContext(source, settings), Shutter(2, 2, 2.5), PIXELS, PIXELS)
    return np.stack([frame.channels[name] for name in "RGB"]).astype(np.float64)


def stage_at(folder: Path) -> Usd.Stage:
    folder.mkdir(exist_ok=True, parents=True)
    layer = Sdf.Layer.FindOrOpen(write_stage(folder / "scene.usda"))
    layer.Reload(force=True)
    return Usd.Stage.Open(layer)


@stage_law
@given(up=st.sampled_from(("Y", "Z")), meters=st.sampled_from((1e-3, 0.0254, 1.0, 1000.0)))
def test_units_and_up_axis_name_the_numbers_and_change_none(up, meters, tmp_path_factory):
    stage = stage_at(tmp_path_factory.mktemp("units"))
    plain = pixels(stage.GetRootLayer().realPath)
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    stage.Save()
    np.testing.assert_array_equal(pixels(stage.GetRootLayer().realPath), plain)


@stage_law
@given(turn=rotations(), shift=vectors(-20, 20), exponent=st.integers(-13, 13), mantissa=numbers(1.0, 2.0))
def test_a_stage_in_other_axes_and_units_has_the_same_frame(turn, shift, exponent, mantissa, tmp_path_factory):
    stage = stage_at(tmp_path_factory.mktemp("converted"))
    plain = pixels(stage.GetRootLayer().realPath)
    scale = mantissa * 2.0**exponent
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    for attribute in (camera.GetHorizontalApertureAttr(), camera.GetVerticalApertureAttr()):
        attribute.Set(attribute.Get() * scale)
    camera.GetClippingRangeAttr().Set(camera.GetClippingRangeAttr().Get() * scale)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = scale * turn.T, scale * shift
    UsdGeom.Xform(stage.GetPrimAtPath("/World")).AddTransformOp().Set(Gf.Matrix4d(matrix))
    stage.Save()
    converted = pixels(stage.GetRootLayer().realPath)
    # A pane of two triangles: rounding moves its few hundred photons by 10⁻⁵ of it, and none to another facet.
    np.testing.assert_allclose(converted, plain, atol=5e-3 * plain.max())


@stage_law
@given(order=st.permutations(("Pane", "Floor", "Surface", "Sun", "Camera")))
def test_the_order_of_prims_on_a_stage_does_not_matter(order, tmp_path_factory):
    stage = stage_at(tmp_path_factory.mktemp("ordered"))
    plain = pixels(stage.GetRootLayer().realPath)
    world = stage.GetRootLayer().GetPrimAtPath("/World")
    world.nameChildrenOrder = list(order)
    stage.Save()
    assert [child.GetName() for child in stage.GetPrimAtPath("/World").GetChildren()] == list(order)
    np.testing.assert_allclose(pixels(stage.GetRootLayer().realPath), plain, atol=1e-5 * plain.max())
