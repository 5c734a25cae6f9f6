"""Laws of light that begins or ends between two instants at which cells are traced, or beyond the last of them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.frames import OPEN, irradiance
from tests.photons.shapes import floor, glass
from tests.photons.traced import sun
from tests.view.scenes import Source, looking_down, quad, steady
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.settings import Settings
from tpdwarp.trajectories.retraced import PARTS
from tpdwarp.usd.read.stage import StageScene
from usd_scenes.oracle.closed_forms import fresnel_reflectance
from usd_scenes.solids import write
from usd_scenes.stage import CAMERA, FRAME

SETTINGS = Settings(photons=4096, segments=1, samples=1, aovs=("irradiance",))
COLUMNS = 144
WATER = quad("/water", (-2, -2), (2, 2), 1.0, glass(1.33))
VIEW = looking_down((-2.25, 2.25, -0.125, 0.125), height=0.5)
# Within a part of the shutter the edge goes by more cells than edges are looked for.
SPEED = 8.0


def uncovered(begins: float) -> Source:
    """A board over flat water leaves its border x = 2 at the part ``begins`` of the shutter, and goes on along −x."""
    edge = 2.0 + SPEED * begins
    board = quad("/board", (edge - 16, -9), (edge, 9), 2.0, motion=(-SPEED, 0, 0))
    return steady([floor(), WATER, board], (sun(),), VIEW)


def covered(ends: float) -> Source:
    """The same, backwards: the board covers the last of the water at the part ``ends`` of the shutter."""
    edge = 2.0 - SPEED * ends
    board = quad("/board", (edge - 16, -9), (edge, 9), 2.0, motion=(SPEED, 0, 0))
    return steady([floor(), WATER, board], (sun(),), VIEW)


def lit(source: Source) -> np.ndarray:
    return irradiance(render_frame(RenderContext(source, SETTINGS), OPEN, COLUMNS, 8)).mean(axis=0)


@pytest.mark.parametrize("begins", [0.46, 0.44, 0.4, 0.31, 0.1])
def test_light_shines_from_when_it_is_uncovered_however_late(begins):
    x = 4.5 * ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5)
    lasts = np.where(np.abs(x) < 2, np.clip(0.5 - begins - (2 - x) / SPEED, 0, None), 0.0)
    exact = (1 - fresnel_reflectance(0.0, 1.0, 1.33)) * lasts
    for found in (lit(uncovered(begins)), lit(covered(-begins))):
        # Parts of parts know within what time a cell is uncovered, and cells at the border within one of them.
        step = 1 / PARTS**2
        assert np.abs(found - exact)[x < 1.8].max() < step
        assert found.mean() == pytest.approx(exact.mean(), rel=0.05)


@pytest.mark.parametrize("scene, photons", [("torus-turning-10", 1024), ("blob-turning", 4096)])
def test_no_scenes_are_loaded_for_hardly_any_light(scene, photons, tmp_path, monkeypatch):
    """A coarse lattice over a turning torus has some cells of which nothing tells when their light ends; over a blob
    there are such on many paths, of which each has little light."""
    loads, load = [], PhotonTracer.load
    monkeypatch.setattr(PhotonTracer, "load", lambda *given, **options: loads.append(1) or load(*given, **options))
    settings = Settings(photons=photons, samples=1, exposure=1.0, camera=CAMERA, image_width=32, aovs=("irradiance",))
    stage = StageScene.open(str(write(scene, tmp_path)), settings)
    render_frame(RenderContext(stage, settings), stage.shutter(FRAME, settings), 32, 32)
    # Keyframes and nine instants take 20; each part that is cut takes eight more, and nearly all hold such cells.
    assert len(loads) < 40
