"""Materials that came along with each reference to their asset are read once, and differ where their copies do."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from tests.usd.stages import SmallStage, mesh_named
from tpdwarp.scene.description import Shutter

TYPES = Sdf.ValueTypeNames
CORNERS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
COPIES = ("/A", "/B")


@pytest.fixture
def small(tmp_path):
    """A stage that references a textured quad with its material twice."""
    small = SmallStage(tmp_path, end=2)
    for number, name in enumerate(("first.exr", "second.exr")):
        pixels = np.full((2, 2, 3), 0.2 + 0.3 * number, np.float32)
        pixels[0, 0] = 0.9
        assert oiio.ImageBuf(pixels).write(str(Path(tmp_path) / name))
    stage = small.stage
    stage.CreateClassPrim("/Asset")
    surface = small.preview("/Asset/Material", roughness=0.5)
    texture = UsdShade.Shader.Define(stage, "/Asset/Material/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", TYPES.Asset).Set("./first.exr")
    for side in ("wrapS", "wrapT"):
        texture.CreateInput(side, TYPES.Token).Set("repeat")
    surface.CreateInput("diffuseColor", TYPES.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    displaced = UsdShade.Shader.Define(stage, "/Asset/Material/Displaced")
    displaced.CreateIdAttr("UsdPreviewSurface")
    material = UsdShade.Material(stage.GetPrimAtPath("/Asset/Material"))
    material.CreateDisplacementOutput().ConnectToSource(displaced.ConnectableAPI(), "displacement")
    mesh = small.mesh("/Asset/Mesh")
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(*corner) for corner in CORNERS])
    small.bind(mesh, "/Asset/Material")
    for copy in COPIES:
        stage.DefinePrim(copy, "Xform").GetReferences().AddInternalReference("/Asset")
    return small


def textures_of(scene, frame):
    at = scene.at(Shutter.still(frame))
    return [mesh_named(at, f"{copy}/Mesh").materials[0].texture for copy in COPIES]


def of_the_second(small, name, kind="Texture"):
    """An input of the second copy's texture."""
    shader = UsdShade.Shader(small.stage.OverridePrim(f"/B/Material/{kind}"))
    return shader.CreateInput(name, {"file": TYPES.Asset, "scale": TYPES.Float4}.get(name, TYPES.Token))


def test_copies_share_their_textures_and_keep_their_names(small):
    scene = small.open()
    first, second = textures_of(scene, 1)
    assert first.tiles[0, 0] is second.tiles[0, 0] and first is second
    at = scene.at(Shutter.still(1))
    assert [mesh_named(at, f"{copy}/Mesh").materials[0].path for copy in COPIES] == ["/A/Material", "/B/Material"]


def test_what_is_said_of_a_material_is_said_of_its_copies(small):
    scene = small.open()
    textures_of(scene, 1)
    (message,) = scene.warnings.messages
    assert "/A/Material and 1 more: displacement is not rendered" in message


@pytest.mark.parametrize(
    ("name", "value", "mean"),
    [("file", "./second.exr", 0.6), ("scale", Gf.Vec4f(0.5), 0.1875), ("wrapS", "clamp", 0.375)],
)
def test_what_a_copy_overrides_is_its_own(small, name, value, mean):
    of_the_second(small, name).Set(value)
    first, second = textures_of(small.open(), 1)
    assert first.tiles[0, 0].mean() == pytest.approx(0.375, rel=1e-3)
    assert second.tiles[0, 0].mean() == pytest.approx(mean, rel=1e-3)
    assert (first.wrap == second.wrap) == (name != "wrapS")


def test_a_copy_that_changes_with_time_is_its_own_and_does_so(small):
    files = of_the_second(small, "file").GetAttr()
    for frame, name in ((1, "./first.exr"), (2, "./second.exr")):
        files.Set(name, frame)
    scene = small.open()
    found = [[texture.tiles[0, 0].mean() for texture in textures_of(scene, frame)] for frame in (1, 2)]
    np.testing.assert_allclose(found, [[0.375, 0.375], [0.375, 0.6]], rtol=1e-3)


def test_copies_that_change_with_time_share_the_textures_of_each_frame(small):
    files = UsdShade.Shader(small.stage.GetPrimAtPath("/Asset/Material/Texture")).GetInput("file").GetAttr()
    for frame, name in ((1, "./first.exr"), (2, "./second.exr")):
        files.Set(name, frame)
    scene = small.open()
    for frame, mean in ((1, 0.375), (2, 0.6), (1, 0.375)):
        first, second = textures_of(scene, frame)
        assert first is second and first.tiles[0, 0].mean() == pytest.approx(mean, rel=1e-3)


def test_a_copy_fed_from_elsewhere_is_its_own(small):
    elsewhere = UsdShade.Shader.Define(small.stage, "/Elsewhere")
    elsewhere.CreateIdAttr("UsdUVTexture")
    elsewhere.CreateInput("file", TYPES.Asset).Set("./second.exr")
    surface = UsdShade.Shader(small.stage.OverridePrim("/B/Material/Surface"))
    surface.CreateInput("diffuseColor", TYPES.Color3f).ConnectToSource(elsewhere.ConnectableAPI(), "rgb")
    first, second = textures_of(small.open(), 1)
    assert first.tiles[0, 0].mean() == pytest.approx(0.375, rel=1e-3)
    assert second.tiles[0, 0].mean() == pytest.approx(0.6, rel=1e-3)
