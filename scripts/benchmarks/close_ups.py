#!/usr/bin/env python3
"""What finer cells where the camera looks are worth in close-ups of ``usd_scenes/solids.py``, and what they cost.

The camera's apertures are a quarter as wide, and off the middle. Errors are relative RMSE of the irradiance beside
photons that are spread evenly, sixteen times as many: errors below .02 cannot be told.

.venv/bin/python scripts/benchmarks/close_ups.py                       # the scenes of docs/measured.md
.venv/bin/python scripts/benchmarks/close_ups.py cube-turning cardioid
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from unittest import mock

import numpy as np
from pxr import Usd, UsdGeom

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tpdwarp import Scene
from tpdwarp.rendering.context import RenderContext
from usd_scenes.solids import SCENES, write
from usd_scenes.stage import CAMERA, FRAME

CLOSE_UPS = (
    "cube-turning", "cardioid", "folded-wave", "waves-over-a-sphere", "board-over-water", "camera-through-water"
)  # fmt: skip
ZOOM = 4.0
# Offsets of the apertures, as parts of them before.
OFFSETS = (0.2, 0.1)
WIDTH, SAMPLES = 64, 4
PHOTONS, MOST_PHOTONS = 1 << 14, 1 << 18


def run(scenes: Sequence[str] = CLOSE_UPS) -> list[dict[str, object]]:
    """Errors and CPU seconds of a further render with the finer cells and with even ones; prints a row a scene.

    Returns:
        A row a scene: ``scene``, ``finer`` and ``even`` (relative RMSE), ``ratio`` of their CPU seconds.
    """
    rows: list[dict[str, object]] = []
    print(f"  {'scene':22s} {'finer':>7s} {'even':>7s} {'CPU s':>6s} {'even':>6s} {'ratio':>6s}")
    for name in scenes:
        with tempfile.TemporaryDirectory() as folder:
            stage = close_up(name, Path(folder))
            truth, _ = _picture(stage, MOST_PHOTONS, even=True)
            (finer, seconds), (even, even_seconds) = (_picture(stage, PHOTONS, even) for even in (False, True))
        errors = [float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean()) for found in (finer, even)]
        rows.append({"scene": name, "finer": errors[0], "even": errors[1], "ratio": seconds / even_seconds})
        times = f"{seconds:6.2f} {even_seconds:6.2f} {seconds / even_seconds:6.2f}"
        print(f"  {name:22s} {errors[0]:7.4f} {errors[1]:7.4f} {times}", flush=True)
    return rows


def close_up(name: str, folder: Path) -> Usd.Stage:
    """A scene of ``usd_scenes/solids.py`` of which the camera sees a sixteenth of its picture."""
    stage = Usd.Stage.Open(str(write(name, folder)))
    camera = UsdGeom.Camera(stage.GetPrimAtPath(CAMERA))
    sides = (
        (camera.GetHorizontalApertureAttr(), camera.GetHorizontalApertureOffsetAttr()),
        (camera.GetVerticalApertureAttr(), camera.GetVerticalApertureOffsetAttr()),
    )
    for (aperture, offset), part in zip(sides, OFFSETS, strict=True):
        offset.Set(part * aperture.Get())
        aperture.Set(aperture.Get() / ZOOM)
    return stage


def _picture(stage: Usd.Stage, photons: int, even: bool) -> tuple[np.ndarray, float]:
    """Irradiance (green), shape [height, width], and CPU seconds, of the second render of the same frame."""
    evenly = mock.patch.object(RenderContext, "_seen_light", lambda *_: None) if even else nullcontext()
    settings = {"image_width": WIDTH, "samples": SAMPLES, "exposure": 1.0, "camera": CAMERA}
    with evenly, Scene(stage, photons=photons, **settings) as scene:
        scene.render_frame(FRAME, aovs=["irradiance"])
        start = time.process_time()
        frame = scene.render_frame(FRAME, aovs=["irradiance"])
        seconds = time.process_time() - start
    return frame.channels["irradiance.G"].astype(np.float64), seconds


def main() -> int:
    wrong = [name for name in sys.argv[1:] if name not in SCENES]
    if wrong:
        sys.exit(f"there is no scene {wrong[0]!r}; there are {', '.join(SCENES)}")
    run(sys.argv[1:] or CLOSE_UPS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
