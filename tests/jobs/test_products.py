"""Several products of the render settings in one render, and the RenderVars of a product as AOVs."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdRender

from tests.usd.stages import SmallStage
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image
from tpdwarp.jobs.sequence import render

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"wide": (8, 4), "square": (4, 4)}


@pytest.fixture
def stage(tmp_path):
    """A square that two cameras look at, each for a product of its own."""
    small = SmallStage(tmp_path)
    small.mesh()
    found = UsdRender.Settings.Define(small.stage, "/Render/Settings")
    small.stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    for name, size in SIZES.items():
        camera = UsdGeom.Camera.Define(small.stage, f"/{name}")
        camera.AddTranslateOp().Set(Gf.Vec3d(0.5, 0.5, 2))
        product = UsdRender.Product.Define(small.stage, f"/Render/{name}")
        product.GetCameraRel().SetTargets([f"/{name}"])
        product.CreateResolutionAttr(Gf.Vec2i(*size))
        product.CreateProductNameAttr(f"out/{name}.####.exr")
        var = UsdRender.Var.Define(small.stage, f"/Render/{name}_depth")
        var.CreateSourceNameAttr("depth" if name == "wide" else "curvature")
        product.GetOrderedVarsRel().SetTargets([var.GetPath()])
    found.GetProductsRel().SetTargets(["/Render/wide", "/Render/square"])
    small.stage.Save()
    return small.file


def sizes(folder):
    return {path.name: next(iter(read_image(path)[0].values())).shape[::-1] for path in sorted(folder.glob("*.exr"))}


def test_every_product_is_rendered_under_its_own_name(stage, tmp_path):
    result = render(stage, tmp_path / "frames" / "<product>.####.exr", frames="1:2", samples=1, threads=1)
    assert result.ok and len(result.outcomes) == 4
    found = sizes(tmp_path / "frames")
    assert found == {f"{name}.{frame:04}.exr": size for name, size in SIZES.items() for frame in (1, 2)}


def test_a_product_alone_is_rendered_where_one_is_chosen(stage, tmp_path):
    render(stage, tmp_path / "frames" / "<product>.exr", frames="1", product="square", samples=1, threads=1)
    assert sizes(tmp_path / "frames") == {"square.exr": (4, 4)}


def test_vars_of_the_product_are_channels_unless_others_are_asked_for(stage, tmp_path, caplog):
    render(stage, tmp_path / "a.exr", frames="1", samples=1, threads=1)
    assert "Z" in read_image(tmp_path / "a.exr")[0]
    render(stage, tmp_path / "b.exr", frames="1", samples=1, threads=1, aovs="N")
    assert "Z" not in read_image(tmp_path / "b.exr")[0]
    caplog.clear()
    render(stage, tmp_path / "c.exr", frames="1", samples=1, threads=1, product="square")
    assert "the RenderVar curvature is not rendered" in caplog.text


def test_what_has_no_place_for_several_names_is_refused(stage, tmp_path):
    with pytest.raises(InputError, match="2 products need a place for their names"):
        render(stage, tmp_path / "<product>.exr", frames="1", stats=tmp_path / "stats.json")
    (tmp_path / "bare").mkdir()
    bare = SmallStage(tmp_path / "bare")
    bare.mesh()
    bare.stage.Save()
    with pytest.raises(InputError, match="no such products"):
        render(bare.file, tmp_path / "<product>.exr", frames="1")


def wave_from_two_sides(tmp_path, second_shutter=0.5, height=16.0):
    """The wave, as two cameras at a height see it of which one moves, each for a product of its own."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "two.usda"))
    stage.GetRootLayer().subLayerPaths.append(str(ROOT / "usd_scenes" / "wave.usdc"))
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    for name, shutter in (("above", 0.5), ("aside", second_shutter)):
        camera = UsdGeom.Camera.Define(stage, f"/{name}")
        camera.CreateShutterCloseAttr(shutter)
        move = camera.AddTranslateOp()
        move.Set(Gf.Vec3d(0, 0, height))
        if name == "aside":
            move.Set(Gf.Vec3d(0.2, 0, height + 0.5), 1)
            move.Set(Gf.Vec3d(0.4, 0, height + 0.5), 3)
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.GetCameraRel().SetTargets([f"/{name}"])
        product.CreateResolutionAttr(Gf.Vec2i(12, 8) if name == "above" else Gf.Vec2i(16, 10))
    settings.GetProductsRel().SetTargets(["/Render/above", "/Render/aside"])
    stage.Save()
    return stage.GetRootLayer().realPath


def rendered_together_and_apart(stage, tmp_path, **options):
    """Images of both products from one command, and from one command each; what became of the former."""
    options = {"frames": "1:2", "photons": 1024, "samples": 1, "threads": 1, **options}
    result = render(stage, tmp_path / "together" / "<product>.####.exr", **options)
    for name in ("above", "aside"):
        render(stage, tmp_path / "apart" / f"{name}.####.exr", product=name, **options)
    files = [f"{name}.{frame:04}.exr" for name in ("above", "aside") for frame in (1, 2)]
    return [[read_image(tmp_path / folder / file)[0] for file in files] for folder in ("together", "apart")], result


@pytest.mark.parametrize(("height", "shares"), [(16.0, True), (3.0, False)])
def test_products_share_one_trace_and_show_what_each_shows_alone(height, shares, tmp_path):
    """From nearby each sees a part of the light, and has photons of its own, as when it is alone."""
    stage = wave_from_two_sides(tmp_path, height=height)
    (together, apart), result = rendered_together_and_apart(stage, tmp_path)
    for one, other in zip(together, apart, strict=True):
        assert one["R"].any()
        for name in other:
            np.testing.assert_array_equal(one[name], other[name])
    traced = {outcome.path.rsplit("/")[-1]: "trace" in outcome.seconds for outcome in result.outcomes}
    first = {f"{name}.000{frame}.exr": name == "above" for name in ("above", "aside") for frame in (1, 2)}
    assert {name: expected or not shares for name, expected in first.items()} == traced


def test_products_of_other_shutters_have_photons_of_their_own(tmp_path):
    (together, apart), result = rendered_together_and_apart(wave_from_two_sides(tmp_path, 1.0), tmp_path)
    for one, other in zip(together, apart, strict=True):
        np.testing.assert_array_equal(one["R"], other["R"])
    assert all("trace" in outcome.seconds for outcome in result.outcomes)
