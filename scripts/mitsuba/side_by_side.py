#!/usr/bin/env python3
"""The caustic of a tumbler under an area lamp, beside Mitsuba 3: time to the same error, and docs/tumbler_lamp.png.

    .venv/bin/python scripts/mitsuba/side_by_side.py PYTHON docs/tumbler_lamp.png

PYTHON is one that has Mitsuba (an environment of its own: pip install mitsuba). Both render the same triangles, with
the same normals, seen from where the floor is seen directly. The floor is all but black, so that light that it throws
back onto the glass is no part of the comparison. Mitsuba's noise follows from two pictures of different seeds; its mean
is the truth for tpdwarp, whose error is what is left of the difference beside that noise.
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

import tpdwarp
from tpdwarp.io.images import encode_srgb
from tpdwarp.scene.description import MeshAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

TUMBLER = Path(__file__).resolve().parents[2] / "usd_scenes" / "tumbler.usdc"
ALBEDO, PIXELS, RADIANCE, LAMP = 0.01, 96, 40.0, 0.6
EYE, TARGET, UP, SIZE = (0.85, 0.0, 3.0), (0.85, 0.0, 0.0), (0.0, 1.0, 0.0), 0.9
PHOTONS = (1 << 14, 1 << 16, 1 << 18)
# Pictures are shown so much enlarged, and a gap between them.
ENLARGED, GAP = 2, 4


def main() -> None:
    """Renders both, prints the ratio, and writes the picture."""
    parser = argparse.ArgumentParser(description="Compares soft caustics with Mitsuba 3.")
    parser.add_argument("python", type=Path, help="a Python that has Mitsuba")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--splits", default="auto", help="parts that the lamp is cut into")
    options = parser.parse_args()
    stage = stage_of()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(stage, folder)
        script = Path(__file__).resolve().parent / "render.py"
        subprocess.run([options.python, script, folder], check=True)
        theirs = dict(np.load(folder / "pictures.npz"))
    means = {name: theirs[name].mean(axis=0) for name in ("ptracer", "path")}
    noise = {name: math.sqrt(0.5 * np.mean((theirs[name][0] - theirs[name][1]) ** 2)) for name in means}
    truth, mean = means["ptracer"], means["ptracer"].mean()
    print(f"  Mitsuba's two integrators: means differ by {means['path'].mean() / mean - 1:+.4f}")
    for name, deviation in noise.items():
        print(f"  {name:10s} relative RMSE {deviation / mean:.4f} in {float(theirs[f'{name}_seconds']):.1f} CPU s")
    best = None
    scene = tpdwarp.Scene(stage, camera="/World/Above", threads=1, image_width=PIXELS, samples=4, exposure=0.0)
    splits = options.splits if options.splits == "auto" else int(options.splits)
    for photons in PHOTONS:
        scene.render_frame(5.0, photons=photons, light_splits=splits)
        start = time.process_time()
        frame = scene.render_frame(5.0, photons=photons, light_splits=splits)
        seconds = time.process_time() - start
        ours = frame.channels["R"].astype(np.float64)
        # The mean of two pictures has half the variance of one.
        squared = np.mean((ours - truth) ** 2) - 0.5 * noise["ptracer"] ** 2
        error = math.sqrt(max(squared, 0.0)) / mean
        needed = {
            name: float(theirs[f"{name}_seconds"]) * (deviation / mean / max(error, 1e-9)) ** 2
            for name, deviation in noise.items()
        }
        parts = frame.energy.counts.get("parts of each light with extent", 1)
        said = ", ".join(f"{name} {value:.1f} s ({value / seconds:.1f} times)" for name, value in needed.items())
        print(
            f"  {photons:7d} photons, {parts:3d} parts: relative RMSE {error:.4f}, mean {ours.mean() / mean:.4f}, "
            f"{seconds:.2f} CPU s; for that error {said}",
            flush=True,
        )
        best = ours
    _write_picture(options.picture, [best, truth, theirs["ptracer"][0], means["path"]])


def stage_of() -> Usd.Stage:
    """The tumbler by itself on a floor that is all but black, under a square lamp in the place of its sun."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(TUMBLER)))
    stage = Usd.Stage.Open(layer)
    place = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Sun")).ComputeLocalToWorldTransform(5.0)
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
    scene = StageScene.open(stage, settings).at(Shutter.still(5))
    meshes = {}
    for mesh in scene.meshes:
        name = mesh.path.rpartition("/")[2]
        _write_ply(folder / f"{name}.ply", mesh)
        meshes[name] = mesh.materials[0].ior if mesh.specular else 0.0
    lamp = UsdLux.RectLight(stage.GetPrimAtPath("/World/Lamp"))
    rows = np.array(lamp.ComputeLocalToWorldTransform(5.0))
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


def _write_ply(path: Path, mesh: MeshAtShutter) -> None:
    """One vertex a corner of each triangle, with its normal where there are any."""
    names, corners = ["x", "y", "z"], [mesh.points[mesh.triangles].reshape(-1, 3)]
    if mesh.normals is not None:
        names, corners = [*names, "nx", "ny", "nz"], [*corners, mesh.normals[mesh.normal_indices].reshape(-1, 3)]
    values = np.concatenate(corners, axis=1).astype("<f4")
    count = len(mesh.triangles)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {3 * count}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {count}", "property list uchar int vertex_indices", "end_header"]
    faces = np.zeros(count, [("sides", "u1"), ("corners", "<i4", 3)])
    faces["sides"], faces["corners"] = 3, np.arange(3 * count).reshape(-1, 3)
    path.write_bytes(("\n".join(header) + "\n").encode() + values.tobytes() + faces.tobytes())


def _write_picture(path: Path, pictures: list[np.ndarray]) -> None:
    gain = 1.0 / np.quantile(pictures[1], 0.995)
    gap = np.ones((ENLARGED * PIXELS, GAP))
    parts = []
    for picture in pictures:
        parts += [np.kron(np.clip(gain * picture, 0, 1), np.ones((ENLARGED,) * 2)), gap]
    pixels = encode_srgb(np.concatenate(parts[:-1], axis=1).astype(np.float32))
    output = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 1, "uint8")
    output.open(str(path), spec)
    output.write_image((np.clip(pixels, 0, 1) * 255 + 0.5).astype(np.uint8)[:, :, None])
    output.close()


if __name__ == "__main__":
    main()
