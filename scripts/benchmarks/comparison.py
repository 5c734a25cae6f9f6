"""Temporal photon differentials beside accumulation and time dependent photon mapping, both tuned against the truth.

For three scenes whose irradiance is known exactly: how many photons and what CPU time the others need for the error of
one trace with the default settings. All look once at each pixel. Accumulation is measured twice: with the lattices and
footprints of this program at every instant, and with what it had to add up without them, photons from random places of
their cells with the paper's kernel.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from accuracy import PIXELS, ROWS, wave_over_floor

from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from usd_scenes.in_memory import rod_and_truth
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.oracle.caustic_rod import PIXELS as ROD_PIXELS

INSTANT_PHOTONS = (256, 1024, 4096, 16_384, 65_536)
# Settings, and instants with the photons of each. Without lattices noise falls with the number of instants, of which
# there have to be many.
BRUTE: dict[str, tuple[dict[str, Any], list[tuple[int, int]]]] = {
    "accumulation": (
        {"estimator": "accumulation"},
        [(times, photons) for photons in INSTANT_PHOTONS for times in (4, 8, 16, 32)],
    ),
    "plain accumulation": (
        {"estimator": "accumulation", "emission": "jittered", "kernel": "epanechnikov"},
        [(8, 256), (32, 256), (32, 1024), (128, 1024), (128, 4096), (512, 1024), (512, 4096), (512, 16_384)],
    ),
}

OPEN = Shutter(0.0, 0.0, 1.0)
PHOTONS = (1000, 4000, 16_000, 64_000)
MAPPED = (1000, 4000, 16_000, 60_000, 240_000, 480_000, 960_000, 1_920_000)
NEIGHBOURS = (6, 12, 25, 50, 100, 200, 400, 800, 1600, 3200)
# Beyond so many photons only the better of in-between frames and random times is gone on with.
BOTH_TIMES = 240_000


@dataclass(frozen=True)
class Scene:
    """A scene over one shutter with its exact irradiance; pixels are averaged from ``finer``² rendered ones."""

    name: str
    source: SceneSource
    truth: np.ndarray
    width: int
    height: int
    finer: int = 1


@dataclass(frozen=True)
class Point:
    """What one way of rendering cost and how far it is from the truth (relative RMSE)."""

    what: str
    photons: int
    error: float
    seconds: float


def scenes() -> Iterator[Scene]:
    """The soft wave, the wave with folds, and the turning glass rod."""
    for name, wavelength in (("soft wave", 1.3), ("wave with folds", 0.65)):
        wave = Wave(wavelength=wavelength, speed=wavelength / 8.0)
        columns = irradiance_average(np.linspace(-1.0, 1.0, PIXELS + 1), wave, 0.0, 1.0, times=256)
        yield Scene(name, wave_over_floor(wave), np.broadcast_to(columns, (ROWS, PIXELS)), PIXELS, ROWS)
    source, truth = rod_and_truth()
    yield Scene("cylinder", source, truth, 2 * ROD_PIXELS, 2 * ROD_PIXELS, 2)


def measured(scene: Scene, what: str, **settings: Any) -> Point:
    """Renders once with kernels compiled; CPU seconds of all threads."""
    chosen = Settings.of(Settings(aovs=("irradiance",), samples=1), **settings)
    start = time.process_time()
    frame = render_frame(RenderContext(scene.source, chosen), OPEN, scene.width, scene.height)
    seconds = time.process_time() - start
    found = frame.channels["irradiance.R"].astype(float)
    height, width = (size // scene.finer for size in found.shape)
    found = found.reshape(height, scene.finer, width, scene.finer).mean(axis=(1, 3))
    error = float(np.sqrt(np.mean((found - scene.truth) ** 2)) / scene.truth.mean())
    instants = chosen.accumulation_times if chosen.estimator == "accumulation" else 1
    return Point(what, chosen.photons * instants, error, seconds)


def mapping(scene: Scene) -> list[Point]:
    """Photon mapping with the best k for each number of photons, in-between frames or random times."""
    best: list[Point] = []
    first, ways = 0, (None, 10)
    for photons in MAPPED:
        if photons > BOTH_TIMES:
            ways = (10,) if best[-1].what.endswith("B 10") else (None,)
        found = []
        for between in ways:
            previous = math.inf
            for k in NEIGHBOURS[first:]:
                if k >= photons:
                    break
                settings = {"estimator": "tdpm", "emission": "jittered", "accumulation_times": 32}
                name = f"k {k}, {'random times' if between is None else f'B {between}'}"
                point = measured(scene, name, photons=photons, tdpm_neighbours=k, tdpm_between=between, **settings)
                found.append(point)
                # Past the best bandwidth errors only grow.
                if point.error > 1.1 * previous:
                    break
                previous = point.error
        best.append(min(found, key=lambda point: point.error))
        shown = best[-1]
        # With more photons the best k is no smaller.
        first = NEIGHBOURS.index(int(shown.what.split()[1].rstrip(",")))
        print(f"  tdpm {photons:7d} photons: {shown.error:.4f}, {shown.seconds:.2f} s ({shown.what})", flush=True)
    return best


def accumulation(scene: Scene, name: str) -> list[Point]:
    """Accumulations on the front of error against CPU time."""
    settings, sizes = BRUTE[name]
    points = [
        measured(scene, f"{times} × {photons}", photons=photons, accumulation_times=times, **settings)
        for times, photons in sizes
    ]
    front = front_of(points)
    for point in front:
        print(f"  {name} {point.what}: {point.error:.4f}, {point.seconds:.2f} s", flush=True)
    return front


def front_of(points: list[Point]) -> list[Point]:
    """Points that none is both cheaper and more exact than, dearest last."""
    front: list[Point] = []
    for point in sorted(points, key=lambda entry: entry.seconds):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


def cost_of(error: float, points: list[Point], cost: str) -> tuple[float, bool]:
    """What ``error`` costs on a front, between its points by power laws, and whether that was reached at all."""
    ordered = sorted(points, key=lambda point: -point.error)
    previous = None
    for point in ordered:
        if point.error <= error:
            if previous is None:
                return float(getattr(point, cost)), True
            part = math.log(previous.error / error) / math.log(previous.error / point.error)
            low, high = getattr(previous, cost), getattr(point, cost)
            return float(low * (high / low) ** part), True
        previous = point
    return float(getattr(ordered[-1], cost)), False


def run() -> list[dict[str, object]]:
    """Ratios for each scene; where a method never got there (``…_reached`` is false), they are lower bounds."""
    results = []
    for scene in scenes():
        print(f"{scene.name}: relative RMSE against the exact irradiance, exposure 1 frame")
        measured(scene, "warm", photons=64)
        ours = [measured(scene, "tpd", photons=photons) for photons in PHOTONS]
        for point in ours:
            print(f"  tpd {point.photons} photons: {point.error:.4f}, {point.seconds:.2f} s", flush=True)
        measured(scene, "warm", estimator="tdpm", photons=64, tdpm_neighbours=8, emission="jittered")
        for settings, _ in BRUTE.values():
            measured(scene, "warm", photons=64, accumulation_times=1, **settings)
        others = {"tdpm": mapping(scene)}
        for name in BRUTE:
            others[name] = accumulation(scene, name)
        for point in ours:
            for method, points in others.items():
                row: dict[str, object] = {"scene": scene.name, "photons": point.photons, "method": method}
                for cost in ("photons", "seconds"):
                    needed, row[f"{cost}_reached"] = cost_of(point.error, points, cost)
                    row[cost] = needed / float(getattr(point, cost))
                bound = "" if row["seconds_reached"] else "more than "
                print(
                    f"  {method} for the error of {point.photons}: {bound}{row['photons']:.3g} times the photons, "
                    f"{bound}{row['seconds']:.3g} times the CPU time",
                    flush=True,
                )
                results.append(row)
    return results
