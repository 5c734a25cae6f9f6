"""Converged light from photons with an estimate of its own error, kept in a folder so that it is made but once.

Truths that take an hour lie beside this file:

    .venv/bin/python scripts/benchmarks/truths.py        # makes those anew
"""

from __future__ import annotations

import hashlib
import itertools
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tpdwarp.jobs.opening import open_scene, shutter_of
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

FOLDER = Path(tempfile.gettempdir()) / "tpdwarp-truths"
PACKAGE = Path(__file__).resolve().parents[2] / "tpdwarp"
SCENES = PACKAGE.parent / "usd_scenes"
CONVERGED = Path(__file__).resolve().parent / "converged"
WIDTH = 64
# None of those that --target-error looks at.
FRAMES = (5.0, 14.0)
# By case of the benchmark: scene, settings, and two accumulations (photons, instants), the second one of which is the
# truth. Four times the photons leave two fifths of an error there: so changes fell from one to the next.
DEAR: dict[str, tuple[str, dict[str, Any], tuple[int, int], tuple[int, int]]] = {
    "cylinder, from above": ("cylinder", {"camera": "TopOrtho"}, (1 << 20, 64), (1 << 22, 16)),
    "cylinder, exposure 2": ("cylinder", {"camera": "TopOrtho", "exposure": 2.0}, (1 << 18, 32), (1 << 20, 64)),
}
LEFT = 0.4
# What the light of given settings follows from.
ROOMS = ("estimators", "footprints", "photons", "scene", "usd", "view")
FEWEST_PHOTONS = 1 << 14
FEWEST_SEGMENTS, MOST_SEGMENTS = 2, 16
# How errors fall from one level to the next: what is believed at least and at most. Where changes fall less, errors
# are no longer of one shape, and each is smaller than the change.
FALL = (0.3, 0.5)


@dataclass(frozen=True, eq=False)
class Truth:
    """Light from photons.

    Attributes:
        light: Shape [frames, 3, height, width].
        error: Its own relative RMSE, as the changes of the last levels tell it.
        photons: Photons of each segment, or instant.
        segments: Segments of the shutter, or instants.
    """

    light: np.ndarray
    error: float
    photons: int
    segments: int


def truth_of(
    source: StageScene,
    shutters: Sequence[Shutter],
    settings: Settings,
    size: tuple[int, int],
    wanted: float,
    levels: int,
) -> Truth:
    """The light of ``settings`` with four times the photons in twice the segments, until it is as exact as wanted.

    Args:
        source: The scene.
        shutters: Of the frames.
        settings: Of the frames, with the estimator that makes the truth: ``tpd`` or ``accumulation``.
        size: Width and height in pixels.
        wanted: Relative RMSE.
        levels: Most levels.
    """
    moves = any(shutter.exposure > 0 for shutter in shutters)
    lights: list[np.ndarray] = []
    error = np.inf
    while len(lights) < levels and error > wanted:
        photons = FEWEST_PHOTONS << 2 * len(lights)
        segments = min(FEWEST_SEGMENTS << len(lights), MOST_SEGMENTS) if moves else 1
        lights.append(_kept(source, shutters, _settings(settings, photons, segments), size))
        changes = [relative_error(a, b) for a, b in itertools.pairwise(lights[-3:])]
        if len(changes) == 2:
            fall = np.clip(changes[1] / changes[0], *FALL)
            error = changes[1] * fall / (1.0 - fall)
    return Truth(lights[-1], float(error), photons, segments)


def kept_truth(case: str) -> Truth | None:
    """The truth that lies beside this file for a case of the benchmark, if one does."""
    path = _path_of(case)
    if not path.exists():
        return None
    with np.load(path) as kept:
        light = np.repeat(kept["light"][:, None].astype(np.float64), 3, axis=1)
        return Truth(light, float(kept["error"]), int(kept["photons"]), int(kept["instants"]))


def _path_of(case: str) -> Path:
    return CONVERGED / f"{case.replace(', ', '-').replace(' ', '-')}.npz"


def make_dear() -> None:
    """Makes the truths that lie beside this file; light is grey, so that one channel is kept."""
    for case, (scene, changes, *sizes) in DEAR.items():
        base = Settings(image_width=WIDTH, aovs=("caustic",), **{"exposure": 1.0, **changes})
        source = open_scene(SCENES / f"{scene}.usdc", base, False)
        shutters = [shutter_of(source, frame, base) for frame in FRAMES]
        coarse, fine = (
            light_of(
                source,
                shutters,
                Settings.of(base, estimator="accumulation", photons=photons, accumulation_times=instants),
                source.resolution(),
            )
            for photons, instants in sizes
        )
        error = relative_error(coarse, fine) * LEFT / (1.0 - LEFT)
        photons, instants = sizes[1]
        CONVERGED.mkdir(exist_ok=True)
        np.savez_compressed(
            _path_of(case), light=fine[:, 0].astype(np.float32), error=error, photons=photons, instants=instants
        )
        print(f"{case}: errs by {error:.4f}", flush=True)


def relative_error(found: np.ndarray, truth: np.ndarray) -> float:
    """RMSE of frames [frames, 3, height, width], each by the mean of its own ``truth``."""
    return float(np.sqrt(np.mean(((found - truth) / truth.mean(axis=(1, 2, 3), keepdims=True)) ** 2)))


def light_of(source: StageScene, shutters: Sequence[Shutter], settings: Settings, size: tuple[int, int]) -> np.ndarray:
    """Light from photons, shape [frames, 3, height, width]."""
    context = RenderContext(source, settings)
    frames = [render_frame(context, shutter, *size).channels for shutter in shutters]
    return np.stack([np.stack([frame[f"caustic.{c}"] for c in "RGB"]) for frame in frames]).astype(np.float64)


def _settings(settings: Settings, photons: int, segments: int) -> Settings:
    if settings.estimator == "accumulation":
        return Settings.of(settings, photons=photons, accumulation_times=4 * segments)
    return Settings.of(settings, photons=photons * segments, segments=segments)


def _kept(source: StageScene, shutters: Sequence[Shutter], settings: Settings, size: tuple[int, int]) -> np.ndarray:
    digest = hashlib.sha256(Path(source.file).read_bytes())
    for path in sorted(path for room in ROOMS for path in (PACKAGE / room).glob("*.py")):
        digest.update(path.read_bytes())
    digest.update(repr((shutters, settings, size)).encode())
    path = FOLDER / f"{digest.hexdigest()[:32]}.npy"
    if path.exists():
        return np.load(path).astype(np.float64)
    light = light_of(source, shutters, settings, size)
    FOLDER.mkdir(exist_ok=True)
    np.save(path, light.astype(np.float32))
    return light


if __name__ == "__main__":
    make_dear()
