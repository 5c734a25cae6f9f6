"""More stages as studios send them: what is read is what USD itself says of them."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade

from tests.usd.read.test_studio_stages import STILL, new, opened, square, world
from tests.usd.stages import mesh_named
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene


def preview(stage, path, **inputs):
    """A material of UsdPreviewSurface."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Shader")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        kind = Sdf.ValueTypeNames.Float if isinstance(value, float) else Sdf.ValueTypeNames.Color3f
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def colour_of(scene, path):
    return mesh_named(scene, path).materials[0].color


def test_instancers_in_instancers_with_animated_prototypes_show_what_their_masks_leave_at_each_frame(tmp_path):
    stage = new(tmp_path)
    outer = UsdGeom.PointInstancer.Define(stage, "/Outer")
    inner = UsdGeom.PointInstancer.Define(stage, "/Outer/Inner")
    bead = UsdGeom.Sphere.Define(stage, "/Outer/Inner/Bead")
    place = bead.AddTranslateOp()
    for time, radius, x in ((1, 0.1, 0.0), (5, 0.3, 1.0)):
        bead.CreateRadiusAttr().Set(radius, time)
        place.Set(Gf.Vec3d(x, 0, 0), time)
    for instancer, target, positions in ((inner, bead, [(0, 0, 0), (0, 2, 0)]), (outer, inner, [(0, 0, 0), (0, 0, 5)])):
        instancer.CreatePrototypesRel().SetTargets([target.GetPath()])
        instancer.CreateProtoIndicesAttr([0, 0])
        instancer.CreatePositionsAttr(positions)
    inner.CreateIdsAttr([10, 20])
    inner.CreateInvisibleIdsAttr().Set([20], 1)
    inner.CreateInvisibleIdsAttr().Set([], 2)
    inner.CreateInvisibleIdsAttr().Set([10], 4)
    source = opened(stage)
    for time, shown in ((1, [0.0]), (3, [0.0, 2.0]), (5, [2.0])):
        found = list(source.at(Shutter.still(time)).objects())
        middles = sorted(tuple(np.round(0.5 * (o.points.min(axis=0) + o.points.max(axis=0)), 4)) for o in found)
        x = (time - 1) / 4
        assert middles == sorted((x, y, z) for y in shown for z in (0.0, 5.0))
        radius = bead.GetRadiusAttr().Get(time)
        for one in found:
            np.testing.assert_allclose(0.5 * np.ptp(one.points[:, 2]), radius, rtol=1e-3)


def test_a_variant_says_whether_a_cage_is_subdivided(tmp_path):
    stage = new(tmp_path)
    cube = square(stage, "/Asset/Cage")
    asset = stage.GetPrimAtPath("/Asset")
    variants = asset.GetVariantSets().AddVariantSet("detail")
    cube.GetPrim().RemoveProperty("subdivisionScheme")
    for name, scheme in (("cage", "none"), ("smooth", "catmullClark"), ("silent", None)):
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            if scheme:
                UsdGeom.Mesh(stage.GetPrimAtPath("/Asset/Cage")).CreateSubdivisionSchemeAttr(scheme)
    counts = {}
    for name in ("cage", "smooth", "silent"):
        variants.SetVariantSelection(name)
        counts[name] = len(mesh_named(opened(stage).at(STILL), "/Asset/Cage").triangles)
    assert counts["cage"] == 2 and counts["smooth"] > 2
    assert counts["silent"] == counts["smooth"]


def test_subsets_of_a_partition_bind_what_holes_leave(tmp_path):
    stage = new(tmp_path)
    mesh = UsdGeom.Mesh.Define(stage, "/Strip")
    mesh.CreatePointsAttr([(x, y, 0) for x in range(5) for y in (0, 1)])
    mesh.CreateFaceVertexCountsAttr([4] * 4)
    mesh.CreateFaceVertexIndicesAttr([i for k in range(4) for i in (2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1)])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateHoleIndicesAttr([1])
    red, blue = (preview(stage, f"/Looks/{n}", diffuseColor=c) for n, c in (("R", (1, 0, 0)), ("B", (0, 0, 1))))
    api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    for name, faces, material in (("left", [0, 1], red), ("right", [3], blue), ("middle", [2], red)):
        subset = api.CreateMaterialBindSubset(name, faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    api.SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.partition)
    found = mesh_named(opened(stage).at(STILL), "/Strip")
    by_triangle = [found.materials[k].color for k in found.triangle_materials]
    middles = found.points[found.triangles].mean(axis=1)[:, 0]
    for x, color in zip(middles, by_triangle, strict=True):
        np.testing.assert_allclose(color, (0, 0, 1) if x > 3 else (1, 0, 0), atol=1e-6)
    assert len(found.triangles) == 6


def test_a_pivot_by_matrices_and_their_inverses_is_usds(tmp_path):
    stage = new(tmp_path)
    mesh = square(stage, "/Rig/Plate")
    rig = UsdGeom.Xformable(stage.GetPrimAtPath("/Rig"))
    pivot = rig.AddTransformOp(opSuffix="pivot")
    pivot.Set(Gf.Matrix4d().SetRotate(Gf.Rotation((0, 0, 1), 30)) * Gf.Matrix4d().SetTranslate((1, 2, 3)))
    turn = rig.AddRotateXYZOp(opSuffix="turn")
    for time, angles in ((1, (0, 0, 0)), (5, (10, 80, -30))):
        turn.Set(Gf.Vec3f(*angles), time)
    squash = rig.AddTransformOp(opSuffix="squash")
    squash.Set(Gf.Matrix4d(1, 0.5, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
    rig.SetXformOpOrder([pivot, turn, squash, rig.AddTransformOp(opSuffix="pivot", isInverseOp=True)])
    source = opened(stage)
    for time in (1, 2.5, 5):
        found = mesh_named(source.at(Shutter.still(time)), "/Rig/Plate").points
        np.testing.assert_allclose(found, world(mesh.GetPrim(), time), atol=1e-5)


def test_a_sublayer_of_another_rate_brings_its_clips_at_the_times_that_usd_gives_them(tmp_path):
    clip = Usd.Stage.CreateNew(str(tmp_path / "clip.usda"))
    points = UsdGeom.Mesh.Define(clip, "/Sheet").CreatePointsAttr()
    for time in range(0, 11):
        points.Set([(x, y, 0.1 * time**2) for x, y, _ in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))], time)
    clip.GetRootLayer().Save()
    slow = new(tmp_path, "slow.usda")
    sheet = square(slow, "/Sheet")
    sheet.GetPrim().RemoveProperty("points")
    sheet.GetPrim().CreateAttribute("points", Sdf.ValueTypeNames.Point3fArray)
    api = Usd.ClipsAPI(sheet.GetPrim())
    api.SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])
    api.SetClipPrimPath("/Sheet")
    api.SetClipActive([(0, 0)])
    api.SetClipTimes([(0, 0), (10, 10)])
    api.SetClipManifestAssetPath("./clip.usda")
    slow.GetRootLayer().Save()
    stage = new(tmp_path, "fast.usda", end=12)
    stage.SetTimeCodesPerSecond(30)
    stage.GetRootLayer().subLayerPaths.append("./slow.usda")
    stage.GetRootLayer().subLayerOffsets[0] = Sdf.LayerOffset(2, 1)
    source = opened(stage)
    sheet = stage.GetPrimAtPath("/Sheet")
    for time in (2, 4.5, 7, 12):
        found = mesh_named(source.at(Shutter.still(time)), "/Sheet").points
        np.testing.assert_allclose(found, world(sheet, time), atol=1e-5)


def test_the_strongest_of_bindings_wins_by_purpose_collection_and_strength(tmp_path):
    stage = new(tmp_path)
    names = ("all", "full", "show", "own", "strong")
    looks = {n: preview(stage, f"/Looks/{n}", diffuseColor=(0.1 * k, 0.5, 0.5)) for k, n in enumerate(names)}
    for path in ("/Set/Plain", "/Set/Owned", "/Set/Purposed", "/Set/Left/Out", "/Strong/Own"):
        square(stage, path)

    def bind(path, look, *arguments, **options):
        UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(path)).Bind(looks[look], *arguments, **options)

    root = stage.GetPrimAtPath("/Set")
    collection = Usd.CollectionAPI.Apply(root, "geo")
    collection.CreateExpansionRuleAttr("expandPrims")
    collection.CreateIncludeRootAttr(True)
    collection.CreateExcludesRel().SetTargets(["/Set/Left"])
    UsdShade.MaterialBindingAPI.Apply(root).Bind(collection, looks["all"], "geo")
    bind("/Set/Owned", "own")
    bind("/Set/Purposed", "show", materialPurpose="preview")
    bind("/Set/Purposed", "full", materialPurpose="full")
    bind("/Strong", "strong", bindingStrength="strongerThanDescendants")
    bind("/Strong/Own", "own")
    scene = opened(stage).at(STILL)
    for path in ("/Set/Plain", "/Set/Owned", "/Set/Purposed", "/Set/Left/Out", "/Strong/Own"):
        bound, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial("full")
        if not bound:
            np.testing.assert_allclose(colour_of(scene, path), 0.18)
            continue
        color = bound.ComputeSurfaceSource("")[0].GetInput("diffuseColor").Get()
        np.testing.assert_allclose(colour_of(scene, path), color, rtol=1e-5)


def test_an_interface_through_two_nested_graphs_gives_the_value_of_the_material(tmp_path):
    stage = new(tmp_path)
    UsdShade.MaterialBindingAPI.Apply(square(stage, "/Plate").GetPrim())
    material = preview(stage, "/Look", roughness=0.5)
    material.CreateInput("paint", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0.2, 0.4, 0.6))
    library = UsdShade.NodeGraph.Define(stage, "/Library/Graph")
    library.CreateInput("tint", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0.9))
    inside = UsdShade.NodeGraph.Define(stage, "/Library/Graph/Inside")
    inside.CreateInput("a", Sdf.ValueTypeNames.Color3f).ConnectToSource(library.GetInput("tint"))
    product = UsdShade.Shader.Define(stage, "/Library/Graph/Inside/Multiply")
    product.CreateIdAttr("ND_multiply_color3FA")
    product.CreateInput("in1", Sdf.ValueTypeNames.Color3f).ConnectToSource(inside.GetInput("a"))
    product.CreateInput("in2", Sdf.ValueTypeNames.Float).Set(0.5)
    product.CreateOutput("out", Sdf.ValueTypeNames.Color3f)
    inside.CreateOutput("out", Sdf.ValueTypeNames.Color3f).ConnectToSource(product.GetOutput("out"))
    library.CreateOutput("out", Sdf.ValueTypeNames.Color3f).ConnectToSource(inside.GetOutput("out"))
    stage.OverridePrim("/Library").SetSpecifier(Sdf.SpecifierClass)
    instance = stage.DefinePrim("/Look/Graph", "NodeGraph")
    instance.GetReferences().AddInternalReference("/Library/Graph")
    graph = UsdShade.NodeGraph(instance)
    graph.GetInput("tint").ConnectToSource(material.GetInput("paint"))
    shader = UsdShade.Shader(stage.GetPrimAtPath("/Look/Shader"))
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(graph.GetOutput("out"))
    UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/Plate")).Bind(material)
    np.testing.assert_allclose(colour_of(opened(stage).at(STILL), "/Plate"), (0.1, 0.2, 0.3), rtol=1e-5)


def test_glass_mixed_into_glass_and_layered_glass_of_materialx_is_glass(tmp_path):
    stage = new(tmp_path)

    def node(path, kind, **inputs):
        shader = UsdShade.Shader.Define(stage, path)
        shader.CreateIdAttr(kind)
        for name, value in inputs.items():
            if isinstance(value, UsdShade.Shader):
                shader.CreateInput(name, Sdf.ValueTypeNames.Token).ConnectToSource(value.ConnectableAPI(), "out")
            else:
                of = Sdf.ValueTypeNames.String if isinstance(value, str) else Sdf.ValueTypeNames.Float
                shader.CreateInput(name, of).Set(value)
        shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
        return shader

    def glass(path, ior):
        return node(
            path, "ND_standard_surface_surfaceshader", transmission=1.0, specular_IOR=ior, specular_roughness=0.0
        )

    mixed = node("/Looks/Mix/Mix", "ND_mix_surfaceshader", fg=glass("/Looks/Mix/A", 1.6), bg=glass("/Looks/Mix/B", 1.4),
                 mix=0.25)  # fmt: skip
    top = node("/Looks/Layer/Top", "ND_dielectric_bsdf", scatter_mode="RT", ior=1.33)
    base = node("/Looks/Layer/Base", "ND_dielectric_bsdf", scatter_mode="T", ior=1.33)
    layered = node("/Looks/Layer/Layer", "ND_layer_bsdf", top=top, base=base)
    surface = node("/Looks/Layer/Surface", "ND_surface", bsdf=layered)
    for name, shader in (("Mix", mixed), ("Layer", surface)):
        material = UsdShade.Material.Define(stage, f"/Looks/{name}")
        material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
        UsdShade.MaterialBindingAPI.Apply(square(stage, f"/{name}").GetPrim()).Bind(material)
    source = opened(stage)
    scene = source.at(STILL)
    # The larger part of a mixture, which is said.
    assert any("larger part" in line for line in source.warnings.messages)
    for name, ior in (("Mix", 1.4), ("Layer", 1.33)):
        (found,) = mesh_named(scene, f"/{name}").materials
        assert found.interaction == Interaction.DIELECTRIC
        assert found.ior == pytest.approx(ior, rel=1e-4)


def test_a_deep_product_is_named_and_the_raster_beside_it_rendered(tmp_path):
    stage = new(tmp_path)
    square(stage, "/Plate")
    camera = UsdGeom.Camera.Define(stage, "/Cam")
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateCameraRel().SetTargets([camera.GetPath()])
    settings.CreateResolutionAttr(Gf.Vec2i(64, 32))
    for name, kind, width in (("Deep", "deepRaster", 32), ("Flat", "raster", 48)):
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.CreateProductTypeAttr(kind)
        product.CreateResolutionAttr(Gf.Vec2i(width, 16))
        settings.GetProductsRel().AddTarget(product.GetPath())
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    source = opened(stage)
    assert source.resolution() == (48, 16)
    assert any("/Render/Deep: is left out" in line for line in source.warnings.messages)
    deep = opened(stage, product="Deep")
    assert deep.resolution() == (32, 16)
    assert any("/Render/Deep.productType: is deepRaster" in line for line in deep.warnings.messages)


def test_tiles_of_a_package_are_found_by_their_number(tmp_path):
    stage = new(tmp_path, "tiled.usda")
    points = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    mesh = square(stage, "/Plate", points)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set([Gf.Vec2f(*point[:2]) for point in points])
    material = preview(stage, "/Look")
    texture = UsdShade.Shader.Define(stage, "/Look/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("tile.<UDIM>.png")
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
    reader = UsdShade.Shader.Define(stage, "/Look/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    shader = UsdShade.Shader(stage.GetPrimAtPath("/Look/Shader"))
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    stage.GetRootLayer().Save()
    values = {1001: (1.0, 0.0, 0.0), 1002: (0.0, 0.0, 1.0)}
    for number, color in values.items():
        tile = oiio.ImageBuf(oiio.ImageSpec(4, 4, 3, "uint8"))
        oiio.ImageBufAlgo.fill(tile, color)
        assert tile.write(str(tmp_path / f"tile.{number}.png"))
    package = tmp_path / "tiled.usdz"
    with Sdf.ZipFileWriter.CreateNew(str(package)) as writer:
        for name in ("tiled.usda", "tile.1001.png", "tile.1002.png"):
            writer.AddFile(str(tmp_path / name), name)
    source = StageScene.open(str(package), Settings())
    found = mesh_named(source.at(STILL), "/Plate").materials[0].texture
    np.testing.assert_allclose(found.tiles[0, 0][0, 0], values[1001])
    np.testing.assert_allclose(found.tiles[1, 0][0, 0], values[1002])


@pytest.mark.parametrize("kind", ["RectLight", "DomeLight", "Shader"])
def test_a_picture_of_a_name_longer_than_any_is_one_that_is_missing(kind, tmp_path):
    """The file system refuses to look for it, as it does in folders that are closed to the user."""
    stage = new(tmp_path)
    mesh = square(stage, "/Plate")
    name = Sdf.AssetPath("x" * 300 + ".png")
    if kind == "Shader":
        material = preview(stage, "/Look")
        texture = UsdShade.Shader.Define(stage, "/Look/Texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(name)
        texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        shader = UsdShade.Shader(stage.GetPrimAtPath("/Look/Shader"))
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    else:
        light = stage.DefinePrim("/Lit", kind)
        light.CreateAttribute("inputs:texture:file", Sdf.ValueTypeNames.Asset).Set(name)
    source = opened(stage)
    source.at(STILL)
    assert any("cannot be read" in line for line in source.warnings.messages)


def test_without_meters_a_unit_is_a_centimetre_and_lights_of_the_old_schema_shine(tmp_path):
    stage = new(tmp_path)
    square(stage, "/Plate")
    for path, kind, values in (
        ("/Bulb", "SphereLight", {"intensity": 3.0, "radius": 0.5, "exposure": 1.0}),
        ("/Sun", "DistantLight", {"intensity": 2.0, "angle": 1.0}),
    ):
        prim = stage.DefinePrim(path, kind)
        for name, value in values.items():
            prim.CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(value)
    bulb, sun = opened(stage).at(STILL).lights
    np.testing.assert_allclose(bulb.power, 6.0 * np.pi * 0.5**2, rtol=1e-5)
    assert bulb.extent.radius == pytest.approx(0.5)
    assert sun.extent.radius == pytest.approx(np.radians(0.5), rel=1e-5)
    assert not UsdGeom.StageHasAuthoredMetersPerUnit(stage) and UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert UsdLux.SphereLight(stage.GetPrimAtPath("/Bulb"))
