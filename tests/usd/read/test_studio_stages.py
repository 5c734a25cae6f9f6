"""Stages as studios send them, several features of USD in each: what is read is what USD itself says of them."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Kind, Sdf, Ts, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, UsdSkel, UsdUtils, Vt

from tests.usd.stages import SQUARE, mesh_named, set_inputs
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

STILL = Shutter.still(1)


def new(folder, name="shot.usda", start=1, end=5):
    stage = Usd.Stage.CreateNew(str(folder / name))
    stage.SetStartTimeCode(start)
    stage.SetEndTimeCode(end)
    stage.SetTimeCodesPerSecond(24)
    return stage


def square(stage, path, points=SQUARE):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    return mesh


def opened(stage, **settings):
    for layer in stage.GetUsedLayers():
        if not layer.anonymous:
            layer.Save()
    return StageScene.open(stage.GetRootLayer().realPath, Settings(**settings))


def world(prim, time):
    """Where USD itself puts the points of a mesh."""
    matrix = UsdGeom.XformCache(time).GetLocalToWorldTransform(prim)
    points = UsdGeom.Mesh(prim).GetPointsAttr().Get(time)
    return np.array([matrix.Transform(Gf.Vec3d(p)) for p in points])


def character(stage, root):
    """A strip of two quads on two joints, of which the upper turns and one corner has a shape of its own."""
    skel = UsdSkel.Root.Define(stage, root)
    bones = UsdSkel.Skeleton.Define(stage, f"{root}/Bones")
    bones.CreateJointsAttr(["Low", "Low/High"])
    rest = [Gf.Matrix4d(1), Gf.Matrix4d().SetTranslate((0, 1, 0))]
    bones.CreateRestTransformsAttr(rest)
    bones.CreateBindTransformsAttr(rest)
    moves = UsdSkel.Animation.Define(stage, f"{root}/Moves")
    moves.CreateJointsAttr(["Low", "Low/High"])
    moves.CreateBlendShapesAttr(["Smile"])
    for time, angle, weight in ((1, 0, 0.0), (3, 40, 1.0), (5, 90, 0.25)):
        turns = [Gf.Quatf(1), Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), angle).GetQuat())]
        moves.CreateRotationsAttr().Set(turns, time)
        moves.CreateTranslationsAttr().Set([Gf.Vec3f(0.1 * time, 0, 0), Gf.Vec3f(0, 1, 0)], time)
        moves.CreateScalesAttr().Set([Gf.Vec3h(1), Gf.Vec3h(1)], time)
        moves.CreateBlendShapeWeightsAttr().Set([weight], time)
    mesh = UsdGeom.Mesh.Define(stage, f"{root}/Body")
    mesh.CreatePointsAttr([(x, y, 0) for y in (0, 1, 2) for x in (-0.5, 0.5)])
    mesh.CreateFaceVertexCountsAttr([4, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 3, 2, 2, 3, 5, 4])
    mesh.CreateSubdivisionSchemeAttr("none")
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * 6)
    binding.CreateJointWeightsPrimvar(False, 2).Set([1.0, 0.0] * 2 + [0.5, 0.5] * 2 + [0.0, 1.0] * 2)
    binding.CreateSkeletonRel().SetTargets([bones.GetPath()])
    shape = UsdSkel.BlendShape.Define(stage, f"{root}/Body/Smile")
    shape.CreateOffsetsAttr([(0, 0, 0.5)])
    shape.CreatePointIndicesAttr([5])
    binding.CreateBlendShapesAttr(["Smile"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    UsdSkel.BindingAPI.Apply(bones.GetPrim()).CreateAnimationSourceRel().SetTargets([moves.GetPath()])
    return skel


def test_a_crowd_of_instances_of_a_character_stands_where_its_baked_skin_does(tmp_path):
    asset = new(tmp_path, "character.usda")
    asset.SetDefaultPrim(character(asset, "/Hero").GetPrim())
    asset.GetRootLayer().Save()
    stage = new(tmp_path)
    for number, place in enumerate([(0, 0, 0), (3, 0, 1), (-2, 5, 0)]):
        hero = stage.DefinePrim(f"/Crowd/Hero{number}", "SkelRoot")
        hero.GetReferences().AddReference("./character.usda")
        hero.SetInstanceable(True)
        xform = UsdGeom.Xformable(hero)
        xform.AddTranslateOp().Set(Gf.Vec3d(*place))
        xform.AddRotateYOp().Set(30.0 * number)
    source = opened(stage)
    baked = Usd.Stage.Open(asset.GetRootLayer().realPath)
    assert UsdSkel.BakeSkinning(Usd.PrimRange(baked.GetPseudoRoot()))
    body = baked.GetPrimAtPath("/Hero/Body")
    for time in (1, 3, 5):
        scene = source.at(Shutter.still(time))
        assert len(list(scene.objects())) == 3
        for number in range(3):
            matrix = UsdGeom.XformCache(time).GetLocalToWorldTransform(stage.GetPrimAtPath(f"/Crowd/Hero{number}"))
            expected = np.array([matrix.Transform(Gf.Vec3d(p)) for p in UsdGeom.Mesh(body).GetPointsAttr().Get(time)])
            found = next(one for one in scene.objects() if f"/Hero{number}/" in one.path)
            np.testing.assert_allclose(found.points, expected, atol=2e-6)


def test_value_clips_that_run_backwards_and_begin_anew_are_what_usd_resolves(tmp_path):
    for number in (1, 2):
        clip = new(tmp_path, f"cache.{number}.usda")
        mesh = UsdGeom.Mesh(clip.OverridePrim("/Cloth"))
        for time in (0, 1, 2, 3):
            points = [Gf.Vec3f(*map(float, p)) + Gf.Vec3f(0, 0, number + 0.25 * time * time) for p in SQUARE]
            mesh.CreatePointsAttr().Set(points, time)
        clip.GetRootLayer().Save()
    manifest = new(tmp_path, "manifest.usda")
    UsdGeom.Mesh(manifest.OverridePrim("/Cloth")).CreatePointsAttr()
    manifest.GetRootLayer().Save()
    stage = new(tmp_path, end=9)
    mesh = square(stage, "/Shot/Cloth")
    clips = Usd.ClipsAPI(mesh.GetPrim())
    clips.SetClipAssetPaths([Sdf.AssetPath("./cache.1.usda"), Sdf.AssetPath("./cache.2.usda")])
    clips.SetClipPrimPath("/Cloth")
    clips.SetClipManifestAssetPath("./manifest.usda")
    clips.SetClipActive([(1, 0), (5, 1)])
    # Forwards at double speed, then backwards.
    clips.SetClipTimes([(1, 0), (2.5, 3), (5, 3), (8, 0)])
    source = opened(stage)
    for time in (1, 2, 4, 5, 6, 6.5, 8, 9):
        np.testing.assert_allclose(
            mesh_named(source.at(Shutter.still(time)), "/Shot/Cloth").points, world(mesh.GetPrim(), time), atol=1e-6,
            err_msg=f"time {time}",
        )  # fmt: skip


def test_a_variant_brings_its_payload_and_another_its_own(tmp_path):
    for name, height in (("high", 2.0), ("low", 1.0)):
        asset = new(tmp_path, f"{name}.usda")
        square(asset, "/Asset/Geo", np.add(SQUARE, (0, 0, height)))
        asset.SetDefaultPrim(asset.GetPrimAtPath("/Asset"))
        asset.GetRootLayer().Save()
    stage = new(tmp_path)
    for number, choice in enumerate(("high", "low", "none")):
        prim = UsdGeom.Xform.Define(stage, f"/Set/Prop{number}").GetPrim()
        Usd.ModelAPI(prim).SetKind(Kind.Tokens.component)
        variants = prim.GetVariantSets().AddVariantSet("lod")
        for name in ("high", "low", "none"):
            variants.AddVariant(name)
            variants.SetVariantSelection(name)
            with variants.GetVariantEditContext():
                if name != "none":
                    prim.GetPayloads().AddPayload(f"./{name}.usda")
        variants.SetVariantSelection(choice)
    scene = opened(stage).at(STILL)
    assert {mesh.path: mesh.points[0, 2] for mesh in scene.meshes} == {"/Set/Prop0/Geo": 2.0, "/Set/Prop1/Geo": 1.0}


def test_nested_instancers_carry_their_lamps_and_meshes_to_where_usd_puts_them(tmp_path):
    stage = new(tmp_path)
    street = UsdGeom.PointInstancer.Define(stage, "/Street")
    street.AddTranslateOp().Set((0, 0, 5))
    block = UsdGeom.Xform.Define(stage, "/Street/Prototypes/Block")
    posts = UsdGeom.PointInstancer.Define(stage, "/Street/Prototypes/Block/Posts")
    post = UsdGeom.Xform.Define(stage, "/Street/Prototypes/Block/Posts/Post")
    post.AddScaleOp().Set((2, 2, 2))
    square(stage, "/Street/Prototypes/Block/Posts/Post/Glass")
    lamp = UsdLux.SphereLight.Define(stage, "/Street/Prototypes/Block/Posts/Post/Lamp")
    lamp.CreateRadiusAttr(0.0)
    lamp.AddTranslateOp().Set((0, 1, 0))
    posts.CreatePrototypesRel().SetTargets([post.GetPath()])
    posts.CreateProtoIndicesAttr([0, 0, 0])
    posts.CreatePositionsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    posts.CreateInvisibleIdsAttr([1])
    street.CreatePrototypesRel().SetTargets([block.GetPath()])
    street.CreateProtoIndicesAttr([0, 0])
    street.CreatePositionsAttr([(0, 0, 0), (10, 0, 0)])
    turn = Gf.Quath(Gf.Rotation(Gf.Vec3d(0, 0, 1), 90).GetQuat())
    street.CreateOrientationsAttr([Gf.Quath(1), turn])
    scene = opened(stage).at(STILL)
    places = []
    for whole in street.ComputeInstanceTransformsAtTime(1, 1, UsdGeom.PointInstancer.ExcludeProtoXform):
        for own in posts.ComputeInstanceTransformsAtTime(1, 1, UsdGeom.PointInstancer.IncludeProtoXform):
            places.append(own * whole * Gf.Matrix4d().SetTranslate((0, 0, 5)))
    assert len(places) == 4
    lamps, corners = ([tuple(place.Transform(Gf.Vec3d(*of))) for place in places] for of in ((0, 1, 0), (1, 1, 0)))
    # Quaternions of half precision turn by 90.01 degrees.
    for found, expected in (
        ([light.position for light in scene.lights], lamps), ([one.points[2] for one in scene.objects()], corners),
    ):  # fmt: skip
        assert len(found) == 4
        apart = np.linalg.norm(np.array(found)[:, None] - np.array(expected), axis=2)
        assert apart.min(axis=0).max() < 1e-5 and apart.min(axis=1).max() < 1e-5


def test_subsets_bind_their_faces_and_corners_keep_their_normals(tmp_path):
    stage = new(tmp_path)
    mesh = UsdGeom.Mesh.Define(stage, "/Vase")
    mesh.CreatePointsAttr([(x, y, 0) for y in (0, 1) for x in (0, 1, 2, 3)])
    mesh.CreateFaceVertexCountsAttr([4, 4, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateOrientationAttr("leftHanded")
    normals = np.random.default_rng(1).normal((0, 0, -3), 1.0, (12, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, "faceVarying")
    order = np.arange(12)[::-1]
    primvar.Set(Vt.Vec3fArray.FromNumpy(normals[order].astype(np.float32)))
    primvar.SetIndices(Vt.IntArray.FromNumpy(order.astype(np.int32)))
    for name, opacity, faces in (("Glass", 0.0, [2]), ("Paint", 1.0, [0])):
        material = UsdShade.Material.Define(stage, f"/Looks/{name}")
        shader = UsdShade.Shader.Define(stage, f"/Looks/{name}/S")
        shader.CreateIdAttr("UsdPreviewSurface")
        set_inputs(shader, opacity=opacity, diffuseColor=(0.7, 0.1, 0.1))
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset(name, faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    (found,) = opened(stage).at(STILL).meshes
    kinds = [found.materials[k].interaction for k in found.triangle_materials]
    by_face = dict(zip([0, 0, 1, 1, 2, 2], kinds, strict=True))
    assert by_face == {0: Interaction.DIFFUSE, 1: Interaction.DIFFUSE, 2: Interaction.DIELECTRIC}
    counts = np.bincount(found.triangle_materials, minlength=3)
    assert sorted(counts.tolist()) == [2, 2, 2]
    # Whatever the order of corners: each corner of the world has the normal that its face gave it.
    given = {}
    for face, corners in enumerate([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6]]):
        for k, point in enumerate(corners):
            given[face, point] = normals[4 * face + k]
    for row, (triangle, of) in enumerate(zip(found.triangles, found.normal_indices, strict=True)):
        for point, number in zip(triangle, of, strict=True):
            np.testing.assert_allclose(found.normals[number], given[row // 2, point], atol=1e-6)
    a, b, c = found.points[found.triangles[0]]
    assert np.cross(b - a, c - a)[2] < 0


def test_proxies_guides_and_what_appears_later_are_as_their_purpose_and_time_say(tmp_path):
    stage = new(tmp_path)
    asset = UsdGeom.Xform.Define(stage, "/Asset")
    render, proxy, guide = (square(stage, f"/Asset/{name}") for name in ("Full", "Box", "Rig"))
    for mesh, purpose in ((render, "render"), (proxy, "proxy"), (guide, "guide")):
        mesh.CreatePurposeAttr(purpose)
    UsdGeom.Imageable(render).SetProxyPrim(proxy.GetPrim())
    later = UsdGeom.Xform.Define(stage, "/Asset/Later")
    square(stage, "/Asset/Later/Spark")
    later.CreateVisibilityAttr().Set("invisible", 1)
    later.GetVisibilityAttr().Set("inherited", 3)
    asset.CreateVisibilityAttr().Set("inherited", 1)
    asset.GetVisibilityAttr().Set("invisible", 5)
    source = opened(stage)
    shown = {time: {mesh.path for mesh in source.at(Shutter.still(time)).meshes} for time in (1, 3, 4.5, 5)}
    assert shown == {
        1: {"/Asset/Full"}, 3: {"/Asset/Full", "/Asset/Later/Spark"},
        4.5: {"/Asset/Full", "/Asset/Later/Spark"}, 5: set(),
    }  # fmt: skip
    boxes = opened(stage, purposes=("default", "proxy"))
    assert {mesh.path for mesh in boxes.at(STILL).meshes} == {"/Asset/Box"}


def test_lights_shine_on_and_are_shadowed_by_what_their_collections_hold(tmp_path):
    stage = new(tmp_path)
    for name in ("Hero/Head", "Hero/Hair", "Set/Floor", "Set/Wall"):
        square(stage, f"/{name}")
    key = UsdLux.DistantLight.Define(stage, "/Key")
    links = UsdLux.LightAPI(key.GetPrim()).GetLightLinkCollectionAPI()
    links.CreateIncludeRootAttr(False)
    links.CreateIncludesRel().SetTargets(["/Hero", "/Set/Floor"])
    links.CreateExcludesRel().SetTargets(["/Hero/Hair"])
    shadows = UsdLux.LightAPI(key.GetPrim()).GetShadowLinkCollectionAPI()
    shadows.CreateExcludesRel().SetTargets(["/Set"])
    (light,) = opened(stage).at(STILL).lights
    assert light.unlit == {"/Hero/Hair", "/Set/Wall"}
    assert light.passed == {"/Set/Floor", "/Set/Wall"}


def test_layers_of_other_units_axes_and_rates_stand_where_usd_composes_them(tmp_path):
    asset = new(tmp_path, "prop.usda")
    UsdGeom.SetStageMetersPerUnit(asset, 0.01)
    UsdGeom.SetStageUpAxis(asset, "Z")
    asset.SetTimeCodesPerSecond(48)
    mesh = square(asset, "/Prop/Geo", np.multiply(SQUARE, 100))
    move = mesh.AddTranslateOp()
    for time, height in ((0, 0), (48, 300)):
        move.Set(Gf.Vec3d(0, 0, height), time)
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Prop"))
    asset.GetRootLayer().Save()
    stage = new(tmp_path, end=40)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Y")
    prop = UsdGeom.Xform.Define(stage, "/Shot/Prop")
    prop.GetPrim().GetReferences().AddReference("./prop.usda", layerOffset=Sdf.LayerOffset(10, 2))
    prop.AddRotateXOp().Set(-90.0)
    prop.AddScaleOp().Set((0.01, 0.01, 0.01))
    source = opened(stage)
    assert (source.up_axis, source.meters_per_unit) == ("Y", 1.0)
    geo = stage.GetPrimAtPath("/Shot/Prop/Geo")
    for time in (1, 10, 22, 34, 40, 58):
        np.testing.assert_allclose(source.at(Shutter.still(time)).meshes[0].points, world(geo, time), atol=1e-6)
    # 48 time codes of its own at 48 a second are 24 here, doubled: it rises 3 units in 48, half of them in 24.
    moved = source.at(Shutter(22, 21, 23)).meshes[0].motions
    np.testing.assert_allclose(moved, np.broadcast_to([0, 3 * 2 / 48, 0], (4, 3)), atol=1e-6)


def test_a_creased_cage_that_moves_keeps_its_edges_on_the_cage_at_every_time(tmp_path):
    stage = new(tmp_path)
    cage = UsdGeom.Mesh.Define(stage, "/Cube")
    corners = np.array([(x, y, z) for z in (-1.0, 1) for y in (-1, 1) for x in (-1, 1)])
    for time in (1, 5):
        cage.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy((corners * time + (0, 0, time)).astype(np.float32)), time)
    cage.CreateFaceVertexCountsAttr([4] * 6)
    quads = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
    cage.CreateFaceVertexIndicesAttr(quads)
    # The lower face is sharp all around, the rest is round.
    cage.CreateCreaseIndicesAttr([0, 1, 3, 2, 0])
    cage.CreateCreaseLengthsAttr([5])
    cage.CreateCreaseSharpnessesAttr([10.0])
    cage.CreateCornerIndicesAttr([0, 1, 2, 3])
    cage.CreateCornerSharpnessesAttr([10.0] * 4)
    source = opened(stage)
    for time in (1, 3, 5):
        points = source.at(Shutter.still(time)).meshes[0].points
        low, high = points.min(axis=0), points.max(axis=0)
        # The bottom stays a flat square as wide as the cage; the top is drawn in.
        np.testing.assert_allclose(low, (-time, -time, 0), atol=1e-5)
        np.testing.assert_allclose(high[:2], (time, time), atol=1e-5)
        assert time < high[2] < 1.9 * time
        bottom = points[np.abs(points[:, 2]) < 1e-5]
        corner = np.abs(np.abs(bottom[:, :2]) - time).max(axis=1).min()
        assert corner < 1e-5
    moving = source.at(Shutter(3, 2.5, 3.5)).meshes[0]
    at = np.argmin(np.linalg.norm(moving.points - (3, 3, 0), axis=1))
    np.testing.assert_allclose(moving.motions[at], (1, 1, 0), atol=1e-5)


def test_a_package_brings_its_layers_and_its_pictures(tmp_path):
    colors = np.zeros((2, 2, 3), np.uint8)
    colors[0, 0], colors[0, 1], colors[1, 0], colors[1, 1] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (188, 188, 188)
    (tmp_path / "tex").mkdir()
    assert oiio.ImageBuf(colors).write(str(tmp_path / "tex" / "tiles.png"))
    asset = new(tmp_path, "asset.usda")
    mesh = square(asset, "/Tile/Geo")
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(
        [(0, 0), (1, 0), (1, 1), (0, 1)]
    )
    material = UsdShade.Material.Define(asset, "/Tile/Look")
    shader, texture, reader = (UsdShade.Shader.Define(asset, f"/Tile/Look/{name}") for name in "SUR")
    shader.CreateIdAttr("UsdPreviewSurface")
    texture.CreateIdAttr("UsdUVTexture")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./tex/tiles.png")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Tile"))
    asset.GetRootLayer().Save()
    stage = new(tmp_path)
    stage.OverridePrim("/Tile").GetReferences().AddReference("./asset.usda")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Tile"))
    stage.GetRootLayer().Save()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "shot.usda"), str(tmp_path / "shot.usdz"))
    (tmp_path / "away").mkdir()
    (tmp_path / "shot.usdz").rename(tmp_path / "away" / "shot.usdz")
    source = StageScene.open(str(tmp_path / "away" / "shot.usdz"), Settings())
    (found,) = source.at(STILL).meshes
    ((tile,),) = [list(material.texture.tiles.values()) for material in found.materials]
    np.testing.assert_allclose(tile[0, 0], (1, 0, 0), atol=1e-3)
    np.testing.assert_allclose(tile[1, 1], [((188 / 255 + 0.055) / 1.055) ** 2.4] * 3, atol=1e-3)


def test_hair_has_the_widths_of_its_vertices_and_grows_with_its_head(tmp_path):
    stage = new(tmp_path)
    head = UsdGeom.Xform.Define(stage, "/Head")
    head.AddScaleOp().Set((3, 3, 3))
    hair = UsdGeom.BasisCurves.Define(stage, "/Head/Hair")
    hair.CreateTypeAttr("linear")
    hair.CreateCurveVertexCountsAttr([3, 2])
    hair.CreatePointsAttr([(0, 0, 0), (0, 0, 1), (0, 0, 2), (5, 0, 0), (5, 0, 1)])
    hair.CreateWidthsAttr([0.2, 0.4, 0.1, 0.6, 0.6])
    hair.SetWidthsInterpolation("vertex")
    points = np.concatenate([one.points for one in opened(stage).at(STILL).objects()])
    for x, z, width in ((0, 0, 0.2), (0, 1, 0.4), (0, 2, 0.1), (5, 0.5, 0.6)):
        beside = np.abs(points[:, 0] - 3 * x) < 2
        ring = points[beside & (np.abs(points[:, 2] - 3 * z) < 1e-4)] if z != 0.5 else points[beside]
        across = np.hypot(ring[:, 0] - 3 * x, ring[:, 1]).max()
        assert across == pytest.approx(3 * width / 2, rel=0.03), (x, z)


def test_a_camera_that_racks_its_focus_zooms_and_clips_is_what_it_is_at_mid_shutter(tmp_path):
    stage = new(tmp_path)
    square(stage, "/Floor")
    crane = UsdGeom.Xform.Define(stage, "/Crane")
    rise = crane.AddTranslateOp()
    camera = UsdGeom.Camera.Define(stage, "/Crane/Camera")
    for time in (1, 5):
        rise.Set(Gf.Vec3d(0, time, 10), time)
        camera.CreateFocusDistanceAttr().Set(2.0 * time, time)
        camera.CreateFocalLengthAttr().Set(20.0 + 5 * time, time)
        camera.CreateFStopAttr().Set(2.0, time)
        camera.CreateClippingRangeAttr().Set(Gf.Vec2f(0.1 * time, 100.0 * time), time)
    camera.CreateHorizontalApertureAttr(24.0)
    camera.CreateVerticalApertureAttr(18.0)
    camera.CreateHorizontalApertureOffsetAttr(3.0)
    camera.CreateExposureAttr(1.0)
    source = opened(stage, resolution=(400, 300))
    for time in (1, 2, 4):
        found = source.at(Shutter(time, time, time + 0.5)).camera
        middle = time + 0.25
        usd = UsdGeom.Camera(stage.GetPrimAtPath("/Crane/Camera")).GetCamera(middle)
        window = usd.frustum.GetWindow()
        expected = (window.GetMin()[0], window.GetMax()[0], window.GetMin()[1], window.GetMax()[1])
        np.testing.assert_allclose(found.window, expected, atol=1e-6)
        assert found.focus_distance == pytest.approx(usd.focusDistance, rel=1e-6)
        assert (found.near, found.far) == pytest.approx((usd.clippingRange.min, usd.clippingRange.max), rel=1e-6)
        # Focal lengths are in tenths of scene units.
        assert found.lens_radius == pytest.approx(usd.focalLength / 10 / usd.fStop / 2, rel=1e-6)
        np.testing.assert_allclose(found.position, (0, middle, 10), atol=1e-9)
        np.testing.assert_allclose(found.position_motion, (0, 0.5, 0), atol=1e-9)
        assert found.exposure_scale == pytest.approx(2.0)


def test_products_of_a_render_take_the_cameras_windows_and_vars_that_they_name(tmp_path):
    stage = new(tmp_path)
    square(stage, "/Floor")
    for name in ("Main", "Witness"):
        camera = UsdGeom.Camera.Define(stage, f"/Cameras/{name}")
        camera.AddTranslateOp().Set((0, 0, 5 if name == "Main" else 9))
    settings = UsdRender.Settings.Define(stage, "/Render/Shot")
    settings.CreateResolutionAttr(Gf.Vec2i(192, 108))
    settings.GetCameraRel().SetTargets(["/Cameras/Main"])
    for name, size, window in (("beauty", None, None), ("check", (64, 64), Gf.Vec4f(0.25, 0.5, 0.75, 1.0))):
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.CreateProductNameAttr(f"{name}.####.exr")
        if size:
            product.CreateResolutionAttr(Gf.Vec2i(*size))
            product.CreateDataWindowNDCAttr(window)
            product.GetCameraRel().SetTargets(["/Cameras/Witness"])
        settings.GetProductsRel().AddTarget(product.GetPath())
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Shot")
    for name, place, size, crop in (("beauty", 5, (192, 108), (192, 108)), ("check", 9, (64, 64), (32, 32))):
        source = opened(stage, product=name)
        assert source.resolution() == size
        region = source.region()
        assert tuple(region.size) == crop
        assert source.at(STILL).camera.position[2] == place


def test_classes_and_inherited_primvars_reach_instances_of_instances(tmp_path):
    leaf = new(tmp_path, "leaf.usda")
    square(leaf, "/Leaf/Geo")
    leaf.SetDefaultPrim(leaf.GetPrimAtPath("/Leaf"))
    leaf.GetRootLayer().Save()
    tree = new(tmp_path, "tree.usda")
    UsdGeom.Xform.Define(tree, "/Tree")
    for number in range(2):
        prim = UsdGeom.Xform.Define(tree, f"/Tree/Leaf{number}")
        prim.AddTranslateOp().Set((number, 0, 0))
        prim.GetPrim().GetReferences().AddReference("./leaf.usda")
        prim.GetPrim().SetInstanceable(True)
    tree.SetDefaultPrim(tree.GetPrimAtPath("/Tree"))
    tree.GetRootLayer().Save()
    stage = new(tmp_path)
    autumn = stage.CreateClassPrim("/_autumn")
    UsdGeom.PrimvarsAPI(UsdGeom.Xform(autumn)).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "constant"
    ).Set([(0.8, 0.3, 0.1)])
    for number in range(2):
        prim = UsdGeom.Xform.Define(stage, f"/Wood/Tree{number}")
        prim.AddTranslateOp().Set((0, 10 * number, 0))
        prim.GetPrim().GetReferences().AddReference("./tree.usda")
        prim.GetPrim().SetInstanceable(True)
        if number:
            prim.GetPrim().GetInherits().AddInherit("/_autumn")
    scene = opened(stage).at(STILL)
    objects = {one.path: one for one in scene.objects()}
    assert len(objects) == 4
    for path, one in objects.items():
        number, leaf_number = int(path.split("/Tree")[1][0]), int(path.split("/Leaf")[1][0])
        np.testing.assert_allclose(one.points, np.add(SQUARE, (leaf_number, 10 * number, 0)))
        colors = {tuple(np.round(one.materials[0].color, 3))}
        if one.colors is not None:
            colors = {tuple(np.round(row, 3)) for row in one.colors[one.color_indices].reshape(-1, 3)}
        assert colors == ({(0.8, 0.3, 0.1)} if number else {(0.18, 0.18, 0.18)}), path


def test_a_simulation_whose_points_change_in_number_is_blurred_by_its_velocities(tmp_path):
    stage = new(tmp_path)
    mesh = UsdGeom.Mesh.Define(stage, "/Splash")
    mesh.CreateSubdivisionSchemeAttr("none")
    for frame in (1, 2, 3):
        count = frame + 1
        points = [(x, y, frame) for x in range(count) for y in (0, 1)]
        mesh.CreatePointsAttr().Set(points, frame)
        mesh.CreateVelocitiesAttr().Set([(0, 0, 24.0 * (1 + x)) for x in range(count) for _ in (0, 1)], frame)
        faces = [(2 * x, 2 * x + 2, 2 * x + 3, 2 * x + 1) for x in range(count - 1)]
        mesh.CreateFaceVertexCountsAttr().Set([4] * len(faces), frame)
        mesh.CreateFaceVertexIndicesAttr().Set([i for face in faces for i in face], frame)
    source = opened(stage)
    for frame in (1, 2, 3):
        found = source.at(Shutter(frame, frame - 0.25, frame + 0.25)).meshes[0]
        assert len(found.points) == 2 * (frame + 1) and len(found.triangles) == 2 * frame
        expected = np.repeat(1.0 + np.arange(frame + 1), 2)
        np.testing.assert_allclose(found.motions[:, 2], 0.5 * expected, atol=1e-5)
        np.testing.assert_allclose(found.points[:, 2], frame, atol=1e-5)


def test_stacks_that_are_reset_mirrored_and_driven_by_splines_stand_where_usd_puts_them(tmp_path):
    stage = new(tmp_path)
    rig = UsdGeom.Xform.Define(stage, "/Rig")
    rig.AddTranslateOp().Set((100, 0, 0))
    free = UsdGeom.Xform.Define(stage, "/Rig/Free")
    free.SetResetXformStack(True)
    turn = free.AddRotateZOp()
    spline = Ts.Spline("float")
    for time, value in ((1.0, 0.0), (5.0, 80.0)):
        knot = Ts.Knot("float", time=time, value=value)
        knot.SetNextInterpolation(Ts.InterpCurve)
        knot.SetPostTanWidth(1.0)
        knot.SetPreTanWidth(1.0)
        spline.SetKnot(knot)
    turn.GetAttr().SetSpline(spline)
    pivot = free.AddTranslateOp(opSuffix="pivot")
    pivot.Set((1, 2, 0))
    free.AddScaleOp().Set((-1, 2, 1))
    free.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    mesh = square(stage, "/Rig/Free/Flag")
    source = opened(stage)
    for time in (1, 2, 3.5, 5):
        found = source.at(Shutter.still(time)).meshes[0]
        np.testing.assert_allclose(found.points, world(mesh.GetPrim(), time), atol=1e-6, err_msg=f"time {time}")
        a, b, c = found.points[found.triangles[0]]
        # What is mirrored still faces the way its faces did.
        assert np.cross(b - a, c - a)[2] > 0


def test_glass_of_a_materialx_file_by_reference_is_glass_on_what_a_collection_binds(tmp_path):
    (tmp_path / "looks.mtlx").write_text(
        """<?xml version="1.0"?>
<materialx version="1.38">
  <standard_surface name="S" type="surfaceshader">
    <input name="transmission" type="float" value="1.0" />
    <input name="specular_IOR" type="float" value="1.33" />
    <input name="base" type="float" value="0" />
  </standard_surface>
  <surfacematerial name="Water" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S" />
  </surfacematerial>
</materialx>
"""
    )
    stage = new(tmp_path)
    stage.DefinePrim("/Looks").GetReferences().AddReference("./looks.mtlx", "/MaterialX")
    group = UsdGeom.Xform.Define(stage, "/Group")
    square(stage, "/Group/Pool")
    square(stage, "/Group/Deck")
    collection = Usd.CollectionAPI.Apply(group.GetPrim(), "wet")
    collection.CreateIncludesRel().SetTargets(["/Group/Pool"])
    # By its path: where this USD reads no MaterialX there is no such prim.
    UsdShade.MaterialBindingAPI.Apply(group.GetPrim())
    binding = group.GetPrim().CreateRelationship("material:binding:collection:wet")
    binding.SetTargets([collection.GetCollectionPath(), "/Looks/Materials/Water"])
    scene = opened(stage).at(STILL)
    pool, deck = mesh_named(scene, "/Group/Pool").materials[0], mesh_named(scene, "/Group/Deck").materials[0]
    assert pool.interaction == Interaction.DIELECTRIC and pool.ior == pytest.approx(1.33)
    assert deck.interaction == Interaction.DIFFUSE
