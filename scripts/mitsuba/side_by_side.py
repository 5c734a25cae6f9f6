#!/usr/bin/env python3
"""The caustic of a tumbler under an area lamp, beside other renderers: time to the same error, and a picture.

    .venv/bin/python scripts/mitsuba/side_by_side.py docs/tumbler_lamp.jpg --mitsuba PYTHON --cycles PYTHON

PYTHON is one that has Mitsuba 3 (an environment of its own: pip install mitsuba), or Blender's Cycles (pip install
bpy). All render the same triangles, with the same normals, seen from where the floor is seen directly. The floor is all
but black, so that light that it throws back onto the glass is no part of the comparison. The truth is that of no
renderer: the light through the glass by brute force (``usd_scenes.brute_force``), all else by many camera samples. The
error of a path tracer falls with the root of its time, which says what it would take to err as little.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from ply import write_ply

import tpdwarp
from tpdwarp.io.images import encode_srgb
from tpdwarp.scene.description import MeshAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from usd_scenes import brute_force
from usd_scenes.brute_force.description import DIELECTRIC, DIFFUSE

TUMBLER = Path(__file__).resolve().parents[2] / "usd_scenes" / "tumbler.usdc"
ALBEDO, PIXELS, RADIANCE, LAMP = 0.01, 160, 40.0, 0.6
EYE, TARGET, UP, SIZE = (0.85, 0.0, 3.0), (0.85, 0.0, 0.0), (0.0, 1.0, 0.0), 0.9
PHOTONS = (1 << 14, 1 << 16, 1 << 18)
FRAME, SHOWN = 5.0, 1 << 16
# Plain photons of the truth, and camera samples of its direct light.
TRUTH_PHOTONS, TRUTH_SAMPLES = 1 << 23, 64
SCRIPTS = {"mitsuba": "render.py", "cycles": "../blender/render_lamp.py"}
# Pictures are shown so much enlarged, and a gap between them.
ENLARGED, GAP = 2, 4


def main() -> None:
    """Renders with all, prints the ratios, and writes the picture."""
    parser = argparse.ArgumentParser(description="Compares soft caustics with other renderers.")
    parser.add_argument("picture", type=Path)
    for name in SCRIPTS:
        parser.add_argument(f"--{name}", type=Path, help="a Python that has it")
    parser.add_argument("--samples", type=float, default=1.0, help="theirs, as a multiple of those of their scripts")
    options = parser.parse_args()
    stage = stage_of()
    scene = tpdwarp.Scene(stage, camera="/World/Above", threads=1, image_width=PIXELS, samples=4, exposure=0.0)
    truth, own = truth_of(stage, scene)

    def error(found: np.ndarray) -> float:
        # The truth's own error is that of independent photons, so that squares add up.
        return math.sqrt(max(np.mean((found - truth) ** 2) / truth.mean() ** 2 - own**2, 0.0))

    shown, others = [truth], {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(stage, folder)
        for renderer, script in SCRIPTS.items():
            if (python := getattr(options, renderer)) is None:
                continue
            command = [python, Path(__file__).resolve().parent / script, folder, str(options.samples)]
            subprocess.run(command, check=True)
            with np.load(folder / f"{renderer}.npz") as found:
                theirs = dict(found)
            for kind in (key for key in theirs if not key.endswith("_seconds")):
                seconds = float(theirs[f"{kind}_seconds"])
                others[kind] = (error(theirs[kind]), seconds)
                shown.append(theirs[kind])
                print(
                    f"  {kind:20s} relative RMSE {others[kind][0]:.4f}, mean {theirs[kind].mean() / truth.mean():.4f}, "
                    f"{seconds:.1f} CPU s",
                    flush=True,
                )
    for photons in PHOTONS:
        scene.render_frame(FRAME, photons=photons)
        start = time.process_time()
        frame = scene.render_frame(FRAME, photons=photons)
        seconds = time.process_time() - start
        ours = frame.channels["R"].astype(np.float64)
        parts = frame.energy.counts.get("parts of each light with extent", 1)
        times = (f"{name} {spent * (own / error(ours)) ** 2 / seconds:.1f}" for name, (own, spent) in others.items())
        print(
            f"  {photons:7d} photons, {parts:3d} parts: relative RMSE {error(ours):.4f}, "
            f"mean {ours.mean() / truth.mean():.4f}, {seconds:.2f} CPU s; for that error times as long: "
            f"{', '.join(times)}",
            flush=True,
        )
        if photons == SHOWN:
            shown.insert(0, ours)
    _write_picture(options.picture, shown)


def truth_of(stage: Usd.Stage, scene: tpdwarp.Scene) -> tuple[np.ndarray, float]:
    """Radiance of the floor, shape [height, width], and its own relative RMSE."""
    source = StageScene.open(stage, Settings(camera="/World/Above", exposure=0.0)).at(Shutter.still(FRAME))
    (lamp,) = source.lights
    light = brute_force.Light(
        lamp.path, lamp.power[0], position=(lamp.position,) * 2, spans=np.asarray(lamp.extent.spans)
    )
    # A square of the floor is the same pixel to a camera close above it.
    eye = np.array([EYE[0], EYE[1], 0.01])
    above = brute_force.Camera((eye, eye), np.eye(3), SIZE, PIXELS, PIXELS)
    meshes = []
    for mesh in source.meshes:
        points, normals, triangles = _corners(mesh)
        kind = DIELECTRIC if mesh.specular else DIFFUSE
        normals = (normals,) * 2 if mesh.specular else None
        meshes.append(
            brute_force.Mesh(mesh.path, (points,) * 2, triangles, kind, mesh.materials[0].ior, normals=normals)
        )
    lit = brute_force.Scene("tumbler", tuple(meshes), (light,), above)
    caustic = brute_force.irradiance(lit, TRUTH_PHOTONS, threads=1)
    direct = scene.render_frame(FRAME, photons=1024, samples=TRUTH_SAMPLES, aovs=("direct",)).channels["direct.R"]
    truth = caustic.irradiance * ALBEDO / math.pi + direct
    own = caustic.error * caustic.irradiance.mean() * ALBEDO / math.pi / truth.mean()
    print(f"  the truth errs by {own:.4f}", flush=True)
    return truth, own


def _corners(mesh: MeshAtShutter) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A mesh with vertices of its own for each triangle: points, normals and triangles."""
    points = mesh.points[mesh.triangles].reshape(-1, 3).astype(np.float64)
    normals = mesh.normals[mesh.normal_indices].reshape(-1, 3).astype(np.float64)
    return points, normals, np.arange(len(points), dtype=np.int32).reshape(-1, 3)


def stage_of() -> Usd.Stage:
    """The tumbler by itself on a floor that is all but black, under a square lamp in the place of its sun."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(TUMBLER)))
    stage = Usd.Stage.Open(layer)
    place = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Sun")).ComputeLocalToWorldTransform(FRAME)
    for name in ("Water", "IceA", "IceB", "Sun"):
        stage.RemovePrim(f"/World/{name}")
    shader = UsdShade.Shader(stage.GetPrimAtPath("/World/Materials/Floor/Surface"))
    shader.GetInput("diffuseColor").Set(Gf.Vec3f(ALBEDO))
    lamp = UsdLux.RectLight.Define(stage, "/World/Lamp")
    lamp.CreateWidthAttr(LAMP)
    lamp.CreateHeightAttr(LAMP)
    lamp.CreateIntensityAttr(RADIANCE)
    place.SetTranslateOnly(Gf.Vec3d(0.0, 0.0, 0.5) + 3.0 * place.TransformDir(Gf.Vec3d(0, 0, 1)))
    lamp.AddTransformOp().Set(place)
    camera = UsdGeom.Camera.Define(stage, "/World/Above")
    camera.CreateHorizontalApertureAttr(SIZE / EYE[2])
    camera.CreateVerticalApertureAttr(SIZE / EYE[2])
    camera.CreateFocalLengthAttr(1.0)
    # It looks along −z of its frame, as it stands.
    camera.AddTranslateOp().Set(Gf.Vec3d(*EYE))
    return stage


def write(stage: Usd.Stage, folder: Path) -> None:
    """Writes meshes as PLY files, and the rest as scene.json."""
    settings = Settings(camera="/World/Above", exposure=0.0)
    scene = StageScene.open(stage, settings).at(Shutter.still(FRAME))
    meshes = {}
    for mesh in scene.meshes:
        name = mesh.path.rpartition("/")[2]
        points, normals, triangles = _corners(mesh)
        write_ply(folder / f"{name}.ply", points, triangles, normals)
        meshes[name] = mesh.materials[0].ior if mesh.specular else 0.0
    lamp = UsdLux.RectLight(stage.GetPrimAtPath("/World/Lamp"))
    rows = np.array(lamp.ComputeLocalToWorldTransform(FRAME))
    described = {
        "albedo": ALBEDO,
        "meshes": meshes,
        "lamp": {"width": LAMP, "height": LAMP, "radiance": RADIANCE, "to_world": rows.T.tolist()},
        "camera": {
            "eye": EYE,
            "target": TARGET,
            "up": UP,
            "pixels": PIXELS,
            "degrees": math.degrees(2.0 * math.atan(0.5 * SIZE / EYE[2])),
        },
    }
    (folder / "scene.json").write_text(json.dumps(described))


def _write_picture(path: Path, pictures: list[np.ndarray]) -> None:
    gain = 1.0 / np.quantile(pictures[1], 0.995)
    gap = np.ones((ENLARGED * PIXELS, GAP))
    parts = []
    for picture in pictures:
        parts += [np.kron(np.clip(gain * picture, 0, 1), np.ones((ENLARGED,) * 2)), gap]
    grey = np.concatenate(parts[:-1], axis=1).astype(np.float32)
    pixels = encode_srgb(np.repeat(grey[:, :, None], 3, axis=2))[:, :, :1]
    output = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 1, "uint8")
    spec.attribute("compression", "jpeg:90")
    output.open(str(path), spec)
    output.write_image((np.clip(pixels, 0, 1) * 255 + 0.5).astype(np.uint8))
    output.close()


if __name__ == "__main__":
    main()
