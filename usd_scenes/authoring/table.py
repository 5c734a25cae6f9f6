"""A drink on a tiled table in the evening sun: textures, a sun with its disc, a large lamp, a drink that absorbs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdShade

from usd_scenes.authoring.scene_writer import SceneWriter
from usd_scenes.authoring.tumbler import GLASS, WATER, clear, write_ice, write_lathed

# The sun stands so far off straight down, towards −x, and turned about the vertical [degrees].
SUN_TILT, SUN_TURN = 52.0, 28.0
# The drink: its index, and the colour that white light has after so far in it.
DRINK_INDEX, DRINK_COLOR, DRINK_DEPTH = 1.35, (0.86, 0.32, 0.05), 0.45
# Where a ball of brushed copper lies, and its radius and roughness.
BALL, BALL_RADIUS, BALL_ROUGHNESS = (-0.55, -0.42), 0.17, 0.12
COPPER = (0.95, 0.64, 0.54)
# Where the camera looks, from how far and how high.
TARGET, DISTANCE, HEIGHT = (0.24, 0.10, 0.36), 4.5, 2.0
# Pixels of the texture, tiles along it, and the side of a tile.
PIXELS, TILES, TILE = 768, 4, 0.42


def write_table(path: Path, speed: float = 0.8, frames: int = 24, resolution: int = 96) -> None:
    """Writes a tumbler with a drink and ice in it and a ball of copper on tiles, seen by a camera that goes around.

    The picture of the tiles is written beside the layer.

    Args:
        path: The layer to write.
        speed: Of the camera about the vertical, degrees a frame.
        frames: Frames, from 1.
        resolution: Sides of glass and drink.

    Raises:
        ValueError: A count is too small.
    """
    writer = SceneWriter(frames, {"speed": speed})
    write_lathed(writer, "Glass", GLASS, clear(writer, "Glass", 1.5), resolution)
    write_lathed(writer, "Drink", WATER, _drink(writer), resolution)
    write_ice(writer, 0, 14.0, 0.0)
    _ball(writer)
    picture = path.with_name(f"{path.stem}.tiles.jpg")
    _floor(writer, picture.name)
    _lights(writer)
    writer.measuring_camera((0.6, 0.2, 0.015), size=1.6)
    writer.camera(eye=(0.0, -DISTANCE, HEIGHT), target=TARGET, field_of_view=30.0, exposure=0.0)
    _orbit(writer, speed)
    writer.save(path)
    _write_tiles(picture)


def _drink(writer: SceneWriter) -> UsdShade.Material:
    """Glass of a colour for those who read MaterialX, and clear glass for those who do not."""
    material = clear(writer, "Drink", DRINK_INDEX)
    shader = UsdShade.Shader.Define(writer.stage, f"{material.GetPath()}/OpenPBR")
    shader.CreateIdAttr("ND_open_pbr_surface_surfaceshader")
    for name, value in {
        "transmission_weight": 1.0,
        "transmission_depth": DRINK_DEPTH,
        "specular_roughness": 0.0,
        "specular_ior": DRINK_INDEX,
    }.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    shader.CreateInput("transmission_color", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*DRINK_COLOR))
    output = shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput("mtlx").ConnectToSource(output)
    return material


def _ball(writer: SceneWriter) -> None:
    ball = UsdGeom.Sphere.Define(writer.stage, "/World/Ball")
    ball.CreateRadiusAttr(BALL_RADIUS)
    ball.CreateExtentAttr([Gf.Vec3f(-BALL_RADIUS), Gf.Vec3f(BALL_RADIUS)])
    ball.AddTranslateOp().Set(Gf.Vec3d(*BALL, BALL_RADIUS))
    copper = writer.material("Copper", diffuseColor=COPPER, metallic=1.0, roughness=BALL_ROUGHNESS)
    UsdShade.MaterialBindingAPI.Apply(ball.GetPrim()).Bind(copper)


def _floor(writer: SceneWriter, picture: str) -> None:
    """Tiles without end, as far as anybody sees."""
    writer.floor(size=16.0, albedo=0.5)
    mesh = UsdGeom.Mesh.Get(writer.stage, "/World/Floor")
    span = 8.0 / (TILES * TILE)
    corners = [(-span, -span), (span, -span), (span, span), (-span, span)]
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set([Gf.Vec2f(*corner) for corner in corners])
    root = "/World/Materials/Floor"
    reader = UsdShade.Shader.Define(writer.stage, f"{root}/Coordinates")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(writer.stage, f"{root}/Tiles")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(f"./{picture}"))
    for name in ("wrapS", "wrapT"):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set("repeat")
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    surface = UsdShade.Shader.Get(writer.stage, f"{root}/Surface")
    surface.GetInput("diffuseColor").ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))


def _lights(writer: SceneWriter) -> None:
    """The low sun, a lamp above, and a sky that is nearly dark."""
    sun = UsdLux.DistantLight.Define(writer.stage, "/World/Sun")
    sun.CreateNormalizeAttr(True)
    sun.CreateIntensityAttr(4.4)
    sun.CreateColorAttr(Gf.Vec3f(1.0, 0.86, 0.68))
    sun.AddRotateZOp().Set(SUN_TURN)
    sun.AddRotateYOp().Set(-SUN_TILT)
    lamp = UsdLux.RectLight.Define(writer.stage, "/World/Lamp")
    lamp.CreateWidthAttr(0.9)
    lamp.CreateHeightAttr(0.6)
    lamp.CreateIntensityAttr(3.0)
    lamp.CreateColorAttr(Gf.Vec3f(0.75, 0.87, 1.0))
    lamp.AddTranslateOp().Set(Gf.Vec3d(1.5, 1.9, 2.0))
    lamp.AddRotateZOp().Set(-36.0)
    lamp.AddRotateXOp().Set(-48.0)
    sky = UsdLux.DomeLight.Define(writer.stage, "/World/Sky")
    sky.CreateIntensityAttr(0.22)
    sky.CreateColorAttr(Gf.Vec3f(0.6, 0.75, 1.0))


def _orbit(writer: SceneWriter, speed: float) -> None:
    """The camera goes around what it looks at."""
    camera = UsdGeom.Camera.Get(writer.stage, "/World/Camera")
    camera.ClearXformOpOrder()
    place = camera.AddTransformOp()
    for time in writer.times:
        turn = math.radians(speed * (time - writer.times[0]) - 10.0)
        eye = Gf.Vec3d(DISTANCE * math.sin(turn), -DISTANCE * math.cos(turn), HEIGHT)
        view = Gf.Matrix4d().SetLookAt(eye, Gf.Vec3d(*TARGET), Gf.Vec3d(0, 0, 1))
        place.Set(view.GetInverse(), time)


def _write_tiles(path: Path) -> None:
    """Four by four tiles of clay with grout between them."""
    random = np.random.default_rng(7)
    side = PIXELS // TILES
    shades = random.normal(1.0, 0.14, (TILES, TILES, 1)) * random.normal(1.0, 0.03, (TILES, TILES, 3))
    grain = _noise(random, 6, 0.5) * 0.12 + _noise(random, 48, 0.5) * 0.08
    pixels = np.kron(shades, np.ones((side, side, 1))) * np.array([0.56, 0.35, 0.25]) * (1.0 + grain[..., None])
    at = np.abs((np.arange(PIXELS) % side + 0.5) / side - 0.5)
    edge = np.maximum(at[:, None], at[None, :])
    joint = np.clip((edge - 0.474) / 0.008, 0.0, 1.0)[..., None]
    pixels = (1.0 - joint) * pixels + joint * np.array([0.62, 0.60, 0.56]) * (1.0 + 0.5 * grain[..., None])
    encoded = np.where(pixels <= 0.0031308, 12.92 * pixels, 1.055 * np.clip(pixels, 0, None) ** (1 / 2.4) - 0.055)
    output = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(PIXELS, PIXELS, 3, "uint8")
    spec.attribute("compression", "jpeg:88")
    output.open(str(path), spec)
    output.write_image((np.clip(encoded, 0, 1) * 255 + 0.5).astype(np.uint8))
    output.close()


def _noise(random: np.random.Generator, cells: int, persistence: float) -> np.ndarray:
    """Smooth noise that repeats with the picture, between about −1 and 1, shape [PIXELS, PIXELS]."""
    total, weight = np.zeros((PIXELS, PIXELS)), 1.0
    for octave in range(3):
        count = cells * 2**octave
        values = random.uniform(-1.0, 1.0, (count, count))
        at = np.arange(PIXELS) / PIXELS * count
        low, part = at.astype(int), at % 1.0
        part = part * part * (3.0 - 2.0 * part)
        rows = values[low] * (1.0 - part)[:, None] + values[(low + 1) % count] * part[:, None]
        total += weight * (rows[:, low] * (1.0 - part) + rows[:, (low + 1) % count] * part)
        weight *= persistence
    return total
