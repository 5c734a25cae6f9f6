"""Of light that a picture shows a part of, that part has finer cells; nothing else about it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tpdwarp
from tpdwarp.estimators import seen_light, temporal
from tpdwarp.estimators.temporal import Temporal
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.scene.description import (
    CameraAtShutter,
    Interaction,
    Material,
    MeshAtShutter,
    SceneAtShutter,
    SceneSource,
    Shutter,
)
from tpdwarp.settings import Settings
from usd_scenes.in_memory import QUAD, WATER, Source, floor, looking_down, quad, steady, wave_source
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.solids import write
from usd_scenes.stage import CAMERA, FRAME

WAVE = Wave(wavelength=0.65, speed=0.65 / 8)
MIRROR = Material(Interaction.MIRROR)
SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
OPEN = Shutter(0, 0.0, 1.0)


def frame_of(source: SceneSource, width: int, height: int, shutter: Shutter = OPEN, **settings) -> Frame:
    return render_frame(RenderContext(source, Settings(aovs=("irradiance",), **settings)), shutter, width, height)


def irradiance(frame: Frame) -> np.ndarray:
    return frame.channels["irradiance.R"].astype(float)


def error_of(frame: Frame, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((irradiance(frame) - truth) ** 2)) / truth.mean())


def without_sight(monkeypatch) -> None:
    monkeypatch.setattr(RenderContext, "_seen_light", lambda *_: None)


def close_up(half: float, left: float = 0.0) -> Source:
    """The folding wave, of which the camera sees a square."""
    window = (left - half, left + half, -half, half)
    return wave_source(WAVE, camera=looking_down(window, height=0.9 * WAVE.height))


@pytest.mark.parametrize("half", [0.5, 0.1])
def test_the_less_of_the_light_a_picture_shows_the_finer_it_is(half, monkeypatch):
    columns, left = 64, 0.3
    truth = irradiance_average(np.linspace(left - half, left + half, columns + 1), WAVE, 0, 1, 128)
    source, asked = close_up(half, left), {"photons": 4096, "samples": 1}
    seen = frame_of(source, columns, columns, **asked)
    assert seen.energy.counts["emitted"] <= 1.3 * asked["photons"]
    without_sight(monkeypatch)
    even = frame_of(source, columns, columns, **asked)
    # At the least, cells are as fine as those of so many times the photons.
    denser = frame_of(source, columns, columns, photons=4096 * (2 if half == 0.5 else 12), samples=1)
    assert error_of(seen, truth) <= 1.1 * error_of(denser, truth)
    assert error_of(seen, truth) <= (0.6 if half == 0.5 else 0.2) * error_of(even, truth)


def test_all_of_the_light_is_counted_and_photons_have_ids_of_their_own(monkeypatch):
    seen = frame_of(close_up(0.3), 32, 32, photons=4096, samples=1)
    without_sight(monkeypatch)
    even = frame_of(close_up(0.3), 32, 32, photons=4096, samples=1)
    for name in ("sent", "deposited", "escaped"):
        assert getattr(seen.energy, name) == pytest.approx(getattr(even.energy, name), rel=2e-3)
    assert len(np.unique(seen.photons.ids)) == len(seen.photons)
    assert seen.photons.flux.sum() == pytest.approx(even.photons.flux.sum(), rel=2e-3)


def test_an_id_means_the_same_cell_in_every_frame():
    context = RenderContext(close_up(0.3), Settings(aovs=("irradiance",), photons=4096, samples=1))
    first, second = (
        render_frame(context, Shutter(frame, frame, frame + 1.0), 32, 32).photons for frame in (0, 1)
    )
    common, mine, theirs = np.intersect1d(first.ids, second.ids, return_indices=True)
    assert len(common) > 0.9 * len(first)
    np.testing.assert_array_equal(np.floor(first.emission[mine]), np.floor(second.emission[theirs]))


def test_photons_are_spread_evenly_where_all_light_is_in_the_picture():
    camera = looking_down((-2.1, 2.1, -2.1, 2.1), height=0.9 * WAVE.height)
    frame = frame_of(wave_source(WAVE, camera=camera), 32, 32, photons=4096, samples=1)
    assert frame.energy.counts["emitted"] == 4096


def board_over_flat_water(speed: float) -> Source:
    """A board's edge passes x = 0 at mid shutter; the camera sees what lies around it, a small part of the water."""
    water = quad("/water", (-2.0, -2.0), (2.0, 2.0), 0.5, WATER)
    board = quad("/board", (-4.0, -4.0), (0.0, 4.0), 0.8, motion=(speed, 0.0, 0.0))
    camera = looking_down((-0.4, 0.4, -0.4, 0.4), height=0.4)
    return steady([floor(), water, board], camera=camera)


@pytest.mark.parametrize("coarse", [256, 300, 361])
@pytest.mark.parametrize("speed", [0.5, -0.7])
def test_what_comes_into_the_light_as_the_shutter_opens_is_seen(speed, coarse, monkeypatch):
    monkeypatch.setattr(seen_light, "FEWEST_COARSE_CELLS", coarse)
    columns = 64
    found = irradiance(frame_of(board_over_flat_water(speed), columns, 8, photons=2048, samples=4)).mean(axis=0)
    x = np.linspace(-0.4, 0.4, columns + 1)
    # Light falls at x while the edge is left of it: for a part of the shutter that grows from 0 to 1 over its way.
    covered = np.clip(0.5 + x / abs(speed), 0.0, 1.0)
    ramp = 0.5 * (covered[1:] + covered[:-1])
    passed = 1.0 - (0.33 / 2.33) ** 2
    assert np.abs(found - passed * ramp).max() < 0.05


def test_light_that_is_seen_in_a_mirror_alone_is_as_fine():
    """The camera looks along x, above the floor, into a mirror that shows it the floor left of that."""
    wave, half = wave_source(WAVE), 0.1
    normal = np.array([-0.9487, 0.0, -0.3162])
    up = np.array([-0.3162, 0.0, 0.9487])
    corners = [(0.6, 0.0, 0.3) + half * (a * up + b * np.array([0.0, 1.0, 0.0])) for a, b in SQUARE]
    mirror = MeshAtShutter("/mirror", np.array(corners), QUAD, materials=(MIRROR,))
    assert np.dot(np.cross(mirror.points[1] - mirror.points[0], mirror.points[2] - mirror.points[0]), normal) > 0.0
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    camera = CameraAtShutter("/cam", True, np.array([-1.0, 0.0, 0.3]), axes, (-half, half, -half, half))

    def at(shutter: Shutter) -> SceneAtShutter:
        scene = wave.at(shutter)
        return replace(scene, meshes=(*scene.meshes, mirror), camera=camera)

    frame = frame_of(Source(at), 48, 48, photons=4096, samples=1)
    assert irradiance(frame).max() > 0.5
    photons = frame.photons.rows((frame.photons.bounces == 1) & (frame.photons.positions[:, 2] < 1e-3))
    # The mirror's middle shows what lies 0.4 left of it.
    x, y = photons.positions[:, 0] - 0.2, photons.positions[:, 1]
    inside, outside = np.hypot(x, y) < 0.08, np.abs(y) > 1.0
    assert inside.sum() / (np.pi * 0.08**2) > 20.0 * outside.sum() / (4.0 * 2.0)


def test_a_shutter_in_strips_shows_the_same(monkeypatch):
    asked = {"photons": 4096, "samples": 1}
    whole = frame_of(close_up(0.3), 32, 32, **asked)
    monkeypatch.setattr(temporal, "PHOTONS_OF_STRIP", 1500)
    strips = frame_of(close_up(0.3), 32, 32, **asked)
    np.testing.assert_allclose(irradiance(strips), irradiance(whole), rtol=1e-3, atol=1e-3)
    assert strips.energy.sent == pytest.approx(whole.energy.sent, rel=1e-4)
    assert strips.energy.deposited == pytest.approx(whole.energy.deposited, rel=1e-4)
    np.testing.assert_array_equal(np.sort(strips.photons.ids), np.sort(whole.photons.ids))


def test_light_that_nobody_looks_at_is_spread_evenly():
    assert Temporal()._seen_light is None
    settings = Settings(aovs=("irradiance",), photons=4096, samples=1, path="straight")
    frame = render_frame(RenderContext(close_up(0.3), settings), OPEN, 32, 32)
    assert frame.energy.counts["emitted"] == 4096


@pytest.mark.parametrize("exposure", [0.0, 1.0])
def test_edges_of_glass_lie_in_finer_cells_whichever_side_of_them_is_seen(exposure, tmp_path, monkeypatch):
    """Of a cell that an edge of a cube goes through, the middle sends its light elsewhere, and a part into the picture.

    So .04 of the light was missing along the edge of what the picture shows of the caustic.
    """
    stage = Usd.Stage.Open(str(write("cube-turning", tmp_path)))
    camera = UsdGeom.Camera(stage.GetPrimAtPath(CAMERA))
    for side, share in (("Horizontal", 0.2), ("Vertical", 0.1)):
        aperture = getattr(camera, f"Get{side}ApertureAttr")()
        width = aperture.Get()
        aperture.Set(width / 3.0)
        getattr(camera, f"Get{side}ApertureOffsetAttr")().Set(share * width)
    asked = {"aovs": ("irradiance",), "image_width": 64, "exposure": exposure, "camera": CAMERA}
    found = irradiance(tpdwarp.render_frame(stage, FRAME, photons=16384, **asked))
    without_sight(monkeypatch)
    even, dense = (irradiance(tpdwarp.render_frame(stage, FRAME, photons=n, **asked)) for n in (16384, 1 << 18))
    error, before = (np.sqrt(np.mean((light - dense) ** 2)) / dense.mean() for light in (found, even))
    assert found.mean() == pytest.approx(dense.mean(), rel=3e-3)
    assert error < 0.6 * before
