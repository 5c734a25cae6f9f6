"""A polished ring on a table and a lamp that goes round it: the cup's caustic, turning with the lamp."""

from __future__ import annotations

import math
from pathlib import Path

from pxr import Gf, UsdGeom, UsdLux

from usd_scenes.authoring.scene_writer import SceneWriter
from usd_scenes.authoring.surfaces import tube_of, tube_quads

LAMP_DISTANCE = 2.2
LAMP_HEIGHT = 1.8
LAMP_RADIUS = 0.05
LAMP_RADIANT_INTENSITY = 13.0
START_ANGLE = 40.0


def write_mirror(
    path: Path, radius: float = 1.0, speed: float = 7.5, frames: int = 24, resolution: int = 256
) -> None:
    """Writes a thin ring that mirrors on its inside, a table, and a point light in orbit.

    Args:
        path: The layer to write.
        radius: Of the ring, in scene units; its height is half of that.
        speed: Of the light, degrees a frame.
        frames: Frames, from 1.
        resolution: Sides of the ring.

    Raises:
        ValueError: The ring reaches the light, or a count is too small.
    """
    if not 0 < radius < LAMP_DISTANCE:
        raise ValueError(f"--radius must be above 0 and below {LAMP_DISTANCE}, not {radius}")
    writer = SceneWriter(frames, {"radius": radius, "speed": speed})
    metal = writer.material("Metal", diffuseColor=(0.95, 0.93, 0.88), metallic=1.0, roughness=0.0)
    # Reversed faces: the front is the inside.
    mesh = writer.mesh("/World/Ring", [tube_quads(resolution)[:, ::-1]], metal)
    mesh.CreateDoubleSidedAttr(True)
    points, outward = tube_of(radius, 0.5 * radius, resolution)
    writer.shape(mesh, points, -outward)
    lamp = UsdLux.SphereLight.Define(writer.stage, "/World/Lamp")
    # A bulb seen from afar: a radius of zero would leave its brightness to each renderer's reading.
    lamp.CreateRadiusAttr(LAMP_RADIUS)
    lamp.CreateTreatAsPointAttr(True)
    lamp.CreateIntensityAttr(LAMP_RADIANT_INTENSITY / (math.pi * LAMP_RADIUS**2))
    turn = lamp.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble)
    lamp.AddTranslateOp().Set(Gf.Vec3d(LAMP_DISTANCE, 0.0, LAMP_HEIGHT))
    for time in writer.times:
        turn.Set(START_ANGLE + speed * (time - writer.times[0]), time)
    writer.floor(size=8.0, albedo=0.6)
    writer.measuring_camera((0.0, 0.0, radius), size=2.4 * radius)
    writer.camera(eye=(0.0, -3.4, 3.6), target=(0.0, 0.05, 0.0), field_of_view=42.0)
    writer.save(path)
