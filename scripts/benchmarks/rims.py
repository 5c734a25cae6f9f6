#!/usr/bin/env python3
"""How well pixels at the rim of glass that moves are seen: a ball that glides before its own caustic.

Errors are relative RMSE of light from photons beside 64 instants with 64 samples each, of the same photons. The
brightest pixels see the caustic, finer than they are, beside the ball's rim, directly and mirrored in it.

.venv/bin/python scripts/benchmarks/rims.py            # 4, 16 and 64 samples
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tpdwarp import Scene
from usd_scenes.authoring.scene_writer import SceneWriter

WIDTH, PHOTONS, INSTANTS = 96, 1 << 14, 64
WAY, RADIUS, HEIGHT = 0.2, 0.4, 0.7


def run() -> list[dict[str, float]]:
    """Errors with several samples; prints a row each.

    Returns:
        A row each: ``samples``, ``relative_rmse`` (by the mean), ``mean`` (of the truth's) and ``cpu_seconds`` of a
        further render.
    """
    rows: list[dict[str, float]] = []
    stage = ball_before_its_caustic()
    truth, _ = _picture(stage, samples=64, estimator="accumulation", accumulation_times=INSTANTS)
    print(f"  {'samples':>7s} {'rel.RMSE':>9s} {'mean':>6s} {'CPU s':>6s}")
    for samples in (4, 16, 64):
        found, seconds = _picture(stage, samples=samples)
        error = float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean())
        rows.append({"samples": samples, "relative_rmse": error, "mean": float(found.mean() / truth.mean())})
        rows[-1]["cpu_seconds"] = seconds
        print(f"  {samples:7d} {error:9.4f} {rows[-1]['mean']:6.3f} {seconds:6.2f}", flush=True)
    return rows


def ball_before_its_caustic() -> Usd.Stage:
    """A glass ball glides above a floor in the sun, seen from beside."""
    writer = SceneWriter(1, {})
    stage = writer.stage
    floor = UsdGeom.Cube.Define(stage, "/World/Floor")
    floor.CreateSizeAttr(1.0)
    floor.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, -0.05))
    floor.AddScaleOp().Set(Gf.Vec3f(8.0, 8.0, 0.1))
    grey = writer.material("Grey", diffuseColor=(0.7, 0.7, 0.7))
    UsdShade.MaterialBindingAPI.Apply(floor.GetPrim()).Bind(grey)
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(RADIUS)
    place = ball.AddTranslateOp()
    for frame, side in ((1, -0.5), (2, 0.5)):
        place.Set(Gf.Vec3d(side * WAY, 0.0, HEIGHT), frame)
    glass = writer.material("Glass", opacity=0.0, ior=1.5, roughness=0.0)
    UsdShade.MaterialBindingAPI.Apply(ball.GetPrim()).Bind(glass)
    sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
    sun.CreateAngleAttr(0.0)
    sun.AddRotateXOp().Set(20.0)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(0.3, -2.6, 1.8), Gf.Vec3d(0.0, 0.1, 0.3), Gf.Vec3d.ZAxis())
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateFocalLengthAttr(28.0)
    return stage


def _picture(stage: Usd.Stage, **settings: object) -> tuple[np.ndarray, float]:
    """Light from photons (green), shape [height, width], and the CPU seconds of the second render of the frame."""
    given = {"image_width": WIDTH, "photons": PHOTONS, "exposure": 1.0, "camera": "/World/Camera"}
    with Scene(stage, **given, **settings) as scene:
        scene.render_frame(1, aovs=["caustic"])
        start = time.process_time()
        frame = scene.render_frame(1, aovs=["caustic"])
    return frame.channels["caustic.G"].astype(np.float64), time.process_time() - start


if __name__ == "__main__":
    run()
