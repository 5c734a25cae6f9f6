"""A tumbler of water in the low sun, with two pieces of ice that turn and bob in it: solids within solids."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from pxr import Gf, UsdGeom, UsdShade

from usd_scenes.authoring.scene_writer import SceneWriter
from usd_scenes.authoring.surfaces import tube_of, tube_quads

# Radius and height of the rings of each body, up the outside; the water reaches into the wall.
GLASS = ((0.32, 0.02), (0.38, 0.95), (0.35, 0.95), (0.31, 0.10))
WATER = ((0.32, 0.09), (0.348, 0.70))
# Ice: half its side, how far from the axis it floats, and how far up and down it bobs.
HALF_SIDE, DISTANCE, BOB = 0.085, 0.16, 0.015
ICE_TILT = (14.0, -9.0)
# Frames that the ice takes to go up and down once.
PERIOD = 12.0
SUN_TILT = 40.0


def write_tumbler(path: Path, speed: float = 6.0, frames: int = 24, resolution: int = 96) -> None:
    """Writes a closed glass with a wall and a base, water that fills it, and two cubes of ice that float there.

    Args:
        path: The layer to write.
        speed: Of the ice, degrees a frame.
        frames: Frames, from 1.
        resolution: Sides of glass and water.

    Raises:
        ValueError: A count is too small.
    """
    writer = SceneWriter(frames, {"speed": speed})
    for name, rings, ior in (("Glass", GLASS, 1.5), ("Water", WATER, 1.33)):
        write_lathed(writer, name, rings, clear(writer, name, ior), resolution)
    for number, tilt in enumerate(ICE_TILT):
        write_ice(writer, number, tilt, speed)
    writer.floor(size=8.0, albedo=0.7)
    writer.sun(irradiance=1.0, tilt=SUN_TILT)
    writer.measuring_camera((0.6, 0.0, 0.015), size=1.6)
    writer.camera(eye=(1.1, -2.6, 1.5), target=(0.3, 0.0, 0.25), field_of_view=34.0)
    writer.save(path)


def clear(writer: SceneWriter, name: str, ior: float) -> UsdShade.Material:
    """Clear glass, water or ice."""
    return writer.material(name, diffuseColor=(0.0, 0.0, 0.0), metallic=0.0, opacity=0.0, ior=ior, roughness=0.0)


def write_lathed(
    writer: SceneWriter,
    name: str,
    rings: tuple[tuple[float, float], ...],
    material: UsdShade.Material,
    resolution: int,
) -> None:
    """A body of revolution about z: ``rings`` joined by straight walls, the first and the last one closed by discs."""
    outward = tube_of(1.0, 1.0, resolution)[1][:resolution]
    points = np.concatenate([np.float32(radius) * outward + [0, 0, np.float32(z)] for radius, z in rings])
    ring, quads = np.arange(resolution), tube_quads(resolution)
    walls = [quads + resolution * number for number in range(len(rings) - 1)]
    discs = np.stack([ring[::-1], ring + resolution * (len(rings) - 1)])
    normals = []
    for (r0, z0), (r1, z1) in itertools.pairwise(rings):
        across, up = np.array([z1 - z0, r0 - r1]) / np.hypot(r1 - r0, z1 - z0)
        normals.append(across * outward[quads.reshape(-1) % resolution] + [0, 0, up])
    normals.append(np.repeat([[0, 0, -1], [0, 0, 1]], resolution, axis=0))
    mesh = writer.mesh(f"/World/{name}", [*walls, discs], material, normals_per=UsdGeom.Tokens.faceVarying)
    writer.shape(mesh, points.astype(np.float32), np.concatenate(normals).astype(np.float32))


def write_ice(writer: SceneWriter, number: int, tilt: float, speed: float) -> None:
    """A cube of ice, on one side of the glass or the other, tilted, turning and bobbing; at rest without a speed."""
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float32)
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    normals = np.repeat(corners[faces].mean(axis=1), 4, axis=0)
    name = f"Ice{'AB'[number]}"
    mesh = writer.mesh(f"/World/{name}", [faces], clear(writer, name, 1.31), UsdGeom.Tokens.faceVarying)
    writer.shape(mesh, np.float32(HALF_SIDE) * corners, normals.astype(np.float32))
    side = 1.0 - 2.0 * number
    place, turn = mesh.AddTranslateOp(), mesh.AddRotateZOp(UsdGeom.XformOp.PrecisionDouble)
    mesh.AddRotateXOp().Set(tilt)
    if not speed:
        place.Set(Gf.Vec3d(side * DISTANCE, 0.0, float(WATER[-1][1] - 0.6 * HALF_SIDE)))
        turn.Set(0.0)
        return
    for time in writer.times:
        gone = time - writer.times[0]
        height = WATER[-1][1] - 0.6 * HALF_SIDE + side * BOB * np.sin(2.0 * np.pi * gone / PERIOD)
        place.Set(Gf.Vec3d(side * DISTANCE, 0.0, float(height)), time)
        turn.Set(side * speed * gone, time)
