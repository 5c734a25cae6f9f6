"""Frames, photons and irradiance as arrays: an open stage against closed forms, files and other ways to name it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image
from usd_scenes.authoring.wave import write_wave
from usd_scenes.oracle import Wave, irradiance_average

SMALL = {"photons": 256, "samples": 1, "image_width": 24, "threads": 1}
FRAME = 2


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_stage(tmp_path_factory.mktemp("small") / "small.usda")


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("wave") / "wave.usda"
    write_wave(path, frames=4)
    return str(path)


def same_channels(one: tpdwarp.RenderedFrame, other: dict[str, np.ndarray], rounding: float = 0.0) -> None:
    assert one.channels.keys() == other.keys()
    for name, channel in one.channels.items():
        np.testing.assert_allclose(channel, other[name], rtol=rounding, atol=0.0, err_msg=name)


def test_a_frame_in_memory_is_the_one_that_is_written(small, tmp_path):
    frame = tpdwarp.render_frame(small, FRAME, **SMALL, aovs=["irradiance"])
    assert list(Path(small).parent.iterdir()) == [Path(small)]
    tpdwarp.render(small, tmp_path / "f.exr", frames=FRAME, **SMALL, aovs=["irradiance"])
    # The beauty is written in half precision.
    same_channels(frame, read_image(tmp_path / "f.exr")[0], rounding=2.0**-11)
    assert frame.frame == FRAME and frame.camera.path == "/World/Camera"
    assert frame.energy.sent > 0 and len(frame.photons) > 0


def test_a_layer_and_a_stage_stand_for_their_file(small):
    frame = tpdwarp.render_frame(small, FRAME, **SMALL)
    same_channels(frame, tpdwarp.render_frame(Sdf.Layer.FindOrOpen(small), FRAME, **SMALL).channels)
    same_channels(frame, tpdwarp.render_frame(Usd.Stage.Open(small), FRAME, **SMALL).channels)


def test_a_stage_is_rendered_with_what_its_session_changes_and_is_not_changed(small, tmp_path):
    stage = Usd.Stage.Open(small)
    stage.SetEditTarget(stage.GetSessionLayer())
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/Pane")).AddTranslateOp().Set(Gf.Vec3d(0.5, 0, 0))
    before = stage.GetSessionLayer().ExportToString()
    moved = tpdwarp.render_frame(stage, FRAME, **SMALL)
    assert np.any(moved.channels["G"] != tpdwarp.render_frame(small, FRAME, **SMALL).channels["G"])
    tpdwarp.render(stage, tmp_path / "f.exr", default_time=True, **SMALL)
    assert stage.GetSessionLayer().ExportToString() == before


def test_an_open_scene_renders_what_single_calls_do(small):
    scene = tpdwarp.Scene(small, **SMALL)
    assert scene.frames == (1.0, 2.0, 3.0)
    for changes in ({}, {"photons": 128}, {"image_width": 12}, {"exposure": 0.0}):
        frame = scene.render_frame(FRAME, **changes)
        same_channels(frame, tpdwarp.render_frame(small, FRAME, **{**SMALL, **changes}).channels)
    np.testing.assert_array_equal(
        scene.trace_photons(FRAME).positions, tpdwarp.trace_photons(small, FRAME, **SMALL).positions
    )


def test_an_open_scene_does_not_throw_dice_in_the_long_cells_of_its_lattices(waves):
    # Under a wave lattice cells are long; those of dice are square.
    settings = {**SMALL, "camera": "TopOrtho"}
    scene = tpdwarp.Scene(waves, **settings)
    scene.render_frame(FRAME)
    frame = scene.render_frame(FRAME, emission="jittered")
    same_channels(frame, tpdwarp.render_frame(waves, FRAME, **settings, emission="jittered").channels)


def test_a_notebook_shows_the_beauty(small):
    assert tpdwarp.render_frame(small, FRAME, **SMALL)._repr_png_().startswith(b"\x89PNG")
    assert "small.usda" in repr(tpdwarp.Scene(small, **SMALL))


def test_numbers_of_numpy_and_lists_are_taken(small):
    plain = tpdwarp.render_frame(small, FRAME, **SMALL, shutter=(-0.5, 0.5))
    numpys = {name: np.int64(value) for name, value in SMALL.items()}
    frame = tpdwarp.render_frame(small, np.float32(FRAME), **numpys, shutter=np.array([-0.5, 0.5]))
    same_channels(plain, frame.channels)


def test_irradiance_is_the_exact_caustic_of_a_wave(waves):
    pixels, width = 64, 2.0 / 64
    x = -1.0 + width * (np.arange(pixels) + 0.5)
    points = np.stack([x, np.zeros(pixels), np.zeros(pixels)], axis=1)
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    found = tpdwarp.irradiance(waves, FRAME, points, up, spacing=width, photons=4096, segments=1, exposure=1.0)
    # Time samples are a frame apart, and positions between them are linear.
    truth = irradiance_average(np.linspace(-1, 1, pixels + 1), Wave(), FRAME - 1, FRAME, 64, "linear")
    # What frames are held to (tests/test_accuracy.py).
    assert np.sqrt(np.mean((found[:, 1] - truth) ** 2)) <= 0.0025 * truth.mean()
    from_below = tpdwarp.irradiance(waves, FRAME, points, -up, photons=1024, segments=1, exposure=1.0)
    np.testing.assert_array_equal(from_below, 0.0)


def test_irradiance_at_what_a_camera_sees_is_that_of_its_pixels(waves):
    scene = tpdwarp.Scene(waves, photons=4096, exposure=1.0, camera="TopOrtho", image_width=32, samples=1)
    channels = scene.render_frame(FRAME, aovs=("irradiance", "P", "N")).channels
    points, normals = (np.stack([channels[f"{aov}.{axis}"].ravel() for axis in "XYZ"], axis=1) for aov in "PN")
    found = scene.irradiance(FRAME, points, normals, spacing=2.0 / 32)
    for k, channel in enumerate("RGB"):
        # Means over squares however they are turned, and over pixels: to oblique footprints they differ.
        np.testing.assert_allclose(found[:, k], channels[f"irradiance.{channel}"].ravel(), rtol=1e-3)


def test_points_of_a_receiver_that_moves_ride_along(waves):
    stage = Usd.Stage.Open(waves)
    stage.SetEditTarget(stage.GetSessionLayer())
    # Against the wave, whose light so passes by most of a wavelength.
    speed = -0.6
    slide = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Floor")).AddTranslateOp()
    for frame in (1, 4):
        slide.Set(Gf.Vec3d(speed * frame, 0, 0), frame)
    scene = tpdwarp.Scene(stage, photons=16384)
    points = np.stack([np.linspace(-0.8, 0.8, 33), np.zeros(33), np.zeros(33)], axis=1)
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    found = scene.irradiance(FRAME, points, up, exposure=1.0, segments=4)[:, 1]
    instants = 32
    stills = np.zeros(33)
    for k in range(instants):
        since = (k + 0.5) / instants
        there = points + np.array([speed * (since - 0.5), 0.0, 0.0])
        stills += scene.irradiance(FRAME + since, there, up, exposure=0.0)[:, 1] / instants
    still = scene.irradiance(FRAME + 0.5, points, up, exposure=0.0)[:, 1]
    assert np.sqrt(np.mean((found - stills) ** 2)) <= 0.005 * stills.mean()
    # Were motion ignored, this would show.
    assert np.sqrt(np.mean((still - stills) ** 2)) > 0.02 * stills.mean()


def test_where_there_is_no_diffuse_surface_there_is_no_irradiance(small):
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.0, 0.0, 1.0]]
    found = tpdwarp.irradiance(small, FRAME, points, [[0, 0, 1]] * 3, **SMALL)
    assert np.isfinite(found[0]).all() and np.isnan(found[1:]).all()


@pytest.mark.parametrize(
    ("points", "normals", "options", "why"),
    [
        ([0.0, 0.0, 0.0], [[0, 0, 1]], {}, "points: shape"),
        ([[0.0, 0.0, 0.0]], [[0, 0, 1]] * 2, {}, "1 points and 2 normals"),
        ([[0.0, 0.0, np.nan]], [[0, 0, 1]], {}, "points: .* not finite"),
        ([[0.0, 0.0, 0.0]], [[0, 0, 1]], {"spacing": -1.0}, "spacing"),
        ([[0.0, 0.0, 0.0]], [[0, 0, 1]], {"photon": 3}, "photon"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(small, points, normals, options, why):
    with pytest.raises(InputError, match=why):
        tpdwarp.irradiance(small, FRAME, points, normals, **options)


def test_a_closed_scene_says_so_and_may_be_closed_again(small):
    with tpdwarp.Scene(small, **SMALL) as scene:
        assert scene.render_frame(FRAME).frame == FRAME
    scene.close()
    assert repr(scene) == "tpdwarp.Scene(closed)"
    for use in (
        lambda: scene.frames,
        lambda: scene.render_frame(FRAME),
        lambda: scene.trace_photons(FRAME, photons=64),
        lambda: scene.irradiance(FRAME, [[0, 0, 0]], [[0, 0, 1]], bounces=2),
    ):
        with pytest.raises(InputError, match="the scene is closed"):
            use()


@pytest.mark.parametrize("frame", [np.int64(2), np.float32(2.0), Usd.TimeCode(2)])
def test_frames_are_numbers_of_any_kind(small, frame):
    assert len(tpdwarp.trace_photons(small, frame, photons=64, threads=1)) > 0
    assert tpdwarp.render_frame(small, frame, **SMALL).frame == 2.0


@pytest.mark.parametrize("frame", ["2", None, [1, 2], True, math.inf, math.nan, Usd.TimeCode.Default()])
def test_what_is_no_frame_is_refused_in_pythons_words(small, frame):
    with pytest.raises(InputError, match="is no time code"):
        tpdwarp.render_frame(small, frame, **SMALL)


def test_the_default_time_is_traced_by_its_own_name(small):
    assert len(tpdwarp.trace_photons(small, Usd.TimeCode.Default(), photons=64, threads=1)) >= 0


@pytest.mark.parametrize("scene", [5, None, b"x.usda", ["x.usda"]])
def test_what_is_no_scene_is_refused(scene):
    with pytest.raises(InputError, match=r"must be a file, an Sdf\.Layer or a Usd\.Stage"):
        tpdwarp.render_frame(scene, FRAME)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"exposure": "1"}, "exposure must be a number, not '1'"),
        ({"shutter": 1.0}, "shutter must be 2 numbers"),
        ({"aovs": 3}, "aovs must be a list of names"),
        ({"camera": 3}, "camera must be a text"),
        ({"photons": 2.5}, "photons must be a whole number"),
        ({"seed": "x"}, "seed must lie in"),
        ({"fotons": 3}, "unknown setting 'fotons'"),
    ],
)
def test_settings_of_the_wrong_kind_are_refused_in_pythons_words(small, changes, why):
    with pytest.raises(InputError, match=why):
        tpdwarp.Scene(small, **changes)


@pytest.mark.parametrize("out", [None, 5, b"f.exr"])
def test_what_names_no_file_is_refused(small, out):
    for write in (tpdwarp.render, tpdwarp.bake):
        with pytest.raises(InputError, match="a file must be named by"):
            write(small, out, frames=FRAME, photons=64, threads=1)


def test_textures_take_what_notebooks_have(small, tmp_path):
    options = {"resolution": np.int64(8), "gutter": np.int32(1), "frames": np.array([FRAME]), "photons": 64}
    for receiver in (Sdf.Path("/World/Floor"), [Sdf.Path("/World/Floor")], np.array(["/World/Floor"])):
        assert tpdwarp.bake(small, tmp_path / "t.exr", receiver=receiver, **options, threads=1).written == (FRAME,)
    with pytest.raises(InputError, match="resolution must be a whole number"):
        tpdwarp.bake(small, tmp_path / "t.exr", resolution=2.5, threads=1)


def test_a_frame_is_short_in_a_notebook(small):
    frame = tpdwarp.render_frame(small, FRAME, **SMALL, aovs=["irradiance"])
    assert repr(frame).startswith("tpdwarp.RenderedFrame(frame 2, 24 × 16, R G B A irradiance, ")
    assert repr(frame.photons).startswith(f"PhotonRecord({len(frame.photons)} photons: ids, positions")


def test_settings_take_what_notebooks_have(small):
    crop = np.array([0, 0, 0.5, 1])
    settings = tpdwarp.Settings(aovs="caustic, Z", photons=np.int32(64), crop=crop, mask=["/World"])
    assert settings.aovs == ("caustic", "Z") and settings.mask == ("/World",)
    assert type(settings.photons) is int and settings.crop == (0.0, 0.0, 0.5, 1.0)
    assert tpdwarp.Scene(small, camera=Sdf.Path("/World/Camera")).settings.camera == "/World/Camera"
    with pytest.raises(InputError, match=r"settings must be a tpdwarp\.Settings"):
        tpdwarp.Scene(small, {"photons": 3})


@pytest.mark.parametrize(
    ("points", "why"),
    [([["a", "b", "c"]], "are no numbers"), ([[0, 0], [0, 0, 1]], "are no numbers"), ([0, 0, 0], "shape"), (None, "")],
)
def test_points_that_are_none_are_refused(small, points, why):
    with pytest.raises(InputError, match=f"points: .*{why}"):
        tpdwarp.irradiance(small, FRAME, points, [[0, 0, 1]], photons=64, threads=1)
