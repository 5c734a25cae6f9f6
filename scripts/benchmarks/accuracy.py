"""Error of the estimators on the travelling wave against its exact caustic, and what each costs."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tpdwarp.presets import PRESETS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from usd_scenes.in_memory import Source, looking_down, wave_source
from usd_scenes.oracle import Wave, irradiance_average

PIXELS = 256
ROWS = 64
CASES: dict[str, dict[str, Any]] = {
    "1 024 photons": {"photons": 1024},
    "4 096 photons": {"photons": 4096},
    "16 384 photons": {"photons": 16384},
    "65 536 photons, auto segments": {"photons": 65536, "segments": "auto"},
    "262 144 photons, auto segments": {"photons": 262144, "segments": "auto"},
    "--preset draft": PRESETS["draft"],
    "--preset standard": PRESETS["standard"],
    "--preset final": PRESETS["final"],
    "--estimator pd, 16 384 photons": {"estimator": "pd", "photons": 16384},
    "--estimator accumulation, 64 × 16 384": {"estimator": "accumulation", "photons": 16384},
}


def wave_over_floor(wave: Wave) -> Source:
    """The wave seen from just below the water by pixels as high as wide, so that no ray meets it."""
    return wave_source(wave, camera=looking_down((-1.0, 1.0, -0.25, 0.25), height=0.85 * wave.height))


def run() -> list[dict[str, object]]:
    """Relative RMSE of the irradiance for each case, and CPU seconds after kernels are compiled."""
    results = []
    for wavelength in (1.3, 0.65):
        wave = Wave(wavelength=wavelength, speed=wavelength / 8.0)
        truth = irradiance_average(np.linspace(-1.0, 1.0, PIXELS + 1), wave, 0.0, 1.0, times=256)
        source = wave_over_floor(wave)
        print(f"wavelength {wavelength}, exposure 1 frame, irradiance over [-1, 1] at {PIXELS} columns")
        print(f"  {'what':38s} {'rel. RMSE':>10s} {'CPU s':>7s}")
        for name, changes in CASES.items():
            settings = Settings(aovs=("irradiance",), **changes)
            render_frame(RenderContext(source, settings), Shutter(0.0, 0.0, 1.0), PIXELS, ROWS)
            start = time.process_time()
            frame = render_frame(RenderContext(source, settings), Shutter(0.0, 0.0, 1.0), PIXELS, ROWS)
            seconds = time.process_time() - start
            error = frame.channels["irradiance.R"].astype(float) - truth
            relative = float(np.sqrt(np.mean(error**2)) / truth.mean())
            print(f"  {name:38s} {relative:10.4f} {seconds:7.2f}", flush=True)
            results.append(
                {"wavelength": wavelength, "case": name, "relative_rmse": relative, "cpu_seconds": seconds}
            )
    return results
