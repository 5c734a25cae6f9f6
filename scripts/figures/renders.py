"""Renders for the figures: the light from photons in one frame of a scene, and how far it is from the truth."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import tpdwarp
from tpdwarp.errors import FrameError
from tpdwarp.io.images import read_image

ROOT = Path(__file__).resolve().parents[2]
MEASURING_CAMERA = "TopOrtho"
FRAME = 12


@dataclass(frozen=True, eq=False)
class Shot:
    """One render.

    Attributes:
        light: Radiance of the light from photons, shape [h, w].
        landed: Photons that landed.
    """

    light: np.ndarray
    landed: int

    def rmse(self, truth: Shot) -> float:
        """Root of the mean squared difference from ``truth`` [radiance]."""
        return float(np.sqrt(np.mean((self.light.astype(np.float64) - truth.light) ** 2)))


def shipped(name: str) -> Path:
    """The scene of that name in usd_scenes."""
    return ROOT / "usd_scenes" / f"{name}.usdc"


def shot(scene: Path, width: int, **settings: Any) -> Shot:
    """Renders the frame that the figures show, as :func:`tpdwarp.render` would, seen by the measuring camera.

    Args:
        scene: The stage; its light is grey.
        width: In pixels.
        **settings: Fields of :class:`tpdwarp.Settings`, and ``frame``, ``debug_layer`` and ``curves``.

    Raises:
        FrameError: The frame could not be rendered.
    """
    options = {"camera": MEASURING_CAMERA, "frames": settings.pop("frame", FRAME), **settings}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.exr"
        result = tpdwarp.render(scene, path, image_width=width, aovs=("caustic",), **options)
        if not result.ok:
            raise FrameError(result.outcomes[0].reason)
        return Shot(read_image(path)[0]["caustic.G"], result.outcomes[0].photons)


def truth(scene: Path, width: int, exposure: float, times: int = 32, **settings: Any) -> Shot:
    """The accumulation of ``times`` instants that a shot is compared with; motion between samples is smooth."""
    return shot(
        scene,
        width,
        exposure=exposure,
        estimator="accumulation",
        accumulation_times=times,
        **{"photons": 1 << 16, "motion": "cubic", **settings},
    )


def finer_sea(folder: Path) -> Path:
    """The sea in a finer mesh than the shipped one, whose quads show in the caustic."""
    return _made(folder, "sea", "--resolution", "201")


def folding_wave(folder: Path) -> Path:
    """The wave at half its length, whose light folds; it moves by an eighth of that a frame."""
    return _made(folder, "wave", "--wavelength", "0.65", "--speed", "0.08125")


def _made(folder: Path, name: str, *options: str) -> Path:
    make = [sys.executable, ROOT / "scripts" / "make_scenes.py", "--out", folder, name, *options]
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
    return folder / f"{name}.usdc"
