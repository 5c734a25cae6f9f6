"""Moving solids against brute force in double precision: quick forms of ``scripts/benchmarks/solids.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from usd_scenes import shapes
from usd_scenes.in_memory import SUN, Source, floor, looking_down, quad
from usd_scenes.kept_truths import kept_truth
from usd_scenes.oracle.closed_forms import fresnel_reflectance
from usd_scenes.solids import SCENES, write
from usd_scenes.stage import CAMERA, FRAME

SETTINGS = Settings(photons=1 << 14, samples=4, threads=1, aovs=("irradiance",), camera=CAMERA)


@pytest.mark.parametrize(
    ("name", "wanted"),
    # Relative RMSE wanted of 65 536 photons; default settings are to reach it with a quarter of these.
    [
        ("ball-gliding", 0.05),
        ("cube-turning", 0.08),
        ("torus-turning-10", 0.05),
        ("board-over-water", 0.05),
        ("board-under-a-lens", 0.02),
        # Light at the onset of total reflection rushes over a fifth of the picture in an eighth of the shutter.
        ("prism-turning", 0.06),
        # A thin wall stands between this light and another one, a thousand times as strong.
        ("two-lights-1000", 0.03),
    ],
)
def test_moving_solids_are_as_brute_force_has_them(name, wanted, tmp_path: Path):
    truth = kept_truth(SCENES[name]())
    height, width = truth.irradiance.shape
    settings = Settings.of(SETTINGS, image_width=width)
    context = RenderContext(StageScene.open(write(name, tmp_path), settings), settings)
    frame = render_frame(context, Shutter(FRAME, FRAME, FRAME + 1), width, height)
    mean = truth.irradiance[truth.mask].mean()
    error = (frame.channels["irradiance.R"] - truth.irradiance)[truth.mask]
    # The truth is noisy itself.
    assert np.sqrt(np.mean(error**2)) / mean < np.hypot(wanted, truth.error)
    true_share = sum(watts for path, watts in truth.energy.items() if path.startswith("/")) / truth.energy["sent"]
    # Beside what is given up below the cutoffs.
    given_up = frame.energy.lost_total / frame.energy.sent
    assert frame.energy.deposited / frame.energy.sent == pytest.approx(true_share, abs=0.003 + given_up)


def test_what_folds_is_right_with_one_sample(tmp_path: Path):
    """A pixel's mean is exact, so that the error of a still falls with photons, and not with samples."""
    truth = kept_truth(SCENES["folded-wave"]())
    height, width = truth.irradiance.shape
    settings = Settings.of(SETTINGS, photons=1 << 16, samples=1, image_width=width)
    context = RenderContext(StageScene.open(write("folded-wave", tmp_path), settings), settings)
    frame = render_frame(context, Shutter(FRAME, FRAME, FRAME + 1), width, height)
    error = (frame.channels["irradiance.R"] - truth.irradiance)[truth.mask]
    assert np.sqrt(np.mean(error**2)) / truth.irradiance[truth.mask].mean() < np.hypot(0.02, truth.error)


def test_light_through_flat_water_is_direct_light_times_what_passes_on_a_smooth_ball_wound_against_its_normals():
    """Photons fall by geometric normals, light shades by interpolated ones; away from the silhouette they agree."""
    points, triangles, normals = shapes.sphere(24, 12)
    wound = triangles[:, ::-1].astype(np.int32)
    grey = Material(color=(0.5, 0.5, 0.5))
    ball = MeshAtShutter("/ball", 0.6 * points + (0, 0, 0.7), wound, None, normals, None, wound, (grey,))
    across, passed = 96, 1.0 - fresnel_reflectance(0.0, 1.0, 1.33)
    water = quad("/water", (-3, -3), (3, 3), 1.8, Material(Interaction.DIELECTRIC, ior=1.33))
    settings = Settings(photons=1 << 16, samples=1, threads=1, aovs=("caustic", "direct"))

    def light(meshes: list[MeshAtShutter], channel: str) -> np.ndarray:
        scene = SceneAtShutter(Shutter.still(0.0), tuple(meshes), (SUN,), looking_down(height=1.4))
        frame = render_frame(RenderContext(Source(lambda shutter: scene), settings), Shutter.still(0.0), across, across)
        return frame.channels[channel].astype(float)

    direct, caustic = light([floor(), ball], "direct.R"), light([floor(), ball, water], "caustic.R")
    y, x = (np.mgrid[0:across, 0:across] + 0.5) / (across / 2) - 1
    inside = np.abs(np.hypot(x, y) - 0.6) > 0.06
    error = (caustic - passed * direct)[inside]
    assert np.sqrt(np.mean(error**2)) < 0.01 * passed * direct[inside].mean()
