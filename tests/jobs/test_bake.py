"""Baked textures against the energy account, an exact caustic, and pictures of the same surfaces."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdValidation, Vt

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image
from usd_scenes.authoring.wave import write_wave
from usd_scenes.oracle import Wave, irradiance_average

FRAME = 2
ALBEDO = 0.8
SMALL = {"photons": 256, "threads": 1, "resolution": 32}


def texture(path: Path) -> np.ndarray:
    channels, _ = read_image(path)
    return np.stack([channels[name] for name in "RGBA"], axis=-1).astype(np.float64)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_stage(tmp_path_factory.mktemp("small") / "small.usda")


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("wave") / "wave.usda"
    write_wave(path, frames=4)
    return str(path)


def own(path: str) -> Usd.Stage:
    """The stage with edits of its own."""
    stage = Usd.Stage.Open(path)
    stage.SetEditTarget(stage.GetSessionLayer())
    return stage


def bent_floor(stage: Usd.Stage, swing: float) -> None:
    """A floor of waves in the place of the flat one, over |x|, |y| < 2; its height goes by ``swing`` a frame."""
    stage.GetPrimAtPath("/World/Floor").SetActive(False)
    edge = np.linspace(-2.0, 2.0, 81)
    x, y = (axis.ravel() for axis in np.meshgrid(edge, edge))
    mesh = UsdGeom.Mesh.Define(stage, "/World/Bent")
    number = np.arange(81 * 81).reshape(81, 81)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(quads), 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(quads.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr("none")
    for frame in range(1, 5):
        z = (0.15 + swing * (frame - 1)) * np.sin(2.0 * x + 1.0) * np.cos(1.5 * y)
        points = np.stack([x, y, z], axis=1).astype(np.float32)
        mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), frame)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set(Vt.Vec2fArray.FromNumpy((np.stack([x, y], axis=1) / 4.0 + 0.5).astype(np.float32)))
    material = UsdShade.Material.Get(stage, "/World/Materials/Floor")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def test_the_flux_over_a_texture_is_what_the_account_says_was_deposited(small, tmp_path):
    result = tpdwarp.bake(small, tmp_path / "c.exr", frames=FRAME, photons=1024, threads=1, resolution=128)
    area = (4.0 / 128) ** 2
    flux = texture(tmp_path / "c.exr")[..., :3].sum() * area
    assert flux == pytest.approx(result.energy[FRAME].deposited, rel=0.005)


def test_a_flat_floor_holds_the_exact_caustic_of_a_wave(waves, tmp_path):
    tpdwarp.bake(waves, tmp_path / "c.exr", frames=FRAME, photons=4096, segments=1, exposure=1.0, resolution=256)
    # The floor is 8 wide, the wave's light is whole on 2 of it: 64 texels of 1/32. Nothing changes along y.
    rows = texture(tmp_path / "c.exr")[128, 96:160, 1]
    truth = irradiance_average(np.linspace(-1, 1, 65), Wave(), FRAME - 1, FRAME, 64, "linear")
    # What frames are held to (tests/test_accuracy.py), and the rounding to half precision.
    assert np.sqrt(np.mean((rows - truth) ** 2)) <= (0.0025 + 2.0**-12) * truth.mean()


@pytest.mark.parametrize(("swing", "speed"), [(0.0, 0.0), (0.1, 0.0), (0.0, -0.1)], ids=["bent", "deforms", "moves"])
def test_a_picture_with_the_texture_for_emission_is_that_of_the_caustic(waves, tmp_path, swing, speed):
    stage = own(waves)
    if speed:
        # The camera rides along: what a texture says of a shutter is its mean, wherever the receiver went.
        for name in ("Floor", "TopOrtho"):
            slide = UsdGeom.Xformable(stage.GetPrimAtPath(f"/World/{name}")).AddTranslateOp(opSuffix="slide")
            for frame in (1, 4):
                slide.Set(Gf.Vec3d(speed * (frame - FRAME), 0, 0), frame)
        points = UsdGeom.Mesh.Get(stage, "/World/Floor").GetPointsAttr()
        points.Set([point / 2 for point in points.Get()])
    else:
        bent_floor(stage, swing)
    light = {"photons": 16384, "segments": 2, "exposure": 1.0, "camera": "TopOrtho"}
    channels = tpdwarp.render_frame(stage, FRAME, **light, image_width=32, samples=16, aovs=("caustic",)).channels
    # A pixel of 1/16 is a square of 4 × 4 texels, for coordinates are those of the floor seen from above.
    tpdwarp.bake(stage, tmp_path / "c.exr", frames=FRAME, **light, resolution=256)
    middle = texture(tmp_path / "c.exr")[64:192, 64:192]
    emission = middle[..., 1].reshape(32, 4, 32, 4).mean(axis=(1, 3)) * ALBEDO / math.pi
    seen = channels["caustic.G"]
    if speed:
        # Camera samples of what moves are looked up one by one. Nothing changes along y: rows are as many more samples.
        emission, seen = emission.mean(axis=0), seen.mean(axis=0)
    assert seen.std() > 0.1 * seen.mean()
    assert np.sqrt(np.mean((emission - seen) ** 2)) <= 0.01 * seen.mean()


def test_radiance_is_albedo_over_pi_times_irradiance(small, tmp_path):
    for what in ("irradiance", "caustic", "motion"):
        tpdwarp.bake(small, tmp_path / f"{what}.exr", frames=FRAME, what=what, **SMALL)
    irradiance, caustic = texture(tmp_path / "irradiance.exr"), texture(tmp_path / "caustic.exr")
    # The floor has no material, and so the albedo .18; both were rounded to half.
    np.testing.assert_allclose(caustic[..., :3], irradiance[..., :3] * 0.18 / math.pi, rtol=2.0**-10, atol=1e-7)
    # Light falls straight through a pane that rises: nothing moves.
    np.testing.assert_allclose(texture(tmp_path / "motion.exr")[..., :3], 0.0, atol=1e-6)
    assert not (tmp_path / "motion.light.usda").exists()


def test_motion_is_how_far_the_light_goes_within_the_shutter(waves, tmp_path):
    stage = own(waves)
    slide = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Water")).AddTranslateOp()
    for frame in (1, 4):
        slide.Set(Gf.Vec3d(0.0, 0.25 * frame, 0), frame)
    options = {"photons": 4096, "exposure": 0.5, "resolution": 64, "what": "motion"}
    tpdwarp.bake(stage, tmp_path / "m.exr", frames=FRAME, **options)
    # Nothing refracts along y, so that photons that ride on the water go with it: half of .25.
    middle = texture(tmp_path / "m.exr")[28:36, 28:36]
    np.testing.assert_allclose(middle[..., 1], 0.125, rtol=1e-3)


def two_tiles(small: str) -> Usd.Stage:
    """The small stage with a floor of two squares, whose coordinates lie in two tiles."""
    stage = own(small)
    floor = UsdGeom.Mesh.Get(stage, "/World/Floor")
    floor.GetPointsAttr().Set([(-2, -2, 0), (0, -2, 0), (2, -2, 0), (-2, 2, 0), (0, 2, 0), (2, 2, 0)])
    floor.GetFaceVertexCountsAttr().Set([4, 4])
    floor.GetFaceVertexIndicesAttr().Set([0, 1, 4, 3, 1, 2, 5, 4])
    st = UsdGeom.PrimvarsAPI(floor).CreatePrimvar("map", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)])
    return stage


def test_tiles_have_files_of_their_own_and_share_the_light(small, tmp_path):
    options = {"frames": FRAME, "photons": 1024, "threads": 1, "resolution": 64}
    result = tpdwarp.bake(two_tiles(small), tmp_path / "c.exr", uv="map", **options)
    tiles = [texture(tmp_path / f"c.{number}.exr")[..., :3].sum() for number in (1001, 1002)]
    # Pane and light are the same on both sides of x = 0; texels are 2/64 by 4/64.
    np.testing.assert_allclose(np.array(tiles) * (2 * 4 / 64**2), result.energy[FRAME].deposited / 2, rtol=0.005)


def test_charts_that_lie_on_each_other_are_warned_about(small, tmp_path, caplog):
    stage = two_tiles(small)
    st = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Floor")).GetPrimvar("map")
    st.SetInterpolation("faceVarying")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)] * 2)
    tpdwarp.bake(stage, tmp_path / "c.exr", uv="map", frames=FRAME, **SMALL)
    assert any("/World/Floor" in line and "lie on each other" in line for line in caplog.messages)
    caplog.clear()
    tpdwarp.bake(two_tiles(small), tmp_path / "c.exr", uv="map", frames=FRAME, **SMALL)
    assert not any("lie on each other" in line for line in caplog.messages)


def test_the_light_layer_is_valid_and_shows_each_frame_on_its_receiver(waves, tmp_path):
    out = tmp_path / "tex" / "c.##.exr"
    tpdwarp.bake(waves, out, frames="2:3", photons=256, resolution=32, threads=1)
    layer = tmp_path / "tex" / "c.light.usda"
    stage = Usd.Stage.Open(str(layer))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [error.GetMessage() for error in context.Validate(stage)] == []
    floor = stage.GetPrimAtPath("/World/Floor")
    material, _ = UsdShade.MaterialBindingAPI(floor).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    # It keeps its look, and emits besides.
    assert surface.GetInput("diffuseColor").Get() == Gf.Vec3f(ALBEDO)
    node = UsdShade.Shader(surface.GetInput("emissiveColor").GetConnectedSource()[0])
    assert node.GetIdAttr().Get() == "UsdUVTexture"
    np.testing.assert_allclose(node.GetInput("scale").Get()[:3], ALBEDO / math.pi, rtol=1e-6)
    for frame in (2, 3):
        assert Path(node.GetInput("file").Get(frame).resolvedPath) == tmp_path / "tex" / f"c.0{frame}.exr"
    reader = UsdShade.Shader(node.GetInput("st").GetConnectedSource()[0])
    primvar = UsdGeom.PrimvarsAPI(floor).GetPrimvar(reader.GetInput("varname").Get())
    np.testing.assert_array_equal(np.array(primvar.Get()), [(0, 0), (1, 0), (1, 1), (0, 1)])


def test_textures_that_are_there_stay_on_demand(small, tmp_path):
    out = tmp_path / "c.##.exr"
    tpdwarp.bake(small, out, frames=2, **SMALL)
    again = tpdwarp.bake(small, out, frames="1:2", skip_existing=True, **SMALL)
    assert (again.skipped, again.written) == ((2.0,), (1.0,))
    other = tpdwarp.bake(small, out, frames="1:2", skip_existing=True, **{**SMALL, "resolution": 16})
    assert other.written == (1.0, 2.0)


@pytest.mark.parametrize(
    ("name", "options", "why"),
    [
        ("c.exr", {"receiver": "/World/Pane"}, "/World/Pane: is specular"),
        ("c.exr", {"receiver": "/World/No"}, "/World/No: no visible mesh is there .*Floor"),
        ("c.exr", {"what": "light"}, "irradiance, caustic, motion"),
        ("c.png", {}, "exr"),
        ("c.exr", {"resolution": 0}, "resolution"),
        ("c.exr", {"gutter": -1}, "gutter"),
    ],
)
def test_what_cannot_be_baked_is_refused(small, tmp_path, name, options, why):
    with pytest.raises(InputError, match=why):
        tpdwarp.bake(small, tmp_path / name, frames=FRAME, **{**SMALL, **options})
    assert list(tmp_path.iterdir()) == []
