"""Materials: three interactions, and a word about everything else."""

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade, UsdUtils

from tests.usd.stages import SmallStage, set_inputs
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

# White decodes to this much more with the sRGB tables of OpenImageIO's built-in configuration.
SRGB_ERROR = 3e-5


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def read(small, frame=1.0):
    scene = small.open()
    (mesh,) = scene.at(Shutter.still(frame)).meshes
    return mesh, scene.warnings.messages


def read_preview(small, **inputs):
    small.preview("/Material", **inputs)
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    (material,) = mesh.materials
    return material, warnings


@pytest.mark.parametrize(
    ("inputs", "interaction", "color", "ior"),
    [
        ({}, Interaction.DIFFUSE, (0.18, 0.18, 0.18), 1.5),
        ({"diffuseColor": (0.5, 0.25, 1.0)}, Interaction.DIFFUSE, (0.5, 0.25, 1.0), 1.5),
        ({"opacity": 0.0, "ior": 1.25}, Interaction.DIELECTRIC, (0.18, 0.18, 0.18), 1.25),
        ({"opacity": 0.0}, Interaction.DIELECTRIC, (0.18, 0.18, 0.18), 1.5),
        ({"transmission": 1.0, "ior": 2.0}, Interaction.DIELECTRIC, (0.18, 0.18, 0.18), 2.0),
        (
            {"metallic": 1.0, "roughness": 0.0, "diffuseColor": (1.0, 0.5, 0.25)},
            Interaction.MIRROR,
            (1, 0.5, 0.25),
            1.5,
        ),
        (
            {"metallic": 0.995, "roughness": 0.01, "diffuseColor": (1.0, 0.5, 0.25)},
            Interaction.MIRROR,
            (1, 0.5, 0.25),
            1.5,
        ),
        ({"opacityThreshold": 0.5, "opacity": 0.75}, Interaction.DIFFUSE, (0.18, 0.18, 0.18), 1.5),
        ({"useSpecularWorkflow": 1, "diffuseColor": (0.5, 0.5, 0.5)}, Interaction.DIFFUSE, (0.5, 0.5, 0.5), 1.5),
        (
            {
                "useSpecularWorkflow": 1,
                "specularColor": (1.0, 0.75, 0.5),
                "diffuseColor": (0.0, 0.0, 0.0),
                "roughness": 0.0,
            },
            Interaction.MIRROR,
            (1.0, 0.75, 0.5),
            1.5,
        ),
    ],
)
def test_preview_surface_has_the_documented_interaction(small, inputs, interaction, color, ior):
    material, warnings = read_preview(small, **inputs)
    assert (material.interaction, material.ior, material.path) == (interaction, ior, "/Material")
    assert material.color == pytest.approx(color, abs=1e-7)
    assert warnings == []


@pytest.mark.parametrize(
    ("inputs", "interaction", "blamed"),
    [
        ({"metallic": 0.03, "roughness": 0.0}, Interaction.DIFFUSE, "metallic"),
        ({"metallic": 1.0}, Interaction.DIFFUSE, "metallic"),
        ({"opacity": 0.0, "roughness": 0.4}, Interaction.DIELECTRIC, "roughness"),
        ({"emissiveColor": (1.0, 0.0, 0.0)}, Interaction.DIFFUSE, "emissiveColor"),
        ({"clearcoat": 0.5}, Interaction.DIFFUSE, "clearcoat"),
        ({"displacement": 0.5}, Interaction.DIFFUSE, "displacement"),
    ],
)
def test_what_is_not_rendered_is_said_and_the_nearest_done(small, inputs, interaction, blamed):
    material, warnings = read_preview(small, **inputs)
    assert material.interaction == interaction
    assert [m for m in warnings if f"/Material/Surface.inputs:{blamed}:" in m] == warnings != []


@pytest.mark.parametrize("name", ["emissiveColor", "clearcoat"])
def test_inputs_that_add_nothing_are_not_mentioned(small, name):
    assert read_preview(small, **{name: (0.0, 0.0, 0.0) if name == "emissiveColor" else 0.0})[1] == []


@pytest.mark.parametrize("ior", [0.0, -1.5, math.nan])
def test_for_an_impossible_index_of_refraction_the_default_counts(small, ior):
    material, warnings = read_preview(small, opacity=0.0, ior=ior)
    assert (material.interaction, material.ior) == (Interaction.DIELECTRIC, 1.5)
    assert ["/Material/Surface.inputs:ior: holds an index" in line for line in warnings] == [True]


@pytest.mark.parametrize(
    ("color", "taken"),
    [
        ((-0.5, 0.25, 0.0), (0.0, 0.25, 0.0)),
        ((1e9, 0.0, 0.0), (1e6, 0.0, 0.0)),
        ((math.nan, 0.0, 0.0), (0.18,) * 3),
        ((math.inf, 0.0, 0.0), (0.18,) * 3),
    ],
)
def test_impossible_colours_are_brought_into_range_and_said(small, color, taken):
    material, warnings = read_preview(small, diffuseColor=color)
    assert material.color == taken
    assert len(warnings) == 1 and "/Material/Surface.inputs:diffuseColor: " in warnings[0]


@pytest.mark.parametrize(
    "inputs",
    [
        {"opacity": 0.0, "opacityMode": "presence"},
        {"opacity": 0.25, "opacityThreshold": 0.5},
    ],
)
def test_faces_that_are_cut_out_are_not_there(small, inputs):
    small.preview("/Cut", **inputs)
    mesh = small.mesh(counts=(4, 3), indices=(0, 1, 2, 3, 1, 2, 3))
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, 1)] * 4)
    small.bind(UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("part", [0]), "/Cut")
    found, warnings = read(small)
    assert found.triangles.tolist() == [[1, 2, 3]] and len(found.normal_indices) == len(found.triangle_materials) == 1
    small.mesh("/Floor")
    small.bind(mesh, "/Cut")
    assert [m.path for m in small.open().at(Shutter.still(1)).meshes] == ["/Floor"]
    assert warnings == []


@pytest.mark.parametrize(
    ("inputs", "interaction", "presence", "diffuse_share"),
    [
        ({"opacity": 0.25}, Interaction.DIELECTRIC, 1.0, 0.25),
        ({"opacity": 0.75}, Interaction.DIFFUSE, 0.75, 0.0),
        ({"opacity": 0.75, "opacityMode": "presence"}, Interaction.DIFFUSE, 0.75, 0.0),
        ({"opacity": 0.25, "opacityMode": "presence"}, Interaction.DIFFUSE, 0.25, 0.0),
        ({"opacity": 0.995}, Interaction.DIFFUSE, 1.0, 0.0),
    ],
)
def test_opacity_between_none_and_all_is_a_share(small, inputs, interaction, presence, diffuse_share):
    material, warnings = read_preview(small, **inputs)
    assert (material.interaction, warnings) == (interaction, [])
    assert (material.presence, material.diffuse_share) == pytest.approx((presence, diffuse_share), abs=1e-7)


@pytest.mark.parametrize("inputs", [{"metallic": 1.0}, {"opacity": 0.0}], ids=["metal", "glass"])
@pytest.mark.parametrize(("roughness", "width"), [(0.0, 0.0), (0.05, 0.0), (0.1, 0.01), (0.3, 0.09)])
def test_what_is_rough_has_the_width_of_its_lobe(small, inputs, roughness, width):
    material, warnings = read_preview(small, roughness=roughness, **inputs)
    assert material.roughness == pytest.approx(width, rel=1e-6) and warnings == []


@pytest.mark.parametrize("metallic", [0.25, 0.75])
def test_what_is_partly_metal_is_a_mirror_for_that_part(small, metallic):
    material, warnings = read_preview(small, metallic=metallic, roughness=0.0, diffuseColor=(0.5, 0.25, 0.125))
    assert (material.interaction, material.diffuse_share, warnings) == (Interaction.MIRROR, 1 - metallic, [])
    assert material.color == (0.5, 0.25, 0.125)


def test_animated_inputs_are_read_at_the_frame(small):
    shader = small.preview("/Material", opacity=0.0)
    ior = shader.CreateInput("ior", Sdf.ValueTypeNames.Float)
    ior.Set(1.0, 1)
    ior.Set(2.0, 5)
    small.bind(small.mesh(), "/Material")
    scene = small.open()
    for frame, expected in ((1, 1.0), (2, 1.25), (5, 2.0)):
        assert scene.at(Shutter(frame, frame, frame + 1)).meshes[0].materials[0].ior == expected


def test_values_on_the_material_reach_the_shader(small):
    shader = small.preview("/Material")
    top = UsdShade.Material(small.stage.GetPrimAtPath("/Material")).CreateInput("tint", Sdf.ValueTypeNames.Color3f)
    top.Set(Gf.Vec3f(0.5, 0.25, 0.125))
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(top)
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    assert mesh.materials[0].color == (0.5, 0.25, 0.125) and warnings == []


@pytest.mark.parametrize(
    ("fallback", "color"), [(None, (0.18,) * 3), (Gf.Vec4f(0.5, 0.25, 0.125, 1), (0.5, 0.25, 0.125))]
)
def test_textures_give_their_fallback_and_are_said(small, fallback, color):
    shader = small.preview("/Material")
    texture = UsdShade.Shader.Define(small.stage, "/Material/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    if fallback is not None:
        texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(fallback)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    assert mesh.materials[0].color == pytest.approx(color)
    assert len(warnings) == 1 and "UsdUVTexture" in warnings[0]


@pytest.mark.parametrize(
    ("kind", "inputs", "interaction"),
    [
        (
            "ND_open_pbr_surface_surfaceshader",
            {"transmission_weight": 1.0, "specular_ior": 1.25},
            Interaction.DIELECTRIC,
        ),
        ("ND_standard_surface_surfaceshader", {"transmission": 1.0, "specular_IOR": 1.25}, Interaction.DIELECTRIC),
        ("ND_open_pbr_surface_surfaceshader", {"base_metalness": 1.0, "specular_roughness": 0.0}, Interaction.MIRROR),
        ("ND_open_pbr_surface_surfaceshader", {"base_color": (0.5, 0.5, 0.5), "base_weight": 0.5}, Interaction.DIFFUSE),
    ],
)
def test_other_surfaces_are_read_by_their_plain_inputs(small, kind, inputs, interaction):
    material = UsdShade.Material.Define(small.stage, "/Material")
    shader = UsdShade.Shader.Define(small.stage, "/Material/Surface")
    shader.CreateIdAttr(kind)
    set_inputs(shader, **inputs)
    material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
    small.bind(small.mesh(), "/Material")
    mesh, _ = read(small)
    found = mesh.materials[0]
    assert found.interaction == interaction
    if interaction == Interaction.DIELECTRIC:
        assert found.ior == 1.25
    if interaction == Interaction.DIFFUSE:
        assert found.color == (0.25, 0.25, 0.25)


@pytest.mark.parametrize(
    ("inputs", "interaction", "metal"),
    [
        ({"metallic": 1.0, "roughness": 0.5}, Interaction.DIFFUSE, 1.0),
        ({"metallic": 0.25, "roughness": 0.5}, Interaction.DIFFUSE, 0.25),
        ({"metallic": 1.0, "roughness": 0.3}, Interaction.MIRROR, 0.0),
        ({"roughness": 0.5}, Interaction.DIFFUSE, 0.0),
        # Half of it is metal, and all of the rest is clear: so all that is not clear is metal.
        ({"metallic": 0.5, "roughness": 0.5, "opacity": 0.0}, Interaction.DIELECTRIC, 1.0),
    ],
)
def test_metal_too_rough_for_a_mirror_has_a_lobe(small, inputs, interaction, metal):
    material, warnings = read_preview(small, diffuseColor=(0.9, 0.6, 0.2), **inputs)
    assert (material.interaction, material.metal) == (interaction, pytest.approx(metal))
    if metal:
        assert material.roughness == pytest.approx(0.25)
        assert material.color == pytest.approx((0.9, 0.6, 0.2))
    assert metal == 0 or any("throws onto other surfaces" in warning for warning in warnings)


def test_an_index_that_reflects_as_metal_does_is_rough_metal_where_it_is_rough(small):
    material, _ = read_preview(small, diffuseColor=(0.1, 0.1, 0.1), ior=5.0, roughness=0.6)
    assert (material.interaction, material.metal) == (Interaction.DIFFUSE, 1.0)
    assert material.color == pytest.approx(((4.0 / 6.0) ** 2,) * 3)


@pytest.mark.parametrize("surface", ["none", "unknown"])
def test_materials_that_cannot_be_read_are_said(small, surface):
    material = UsdShade.Material.Define(small.stage, "/Material")
    if surface == "unknown":
        shader = UsdShade.Shader.Define(small.stage, "/Material/Surface")
        shader.CreateIdAttr("SomeoneElsesShader")
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "out")
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    assert mesh.materials[0].interaction == Interaction.DIFFUSE
    assert len(warnings) == 1 and "/Material" in warnings[0]


def test_an_unbound_mesh_takes_its_display_colour(small):
    small.mesh().CreateDisplayColorAttr([Gf.Vec3f(0.5, 0.25, 0.125)])
    mesh, _ = read(small)
    np.testing.assert_array_equal(mesh.colors[mesh.color_indices], np.broadcast_to([0.5, 0.25, 0.125], (2, 3, 3)))


@pytest.mark.parametrize("authored", [False, True])
def test_display_colour_gives_way_to_an_authored_diffuse_colour(small, authored):
    small.preview("/Material", **({"diffuseColor": (1.0, 0.0, 0.0)} if authored else {}))
    mesh = small.mesh()
    mesh.CreateDisplayColorAttr([Gf.Vec3f(0.5, 0.25, 0.125)])
    small.bind(mesh, "/Material")
    assert (read(small)[0].colors is None) == authored


def test_a_primvar_reader_of_display_colour_reads_it(small):
    shader = small.preview("/Material")
    reader = UsdShade.Shader.Define(small.stage, "/Material/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(reader.ConnectableAPI(), "result")
    mesh = small.mesh()
    mesh.CreateDisplayColorPrimvar("vertex").Set([Gf.Vec3f(k, 0, 0) for k in range(4)])
    small.bind(mesh, "/Material")
    found, warnings = read(small)
    np.testing.assert_array_equal(found.colors[found.color_indices][..., 0], found.triangles)
    assert warnings == []


@pytest.mark.parametrize(
    ("reader", "name"),
    [
        ("UsdPrimvarReader_float3", "varname"),
        ("ND_geompropvalue_color3", "geomprop"),
        ("arnold:user_data_rgb", "attribute"),
    ],
)
def test_any_primvar_may_be_the_colour(small, reader, name):
    small.preview("/Material")
    mesh = small.mesh()
    small.bind(mesh, "/Material")
    for primvar, color in (("Cd", (1.0, 0.5, 0.25)), ("displayColor", (0.0, 0.0, 1.0))):
        made = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(primvar, Sdf.ValueTypeNames.Color3fArray, "constant")
        made.Set([color])
    shader = UsdShade.Shader.Define(small.stage, "/Material/Reader")
    shader.CreateIdAttr(reader)
    shader.CreateInput(name, Sdf.ValueTypeNames.String).Set("Cd")
    surface = UsdShade.Shader.Get(small.stage, "/Material/Surface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        shader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    )
    scene = small.open()
    found = scene.at(Shutter.still(1)).meshes[0]
    np.testing.assert_allclose(found.colors, [[1.0, 0.5, 0.25]])
    assert scene.warnings.messages == []


def test_display_colour_is_inherited_and_indexed(small):
    UsdGeom.Xform.Define(small.stage, "/Parent")
    primvar = UsdGeom.PrimvarsAPI(small.stage.GetPrimAtPath("/Parent")).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "constant"
    )
    primvar.Set([Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0)])
    primvar.SetIndices([1])
    small.mesh("/Parent/Mesh")
    mesh, _ = read(small)
    np.testing.assert_array_equal(mesh.colors, [[0, 1, 0]])


def test_display_colours_below_zero_are_clamped_and_said(small):
    small.mesh().CreateDisplayColorAttr([Gf.Vec3f(0.5, -0.02, 0.25)])
    mesh, warnings = read(small)
    np.testing.assert_array_equal(mesh.colors, [[0.5, 0, 0.25]])
    assert len(warnings) == 1 and "/Mesh.primvars:displayColor: " in warnings[0]


@pytest.mark.parametrize("what", ["indices", "numbers"])
def test_display_colours_that_cannot_be_read_are_ignored_and_said(small, what):
    primvar = small.mesh().CreateDisplayColorPrimvar("uniform")
    primvar.Set([Gf.Vec3f(1 if what == "indices" else math.nan, 0, 0)])
    if what == "indices":
        primvar.SetIndices([3])
    mesh, warnings = read(small)
    assert mesh.colors is None and len(warnings) == 1 and "/Mesh.primvars:displayColor" in warnings[0]


def test_subsets_bind_materials_to_faces_and_keep_display_colour_elsewhere(small):
    mesh = small.mesh(counts=(4, 3), indices=(0, 1, 2, 3, 2, 1, 0))
    mesh.CreateDisplayColorAttr([Gf.Vec3f(1, 0.5, 0)])
    small.preview("/Glass", opacity=0.0)
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("part", [0])
    small.bind(subset, "/Glass")
    found, _ = read(small)
    assert [found.materials[i].interaction for i in found.triangle_materials] == [
        Interaction.DIELECTRIC,
        Interaction.DIELECTRIC,
        Interaction.DIFFUSE,
    ]
    assert (found.color_indices[:2] == -1).all() and (found.color_indices[2] == 0).all()


def test_a_subset_that_covers_everything_leaves_no_trace_of_the_mesh_material(small):
    mesh = small.mesh()
    small.preview("/Glass", opacity=0.0)
    small.bind(UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("part", [0]), "/Glass")
    found, _ = read(small)
    assert [m.path for m in found.materials] == ["/Glass"]
    assert found.triangle_materials.tolist() == [0, 0]


def test_faces_of_a_subset_that_do_not_exist_are_ignored_and_said(small):
    mesh = small.mesh(counts=(3, 3), indices=(0, 1, 2, 0, 2, 3))
    small.preview("/Glass", opacity=0.0)
    small.bind(UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("part", [1, 2, -1]), "/Glass")
    found, warnings = read(small)
    assert [found.materials[i].interaction for i in found.triangle_materials] == [0, 1]
    assert len(warnings) == 1 and "/Mesh/part.indices: " in warnings[0]


def textured(small, pixels, name="texture.png", tiles=(), **inputs):
    """A diffuse colour fed by a texture of these pixels [h, w, c]."""
    for file in tiles or (name,):
        made = oiio.ImageBuf(np.ascontiguousarray(pixels))
        assert made.write(str(Path(small.file).parent / file))
    shader = small.preview("/Material")
    texture = UsdShade.Shader.Define(small.stage, "/Material/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{name}")
    for key, value in inputs.items():
        kind = Sdf.ValueTypeNames.Float4 if isinstance(value, tuple) else Sdf.ValueTypeNames.Token
        texture.CreateInput(key, kind).Set(value)
    return shader, texture


@pytest.mark.parametrize(
    ("space", "expected"),
    [
        # Half black, half a grey of 188, which sRGB's transfer function takes to about one half.
        ("auto", 0.5 * ((188 / 255 + 0.055) / 1.055) ** 2.4),
        ("sRGB", 0.5 * ((188 / 255 + 0.055) / 1.055) ** 2.4),
        ("raw", 0.5 * 188 / 255),
    ],
)
def test_a_textures_mean_is_taken_after_decoding(small, space, expected):
    pixels = np.zeros((4, 8, 3), np.uint8)
    pixels[:, ::2] = 188
    shader, texture = textured(small, pixels, sourceColorSpace=space)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    assert mesh.materials[0].color == pytest.approx((expected,) * 3, rel=1e-4)
    assert len(warnings) == 1 and "mean colour" in warnings[0]


def test_a_textures_scale_and_bias_and_channels_count(small):
    pixels = np.zeros((2, 2, 4), np.float32) + np.float32([0.5, 0.25, 0.75, 1.0])
    shader, texture = textured(small, pixels, "texture.exr", scale=(2.0, 1.0, 1.0, 1.0), bias=(-0.5, 0.0, 0.0, 0.0))
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    shader.CreateInput("ior", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "b")
    small.bind(small.mesh(), "/Material")
    (material,) = read(small)[0].materials
    assert material.color == pytest.approx((0.5, 0.25, 0.75)) and material.ior == pytest.approx(0.75)


def test_tiles_give_their_mean(small):
    pixels = np.zeros((2, 2, 3), np.uint8) + np.uint8(255)
    shader, texture = textured(small, pixels, "t.<UDIM>.png", ("t.1001.png", "t.1002.png"))
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    small.bind(small.mesh(), "/Material")
    assert read(small)[0].materials[0].color == pytest.approx((1.0,) * 3, abs=SRGB_ERROR)


@pytest.mark.parametrize("threshold", [0.0, 0.5])
def test_a_texture_that_cuts_out_makes_no_glass(small, threshold):
    pixels = np.zeros((4, 4, 4), np.float32)
    pixels[1] = 0.75
    shader, texture = textured(small, pixels, "texture.exr")
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "a")
    shader.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(threshold)
    mesh = small.mesh()
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(0), Gf.Vec2f(1, 0), Gf.Vec2f(1), Gf.Vec2f(0, 1)])
    small.bind(mesh, "/Material")
    found, warnings = read(small)
    (material,) = found.materials
    assert (material.interaction, material.threshold, warnings) == (Interaction.DIFFUSE, threshold, [])
    np.testing.assert_array_equal(material.cutout.tiles[0, 0], pixels[..., 3:].repeat(3, axis=2))
    assert found.coordinates is not None


def test_without_its_file_a_texture_that_cuts_out_is_filled_and_that_is_said(small):
    shader = small.preview("/Material")
    texture = UsdShade.Shader.Define(small.stage, "/Material/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./missing.png")
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0))
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "a")
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    assert mesh.materials[0].interaction == Interaction.DIFFUSE and mesh.materials[0].presence == 1.0
    assert any("cut-outs" in message for message in warnings)


def test_a_texture_within_a_package_is_found(small, tmp_path):
    shader, texture = textured(small, np.zeros((2, 2, 3), np.uint8) + np.uint8(255))
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    small.bind(small.mesh(), "/Material")
    small.stage.Save()
    package = str(tmp_path / "scene.usdz")
    assert UsdUtils.CreateNewUsdzPackage(small.file, package)
    (mesh,) = StageScene.open(package, Settings()).at(Shutter.still(1)).meshes
    assert mesh.materials[0].color == pytest.approx((1.0,) * 3, abs=SRGB_ERROR)


def test_a_circular_network_is_said(small):
    material = UsdShade.Material.Define(small.stage, "/Material")
    shaders = {}
    for name, kind in (("S", "ND_standard_surface_surfaceshader"), ("A", "ND_add_float"), ("B", "ND_add_float")):
        shaders[name] = UsdShade.Shader.Define(small.stage, f"/Material/{name}")
        shaders[name].CreateIdAttr(kind)
    for asking, key, giving in (("S", "transmission", "A"), ("A", "in1", "B"), ("B", "in1", "A")):
        target = shaders[giving].ConnectableAPI()
        shaders[asking].CreateInput(key, Sdf.ValueTypeNames.Float).ConnectToSource(target, "out")
    material.CreateSurfaceOutput("mtlx").ConnectToSource(shaders["S"].ConnectableAPI(), "out")
    small.bind(small.mesh(), "/Material")
    mesh, warnings = read(small)
    assert mesh.materials[0].interaction == Interaction.DIFFUSE
    assert any("circular" in message for message in warnings)


@pytest.mark.parametrize(
    ("inputs", "interaction"),
    [
        ({"ior": 9.0, "diffuseColor": (0.0, 0.0, 0.0), "roughness": 0.0}, Interaction.MIRROR),
        ({"ior": 9.0, "diffuseColor": (0.0, 0.0, 0.0), "roughness": 0.9}, Interaction.DIFFUSE),
        ({"ior": 9.0, "diffuseColor": (0.8, 0.8, 0.8), "roughness": 0.0}, Interaction.DIFFUSE),
        ({"ior": 1.5, "diffuseColor": (0.0, 0.0, 0.0), "roughness": 0.0}, Interaction.DIFFUSE),
    ],
)
def test_what_shines_more_than_any_dielectric_by_its_index_is_a_metal(small, inputs, interaction):
    material, _ = read_preview(small, **inputs)
    assert material.interaction == interaction
    if interaction == Interaction.MIRROR:
        # Fresnel's reflectance at normal incidence.
        assert material.color == pytest.approx((0.64,) * 3)


def test_a_metal_of_the_specular_workflow_reflects_by_its_specular_texture_alone(small):
    pixels = np.full((2, 2, 3), 0.75, np.float32)
    pixels[0] = 1.0
    shader, texture = textured(small, pixels, "texture.exr")
    shader.CreateInput("specularColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    shader.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.0, 0.0, 0.0))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.0)
    small.bind(small.mesh(), "/Material")
    (material,) = read(small)[0].materials
    assert material.interaction == Interaction.MIRROR and set(material.texture.tiles[0, 0].ravel()) == {0.75, 1.0}


def wide(small, surface, kind, asking, inputs, count):
    """A surface fed by a row of nodes, each by two inputs from the next, and the last from the first."""
    material = UsdShade.Material.Define(small.stage, "/Material")
    shader = UsdShade.Shader.Define(small.stage, "/Material/S")
    shader.CreateIdAttr(surface)
    nodes = [UsdShade.Shader.Define(small.stage, f"/Material/N{k}") for k in range(count)]
    shader.CreateInput(asking, Sdf.ValueTypeNames.Float).ConnectToSource(nodes[0].ConnectableAPI(), "out")
    for number, node in enumerate(nodes):
        node.CreateIdAttr(kind)
        for name in inputs:
            following = nodes[(number + 1) % count].ConnectableAPI()
            node.CreateInput(name, Sdf.ValueTypeNames.Float).ConnectToSource(following, "out")
    material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
    small.bind(small.mesh(), "/Material")
    return nodes


# Walked along all of their ways, these would take for ever.
@pytest.mark.parametrize(
    ("surface", "kind", "asking", "inputs", "count"),
    [
        ("ND_standard_surface_surfaceshader", "ND_add_float", "transmission", ("in1", "in2"), 1),
        ("ND_standard_surface_surfaceshader", "ND_mix_float", "base_color", ("bg", "fg", "mix"), 60),
        ("ND_surface", "ND_layer_bsdf", "bsdf", ("top", "base"), 1),
    ],
)
def test_a_circular_network_that_is_wide_is_said_too(small, surface, kind, asking, inputs, count):
    wide(small, surface, kind, asking, inputs, count)
    _, warnings = read(small)
    assert any("circular" in message for message in warnings)


def test_a_network_whose_ways_meet_again_is_walked_once(small):
    last = wide(small, "ND_standard_surface_surfaceshader", "ND_add_float", "base", ("in1", "in2"), 41)[-1]
    for name in ("in1", "in2"):
        UsdShade.ConnectableAPI.ClearSources(last.GetInput(name))
        last.GetInput(name).Set(2.0**-42)
    mesh, warnings = read(small)
    assert mesh.materials[0].color == pytest.approx((0.5 * 0.8,) * 3) and warnings == []


def test_a_texture_scaled_by_itself_is_circular(small):
    shader, texture = textured(small, np.full((2, 2, 3), 0.5, np.float32), "t.exr")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).ConnectToSource(texture.ConnectableAPI(), "rgb")
    small.bind(small.mesh(), "/Material")
    assert any("circular" in message for message in read(small)[1])


def test_a_material_for_previews_is_better_than_none(small):
    mesh = small.mesh()
    small.preview("/Preview", diffuseColor=(1.0, 0.0, 0.0))
    small.preview("/Whole", diffuseColor=(0.0, 1.0, 0.0))
    api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    api.Bind(UsdShade.Material(small.stage.GetPrimAtPath("/Preview")), materialPurpose=UsdShade.Tokens.preview)
    scene = small.open()
    assert scene.at(Shutter.still(1)).meshes[0].materials[0].color == (1.0, 0.0, 0.0)
    assert any("has a material for previews alone" in message for message in scene.warnings.messages)
    api.Bind(UsdShade.Material(small.stage.GetPrimAtPath("/Whole")))
    assert small.open().at(Shutter.still(1)).meshes[0].materials[0].color == (0.0, 1.0, 0.0)


def test_a_material_that_names_no_surface_shows_display_colours_as_viewers_do(small):
    UsdShade.Material.Define(small.stage, "/Material")
    surface = small.mesh()
    surface.CreateDisplayColorAttr([Gf.Vec3f(0.25, 0.5, 0.75)])
    small.bind(surface, "/Material")
    mesh, warnings = read(small)
    np.testing.assert_array_equal(mesh.colors[mesh.color_indices], np.broadcast_to((0.25, 0.5, 0.75), (2, 3, 3)))
    assert [text for text in warnings if "names no surface" in text and "/Material" in text] == warnings
