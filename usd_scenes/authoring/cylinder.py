"""A lying glass cylinder that turns about one end: a line of light, slow at that end and fast at the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, UsdGeom

from usd_scenes.authoring.scene_writer import SceneWriter
from usd_scenes.authoring.surfaces import tube_of, tube_quads

LENGTH = 2.0
HEIGHT = 0.26


def write_cylinder(
    path: Path, radius: float = 0.15, speed: float = 5.0, frames: int = 24, resolution: int = 128
) -> None:
    """Writes a closed glass cylinder above a plane; its axis lies along local x, and turns about the vertical.

    Args:
        path: The layer to write.
        radius: In scene units.
        speed: Degrees a frame.
        frames: Frames, from 1.
        resolution: Sides of the cylinder.

    Raises:
        ValueError: The cylinder touches the plane, or a count is too small.
    """
    if not 0 < radius < HEIGHT:
        raise ValueError(f"--radius must be above 0 and below {HEIGHT}, not {radius}")
    writer = SceneWriter(frames, {"radius": radius, "speed": speed})
    glass = writer.material(
        "Glass", diffuseColor=(0.0, 0.0, 0.0), metallic=0.0, opacity=0.0, ior=1.5, roughness=0.0
    )
    ring = np.arange(resolution)
    sides = tube_quads(resolution)
    caps = np.stack([ring[::-1], ring + resolution])
    mesh = writer.mesh("/World/Cylinder", [sides, caps], glass, normals_per=UsdGeom.Tokens.faceVarying)
    points, outward = tube_of(radius, LENGTH, resolution)
    flat = np.repeat(np.array([[0, 0, -1], [0, 0, 1]], np.float32), resolution, axis=0)
    normals = np.concatenate([outward[sides.reshape(-1)], flat])
    # A cyclic change of axes lays the tube down along x and keeps its orientation.
    writer.shape(mesh, np.roll(points, 1, axis=1), np.roll(normals, 1, axis=1))
    mesh.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, HEIGHT))
    turn = mesh.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble)
    for time in writer.times:
        turn.Set(speed * (time - writer.times[0] - frames / 2), time)
    writer.floor(size=8.0, albedo=0.7)
    writer.sun(irradiance=1.0)
    writer.measuring_camera((1.0, 0.0, 0.5 * (HEIGHT - radius)), size=2.4)
    writer.camera(eye=(3.6, -1.0, 2.3), target=(0.85, 0.0, 0.0), field_of_view=44.0, exposure=0.5)
    writer.save(path)
