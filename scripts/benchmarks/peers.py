#!/usr/bin/env python3
"""CPU time to the same error beside Mitsuba 3, whose in-between stills are averaged: what a user would do instead.

    .venv/bin/python scripts/benchmarks/run.py peers                       # all scenes
    .venv/bin/python scripts/benchmarks/run.py peers --only ball-gliding

Mitsuba is installed into an environment of its own (``build/mitsuba``); where it cannot be, the benchmark says so and
measures nothing. Both render the same triangles with the same normals over the same shutter, without light from diffuse
surface to diffuse surface, and see the floor directly; the truth is that of no renderer (``usd_scenes.brute_force``, of
the wave its closed form). Mitsuba's particles are aimed, as this program's photons are: from a cone or a square beam
just as wide as the glass. What of them falls beside it is measured apart, untimed, and taken off.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "mitsuba"))

from accuracy import PIXELS, ROWS, wave_over_floor
from ply import write_ply
from solids import channel

import tpdwarp
from tpdwarp.presets import PRESETS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from usd_scenes.brute_force.description import DIELECTRIC, between
from usd_scenes.kept_truths import kept_truth
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.solids import SCENES, write
from usd_scenes.stage import CAMERA, FRAME

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = ROOT / "build" / "mitsuba"
WAVE = "wave-folding"
COMPARED = (
    WAVE, "ball-gliding", "torus-turning-10", "cube-turning", "blob-turning", "ball-behind-a-slab", "prism-turning",
)  # fmt: skip
WANTED = (0.1, 0.05)
# Of these the cheapest that errs by no more than what is wanted counts, presets aside.
PHOTONS = tuple(1 << power for power in range(10, 19))
SAMPLES = (1, 4)
NAMED = ("draft", "standard", "final")
# Numbers of Mitsuba's stills, the CPU seconds after which each ends, and how much of its light the floor throws back.
STILLS, SECONDS, ALBEDO = (16, 64), 15.0, 0.01


@dataclass(frozen=True, eq=False)
class Still:
    """A mesh at one instant: points [v, 3], triangles [m, 3], normals of vertices [v, 3] or None, its index or 0."""

    points: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray | None
    ior: float

    @property
    def unit_normals(self) -> np.ndarray | None:
        """Normals of length one, shape [v, 3]: those between two instants are shorter."""
        return None if self.normals is None else self.normals / np.linalg.norm(self.normals, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Compared:
    """A scene both render.

    Attributes:
        truth, mask: Irradiance of the floor and where it counts, each [height, width].
        truth_error: Relative RMSE of the truth itself.
        render: Irradiance by this program with some settings, shape [height, width].
        describe: Writes a number of stills for Mitsuba into a folder.
    """

    truth: np.ndarray
    mask: np.ndarray
    truth_error: float
    render: Callable[..., np.ndarray]
    describe: Callable[[Path, int], None]

    def error_of(self, picture: np.ndarray) -> float:
        """Relative RMSE of irradiance within the mask."""
        difference, mean = (picture - self.truth)[self.mask], self.truth[self.mask].mean()
        return float(np.sqrt(np.mean(difference**2)) / mean)


def run(scenes: Sequence[str] = ()) -> list[dict[str, object]]:
    """CPU seconds to each wanted error; prints them as they come.

    Args:
        scenes: Names out of :data:`COMPARED`; none for all.

    Returns:
        A row a scene: ``scene``, ``truth_error``, ``ours`` (settings, ``error`` and ``cpu_seconds`` of each render),
        ``mitsuba`` (errors and CPU seconds of its passes, by number of stills), ``wanted`` (by error: CPU seconds of
        ``mitsuba``, of the ``best`` settings and of the best ``preset``, None where it does not get there).
    """
    if unknown := [name for name in scenes if name not in COMPARED]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(COMPARED)}")
    if (python := _mitsuba()) is None:
        return []
    rows: list[dict[str, object]] = []
    for name in scenes or COMPARED:
        with tempfile.TemporaryDirectory() as folder:
            compared = (_wave if name == WAVE else _solid)(name, Path(folder))
            theirs = {stills: _theirs(compared, python, Path(folder), stills) for stills in STILLS}
            ours = list(_ours(compared))
        row = {"scene": name, "truth_error": compared.truth_error, "ours": ours, "mitsuba": theirs}
        row["wanted"] = {wanted: _seconds(ours, theirs, wanted) for wanted in WANTED}
        rows.append(row)
        _print(row)
    return rows


def _mitsuba() -> Path | None:
    """A Python that has Mitsuba; None, and a word why, where there is none."""
    python = ENVIRONMENT / "bin" / "python"
    try:
        if not python.exists():
            venv.create(ENVIRONMENT, with_pip=True)
            subprocess.run([python, "-m", "pip", "install", "-q", "mitsuba", "numpy"], check=True)
        subprocess.run([python, "-c", "import mitsuba, numpy"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"  skipped: Mitsuba cannot be installed into {ENVIRONMENT} ({error})")
        return None
    return python


def _solid(name: str, folder: Path) -> Compared:
    """A scene of ``usd_scenes.solids``."""
    scene = SCENES[name]()
    truth, stage, picture = kept_truth(scene), write(name, folder), folder / "ours.exr"
    camera = scene.camera

    def render(**settings: Any) -> np.ndarray:
        options = {"frames": FRAME, "camera": CAMERA, "image_width": camera.width, "exposure": 1.0}
        tpdwarp.render(stage, picture, aovs=("irradiance",), **options, **settings)
        return channel(picture, "irradiance.R")

    def meshes_at(s: float) -> dict[str, Still]:
        return {
            mesh.name: Still(
                between(mesh.points, s),
                mesh.triangles,
                None if mesh.normals is None else between(mesh.normals, s),
                mesh.ior if mesh.interaction == DIELECTRIC else 0.0,
            )
            for mesh in scene.meshes
        }

    bends = [np.concatenate(mesh.points) for mesh in scene.meshes if mesh.interaction == DIELECTRIC]
    corners = np.concatenate(bends).astype(np.float64)
    lamps = [
        _cone(light.position[0], corners, light.power)
        if light.direction is None
        else _beam(np.asarray(light.direction, dtype=np.float64), corners, light.power)
        for light in scene.lights
    ]

    def describe(into: Path, stills: int) -> None:
        pixels = (camera.width, camera.height)
        _write(into, stills, meshes_at, lamps, camera.position[0], camera.size, pixels, False)

    return Compared(truth.irradiance, truth.mask, truth.error, render, describe)


def _wave(_name: str, _folder: Path) -> Compared:
    """The travelling wave that makes folds, which has a closed form."""
    wave = Wave(wavelength=0.65, speed=0.65 / 8.0)
    columns = irradiance_average(np.linspace(-1.0, 1.0, PIXELS + 1), wave, 0.0, 1.0, times=256)
    truth = np.tile(columns, (ROWS, 1))
    source = wave_over_floor(wave)

    def render(**settings: Any) -> np.ndarray:
        chosen = Settings(aovs=("irradiance",), **settings)
        frame = render_frame(RenderContext(source, chosen), Shutter(0.0, 0.0, 1.0), PIXELS, ROWS)
        return frame.channels["irradiance.R"].astype(np.float64)

    def meshes_at(s: float) -> dict[str, Still]:
        return {
            mesh.path: Still(
                mesh.points, mesh.triangles, mesh.normals, mesh.materials[0].ior if mesh.specular else 0.0
            )
            for mesh in source.at(Shutter.still(s)).meshes
        }

    water = meshes_at(0.5)["/water"].points
    lamps = [_beam(np.array([0.0, 0.0, -1.0]), water, wave.irradiance)]

    def describe(into: Path, stills: int) -> None:
        eye = np.array([0.0, 0.0, 0.85 * wave.height])
        _write(into, stills, meshes_at, lamps, eye, 2.0, (PIXELS, ROWS), True)

    return Compared(truth, np.ones(truth.shape, bool), 0.0, render, describe)


def _cone(position: np.ndarray, corners: np.ndarray, power: float) -> dict[str, object]:
    """The narrowest cone about the middle of corners [n, 3] that holds them all."""
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    axis, ways = middle - position, corners - position
    cosines = ways @ axis / (np.linalg.norm(ways, axis=1) * np.linalg.norm(axis))
    degrees = math.degrees(math.acos(cosines.min()))
    return {"eye": position.tolist(), "target": middle.tolist(), "up": [0, 1, 0], "degrees": degrees, "power": power}


def _beam(direction: np.ndarray, corners: np.ndarray, power: float) -> dict[str, object]:
    """The narrowest rectangular beam along a direction, with sides along y, that holds corners [n, 3]."""
    across = np.cross((0.0, 1.0, 0.0), direction)
    across /= np.linalg.norm(across)
    axes = np.array([across, np.cross(direction, across), direction])
    low, high = (end(corners @ axes.T, axis=0) for end in (np.min, np.max))
    eye = np.array([*(0.5 * (low + high)[:2]), low[2] - 1.0]) @ axes
    half = (0.5 * (high - low)[:2]).tolist()
    return {"eye": eye.tolist(), "target": (eye + direction).tolist(), "up": [0, 1, 0], "half": half, "power": power}


def _write(
    folder: Path,
    stills: int,
    meshes_at: Callable[[float], dict[str, Still]],
    lamps: list[dict[str, object]],
    eye: np.ndarray,
    size: float,
    pixels: tuple[int, int],
    covered: bool,
) -> None:
    """Writes the meshes of every still as PLY files, and the rest as ``scene.json``.

    Args:
        folder: What Mitsuba reads.
        stills: At the middles of as many parts of the shutter.
        meshes_at: Meshes by prim path at a share of the shutter.
        lamps: Of :func:`_cone` and :func:`_beam`.
        eye: Of a camera that looks straight down at the floor z = 0.
        size: Of the picture on the floor, scene units.
        pixels: Width and height.
        covered: Whether no light falls beside what refracts.
    """
    before, meshes = meshes_at(0.0), {}
    for number in range(stills):
        for path, mesh in meshes_at((number + 0.5) / stills).items():
            name = path.rpartition("/")[2]
            moves = not np.array_equal(before[path].points, mesh.points)
            meshes[name] = {"ior": mesh.ior, "moves": moves, "flat": mesh.normals is None, "albedo": ALBEDO}
            file = folder / (f"{name}.{number}.ply" if moves else f"{name}.ply")
            write_ply(file, mesh.points, mesh.triangles, mesh.unit_normals)
    described = {
        "meshes": meshes,
        "lamps": lamps,
        "eye": eye.tolist(),
        "degrees": math.degrees(2.0 * math.atan(0.5 * size / eye[2])),
        "width": pixels[0],
        "height": pixels[1],
        "covered": covered,
        "stills": stills,
        "seconds": SECONDS,
    }
    (folder / "scene.json").write_text(json.dumps(described))


def _theirs(compared: Compared, python: Path, folder: Path, stills: int) -> list[dict[str, float]]:
    """Mitsuba's error and CPU seconds after each of its passes."""
    compared.describe(folder, stills)
    subprocess.run([python, ROOT / "scripts" / "mitsuba" / "stills.py", folder], check=True, stdout=subprocess.DEVNULL)
    with np.load(folder / "stills.npz") as found:
        pictures = (found["pictures"] - found["direct"]) * math.pi / ALBEDO
        seconds = found["seconds"].tolist()
    return [
        {
            "error": compared.error_of(picture),
            "cpu_seconds": spent,
            "mean": float(picture[compared.mask].mean() / compared.truth[compared.mask].mean()),
        }
        for picture, spent in zip(pictures, seconds, strict=True)
    ]


def _ours(compared: Compared) -> Iterator[dict[str, object]]:
    """Error and CPU seconds of presets, and of photons and samples until all that is wanted is reached."""
    compared.render(photons=PHOTONS[0], samples=1)
    for preset in NAMED:
        yield {"settings": preset} | _measured(compared, **PRESETS[preset])
    for samples in SAMPLES:
        for photons in PHOTONS:
            row = {"settings": f"{photons} photons, {samples} samples"}
            row |= _measured(compared, photons=photons, samples=samples)
            yield row
            if row["error"] <= min(WANTED):
                break


def _measured(compared: Compared, **settings: Any) -> dict[str, float]:
    start = time.process_time()
    picture = compared.render(**settings)
    return {"cpu_seconds": time.process_time() - start, "error": compared.error_of(picture)}


def _seconds(
    ours: list[dict[str, Any]], theirs: dict[int, list[dict[str, float]]], wanted: float
) -> dict[str, float | None]:
    """CPU seconds that Mitsuba, this program's best settings and its best preset take to an error."""
    reached = (seconds_to(passes, wanted) for passes in theirs.values())
    found = {"mitsuba": min((seconds for seconds in reached if seconds is not None), default=None)}
    for name, rows in (("best", ours), ("preset", [row for row in ours if row["settings"] in NAMED])):
        found[name] = min((row["cpu_seconds"] for row in rows if row["error"] <= wanted), default=None)
    return found


def seconds_to(passes: Sequence[dict[str, float]], wanted: float) -> float | None:
    """CPU seconds until independent particles err by no more than wanted, between two passes by the root of time.

    What is beyond the last pass is told by that root, too, as long as it errs by no more than twice what is wanted.
    """
    last = passes[-1]
    for row in passes:
        if row["error"] <= wanted:
            return row["cpu_seconds"] * (row["error"] / wanted) ** 2
    return last["cpu_seconds"] * (last["error"] / wanted) ** 2 if last["error"] <= 2.0 * wanted else None


def _print(row: dict[str, Any]) -> None:
    print(f"  {row['scene']}: the truth errs by {row['truth_error']:.4f}")
    for found in row["ours"]:
        print(f"    {found['settings']:28s} errs by {found['error']:.4f} in {found['cpu_seconds']:7.2f} CPU s")
    for stills, passes in row["mitsuba"].items():
        for found in passes[-2:]:
            print(f"    {f'Mitsuba, {stills} stills':28s} errs by {found['error']:.4f} in", end=" ")
            print(f"{found['cpu_seconds']:7.2f} CPU s, mean {found['mean']:.4f}")
    for wanted, found in row["wanted"].items():
        print(f"    to {wanted}:", end=" ")
        told = {name: "never" if seconds is None else f"{seconds:.2f}" for name, seconds in found.items()}
        for name in ("best", "preset"):
            if found["mitsuba"] and found[name]:
                told[name] += f" ({found['mitsuba'] / found[name]:.1f} times less)"
        print(", ".join(f"{name} {seconds}" for name, seconds in told.items()), flush=True)
