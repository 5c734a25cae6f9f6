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
# Points into which a light is split to compare costs: their number, and photons of each.
POINT_PLACES = (4, 16, 64, 256)
POINT_PHOTONS = (1 << 10, 1 << 12, 1 << 14, 1 << 16)
# No more of a frame's time is spent on points: what was asked for is 20 times.
MOST_RATIO = 80.0
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
        frame of the same light without extent) and ``points_ratio`` (CPU time of points with the same error, by that of
        the frame; at least, where no number of points tried was as good; NaN where one point is as good).
    """
    if unknown := [name for name in only if name not in CASES]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(CASES)}")
    rows = []
    photons = [f"{count // 1024} k" for count in (FEWER, PHOTONS, MORE)]
    columns = (*photons, "unsplit", "1 point", "limit", "truth")
    print(f"  {'case':22s} " + " ".join(f"{name:>7s}" for name in columns), end=" ")
    print(f"{'splits':>6s} {'CPU s':>6s} {'by point':>8s} {'of points':>9s}")
    for name in only or CASES:
        row = _measured(name, CASES[name], cost)
        rows.append(row)
        at_least = ">" if row["points_at_least"] else " "
        print(
            f"  {name:22s} {row['fewer']:7.4f} {row['relative_rmse']:7.4f} {row['more']:7.4f} {row['unsplit']:7.4f} "
            f"{row['one_point']:7.4f} {row['limit']:7.2f} "
            f"{row['truth_error']:7.4f} {row['splits']:6d} {row['cpu_seconds']:6.2f} {row['cpu_ratio']:8.2f} "
            f"{at_least}{row['points_ratio']:8.1f}",
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
    best, worst = math.nan, math.nan
    # Where one point is as good, an extent saves nothing, and a ratio would say what many points cost.
    if cost and row["one_point"] > row["relative_rmse"]:
        best, worst = _seconds_of_points(stage, case, error, row["relative_rmse"], MOST_RATIO * of_frame)
    row["points_at_least"] = math.isinf(best)
    row["points_ratio"] = (worst if math.isinf(best) else best) / of_frame
    return row


def _seconds_of_points(
    stage: tpdwarp.Scene, case: Case, error: Callable[[np.ndarray], float], wanted: float, most: float
) -> tuple[float, float]:
    """The least CPU time of points that err by no more than ``wanted``, of all that are tried, and the most tried.

    For each number of places, photons are doubled until that is reached, or takes longer than the best, or ``most``.
    """
    best, worst = math.inf, 0.0
    for count in POINT_PLACES:
        for photons in POINT_PHOTONS:
            start = time.process_time()
            found = _irradiance(stage, case, places=count, photons=photons)
            spent = time.process_time() - start
            worst = max(worst, spent)
            if error(found) <= wanted:
                best = min(best, spent)
            if spent >= min(best, most):
                break
    return best, worst


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
