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
from tpdwarp.scene.description import (
    CameraAtShutter,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    SceneAtShutter,
    Shutter,
)
from tpdwarp.settings import Settings
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


class WaveInMemory:
    """The wave of the oracle as a scene: smooth motion, exact positions and normals, an orthographic camera."""

    file = "wave"

    def __init__(self, wave: Wave, columns: int = 1025) -> None:
        self.wave = wave
        self.x = np.linspace(-2.0, 2.0, columns)
        first = np.arange(columns - 1)
        corners = [(first, first + 1, first + 1 + columns), (first, first + 1 + columns, first + columns)]
        self.triangles = np.concatenate([np.stack(c, axis=1) for c in corners]).astype(np.int32)

    def _surface(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        k = 2.0 * np.pi / self.wave.wavelength
        phase = k * (self.x - self.wave.speed * time)
        height = self.wave.height + self.wave.amplitude * np.cos(phase)
        slope = -self.wave.amplitude * k * np.sin(phase)
        points = np.concatenate([np.stack([self.x, np.full_like(self.x, y), height], axis=1) for y in (-2.0, 2.0)])
        normals = np.stack([-slope, np.zeros_like(slope), np.ones_like(slope)], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return points, np.concatenate([normals, normals])

    def at(self, shutter: Shutter) -> SceneAtShutter:
        points, normals = self._surface(shutter.middle)
        motions = {}
        if shutter.exposure > 0.0:
            step = 1e-4
            (p0, n0), (p1, n1) = self._surface(shutter.middle - step), self._surface(shutter.middle + step)
            rate = shutter.exposure / (2.0 * step)
            motions = {"motions": (p1 - p0) * rate, "normal_motions": (n1 - n0) * rate}
        water = MeshAtShutter(
            "/Water",
            points,
            self.triangles,
            normals=normals,
            normal_indices=self.triangles,
            materials=(Material(Interaction.DIELECTRIC, ior=self.wave.ior),),
            **motions,
        )
        corners = np.array([[-4.0, -4.0, 0.0], [4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]])
        floor = MeshAtShutter("/Floor", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        sun = LightAtShutter("/Sun", LightKind.DISTANT, (1.0, 1.0, 1.0))
        camera = CameraAtShutter("/Camera", True, np.array([0.0, 0.0, 0.85]), np.eye(3), (-1.0, 1.0, -0.25, 0.25))
        return SceneAtShutter(shutter, (floor, water), (sun,), camera)

    def reference_shutters(self) -> list[Shutter]:
        return [Shutter.still(0.0)]

    def motion_breaks(self, shutter: Shutter) -> list[float]:
        return []


def run() -> list[dict[str, object]]:
    """Relative RMSE of the irradiance for each case, and CPU seconds after kernels are compiled."""
    results = []
    for wavelength in (1.3, 0.65):
        wave = Wave(wavelength=wavelength, speed=wavelength / 8.0)
        truth = irradiance_average(np.linspace(-1.0, 1.0, PIXELS + 1), wave, 0.0, 1.0, times=256)
        source = WaveInMemory(wave)
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
