"""Time and memory of stages that are large in one way: animated triangles, instances, meshes, lights.

Each is the shipped wave with something more on its floor, in two sizes, the smaller a quarter of the larger; what the
wave takes alone is taken off. Growth is the exponent p of n^p between the two: 1 grows as its input does.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt

WAVE = Path(__file__).resolve().parents[2] / "usd_scenes" / "wave.usdc"
SMALLER = 4
# Side of a square patch of 2 n² triangles that counts 500: 16 × 16 × 2 = 512.
PATCH = 16
_FRAME = """
import json, sys, time, tpdwarp
from tpdwarp.studies.memory import peak_bytes
start = time.process_time()
sizes = {"camera": "TopOrtho", "image_width": 160, "photons": 16384, "samples": 1, "threads": 1}
assert tpdwarp.render(sys.argv[1], sys.argv[2], frames=1, **sizes).ok
print(json.dumps([time.process_time() - start, peak_bytes()]))
"""


def run(only: Sequence[str] = ()) -> dict[str, dict[str, float]]:
    """CPU seconds and peak in MB of a frame, 160 pixels wide, by row, with the growth of both."""
    if unknown := [name for name in only if name not in ROWS]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(ROWS)}")
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder) / "stage.usdc"
        # Twice: the first compiles.
        alone = [_measured(_stage(stage, None, 0), folder) for _ in range(2)][-1]
        print(f"  {'the wave alone':30s} {alone[0]:7.2f} CPU s {alone[1] / 1e6:7.0f} MB", flush=True)
        for name, (add, count) in ROWS.items():
            if only and name not in only:
                continue
            # Once before, for kernels that this stage has and the wave has not.
            _measured(_stage(stage, add, max(1, count // 100)), folder)
            few, many = (_measured(_stage(stage, add, size), folder) for size in (count // SMALLER, count))
            growth = [
                math.log(max(large - base, 1e-9) / max(small - base, 1e-9)) / math.log(SMALLER)
                for base, small, large in zip(alone, few, many, strict=True)
            ]
            results[name] = {"seconds": many[0], "bytes": many[1], "growth": growth[0], "growth of memory": growth[1]}
            measured = f"{many[0]:7.2f} CPU s {many[1] / 1e6:7.0f} MB"
            print(f"  {name:30s} {measured}   growth {growth[0]:.2f} and {growth[1]:.2f}", flush=True)
    return results


def triangles(stage: Usd.Stage, count: int) -> None:
    """A carpet of so many triangles that waves below the water."""
    side = max(1, math.isqrt(count // 2))
    mesh = _grid(stage, "/World/Carpet", side, 2.0)
    points = np.array(mesh.GetPointsAttr().Get())
    for time in (1, 2):
        mesh.GetPointsAttr().Set(
            Vt.Vec3fArray.FromNumpy(points + np.float32([0, 0, 0.01]) * np.sin(9 * points[:, :1] + time)), time
        )


def instances(stage: Usd.Stage, count: int) -> None:
    """So many instances of a mesh of 512 triangles."""
    many = UsdGeom.PointInstancer.Define(stage, "/World/Crowd")
    patch = _grid(stage, "/World/Crowd/Patch", PATCH, 1e-3)
    many.CreatePrototypesRel().SetTargets([patch.GetPath()])
    many.CreateProtoIndicesAttr(Vt.IntArray(count, 0))
    many.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(_places(count)))


def meshes(stage: Usd.Stage, count: int) -> None:
    """So many meshes of 512 triangles."""
    for number, place in enumerate(_places(count)):
        patch = _grid(stage, f"/World/Patch{number}", PATCH, 1e-3)
        patch.AddTranslateOp().Set(Gf.Vec3d(*map(float, place)))


def lights(stage: Usd.Stage, count: int) -> None:
    """So many lamps above the water."""
    for number, place in enumerate(_places(count)):
        lamp = UsdLux.SphereLight.Define(stage, f"/World/Lamp{number}")
        lamp.CreateRadiusAttr(0.0)
        lamp.CreateTreatAsPointAttr(True)
        lamp.CreateIntensityAttr(1.0)
        lamp.AddTranslateOp().Set(Gf.Vec3d(float(place[0]), float(place[1]), 2.0))


ROWS: dict[str, tuple[Callable[[Usd.Stage, int], None], int]] = {
    "animated triangles": (triangles, 2_000_000),
    "instances": (instances, 10_000),
    "meshes": (meshes, 1_000),
    # Of a thousand most lies where the wave alone takes its most, at another time.
    "more meshes": (meshes, 4_000),
    "lights": (lights, 200),
}


def _stage(path: Path, add: Callable[[Usd.Stage, int], None] | None, count: int) -> Path:
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().subLayerPaths.append(str(WAVE))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(1)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    if add is not None:
        add(stage, count)
    stage.GetRootLayer().Export(str(path))
    return path


def _grid(stage: Usd.Stage, path: str, side: int, width: float) -> UsdGeom.Mesh:
    """A square of 2 side² triangles, just above the floor."""
    at = np.arange(side + 1)
    u, v = (part.ravel() for part in np.meshgrid(at, at))
    mesh = UsdGeom.Mesh.Define(stage, Sdf.Path(path))
    places = np.column_stack([u / side - 0.5, v / side - 0.5, np.full(len(u), 1e-4 / width)]) * width
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(places.astype(np.float32)))
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.stack([corner, corner + 1, corner + side + 2, corner, corner + side + 2, corner + side + 1], axis=1)
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel().astype(np.int32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(2 * side * side, 3))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    return mesh


def _places(count: int) -> np.ndarray:
    """Places spread over the floor, shape [count, 3]."""
    side = math.ceil(math.sqrt(count))
    places = np.stack(np.divmod(np.arange(count), side), axis=1) * (2.0 / side) - 1.0
    return np.column_stack([places, np.zeros(count)]).astype(np.float32)


def _measured(stage: Path, folder: str) -> tuple[float, float]:
    command = [sys.executable, "-c", _FRAME, str(stage), f"{folder}/a.exr"]
    printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    seconds, peak = json.loads(printed.splitlines()[-1])
    return seconds, peak


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1:])))
