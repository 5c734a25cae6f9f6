#!/usr/bin/env python3
"""Error of light from lights with extent against sums over places on them, and what it costs beside points.

.venv/bin/python scripts/benchmarks/run.py extent
.venv/bin/python scripts/benchmarks/run.py extent --only ball-sun-5 --only ball-rectangle
.venv/bin/python scripts/benchmarks/extent.py --keep ball-sun-5        # makes its truth anew

The truth of solids is brute force (``usd_scenes.brute_force``): plain photons in double precision, each from a place on
the light and an instant of its own. Of water it is the estimator ``accumulation``: the mean of frames each of which has
its lights at one place on them (and, where things move, at one instant), as points, with static footprints. Truths are
kept beside this file, with what their halves differ by. Errors are root mean squares over all pixels, by that of the
truth.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import tpdwarp
from usd_scenes import brute_force
from usd_scenes.solids import SCENES
from usd_scenes.solids import write as write_solid
from usd_scenes.stage import CAMERA, FRAME

SHIPPED = Path(__file__).resolve().parents[2] / "usd_scenes"
CONVERGED = Path(__file__).resolve().parent / "converged"
FEWER, PHOTONS, MORE, PIXELS, SAMPLES = 1 << 14, 1 << 16, 1 << 18, 64, 4
# Plain photons of a truth of solids, so many that it errs by less than a quarter of what was asked for.
TRUTH_PHOTONS = {"cardioid": 1 << 28, "torus-turning-10": 1 << 26, "ball-in-the-sun": 1 << 23, "ball-gliding": 1 << 26}
# Numbers of photons that frames are tried with, of points into which a light is split, and of photons of each.
LADDER = tuple(1 << power for power in range(8, 19))
POINT_PLACES = tuple(1 << power for power in range(1, 9))
POINT_PHOTONS = tuple(1 << power for power in range(9, 17))
# No more of a frame's time is spent on points: what was asked for is 20 times.
MOST_RATIO = 40.0
# Frames of which the quickest counts, where they take less than a second.
TRIES = 3
# Turns of a light with extent and one without, whose ratios have a median.
TURNS = 7
COMMON = {"threads": 1, "image_width": PIXELS, "samples": SAMPLES, "aovs": ("irradiance",)}


@dataclass(frozen=True)
class Case:
    """A stage, and how its light is changed.

    Attributes:
        scene: A shipped scene, or one of ``usd_scenes.solids``.
        light: Gives the stage's light an extent.
        limit: The error that was asked for.
        exposure: In frames; 0 for a still.
        places: Places on the light, and instants, of each half of the truth of water.
        photons: Of each of them: a narrow light takes few places and many photons.
    """

    scene: str
    light: Callable[[Usd.Stage], None]
    limit: float
    exposure: float = 0.0
    places: int = 128
    photons: int = 1 << 13


def sun(degrees: float) -> Callable[[Usd.Stage], None]:
    """Makes the stage's parallel light a disc, of the same irradiance."""

    def change(stage: Usd.Stage) -> None:
        light = UsdLux.DistantLight(_light(stage))
        light.CreateAngleAttr(degrees)
        UsdLux.LightAPI(light).CreateNormalizeAttr(True)

    return change


def lamp(part: float) -> Callable[[Usd.Stage], None]:
    """Makes the stage's lamp a sphere whose diameter is ``part`` of its distance from what it lights."""

    def change(stage: Usd.Stage) -> None:
        light = UsdLux.SphereLight(_light(stage))
        place = light.ComputeLocalToWorldTransform(FRAME).ExtractTranslation()
        radius = 0.5 * part * (place - Gf.Vec3d(0, 0, 0.6)).GetLength()
        was = light.GetRadiusAttr().Get()
        light.GetRadiusAttr().Set(radius)
        light.GetIntensityAttr().Set(light.GetIntensityAttr().Get() * (was / radius) ** 2)
        light.CreateTreatAsPointAttr(False)

    return change


def ring_sun(stage: Usd.Stage) -> None:
    """A sun of 5 degrees from where the ring's lamp stands."""
    lamp_prim = _light(stage)
    place = UsdLux.SphereLight(lamp_prim).ComputeLocalToWorldTransform(FRAME).ExtractTranslation()
    stage.RemovePrim(lamp_prim.GetPath())
    light = UsdLux.DistantLight.Define(stage, "/World/Sun")
    light.CreateIntensityAttr(1.0)
    light.AddTransformOp().Set(Gf.Matrix4d(Gf.Rotation(Gf.Vec3d(0, 0, 1), place), Gf.Vec3d(0)))
    sun(5.0)(stage)


def rectangle_beside(stage: Usd.Stage) -> None:
    """A rectangle as wide as the glass, half of its width above it, in the place of the stage's lamp."""
    light = _in_place_of_lamp(stage, UsdLux.RectLight)
    light.CreateWidthAttr(0.6)
    light.CreateHeightAttr(0.4)
    light.AddTranslateOp().Set(Gf.Vec3d(0.1, 0.05, 1.5))


def sphere_beside(stage: Usd.Stage) -> None:
    """A sphere half as wide as the glass, a seventh of its own width above it."""
    light = _in_place_of_lamp(stage, UsdLux.SphereLight)
    light.CreateRadiusAttr(0.25)
    light.AddTranslateOp().Set(Gf.Vec3d(0.1, 0.05, 1.72))


def disc_beside(stage: Usd.Stage) -> None:
    """A disc a little wider than half of the glass, as near to it as the rectangle."""
    light = _in_place_of_lamp(stage, UsdLux.DiskLight)
    light.CreateRadiusAttr(0.3)
    light.AddTranslateOp().Set(Gf.Vec3d(0.1, 0.05, 1.5))


def tube_beside(stage: Usd.Stage) -> None:
    """A tube as long as three quarters of the glass is wide, a fifth as wide as it is long."""
    light = _in_place_of_lamp(stage, UsdLux.CylinderLight)
    light.CreateRadiusAttr(0.08)
    light.CreateLengthAttr(0.75)
    light.AddTranslateOp().Set(Gf.Vec3d(0.1, 0.05, 1.55))


def _in_place_of_lamp(stage: Usd.Stage, kind: type) -> UsdLux.BoundableLightBase:
    stage.RemovePrim(_light(stage).GetPath())
    light = kind.Define(stage, "/World/Panel")
    light.CreateIntensityAttr(40.0)
    return light


def _light(stage: Usd.Stage) -> Usd.Prim:
    return next(prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI))


BALL, RING, TORUS = "ball-in-the-sun", "cardioid", "torus-turning-10"
CASES = {
    "wave-sun-0.53": Case("wave", sun(0.53), 0.02, 0.0, 8, 1 << 17),
    "wave-sun-5": Case("wave", sun(5.0), 0.02),
    "sea-sun-0.53": Case("sea", sun(0.53), 0.02, 0.0, 8, 1 << 17),
    "sea-sun-5": Case("sea", sun(5.0), 0.02),
    "ball-sun-0.53": Case(BALL, sun(0.53), 0.02),
    "ball-sun-5": Case(BALL, sun(5.0), 0.02),
    "torus-sun-0.53": Case(TORUS, sun(0.53), 0.02),
    "torus-sun-5": Case(TORUS, sun(5.0), 0.02),
    "ring-sun-5": Case(RING, ring_sun, 0.02),
    "ring-lamp": Case(RING, lamp(0.1), 0.04),
    "ball-lamp": Case("ball-gliding", lamp(0.1), 0.04),
    "ball-rectangle": Case("ball-gliding", rectangle_beside, 0.06),
    "ball-sphere-beside": Case("ball-gliding", sphere_beside, 0.06),
    "ball-disc-beside": Case("ball-gliding", disc_beside, 0.06),
    "ball-tube-beside": Case("ball-gliding", tube_beside, 0.06),
    "wave-sun-5-moving": Case("wave", sun(5.0), 0.02, 1.0, 64, 1 << 14),
    "ball-sun-5-moving": Case(BALL, sun(5.0), 0.02, 1.0),
    "torus-sun-0.53-moving": Case(TORUS, sun(0.53), 0.02, 1.0),
    "torus-sun-5-moving": Case(TORUS, sun(5.0), 0.02, 1.0),
    "ring-lamp-moving": Case(RING, lamp(0.1), 0.04, 1.0),
    "ball-rectangle-moving": Case("ball-gliding", rectangle_beside, 0.06, 1.0),
}


def run(only: Sequence[str] = (), cost: bool = True) -> list[dict[str, object]]:
    """Errors and costs of each case; prints them as they come.

    Args:
        only: Names of cases; none for all.
        cost: Whether to measure CPU time, and points of the same error.

    Returns:
        A row a case: ``case``, ``relative_rmse`` as chosen, with a quarter of the photons (``fewer``) and with four
        times as many (``more``), with one part a light in ``unsplit``, ``truth_error``, ``limit``, ``splits`` (as
        chosen), ``one_point`` (the error of as many photons from the middle of the light alone), ``cpu_ratio`` (by a
        frame of the same light without extent), and ``points``: for the error that was asked for and for that of the
        frame, ``wanted``, ``ours`` and ``theirs`` (least CPU seconds of the light, and of points, with that error,
        whatever numbers of photons and points take least), ``places`` (how many points that are; 1 for one in the
        middle of the light) and ``ratio`` (at least, where no points that were tried were as good: ``theirs`` is
        infinite then).
    """
    if unknown := [name for name in only if name not in CASES]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(CASES)}")
    rows = []
    photons = [f"{count // 1024} k" for count in (FEWER, PHOTONS, MORE)]
    columns = (*photons, "unsplit", "1 point", "limit", "truth")
    print(f"  {'case':22s} " + " ".join(f"{name:>7s}" for name in columns), end=" ")
    print(f"{'splits':>6s} {'CPU s':>6s} {'by point':>8s}  points of the same error: times the CPU time")
    for name in only or CASES:
        row = _measured(name, CASES[name], cost)
        rows.append(row)
        print(
            f"  {name:22s} {row['fewer']:7.4f} {row['relative_rmse']:7.4f} {row['more']:7.4f} {row['unsplit']:7.4f} "
            f"{row['one_point']:7.4f} {row['limit']:7.2f} "
            f"{row['truth_error']:7.4f} {row['splits']:6d} {row['cpu_seconds']:6.2f} {row['cpu_ratio']:8.2f}  "
            + "; ".join(map(_said, row["points"])),
            flush=True,
        )
    return rows


def keep(name: str) -> Path:
    """Makes the truth of a case and keeps it, irradiance as float16 (half a thousandth of each pixel); its path."""
    case = CASES[name]
    truth, error = _brute_force(case) if case.scene in SCENES else _sum_of_places(case)
    path = CONVERGED / f"extent-{name}.npz"
    np.savez_compressed(path, irradiance=truth.astype(np.float16), error=error)
    return path


def _brute_force(case: Case) -> tuple[np.ndarray, float]:
    """The light of a solid from plain photons, and its error by the root mean square of it."""
    scene = SCENES[case.scene]()
    meshes = scene.meshes
    if case.exposure == 0.0:
        meshes = tuple(
            replace(m, points=(m.points[0],) * 2, normals=m.normals and (m.normals[0],) * 2) for m in meshes
        )
    light = _light_of_oracle(_stages(case)[0], case.exposure)
    camera = replace(scene.camera, width=PIXELS, height=PIXELS)
    lit = brute_force.Scene(scene.name, meshes, (light,), camera, scene.view_is_clear)
    truth = brute_force.irradiance(lit, TRUTH_PHOTONS[case.scene], threads=1)
    rms = math.sqrt(np.mean(truth.irradiance**2))
    return truth.irradiance, truth.error * float(truth.irradiance[truth.mask].mean()) / rms


def _light_of_oracle(stage: Usd.Stage, exposure: float) -> brute_force.Light:
    """The light of a stage, as brute force has it."""
    prim = _light(stage)
    ends = [UsdGeom.XformCache(FRAME + step).GetLocalToWorldTransform(prim) for step in (0.0, exposure)]
    places = tuple(np.array(end.ExtractTranslation()) for end in ends)
    power = float(UsdLux.LightAPI(prim).GetIntensityAttr().Get())
    if prim.IsA(UsdLux.DistantLight):
        direction = -np.array(ends[0].GetRow3(2))
        angle = math.radians(UsdLux.DistantLight(prim).GetAngleAttr().Get())
        return brute_force.Light(str(prim.GetPath()), power, direction=direction, angle=angle)
    if prim.IsA(UsdLux.SphereLight):
        radius = float(UsdLux.SphereLight(prim).GetRadiusAttr().Get())
        return brute_force.Light(str(prim.GetPath()), math.pi * radius**2 * power, position=places, radius=radius)
    given: dict[str, object] = {}
    if prim.IsA(UsdLux.CylinderLight):
        tube = UsdLux.CylinderLight(prim)
        radius, half = float(tube.GetRadiusAttr().Get()), 0.5 * tube.GetLengthAttr().Get()
        area, sides, given["radius"] = 4.0 * radius * half, (half, 0.0), radius
    elif prim.IsA(UsdLux.DiskLight):
        radius = UsdLux.DiskLight(prim).GetRadiusAttr().Get()
        area, sides, given["rounded"] = math.pi * radius**2, (radius, radius), True
    else:
        panel = UsdLux.RectLight(prim)
        sides = 0.5 * panel.GetWidthAttr().Get(), 0.5 * panel.GetHeightAttr().Get()
        area = 4.0 * sides[0] * sides[1]
    spans = np.array([[sides[0], 0.0, 0.0], [0.0, sides[1], 0.0]])
    return brute_force.Light(str(prim.GetPath()), area * power, position=places, spans=spans, **given)


def _sum_of_places(case: Case) -> tuple[np.ndarray, float]:
    """The light of points at many places, and its error by the root mean square of it."""
    stage = tpdwarp.Scene(_stages(case)[0], **_options(case))
    # Another number of places is other places.
    halves = [
        _irradiance(stage, case, places=case.places + more, photons=case.photons, samples=1) for more in (0, 1)
    ]
    truth = 0.5 * (halves[0] + halves[1])
    return truth, math.sqrt(np.mean((halves[0] - halves[1]) ** 2) / np.mean(truth**2)) / 2.0


def kept(name: str) -> tuple[np.ndarray, float]:
    """The kept truth of a case and its own error; made if there is none."""
    path = CONVERGED / f"extent-{name}.npz"
    with np.load(path if path.exists() else keep(name)) as found:
        return found["irradiance"].astype(np.float64), float(found["error"])


def _measured(name: str, case: Case, cost: bool) -> dict[str, object]:
    stage, bare = (tpdwarp.Scene(stage, **_options(case)) for stage in _stages(case))
    truth, own = kept(name)

    def error(found: np.ndarray) -> float:
        return math.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2))

    frame = stage.render_frame(_frame(case), photons=PHOTONS)
    row: dict[str, object] = {
        "case": name,
        "limit": case.limit,
        "truth_error": own,
        "splits": frame.energy.counts.get("parts of each light with extent", 1),
        "relative_rmse": error(frame.channels["irradiance.R"].astype(np.float64)),
        "fewer": error(_irradiance(stage, case, photons=FEWER)),
        "more": error(_irradiance(stage, case, photons=MORE)),
        "unsplit": error(_irradiance(stage, case, light_splits=1)),
        "one_point": error(_irradiance(bare, case)),
    }
    # The kernels are loaded: each by turns. What else runs slows both of a turn, and few turns by much.
    seconds: dict[str, list[float]] = {"extent": [], "bare": []}
    _seconds(bare, case)
    for _ in range(TURNS if cost else 1):
        for kind, scene in (("extent", stage), ("bare", bare)):
            seconds[kind].append(_seconds(scene, case))
    ratios = [one / other for one, other in zip(seconds["extent"], seconds["bare"], strict=True)]
    of_frame = median(seconds["extent"])
    row |= {"cpu_seconds": of_frame, "cpu_ratio": median(ratios)}
    errors = (case.limit, row["relative_rmse"])
    row["points"] = _points_beside(stage, bare, case, error, errors) if cost else []
    return row


def _points_beside(
    stage: tpdwarp.Scene, bare: tpdwarp.Scene, case: Case, error: Callable[[np.ndarray], float], errors: Sequence[float]
) -> list[dict[str, float]]:
    """What points take beside a light with extent, both at their cheapest for each of some errors."""
    known: dict[tuple[int, int], tuple[float, float]] = {}

    def tried(places: int, photons: int) -> tuple[float, float]:
        """CPU seconds and error of a frame: of the light (0 places), its middle (1), or points at places on it."""
        if (places, photons) not in known:
            spent: list[float] = []
            while len(spent) < TRIES and sum(spent) < TRIES:
                start = time.process_time()
                found = _irradiance(bare if places == 1 else stage, case, places if places > 1 else 0, photons)
                spent.append(time.process_time() - start)
            known[places, photons] = min(spent), error(found)
        return known[places, photons]

    # What is compiled or chosen for the first frame.
    for places in (0, 1, 2):
        _irradiance(bare if places == 1 else stage, case, places if places > 1 else 0, LADDER[0])
    rows = []
    for wanted in errors:
        ours, worst = _least_seconds(lambda photons: tried(0, photons), LADDER, wanted, math.inf)
        best, places = math.inf, 1
        for count in (1, *POINT_PLACES):
            ladder = LADDER if count == 1 else POINT_PHOTONS
            most = min(best, MOST_RATIO * ours)
            found, spent = _least_seconds(lambda photons, n=count: tried(n, photons), ladder, wanted, most)
            worst = max(worst, spent)
            if found < best:
                best, places = found, count
        ratio = (worst if math.isinf(best) else best) / ours
        rows.append({"wanted": wanted, "ours": ours, "theirs": best, "places": places, "ratio": ratio})
    return rows


def _least_seconds(
    tried: Callable[[int], tuple[float, float]], ladder: Sequence[int], wanted: float, most: float
) -> tuple[float, float]:
    """The CPU time with which light errs by ``wanted``, and the longest tried: between two numbers of photons by the
    logarithms of both, infinite where no number that takes less than ``most`` is so good."""
    before: tuple[float, float] | None = None
    for photons in ladder:
        seconds, found = tried(photons)
        if found <= wanted:
            if before is None or before[1] <= found:
                return seconds, seconds
            part = math.log(before[1] / wanted) / math.log(before[1] / found)
            return before[0] * (seconds / before[0]) ** part, seconds
        if seconds >= most:
            break
        before = seconds, found
    return math.inf, seconds


def _said(points: dict[str, float]) -> str:
    at_least = ">" if math.isinf(points["theirs"]) else ""
    return f"{points['wanted']:.4f}: {at_least}{points['ratio']:.1f} ({points['places']} in {points['theirs']:.2f} s)"


def _stages(case: Case) -> tuple[Usd.Stage, Usd.Stage]:
    """The stage with a light of some extent, and the same without."""
    stages = []
    for extended in (True, False):
        path = SHIPPED / f"{case.scene}.usdc"
        layer = Sdf.Layer.CreateAnonymous(".usdc")
        if path.exists():
            layer.TransferContent(Sdf.Layer.FindOrOpen(str(path)))
        else:
            with tempfile.TemporaryDirectory() as folder:
                layer.TransferContent(Sdf.Layer.FindOrOpen(str(write_solid(case.scene, Path(folder)))))
        stage = Usd.Stage.Open(layer)
        case.light(stage)
        if not extended:
            light = _light(stage)
            if light.IsA(UsdLux.DistantLight):
                UsdLux.DistantLight(light).GetAngleAttr().Set(0.0)
            elif light.IsA(UsdLux.SphereLight):
                UsdLux.SphereLight(light).CreateTreatAsPointAttr(True)
            else:
                place = UsdGeom.Xformable(light).ComputeLocalToWorldTransform(FRAME).ExtractTranslation()
                stage.RemovePrim(light.GetPath())
                point = UsdLux.SphereLight.Define(stage, light.GetPath())
                point.CreateTreatAsPointAttr(True)
                point.AddTranslateOp().Set(place)
        stages.append(stage)
    return stages[0], stages[1]


def _options(case: Case) -> dict[str, object]:
    camera = CAMERA if case.scene in SCENES else "/World/TopOrtho"
    return {**COMMON, "camera": camera, "exposure": case.exposure}


def _frame(case: Case) -> float:
    return float(FRAME) if case.scene in SCENES else 4.0


def _irradiance(
    scene: tpdwarp.Scene, case: Case, places: int = 0, photons: int = PHOTONS, **settings: object
) -> np.ndarray:
    """Irradiance from photons, first channel; from points at ``places`` places where there are any."""
    options = {"photons": photons, **settings}
    if places:
        options |= {"estimator": "accumulation", "accumulation_times": places}
    frame = scene.render_frame(_frame(case), **options)
    return frame.channels["irradiance.R"].astype(np.float64)


def _seconds(scene: tpdwarp.Scene, case: Case) -> float:
    """CPU time of a frame of an open scene, with as many parts a light as are chosen."""
    start = time.process_time()
    scene.render_frame(_frame(case), photons=PHOTONS)
    return time.process_time() - start


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures lights with extent.")
    parser.add_argument("case", nargs="*", help=f"which of {', '.join(CASES)}; all by default")
    parser.add_argument("--keep", action="store_true", help="make the truths anew")
    parser.add_argument("--no-cost", action="store_true", help="measure errors alone")
    parser.add_argument("--json", type=Path, help="also write the results to this file")
    options = parser.parse_args()
    for name in options.case:
        if name not in CASES:
            parser.error(f"there is no case {name!r}; there are {', '.join(CASES)}")
    if options.keep:
        for name in options.case or CASES:
            start = time.process_time()
            print(f"  {keep(name).name}: {time.process_time() - start:.0f} CPU s", flush=True)
        return 0
    rows = run(options.case, not options.no_cost)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
