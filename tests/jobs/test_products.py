"""Several products of the render settings in one render, and the RenderVars of a product as AOVs."""

import pytest
from pxr import Gf, UsdGeom, UsdRender

from tests.usd.stages import SmallStage
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image
from tpdwarp.jobs.sequence import render

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
    return {
        path.name: next(iter(read_image(path)[0].values())).shape[::-1] for path in sorted(folder.glob("*.exr"))
    }


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
