#!/usr/bin/env python3
"""Light of lamps close to water or standing in it, inside glass, and of wide suns, against brute force.

.venv/bin/python scripts/benchmarks/near_lights.py
.venv/bin/python scripts/benchmarks/near_lights.py sphere-cuts tube-near --photons 23
.venv/bin/python scripts/benchmarks/near_lights.py disk-near --splits auto 1 4 16     # numbers of parts, by hand too

Errors are of the mean, and root mean squares over all pixels by that of the truth, which is made anew each time and
errs by what stands beside it.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tpdwarp.photons.energy import COARSE_PARTS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    Shutter,
)
from tpdwarp.settings import Settings
from usd_scenes import brute_force, shapes
from usd_scenes.brute_force.description import DIELECTRIC, DIFFUSE
from usd_scenes.in_memory import SUN, WATER, bumpy, floor, looking_down, steady, turned

PIXELS, PHOTONS = 32, 1 << 16
CAMERA = looking_down(height=0.3)
GLASS = Material(Interaction.DIELECTRIC, ior=1.5)
LAMP = LightAtShutter("/lamp", LightKind.POINT, (4.0, 4.0, 4.0))
# Looks along −x, with y to the side.
UPRIGHT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

Meshes = list[MeshAtShutter]


def water() -> Meshes:
    return [floor(), bumpy("/water", WATER, 1.0, False)]


def ball(at: tuple[float, float, float], radius: float, inside_out: bool = False) -> MeshAtShutter:
    points, triangles, normals = shapes.sphere()
    if inside_out:
        triangles, normals = triangles[:, ::-1], -normals
    triangles = np.ascontiguousarray(triangles, np.int32)
    points = radius * points + np.array(at)
    path = "/inner" if inside_out else "/ball"
    return MeshAtShutter(path, points, triangles, normals=normals, normal_indices=triangles, materials=(GLASS,))


def lantern() -> Meshes:
    return [floor(), ball((0, 0, 1.0), 0.5), ball((0, 0, 1.0), 0.45, inside_out=True)]


def sphere(at: tuple[float, float, float], radius: float) -> LightAtShutter:
    return replace(LAMP, position=np.array(at), extent=Extent(ExtentShape.ROUND, radius))


def tube(at: tuple[float, float, float], half: float, radius: float) -> LightAtShutter:
    extent = Extent(ExtentShape.CYLINDER, radius, np.array([[half, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    return replace(LAMP, position=np.array(at), profile=EmissionProfile.SINE, extent=extent)


def flat(at: tuple[float, float, float], half: float, shape: ExtentShape, axes: np.ndarray) -> LightAtShutter:
    extent = Extent(shape, 0.0, half * axes[:2])
    return replace(LAMP, position=np.array(at), axes=axes, profile=EmissionProfile.COSINE, extent=extent)


def sun(degrees: float, tilt: float = 0.0) -> LightAtShutter:
    axes = turned((0.0, math.radians(tilt), 0.0)).T if tilt else np.eye(3)
    return replace(SUN, axes=axes, extent=Extent(ExtentShape.ROUND, math.radians(0.5 * degrees)))


CASES: dict[str, Callable[[], tuple[Meshes, LightAtShutter]]] = {
    "sphere-cuts": lambda: (water(), sphere((0.3, 0.2, 1.0), 0.3)),
    "sphere-crest": lambda: (water(), sphere((0.3, 0.2, 1.35), 0.25)),
    "sphere-1-above": lambda: (water(), sphere((0.3, 0.2, 2.0), 0.3)),
    "tube-cuts": lambda: (water(), tube((0.3, 0.2, 1.0), 0.5, 0.15)),
    "tube-near": lambda: (water(), tube((0.3, 0.2, 1.4), 0.5, 0.1)),
    "tube-1-above": lambda: (water(), tube((0.3, 0.2, 2.0), 0.5, 0.1)),
    "disk-near": lambda: (water(), flat((0.3, 0.2, 1.3), 0.3, ExtentShape.DISK, np.eye(3))),
    "rect-cuts": lambda: (water(), flat((0.8, 0.2, 1.0), 0.3, ExtentShape.RECT, UPRIGHT)),
    "rect-upright": lambda: (water(), flat((0.8, 0.2, 1.5), 0.3, ExtentShape.RECT, UPRIGHT)),
    "sun-90": lambda: (water(), sun(90.0)),
    "sun-180": lambda: (water(), sun(180.0)),
    "sun-30-low": lambda: (water(), sun(30.0, 80.0)),
    "sun-90-ball": lambda: ([floor(), ball((0, 0, 0.9), 0.5)], sun(90.0)),
    "sphere-in-lantern": lambda: (lantern(), sphere((0.05, 0.03, 1.0), 0.1)),
    "sphere-in-ball": lambda: ([floor(), ball((0, 0, 0.9), 0.5)], sphere((0.05, 0.03, 0.95), 0.1)),
}


def truth_of(meshes: Meshes, light: LightAtShutter, photons: int) -> tuple[np.ndarray, float]:
    """Irradiance by brute force, and its error by the root mean square of it."""
    bodies = [
        brute_force.Mesh(
            mesh.path,
            (mesh.points,) * 2,
            mesh.triangles,
            DIELECTRIC if mesh.materials[0].interaction == Interaction.DIELECTRIC else DIFFUSE,
            mesh.materials[0].ior,
            normals=None if mesh.normals is None else (mesh.normals,) * 2,
        )
        for mesh in meshes
    ]
    extent, given = light.extent, {}
    if light.kind == LightKind.DISTANT:
        given = {"direction": -light.axes[2], "angle": 2.0 * extent.radius}
    else:
        given = {"position": (light.position,) * 2, "radius": extent.radius}
        if extent.shape != ExtentShape.ROUND:
            given |= {"spans": extent.spans, "rounded": extent.shape == ExtentShape.DISK}
    camera = brute_force.Camera((CAMERA.position,) * 2, np.eye(3), 2.0, PIXELS, PIXELS)
    lamp = brute_force.Light(light.path, light.power[0], **given)
    found = brute_force.irradiance(
        brute_force.Scene("near", tuple(bodies), (lamp,), camera), photons, parts=2, threads=1
    )
    rms = math.sqrt(np.mean(found.irradiance**2))
    return found.irradiance, found.error * float(found.irradiance[found.mask].mean()) / rms


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures lamps close to what is specular.")
    parser.add_argument("case", nargs="*", help=f"which of {', '.join(CASES)}; all by default")
    parser.add_argument("--photons", type=int, default=22, help="of the truth, as a power of two")
    parser.add_argument("--splits", nargs="*", default=["auto", "1"], help="parts of each light; auto and 1 by default")
    options = parser.parse_args()
    print(f"  {'case':18s} truth errs   asked  parts    mean  error  told of")
    for name in options.case or CASES:
        meshes, light = CASES[name]()
        truth, own = truth_of(meshes, light, 1 << options.photons)
        source = steady(meshes, (light,), CAMERA)
        for splits in (int(asked) if asked.isdigit() else asked for asked in options.splits):
            settings = Settings(photons=PHOTONS, samples=4, threads=1, aovs=("irradiance",), light_splits=splits)
            frame = render_frame(RenderContext(source, settings), Shutter(0, 0, 0), PIXELS, PIXELS)
            found = frame.channels["irradiance.R"].astype(np.float64)
            parts = frame.energy.counts.get("parts of each light with extent", 1)
            error = math.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2))
            told = frame.energy.counts.get(COARSE_PARTS, 0) / 1000.0
            row = f"{own:10.3f} {splits!s:>7s} {parts:6d} {found.mean() / truth.mean() - 1.0:+7.3f} {error:6.3f}"
            print(f"  {name:18s} {row} {told:8.3f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
