"""Models drawn as cards: as UsdImaging draws them."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdLux

from tests.usd.read.test_studio_stages import STILL, new, opened, square
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

BOX = np.array([(-1.0, 0.0, 2.0), (3.0, 1.0, 4.0)])
SIDES = ("XPos", "XNeg", "YPos", "YNeg", "ZPos", "ZNeg")
OUT = {side: (1 if "Pos" in side else -1) * np.eye(3)["XYZ".index(side[0])] for side in SIDES}
# The top of a picture: up, and on top and bottom away from and towards a viewer who looks along y.
UP = {"XPos": (0, 0, 1), "XNeg": (0, 0, 1), "YPos": (0, 0, 1), "YNeg": (0, 0, 1), "ZPos": (0, 1, 0), "ZNeg": (0, -1, 0)}


def picture(folder, name, color=(0.5, 0.25, 0.125, 1.0)):
    image = oiio.ImageBuf(oiio.ImageSpec(4, 4, 4, "float"))
    oiio.ImageBufAlgo.fill(image, color)
    assert image.write(str(folder / name))


def model(stage, path="/Tree", mode="cards", kind=Kind.Tokens.component, **attributes):
    """A model whose own contents are a square and a lamp, with a box of its own."""
    xform = UsdGeom.Xform.Define(stage, path)
    Usd.ModelAPI(xform.GetPrim()).SetKind(kind)
    square(stage, f"{path}/Leaf")
    UsdLux.SphereLight.Define(stage, f"{path}/Lamp")
    api = UsdGeom.ModelAPI.Apply(xform.GetPrim())
    api.SetExtentsHint([Gf.Vec3f(*map(float, corner)) for corner in BOX])
    if mode:
        api.CreateModelDrawModeAttr(mode)
    for name, value in attributes.items():
        kind_of = Sdf.ValueTypeNames.Asset if name.startswith("cardTexture") else Sdf.ValueTypeNames.Token
        value = Sdf.AssetPath(value) if name.startswith("cardTexture") else value
        xform.GetPrim().CreateAttribute(f"model:{name}", kind_of, custom=False).Set(value)
    return api


def cards_of(mesh):
    """Corners [2, 3, 3], their coordinates [2, 3, 2], normal and material of each card."""
    for first in range(0, len(mesh.triangles), 2):
        rows = mesh.triangles[first : first + 2]
        points = mesh.points[rows]
        normal = np.cross(points[0, 1] - points[0, 0], points[0, 2] - points[0, 0])
        coordinates = mesh.coordinates[mesh.coordinate_indices[first : first + 2]]
        yield points, coordinates, normal / np.linalg.norm(normal), mesh.materials[mesh.triangle_materials[first]]


def gradients(points, coordinates):
    """How positions change with s and t, shape [2, 3]."""
    flat_points, flat = points.reshape(-1, 3), coordinates.reshape(-1, 2)
    return np.linalg.lstsq(flat - flat.mean(axis=0), flat_points - flat_points.mean(axis=0), rcond=None)[0]


def test_pictures_stand_upright_on_the_sides_of_the_box_as_seen_from_outside(tmp_path):
    stage = new(tmp_path)
    for number, side in enumerate(SIDES):
        picture(tmp_path, f"{side}.tif", (0.1 * number, 0.5, 0.5, 1.0))
    model(stage, cardGeometry="box", **{f"cardTexture{side}": f"./{side}.tif" for side in SIDES})
    (mesh,) = opened(stage).at(STILL).meshes
    assert len(mesh.triangles) == 12
    for points, coordinates, normal, material in cards_of(mesh):
        side = SIDES[round(10 * material.texture.tiles[0, 0][0, 0, 0].item())]
        np.testing.assert_allclose(normal, OUT[side], atol=1e-6)
        far = BOX.max(axis=0) if "Pos" in side else BOX.min(axis=0)
        np.testing.assert_allclose(points @ OUT[side], far @ OUT[side], atol=1e-6)
        right, up = gradients(points, coordinates)
        size = BOX[1] - BOX[0]
        np.testing.assert_allclose(up, np.abs(UP[side]) @ size * np.array(UP[side]), atol=1e-5)
        across = np.cross(-OUT[side], UP[side])
        np.testing.assert_allclose(right, np.abs(across) @ size * across, atol=1e-5)
        assert coordinates.min() == 0 and coordinates.max() == 1


@pytest.mark.parametrize("side", SIDES)
def test_the_side_without_a_picture_shows_that_of_the_other_from_behind(side, tmp_path):
    stage = new(tmp_path)
    picture(tmp_path, "one.tif")
    model(stage, cardGeometry="box", **{f"cardTexture{side}": "./one.tif"})
    (mesh,) = opened(stage).at(STILL).meshes
    found = list(cards_of(mesh))
    assert len(found) == 2
    np.testing.assert_allclose(found[0][2], -found[1][2], atol=1e-6)
    for points, coordinates, _, material in found:
        assert material.threshold == pytest.approx(0.1) and material.texture is not None
        _, up = gradients(points, coordinates)
        assert up @ np.array(UP[side]) > 0
    first, second = (gradients(points, coordinates) for points, coordinates, *_ in found)
    np.testing.assert_allclose(first, second, atol=1e-5)


def test_a_cross_has_a_card_across_each_axis_that_has_a_picture(tmp_path):
    stage = new(tmp_path)
    picture(tmp_path, "one.tif")
    picture(tmp_path, "other.tif", (0.9, 0.9, 0.9, 1.0))
    model(stage, cardTextureXPos="./one.tif", cardTextureYPos="./one.tif", cardTextureYNeg="./other.tif")
    (mesh,) = opened(stage).at(STILL).meshes
    across, front, back = cards_of(mesh)
    np.testing.assert_allclose(across[0][..., 0], 1.0, atol=1e-6)
    # Back to back, each hides the other.
    assert 0 < front[0][..., 1].min() - back[0][..., 1].max() < 1e-3
    assert (front[2] @ (0, 1, 0), back[2] @ (0, 1, 0)) == pytest.approx((1, -1))
    assert back[3].texture.tiles[0, 0][0, 0, 0] == pytest.approx(0.9, abs=1e-3)


def test_without_pictures_the_whole_box_has_the_colour_of_the_mode_and_nothing_inside_is_drawn(tmp_path):
    stage = new(tmp_path)
    model(stage, cardGeometry="box").CreateModelDrawModeColorAttr((0.2, 0.4, 0.6))
    source = opened(stage)
    scene = source.at(STILL)
    (mesh,) = scene.meshes
    np.testing.assert_allclose((mesh.points.min(axis=0), mesh.points.max(axis=0)), BOX, atol=1e-6)
    np.testing.assert_allclose(mesh.colors, [(0.2, 0.4, 0.6)], atol=1e-6)
    assert source.lit_by_camera


def test_modes_are_inherited_and_count_for_components_and_what_asks_for_them(tmp_path):
    stage = new(tmp_path)
    for path, mode in (("/Set", "cards"), ("/Other", "")):
        group = UsdGeom.Xform.Define(stage, path)
        Usd.ModelAPI(group.GetPrim()).SetKind(Kind.Tokens.group)
        if mode:
            UsdGeom.ModelAPI.Apply(group.GetPrim()).CreateModelDrawModeAttr(mode)
    model(stage, "/Set/Tree", mode="")
    model(stage, "/Set/Own", mode="default")
    model(stage, "/Set/Group", mode="", kind=Kind.Tokens.group)
    model(stage, "/Other/Tree", mode="")
    model(stage, "/Other/Cards", mode="cards")
    model(stage, "/Other/Asks", mode="cards", kind="").CreateModelApplyDrawModeAttr(True)
    model(stage, "/Other/Says", mode="cards", kind="")
    drawn = {mesh.path.rpartition("/")[0]: mesh.path.endswith("cards") for mesh in opened(stage).at(STILL).meshes}
    assert drawn == {
        "/Set/Tree": True, "/Set/Own": False, "/Set/Group": False,
        "/Other/Tree": False, "/Other/Cards": True, "/Other/Asks": True, "/Other/Says": False,
    }  # fmt: skip


def test_instances_and_what_is_referenced_within_the_stage_stand_as_cards_too(tmp_path):
    asset = new(tmp_path, "tree.usda")
    model(asset, "/Tree")
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Tree"))
    asset.GetRootLayer().Save()
    stage = new(tmp_path)
    model(stage, "/Inside")
    for number, reference in enumerate((("./tree.usda", ""), ("./tree.usda", ""), ("", "/Inside"))):
        prim = UsdGeom.Xform.Define(stage, f"/Tree{number}")
        prim.AddTranslateOp().Set((10.0 * number, 0, 0))
        prim.GetPrim().GetReferences().AddReference(*reference)
        prim.GetPrim().SetInstanceable(True)
    found = {mesh.path: mesh.points.min(axis=0) for mesh in opened(stage).at(STILL).objects()}
    assert set(found) == {f"/{name}/tpdwarp_cards" for name in ("Inside", "Tree0", "Tree1", "Tree2")}
    for number in range(3):
        np.testing.assert_allclose(found[f"/Tree{number}/tpdwarp_cards"], BOX[0] + (10 * number, 0, 0), atol=1e-5)


def test_a_stage_that_is_handed_over_keeps_its_models_and_what_stands_in_viewports_alone_is_said(tmp_path):
    stage = new(tmp_path)
    model(stage)
    model(stage, "/Bush", mode="bounds")
    model(stage, "/Shrub", mode="cards", cardGeometry="fromTexture")
    source = StageScene.open(stage, Settings())
    paths = {mesh.path for mesh in source.at(STILL).meshes}
    assert paths == {"/Tree/tpdwarp_cards", "/Bush/Leaf", "/Shrub/Leaf"}
    assert stage.GetPrimAtPath("/Tree/Leaf").IsActive() and not stage.GetPrimAtPath("/Tree/tpdwarp_cards")
    said = [line for line in source.warnings.messages if "the model itself is rendered" in line]
    assert len(said) == 2 and any("/Bush.model:drawMode: is bounds," in line for line in said)
    assert any("/Shrub.model:drawMode: is cards fromTexture" in line for line in said)


def test_a_model_whose_extent_is_no_number_is_rendered_itself_and_said(tmp_path):
    stage = new(tmp_path)
    model(stage).SetExtentsHint([Gf.Vec3f(0, float("nan"), 0), Gf.Vec3f(1, 1, float("inf"))])
    source = opened(stage)
    assert [mesh.path for mesh in source.at(STILL).meshes] == ["/Tree/Leaf"]
    assert any("/Tree.model:drawMode: is cards, of a model that has no extent" in m for m in source.warnings.messages)
