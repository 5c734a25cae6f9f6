"""How close frames are to what the machine can do: rates beside bare ray queries, threads, what no stage names, growth.

All of it needs no other commit to compare with. Rows are run alone with ``run.py efficiency --only ROW``.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from frame_time import run as frame_time

from tpdwarp.clock import Clock
from tpdwarp.photons.emission import Patch, emit
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from tpdwarp.view.area_lights import area_light_arrays
from tpdwarp.view.camera import Camera, camera_of, camera_ray
from tpdwarp.view.lights import LightArrays, light_arrays, lit_from
from tpdwarp.view.sampling import block_order, film_positions
from tpdwarp.view.visibility import visible_points

WAVE = Path(__file__).resolve().parents[2] / "usd_scenes" / "wave.usdc"
TURNS = 3
INSTANCES = 70_000
# Rays start so far off the surface they leave, in the tracer's units.
OFFSET = wp.constant(1e-5)


def run(only: Sequence[str] = ()) -> dict[str, Any]:
    """What each row measured, with what was asked.

    Args:
        only: Names of rows; none for all.
    """
    if unknown := [name for name in only if name not in ROWS]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(ROWS)}")
    return {name: row() for name, row in ROWS.items() if not only or name in only}


def motion() -> dict[str, float]:
    """CPU seconds of a further frame of the wave with motion against the same at rest."""
    contexts = {exposure: _wave(exposure=exposure) for exposure in (0.0, 1.0)}
    seconds = {exposure: math.inf for exposure in contexts}
    for _ in range(TURNS):
        for exposure, (context, shutter) in contexts.items():
            seconds[exposure] = min(seconds[exposure], _frame_seconds(context, shutter))
    return _said("moving against still", seconds[1.0] / seconds[0.0], "at most 1.2")


def unnamed() -> dict[str, float]:
    """The part of a frame's wall time that no stage names, at a million photons."""
    context, shutter = _wave(photons=1_000_000, samples=1)
    _frame_seconds(context, shutter)
    clock, start = Clock(), time.perf_counter()
    render_frame(context, shutter, *context.source.resolution(), clock)
    seconds = time.perf_counter() - start
    return _said("time in no named stage", 1.0 - sum(clock.seconds.values()) / seconds, "at most .03")


def threads() -> dict[str, float]:
    """Wall time with one thread over that with two, by stage; other work on the machine makes it less."""
    clocks: dict[int, Clock] = {}
    for count in (1, 2):
        context, shutter = _wave(photons=1 << 18, threads=count)
        _frame_seconds(context, shutter)
        clocks[count] = Clock()
        render_frame(context, shutter, *context.source.resolution(), clocks[count])
    ratios = {name: clocks[1].seconds[name] / max(clocks[2].seconds[name], 1e-9) for name in clocks[1].seconds}
    whole = sum(clocks[1].seconds.values()) / sum(clocks[2].seconds.values())
    for name, ratio in ratios.items():
        _said(f"two threads against one, {name} ({clocks[1].seconds[name]:.2f} s)", ratio, "at least 1.85")
    return {**ratios, **_said("two threads against one, whole frame", whole, "at least 1.75")}


@wp.kernel(enable_backward=False)
def bare_photons(
    base: int, surfaces: Surfaces, patch: Patch, landed: wp.array(dtype=wp.vec3), out: wp.array(dtype=wp.float32)
):
    """The two hops of photons through open water, with nothing but ray queries."""
    cell = base + wp.tid()
    beam = emit(
        patch,
        wp.vec2(
            float(patch.first_u + cell % patch.count_u) + 0.5, float(patch.first_v + cell // patch.count_u) + 0.5
        ),
    )
    x = beam.x + patch.start * beam.w
    first = wp.mesh_query_ray(surfaces.tree.mesh, x, beam.w, 1.0e6)
    if first.result:
        surface = x + first.t * beam.w
        w = wp.normalize(landed[cell] - surface)
        second = wp.mesh_query_ray(surfaces.tree.mesh, surface + OFFSET * w, w, 1.0e6)
        out[cell] = second.t


@wp.kernel(enable_backward=False)
def bare_view(
    base: int,
    surfaces: Surfaces,
    lights: LightArrays,
    camera: Camera,
    films: wp.array(dtype=wp.vec2),
    out: wp.array(dtype=wp.float32),
):
    """First hits of camera rays, and whether the light is seen from there, with nothing but ray queries."""
    i = base + wp.tid()
    beam = camera_ray(camera, films[i], 0.0)
    hit = wp.mesh_query_ray(surfaces.tree.mesh, beam.x, beam.w, 1.0e6)
    if hit.result:
        x = beam.x + hit.t * beam.w
        light = lit_from(surfaces, lights, 0, x)
        if not wp.mesh_query_ray_anyhit(surfaces.tree.mesh, x + OFFSET * light.w, light.w, light.distance):
            out[i] = hit.t


def trace_rate() -> dict[str, float]:
    """Photons with all differentials of open water, against their ray queries alone, on one thread."""
    context, shutter = _wave(photons=1 << 20, threads=1)
    loaded = context.loader.load(shutter)
    plan = context.tracer.plan(context.settings.photons)
    (_, patch), *_ = plan.patches(loaded.scene)
    count, launcher = patch.count_u * patch.count_v, context.launcher
    landed = np.zeros((count, 3), np.float32)
    photons, _ = context.tracer.trace(loaded, plan, Clock())
    landed[_cells(photons, patch)] = photons.position
    out, ends = launcher.zeros(count, wp.float32), launcher.array(landed, wp.vec3)
    rays = [loaded.geometry.surfaces, patch, ends, out]
    return _compared_with_bare(
        "photons with differentials",
        lambda: launcher(bare_photons, count, rays),
        lambda: context.tracer.trace(loaded, plan, Clock()),
    )


def view_rate() -> dict[str, float]:
    """First hits of the camera with their direct light, against their ray queries alone, on one thread."""
    context, shutter = _wave(threads=1)
    loaded, launcher = context.loader.load(shutter), context.launcher
    width, height = context.source.resolution()
    camera = camera_of(loaded.scene.camera, width, height, context.normalization)
    lights = light_arrays(loaded.scene.lights, context.normalization, launcher)
    areas = area_light_arrays(loaded.scene.lights, context.normalization, launcher)
    pixels = block_order(width, height)
    positions = film_positions(pixels, width, 1, 0)
    films = launcher.array(positions.astype(np.float32), wp.vec2)
    items = np.arange(len(pixels), dtype=np.int32)
    out, surfaces = launcher.zeros(len(pixels), wp.float32), loaded.geometry.at(0.0, launcher)

    def looked() -> None:
        list(visible_points(surfaces, lights, areas, camera, films, items, loaded.requirements, launcher, moves=False))

    bare = [surfaces, lights, camera, films, out]
    return _compared_with_bare("first hits of the camera", lambda: launcher(bare_view, len(pixels), bare), looked)


def memory() -> dict[str, float]:
    """Peak memory of a frame of ten million photons [GiB]."""
    script = (
        "import sys, tpdwarp\nfrom tpdwarp.studies.memory import peak_bytes\n"
        "tpdwarp.render(sys.argv[1], sys.argv[2], frames=3, photons=10_000_000, image_width=512, samples=1)\n"
        "print(peak_bytes())"
    )
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", script, str(WAVE), f"{folder}/wave.exr"]
        printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    return _said("GiB at ten million photons", int(printed.splitlines()[-1]) / 2**30, "at most 3")


def growth() -> dict[str, float]:
    """Exponents of CPU seconds with photons, and with pixels."""
    found = {}
    for name, sizes in (
        ("photons", [{"photons": 1 << power, "samples": 1} for power in (17, 19)]),
        ("pixels", [{"image_width": width, "samples": 1} for width in (512, 1024)]),
    ):
        seconds = []
        for size in sizes:
            context, shutter = _wave(**size)
            _frame_seconds(context, shutter)
            seconds.append(min(_frame_seconds(context, shutter) for _ in range(TURNS)))
        # Four times as many of either.
        found |= _said(f"growth with {name}", math.log(seconds[1] / seconds[0]) / math.log(4.0), "at most 1.05")
    return found


def instances() -> dict[str, float]:
    """CPU seconds of a process that renders seventy thousand instances of a small mesh, 160 pixels wide, or moving."""
    found = {}
    script = (
        "import sys, time, tpdwarp\nstart = time.process_time()\n"
        "tpdwarp.render(sys.argv[1], sys.argv[2], frames=1, photons=16384, image_width=160)\n"
        "print(time.process_time() - start)"
    )
    for moving in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            stage = _instanced(Path(folder) / "instances.usdc", moving)
            command = [sys.executable, "-c", script, str(stage), f"{folder}/a.exr"]
            printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
        what = f"CPU s of {INSTANCES} {'moving' if moving else 'still'} instances"
        found |= _said(what, float(printed.splitlines()[-1]), "at most 3 s on two cores")
    return found


def process() -> dict[str, float]:
    """Wall time of the whole process for one frame of the wave, with and without compiled kernels."""
    found = frame_time()
    _said("whole process, warm", found["warm median"], "at most 1.2 s")
    _said("whole process, cold", found["cold"], "at most 6 s")
    return found


ROWS: dict[str, Callable[[], dict[str, float]]] = {
    "motion": motion,
    "unnamed": unnamed,
    "threads": threads,
    "trace": trace_rate,
    "view": view_rate,
    "growth": growth,
    "instances": instances,
    "process": process,
    "memory": memory,
}


def _wave(**changes: Any) -> tuple[RenderContext, Shutter]:
    chosen = {"camera": "TopOrtho", "image_width": 512, "photons": 1 << 14, "samples": 4, "exposure": 1.0, **changes}
    settings = Settings(**chosen)
    source = StageScene.open(str(WAVE), settings)
    return RenderContext(source, settings), source.shutter(3, settings)


def _frame_seconds(context: RenderContext, shutter: Shutter) -> float:
    start = time.process_time()
    render_frame(context, shutter, *context.source.resolution())
    return time.process_time() - start


def _compared_with_bare(what: str, bare: Callable[[], object], whole: Callable[[], object]) -> dict[str, float]:
    """The rate of ``whole`` as a part of that of ``bare``, by turns."""
    seconds = {}
    for turn in range(TURNS + 1):
        for name, work in (("bare", bare), ("whole", whole)):
            start = time.process_time()
            work()
            if turn:
                seconds[name] = min(seconds.get(name, math.inf), time.process_time() - start)
    return _said(f"{what}, of the rate of bare queries", seconds["bare"] / seconds["whole"], "at least .85")


def _cells(photons: PhotonMap, patch: Patch) -> np.ndarray:
    """Number of each photon's cell in its patch, shape [n]."""
    u, v = np.floor(photons.emission).astype(np.int64).T
    return (v - patch.first_v) * patch.count_u + u - patch.first_u


def _instanced(path: Path, moving: bool) -> Path:
    """The wave with a crowd of small pyramids on its floor, at rest or gliding along it."""
    from pxr import Gf, Usd, UsdGeom, Vt

    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().subLayerPaths.append(str(WAVE))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(1)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Crowd")
    mesh = UsdGeom.Mesh.Define(stage, "/World/Crowd/Pyramid")
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 2)]
    mesh.CreatePointsAttr([Gf.Vec3f(*(0.001 * value for value in corner)) for corner in corners])
    mesh.CreateFaceVertexCountsAttr([3] * 4)
    mesh.CreateFaceVertexIndicesAttr([0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4])
    instancer.CreatePrototypesRel().SetTargets([mesh.GetPath()])
    instancer.CreateProtoIndicesAttr(Vt.IntArray(INSTANCES, 0))
    side = math.ceil(math.sqrt(INSTANCES))
    places = np.stack(np.divmod(np.arange(INSTANCES), side), axis=1) * (2.0 / side) - 1.0
    positions = np.column_stack([places, np.full(INSTANCES, 1e-4)]).astype(np.float32)
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(positions))
    if moving:
        for time_code in (1, 2):
            glided = positions + np.float32([2e-4 * time_code, 0.0, 0.0])
            instancer.GetPositionsAttr().Set(Vt.Vec3fArray.FromNumpy(glided), time_code)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.GetRootLayer().Export(str(path))
    return path


def _said(what: str, value: float, asked: str) -> dict[str, float]:
    print(f"  {what:58s} {value:8.3f}   asked: {asked}", flush=True)
    return {what: value}


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1:])))
