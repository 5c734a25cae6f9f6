"""Textures of a stage: which picture lies where on a surface."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from tests.usd.stages import SmallStage, mesh_named, set_inputs
from tpdwarp.scene.description import Interaction, Shutter, Wrap
from tpdwarp.usd.read.materials.textures import LARGEST_SIDE

TYPES = Sdf.ValueTypeNames
CORNERS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
# Half precision of colours up to one.
HALF = 2.0**-11
RANDOM = np.random.default_rng(3)


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def write(small, pixels, name="texture.exr", **attributes):
    image = oiio.ImageBuf(np.ascontiguousarray(pixels))
    for key, value in attributes.items():
        image.specmod().attribute(key, value)
    assert image.write(str(Path(small.file).parent / name))


def shader(small, name, kind, **inputs):
    made = UsdShade.Shader.Define(small.stage, f"/Material/{name}")
    made.CreateIdAttr(kind)
    for key, value in inputs.items():
        pair = isinstance(value, tuple) and len(value) == 2
        if pair:
            made.CreateInput(key, TYPES.Float2).Set(Gf.Vec2f(*value))
        elif isinstance(value, tuple) and len(value) == 4:
            made.CreateInput(key, TYPES.Float4).Set(Gf.Vec4f(*value))
        elif key in ("file", "filename"):
            made.CreateInput("file", TYPES.Asset).Set(value)
        elif isinstance(value, int):
            made.CreateInput(key, TYPES.Int).Set(value)
        else:
            set_inputs(made, **{key: value})
    return made


def link(target, name, source, output, kind=TYPES.Color3f):
    target.CreateInput(name, kind).ConnectToSource(source.ConnectableAPI(), output)


def textured(small, pixels, name="texture.exr", output="rgb", **inputs):
    """A quad whose diffuse colour is a texture; the texture's shader."""
    if pixels is not None:
        write(small, pixels, name)
    surface = small.preview("/Material")
    texture = shader(small, "Texture", "UsdUVTexture", file=f"./{name}", **inputs)
    link(surface, "diffuseColor", texture, output)
    mesh = small.mesh()
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(*corner) for corner in CORNERS])
    small.bind(mesh, "/Material")
    return texture


def read(small, words=0):
    scene = small.open()
    found = mesh_named(scene.at(Shutter.still(1)), "/Mesh")
    assert len(scene.warnings.messages) == words, scene.warnings.messages
    return found


def at_corners(mesh):
    """Texture coordinates by point, shape [v, 2]."""
    found = np.zeros((len(mesh.points), 2))
    found[mesh.triangles.ravel()] = mesh.coordinates[mesh.coordinate_indices.ravel()]
    return found


def pixels_of(height=3, width=5, channels=4):
    return RANDOM.uniform(0.1, 0.9, (height, width, channels)).astype(np.float32)


def test_a_texture_lies_by_its_coordinates(small):
    pixels = pixels_of()
    textured(small, pixels, wrapS="repeat", wrapT="mirror")
    mesh = read(small)
    (material,) = mesh.materials
    np.testing.assert_allclose(material.texture.tiles[0, 0], pixels[..., :3], atol=HALF)
    assert material.texture.wrap == (Wrap.REPEAT, Wrap.MIRROR)
    assert material.color == pytest.approx(pixels[..., :3].mean(axis=(0, 1)), abs=HALF)
    np.testing.assert_array_equal(at_corners(mesh), CORNERS)


@pytest.mark.parametrize(
    ("inputs", "expected"), [({}, Wrap.BORDER), ({"wrapS": "clamp", "wrapT": "clamp"}, Wrap.CLAMP)]
)
def test_a_texture_that_says_nothing_is_black_beyond_its_edges(small, inputs, expected):
    textured(small, pixels_of(), **inputs)
    (material,) = read(small).materials
    assert material.texture.wrap == (expected, expected) and material.texture.border == (0.0, 0.0, 0.0)


def test_the_files_own_wrap_modes_count_where_metadata_are_asked_for(small):
    write(small, pixels_of(), "own.exr", wrapmodes="periodic,clamp")
    textured(small, None, "own.exr", wrapS="useMetadata")
    assert read(small).materials[0].texture.wrap == (Wrap.REPEAT, Wrap.CLAMP)


def test_scale_and_bias_count_by_pixel_and_beyond_the_edges(small):
    pixels = pixels_of()
    textured(small, pixels, scale=(0.5, 0.4, 0.3, 1.0), bias=(0.1, 0.0, 0.2, 0.0))
    texture = read(small).materials[0].texture
    expected = pixels[..., :3] * (0.5, 0.4, 0.3) + (0.1, 0.0, 0.2)
    np.testing.assert_allclose(texture.tiles[0, 0], expected, atol=2 * HALF)
    assert texture.border == pytest.approx((0.1, 0.0, 0.2))


def test_one_channel_is_grey(small):
    pixels = pixels_of()
    textured(small, pixels, output="g")
    expected = pixels[..., 1:2].repeat(3, axis=2)
    np.testing.assert_allclose(read(small).materials[0].texture.tiles[0, 0], expected, atol=HALF)


@pytest.mark.parametrize(("space", "srgb"), [("auto", True), ("sRGB", True), ("raw", False)])
def test_eight_bits_are_decoded_as_their_colour_space_says(small, space, srgb):
    pixels = RANDOM.integers(0, 256, (4, 4, 3), dtype=np.uint8)
    textured(small, pixels, "texture.png", sourceColorSpace=space)
    linear = pixels / 255.0
    if srgb:
        linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(read(small).materials[0].texture.tiles[0, 0], linear, atol=HALF)


def test_tiles_lie_by_their_numbers(small):
    parts = {1001: pixels_of(2, 2), 1002: pixels_of(3, 3), 1011: pixels_of(4, 4)}
    for number, pixels in parts.items():
        write(small, pixels, f"t.{number}.exr")
    textured(small, None, "t.<UDIM>.exr")
    tiles = read(small).materials[0].texture.tiles
    assert set(tiles) == {(0, 0), (1, 0), (0, 1)}
    for place, number in (((0, 0), 1001), ((1, 0), 1002), ((0, 1), 1011)):
        np.testing.assert_allclose(tiles[place], parts[number][..., :3], atol=HALF)


@pytest.mark.parametrize(("reach", "words"), [(2.0, 0), (3.0, 1)])
def test_tiles_without_a_file_are_said_where_a_mesh_lies_on_them(small, reach, words):
    for number in (1001, 1002):
        write(small, pixels_of(2, 2), f"t.{number}.exr")
    textured(small, None, "t.<UDIM>.exr")
    primvar = UsdGeom.PrimvarsAPI(small.stage.GetPrimAtPath("/Mesh")).GetPrimvar("st")
    # The middles of its triangles lie at a third and two thirds of its width.
    primvar.Set([Gf.Vec2f(s * reach, t) for s, t in CORNERS])
    mesh = small.open()
    mesh.at(Shutter.still(1))
    said = [message for message in mesh.warnings.messages if "UDIM" in message]
    assert len(said) == words


def test_the_reader_names_the_primvar(small):
    texture = textured(small, pixels_of())
    link(texture, "st", shader(small, "Reader", "UsdPrimvarReader_float2", varname="map1"), "result", TYPES.Float2)
    mesh = UsdGeom.Mesh(small.stage.GetPrimAtPath("/Mesh"))
    other = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("map1", TYPES.Float2Array, "faceVarying")
    other.Set([Gf.Vec2f(0.25 * k, 0.5) for k in range(4)])
    np.testing.assert_allclose(at_corners(read(small)), [(0.25 * k, 0.5) for k in range(4)])


def test_the_primvars_name_may_come_from_the_material(small):
    texture = textured(small, pixels_of())
    reader = shader(small, "Reader", "UsdPrimvarReader_float2")
    link(texture, "st", reader, "result", TYPES.Float2)
    named = UsdShade.Material(small.stage.GetPrimAtPath("/Material")).CreateInput("frame:stPrimvarName", TYPES.Token)
    named.Set("st")
    reader.CreateInput("varname", TYPES.Token).ConnectToSource(named)
    np.testing.assert_array_equal(at_corners(read(small)), CORNERS)


def test_coordinates_are_scaled_turned_and_moved(small):
    texture = textured(small, pixels_of())
    transform = shader(small, "Transform", "UsdTransform2d", rotation=90.0, scale=(2.0, 3.0), translation=(0.5, -0.25))
    link(texture, "st", transform, "result", TYPES.Float2)
    link(transform, "in", shader(small, "R", "UsdPrimvarReader_float2", varname="st"), "result", TYPES.Float2)
    expected = [(0.5 - 3 * t, 2 * s - 0.25) for s, t in CORNERS]
    np.testing.assert_allclose(at_corners(read(small)), expected, atol=1e-12)


@pytest.mark.parametrize("order", [0, 1])
def test_materialx_places_about_a_pivot(small, order):
    texture = textured(small, pixels_of())
    place = shader(
        small, "Place", "ND_place2d_vector2", pivot=(0.5, 0.5), scale=(2.0, 4.0), rotate=90.0, offset=(0.1, 0.2),
        operationorder=order,
    )  # fmt: skip
    link(texture, "st", place, "out", TYPES.Float2)
    expected = []
    for s, t in CORNERS:
        if order == 0:
            # Scaled by the inverse, turned clockwise, moved back.
            x, y = (s - 0.5) / 2, (t - 0.5) / 4
            expected.append((y - 0.1 + 0.5, -x - 0.2 + 0.5))
        else:
            x, y = s - 0.5 - 0.1, t - 0.5 - 0.2
            expected.append((y / 2 + 0.5, -x / 4 + 0.5))
    np.testing.assert_allclose(at_corners(read(small)), expected, atol=1e-7)


def test_networks_are_computed_by_pixel(small):
    first, second = pixels_of(2, 2), pixels_of(4, 4)
    write(small, first, "a.exr")
    write(small, second, "b.exr")
    material = UsdShade.Material.Define(small.stage, "/Material")
    surface = shader(small, "Surface", "ND_standard_surface_surfaceshader", base=0.5)
    material.CreateSurfaceOutput("mtlx").ConnectToSource(surface.ConnectableAPI(), "out")
    a, b = (shader(small, n, "ND_image_color3", file=f"./{n}.exr") for n in "ab")
    both = shader(small, "Both", "ND_multiply_color3")
    link(both, "in1", a, "out")
    link(both, "in2", b, "out")
    link(surface, "base_color", both, "out")
    mesh = small.mesh()
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(*corner) for corner in CORNERS])
    small.bind(mesh, "/Material")
    texture = read(small).materials[0].texture
    expected = 0.5 * first[..., :3].repeat(2, axis=0).repeat(2, axis=1) * second[..., :3]
    np.testing.assert_allclose(texture.tiles[0, 0], expected, atol=2 * HALF)
    assert texture.wrap == (Wrap.REPEAT, Wrap.REPEAT)


def test_without_coordinates_a_texture_has_its_mean_colour(small):
    pixels = pixels_of()
    textured(small, pixels)
    small.stage.GetPrimAtPath("/Mesh").RemoveProperty("primvars:st")
    mesh = read(small, words=1)
    assert mesh.coordinates is None
    assert mesh.materials[0].color == pytest.approx(pixels[..., :3].mean(axis=(0, 1)), abs=HALF)


def test_parts_of_a_mesh_have_coordinates_of_their_own(small):
    textured(small, pixels_of())
    points = [*((x, y, 0) for x, y in CORNERS), (2, 0, 0), (2, 1, 0)]
    mesh = small.mesh("/Mesh", points, (4, 4), (0, 1, 2, 3, 1, 4, 5, 2))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    primvars.GetPrimvar("st").Set([Gf.Vec2f(*p[:2]) for p in (*CORNERS, (2, 0), (2, 1))])
    small.preview("/Plain", diffuseColor=(0.2, 0.2, 0.2))
    part = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset("part", [1])
    small.bind(part, "/Plain")
    found = read(small)
    plain = np.array([m.texture is None for m in found.materials])[found.triangle_materials]
    assert plain.sum() == 2
    assert (found.coordinate_indices[plain] == -1).all() and (found.coordinate_indices[~plain] >= 0).all()


def test_large_pictures_are_brought_down(small):
    textured(small, np.full((2, 2 * LARGEST_SIDE, 3), 0.5, np.float32))
    assert read(small).materials[0].texture.tiles[0, 0].shape == (1, LARGEST_SIDE, 3)


def test_animated_coordinates_are_those_of_the_frame(small):
    textured(small, pixels_of())
    primvar = UsdGeom.PrimvarsAPI(small.stage.GetPrimAtPath("/Mesh")).GetPrimvar("st")
    primvar.GetAttr().Clear()
    for time in (1, 5):
        primvar.Set([Gf.Vec2f(s + time, t) for s, t in CORNERS], time)
    scene = small.open()
    for time in (1, 3):
        mesh = mesh_named(scene.at(Shutter.still(time)), "/Mesh")
        np.testing.assert_allclose(at_corners(mesh), [(s + time, t) for s, t in CORNERS])


@pytest.mark.parametrize(("opacity", "words"), [(1.0, 0), (0.0, 1)])
def test_a_texture_of_what_does_not_show_is_not_mentioned(small, opacity, words):
    write(small, np.full((2, 2, 1), 1.25, np.float32))
    surface = small.preview("/Material", opacity=opacity)
    link(surface, "ior", shader(small, "Texture", "UsdUVTexture", file="./texture.exr"), "r", TYPES.Float)
    small.bind(small.mesh(), "/Material")
    source = small.open()
    source.at(Shutter.still(1))
    said = [message for message in source.warnings.messages if "/Material/" in message]
    assert len(said) == words and all("inputs:ior: is a texture" in message for message in said)


def spread(small, shader_id, plain, name, pixels, kind=TYPES.Float, output="r"):
    """A quad whose material has a texture at one input and numbers at others; its material and what is said."""
    write(small, pixels)
    material = UsdShade.Material.Define(small.stage, "/Material")
    surface = shader(small, "Surface", shader_id, **plain)
    context = "" if shader_id == "UsdPreviewSurface" else "mtlx"
    (material.CreateSurfaceOutput(context) if context else material.CreateSurfaceOutput()).ConnectToSource(
        surface.ConnectableAPI(), "out"
    )
    link(surface, name, shader(small, "Texture", "UsdUVTexture", file="./texture.exr"), output, kind)
    mesh = small.mesh()
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(*corner) for corner in CORNERS])
    small.bind(mesh, "/Material")
    source = small.open()
    found = mesh_named(source.at(Shutter.still(1)), "/Mesh")
    assert found.coordinates is not None or not found.materials[0].has_maps
    return found.materials[0], [message for message in source.warnings.messages if "/Material" in message]


def tile(texture):
    """The only picture of a texture, as numbers."""
    (pixels,) = texture.tiles.values()
    return pixels.astype(float)


PREVIEW, STANDARD = "UsdPreviewSurface", "ND_standard_surface_surfaceshader"
RAMP = np.array([[[0.0], [0.5]], [[0.75], [1.0]]], np.float32)


def test_roughness_over_a_mirror_is_its_width_and_what_is_too_rough_is_a_lobe(small):
    rough = np.array([[[0.0], [0.2]], [[0.3], [0.8]]], np.float32)
    material, said = spread(small, PREVIEW, {"metallic": 1.0}, "roughness", rough)
    assert material.interaction == Interaction.MIRROR
    assert ["throws onto other surfaces" in message for message in said] == [True]
    np.testing.assert_allclose(tile(material.roughness_map)[..., 0], np.minimum(rough[..., 0], 1) ** 2, rtol=2 * HALF)
    for too_rough in (material.diffuse_map, material.metal_map):
        np.testing.assert_allclose(tile(too_rough)[..., 0], [[0, 0], [0, 1]])


def test_metal_over_a_surface_leaves_the_rest_of_it_diffuse(small):
    material, said = spread(small, PREVIEW, {"roughness": 0.0}, "metallic", RAMP)
    assert (material.interaction, said) == (Interaction.MIRROR, [])
    np.testing.assert_allclose(tile(material.diffuse_map)[..., 0], 1 - RAMP[..., 0])
    assert material.diffuse_share == pytest.approx(1 - RAMP.mean(), abs=HALF)


def test_a_metal_texture_that_shows_nothing_but_rough_metal_or_none_makes_no_mirror(small):
    material, said = spread(small, PREVIEW, {"roughness": 0.6}, "metallic", RAMP)
    assert (material.interaction, material.diffuse_map) == (Interaction.DIFFUSE, None)
    assert ["throws onto other surfaces" in message for message in said] == [True]
    np.testing.assert_allclose(tile(material.metal_map)[..., 0], RAMP[..., 0])
    assert material.roughness == pytest.approx(0.36)


def test_noise_in_a_black_metal_texture_makes_no_mirror(small):
    material, said = spread(small, PREVIEW, {"roughness": 0.0}, "metallic", RAMP * np.float32(0.02))
    assert (material.interaction, said) == (Interaction.DIFFUSE, [])


def test_transmission_over_a_surface_leaves_the_rest_of_it_diffuse(small):
    plain = {"specular_roughness": 0.0, "specular_IOR": 1.4}
    material, said = spread(small, STANDARD, plain, "transmission", RAMP)
    assert (material.interaction, material.ior, said) == (Interaction.DIELECTRIC, pytest.approx(1.4), [])
    np.testing.assert_allclose(tile(material.diffuse_map)[..., 0], 1 - RAMP[..., 0])


@pytest.mark.parametrize("depth", [0.0, 2.0])
def test_a_tint_over_glass_is_spread_where_it_acts_at_once_and_averaged_where_it_is_absorbed(small, depth):
    pixels = RANDOM.uniform(0.1, 1.0, (2, 2, 3)).astype(np.float32)
    plain = {"transmission": 1.0, "specular_roughness": 0.0, "transmission_depth": depth}
    material, said = spread(small, STANDARD, plain, "transmission_color", pixels, TYPES.Color3f, "rgb")
    if depth:
        assert material.transmittance_map is None and ["of which the mean is rendered" in m for m in said] == [True]
        expected = -np.log(pixels.mean(axis=(0, 1))) / depth
        np.testing.assert_allclose(material.absorption, expected, atol=2 * HALF)
    else:
        assert said == []
        np.testing.assert_allclose(tile(material.transmittance_map), pixels, atol=HALF)


def test_the_base_colour_over_a_mirror_is_what_it_reflects(small):
    pixels = RANDOM.uniform(0.1, 1.0, (2, 2, 3)).astype(np.float32)
    plain = {"metallic": 1.0, "roughness": 0.0}
    material, said = spread(small, PREVIEW, plain, "diffuseColor", pixels, TYPES.Color3f, "rgb")
    assert (material.interaction, material.specular_maps, said) == (Interaction.MIRROR, True, [])
    np.testing.assert_allclose(tile(material.texture), pixels, atol=HALF)


def test_what_a_surface_gives_off_is_spread_over_it(small):
    pixels = RANDOM.uniform(0.0, 4.0, (2, 2, 3)).astype(np.float32)
    material, said = spread(small, PREVIEW, {}, "emissiveColor", pixels, TYPES.Color3f, "rgb")
    assert len(said) == 1 and "lights nothing" in said[0]
    np.testing.assert_allclose(tile(material.emission_map), pixels, rtol=2 * HALF)


@pytest.mark.parametrize("weight", [0.0, 0.5])
def test_what_a_surface_gives_off_is_read_only_where_it_has_a_weight(small, weight):
    pixels = RANDOM.uniform(0.5, 1.0, (2, 2, 3)).astype(np.float32)
    material, said = spread(small, STANDARD, {"emission": weight}, "emission_color", pixels, TYPES.Color3f, "rgb")
    assert (material.emission_map is None, len(said)) == (weight == 0, weight > 0)
    if weight:
        np.testing.assert_allclose(tile(material.emission_map), weight * pixels, atol=HALF)


def test_a_texture_of_one_value_is_that_value(small):
    material, said = spread(small, PREVIEW, {"metallic": 1.0}, "roughness", np.full((2, 2, 1), 0.2, np.float32))
    assert (material.roughness_map, material.roughness, said) == (None, pytest.approx(0.04, abs=HALF), [])


@pytest.mark.parametrize("dialect", ["preview", "MaterialX"])
def test_a_normal_map_is_read_as_what_it_stands_for(small, dialect):
    pixels = RANDOM.uniform(0.0, 1.0, (2, 2, 3)).astype(np.float32)
    write(small, pixels)
    if dialect == "preview":
        surface = small.preview("/Material")
        texture = shader(
            small, "Texture", "UsdUVTexture", file="./texture.exr", scale=(2.0,) * 4, bias=(-1.0,) * 4
        )
        link(surface, "normal", texture, "rgb", TYPES.Normal3f)
        lean = 1.0
    else:
        material = UsdShade.Material.Define(small.stage, "/Material")
        surface = shader(small, "Surface", "ND_standard_surface_surfaceshader")
        bent = shader(small, "Bent", "ND_normalmap", scale=0.5)
        link(bent, "in", shader(small, "Texture", "ND_image_vector3", file="./texture.exr"), "out", TYPES.Float3)
        link(surface, "normal", bent, "out", TYPES.Float3)
        material.CreateSurfaceOutput("mtlx").ConnectToSource(surface.ConnectableAPI(), "out")
        lean = 0.5
    mesh = small.mesh()
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(*corner) for corner in CORNERS])
    small.bind(mesh, "/Material")
    found = read(small)
    (tile,) = found.materials[0].normal_map.tiles.values()
    np.testing.assert_allclose(tile, (2 * pixels - 1) * (lean, lean, 1), atol=4 * HALF)
    assert found.coordinates is not None


def test_a_normal_map_on_glass_is_said(small):
    write(small, np.full((2, 2, 3), 0.5, np.float32))
    surface = small.preview("/Material", opacity=0.0)
    link(surface, "normal", shader(small, "Texture", "UsdUVTexture", file="./texture.exr"), "rgb", TYPES.Normal3f)
    small.bind(small.mesh(), "/Material")
    source = small.open()
    source.at(Shutter.still(1))
    assert any("inputs:normal: a normal map of what reflects" in message for message in source.warnings.messages)


@pytest.mark.parametrize("name", ["movie.####.exr", ""])
def test_a_film_of_textures_shows_each_frame_its_own_picture(small, name):
    colors = {frame: np.full((2, 2, 3), 0.1 * frame, np.float32) for frame in (1, 2)}
    for frame, pixels in colors.items():
        write(small, pixels, f"movie.{frame:04d}.exr")
    texture = textured(small, None, name)
    if not name:
        for frame in colors:
            texture.GetInput("file").GetAttr().Set(f"./movie.{frame:04d}.exr", frame)
    small.stage.SetEndTimeCode(2)
    scene = small.open()
    assert scene.frames() == (1, 2)
    for frame, pixels in colors.items():
        (mesh,) = scene.at(Shutter.still(frame)).meshes
        (tile,) = mesh.materials[0].texture.tiles.values()
        np.testing.assert_allclose(tile, pixels, rtol=HALF)
    assert not scene.warnings.messages
    files = {Path(file).name for file in scene.used_files()}
    assert {f"movie.{frame:04d}.exr" for frame in colors} <= files


def test_an_image_of_materialx_that_names_no_file_has_its_default_everywhere(tmp_path):
    small = SmallStage(tmp_path)
    for name, default in (("Black", None), ("Red", Gf.Vec3f(0.6, 0.1, 0.0))):
        material = UsdShade.Material.Define(small.stage, f"/{name}")
        surface, image = (UsdShade.Shader.Define(small.stage, f"/{name}/{of}") for of in ("Surface", "Image"))
        surface.CreateIdAttr("ND_standard_surface_surfaceshader")
        image.CreateIdAttr("ND_image_color3")
        if default is not None:
            image.CreateInput("default", Sdf.ValueTypeNames.Color3f).Set(default)
        surface.CreateInput("base", Sdf.ValueTypeNames.Float).Set(1.0)
        base = surface.CreateInput("base_color", Sdf.ValueTypeNames.Color3f)
        base.ConnectToSource(image.ConnectableAPI(), "out")
        material.CreateSurfaceOutput("mtlx").ConnectToSource(surface.ConnectableAPI(), "out")
        small.bind(small.mesh(f"/On{name}"), f"/{name}")
    source = small.open()
    scene = source.at(Shutter.still(1))
    assert mesh_named(scene, "/OnBlack").materials[0].color == (0.0, 0.0, 0.0)
    assert mesh_named(scene, "/OnRed").materials[0].color == pytest.approx((0.6, 0.1, 0.0))
    assert source.warnings.messages == []
