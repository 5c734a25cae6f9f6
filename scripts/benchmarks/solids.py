#!/usr/bin/env python3
"""Error of the renderer on moving solids against brute force in double precision, and what it costs.

.venv/bin/python scripts/benchmarks/solids.py                         # every scene whose truth is kept
.venv/bin/python scripts/benchmarks/solids.py ball-gliding --quick    # 16 384 photons only
.venv/bin/python scripts/benchmarks/solids.py --settings default --photons 16384 --photons 65536    # README's table
.venv/bin/python scripts/benchmarks/solids.py --best                  # automatic segments beside the best number
.venv/bin/python scripts/benchmarks/solids.py --target-error 0.1 --target-error 0.05    # asked and got
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import tpdwarp
from tpdwarp.jobs.opening import open_scene, spread_shutters
from tpdwarp.rendering.error_target import settled
from tpdwarp.settings import Settings
from usd_scenes.brute_force import Truth
from usd_scenes.kept_truths import FOLDER, kept_truth
from usd_scenes.solids import SCENES, write
from usd_scenes.stage import CAMERA, FRAME

PHOTONS = (1 << 12, 1 << 14, 1 << 16, 1 << 18)
MOST_PHOTONS = 1 << 20
SETTINGS: dict[str, dict[str, Any]] = {"default": {}, "one": {"segments": 1}}
SAMPLES = 4
# A ball, a flat solid, an edge in time: together a few seconds at 16 384 photons.
QUICK_SCENES = ("ball-gliding", "cube-turning", "board-over-water")
QUICK_PHOTONS = (1 << 14,)
# Scenes on which errors are asked for: a ball, flat and bent solids, a board over a pool, a mirror ring.
ASKED = ("ball-gliding", "cube-turning", "torus-turning-10", "blob-turning", "board-over-water", "cardioid")
# Numbers of segments that automatic ones are compared with.
NUMBERS_OF_SEGMENTS = (1, 2, 4, 8, 16)


def run(
    scenes: Sequence[str] = (), photons: Sequence[int] = PHOTONS, settings: Sequence[str] = tuple(SETTINGS)
) -> list[dict[str, object]]:
    """Errors of each scene at each number of photons; prints them as they come.

    Args:
        scenes: Names of scenes; none for all whose truth is kept.
        photons: Photons a frame.
        settings: Names of :data:`SETTINGS`.

    Returns:
        A row a render: ``scene``, ``settings``, ``photons``, ``relative_rmse`` (by the truth's mean, within its mask),
        ``truth_error`` (the truth's own), ``irradiance_ratio`` (of the means), ``deposited`` and ``lost`` (shares of
        the flux sent, the latter by cause), ``true_deposited``, ``beside`` and ``true_beside`` (what of that does not
        lie in the picture, or not in its mask), ``cpu_seconds`` and ``slope`` (of the error with photons since the row
        before, or None).
    """
    rows: list[dict[str, object]] = []
    print(f"  {'scene':22s} {'settings':9s} {'photons':>8s} {'rel.RMSE':>9s} {'slope':>6s} {'mean':>6s}", end=" ")
    print(f"{'landed':>7s} {'(true)':>7s} {'beside':>7s} {'(true)':>7s} {'lost':>8s} {'CPU s':>6s}")
    for name in scenes or [name for name in SCENES if (FOLDER / f"{name}.npz").exists()]:
        scene = SCENES[name]()
        truth = kept_truth(scene)
        in_picture = truth.irradiance[truth.mask].sum() * scene.camera.pixel**2 / truth.energy["sent"]
        print(f"  {name}: the truth errs by {truth.error:.4f}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            stage = write(name, Path(folder))
            for chosen in settings:
                before: dict[str, object] | None = None
                # Kernels are compiled, or loaded, by a render that is not timed.
                _measured(stage, truth, photons=1 << 10, **SETTINGS[chosen])
                for count in photons:
                    row = {"scene": name, "settings": chosen, "photons": count, "slope": None}
                    row |= _measured(stage, truth, photons=count, **SETTINGS[chosen])
                    row["beside"] = row["deposited"] - row["irradiance_ratio"] * in_picture
                    row["true_beside"] = row["true_deposited"] - in_picture
                    if before is not None:
                        change = math.log(row["relative_rmse"] / before["relative_rmse"])
                        row["slope"] = change / math.log(count / before["photons"])
                    rows.append(row)
                    before = row
                    _print(row)
    return rows


def quick() -> list[dict[str, object]]:
    """A few scenes with few photons and default settings; for tests."""
    return run(QUICK_SCENES, QUICK_PHOTONS, ("default",))


def compare_segments(scenes: Sequence[str] = (), photons: int = 1 << 16) -> list[dict[str, object]]:
    """The error of automatic segments beside that of fixed numbers of them; prints a row a scene.

    Returns:
        A row a scene: ``scene``, ``photons``, ``chosen`` (number of segments), ``relative_rmse`` (of these),
        ``truth_error``, ``errors`` (by number) and ``ratio`` (to the least of them).
    """
    rows: list[dict[str, object]] = []
    numbers = " ".join(f"{f'K = {number}':>7s}" for number in NUMBERS_OF_SEGMENTS)
    print(f"  {'scene':22s} {numbers} {'auto':>7s} {'of':>3s} {'ratio':>6s} {'truth':>7s}")
    for name in scenes or [name for name in SCENES if (FOLDER / f"{name}.npz").exists()]:
        truth = kept_truth(SCENES[name]())
        with tempfile.TemporaryDirectory() as folder:
            stage = write(name, Path(folder))
            found = _measured(stage, truth, photons=photons)
            fixed = {
                number: float(_measured(stage, truth, photons=photons, segments=number)["relative_rmse"])
                for number in NUMBERS_OF_SEGMENTS
            }
        error = float(found["relative_rmse"])
        ratio = error / min(*fixed.values(), error)
        rows.append({"scene": name, "photons": photons, "chosen": found["segments"], "relative_rmse": error})
        rows[-1] |= {"truth_error": truth.error, "errors": fixed, "ratio": ratio}
        errors = " ".join(f"{value:7.4f}" for value in fixed.values())
        print(f"  {name:22s} {errors} {error:7.4f} {found['segments']:3d} {ratio:6.2f} {truth.error:7.4f}", flush=True)
    return rows


def compare_targets(scenes: Sequence[str], wanted: Sequence[float]) -> list[dict[str, object]]:
    """The error that is asked for beside the one that comes out, and what the pilot costs; prints a row each.

    Returns:
        A row a scene and wanted error: ``scene``, ``wanted``, ``photons``, ``chosen`` (segments), ``expected``,
        ``relative_rmse``, ``truth_error``, ``pilot_seconds`` and ``cpu_seconds`` (of the frame).
    """
    rows: list[dict[str, object]] = []
    print(f"  {'scene':18s} {'asked':>6s} {'photons':>8s} {'K':>3s} {'told':>6s} {'got':>6s}", end=" ")
    print(f"{'got/asked':>9s} {'truth':>6s} {'pilot s':>8s} {'frame s':>8s} {'frames':>6s}")
    for name in scenes or ASKED:
        truth = kept_truth(SCENES[name]())
        size = truth.irradiance.shape[::-1]
        with tempfile.TemporaryDirectory() as folder:
            stage = write(name, Path(folder))
            _measured(stage, truth, photons=1 << 10)
            for asked in wanted:
                settings = Settings(
                    camera=CAMERA, image_width=size[0], exposure=1.0, samples=SAMPLES, target_error=asked
                )
                source = open_scene(stage, settings, False)
                start = time.process_time()
                found, target = settled(source, settings, spread_shutters(source, settings), *size)
                pilot = time.process_time() - start
                chosen = {"photons": found.photons, "segments": found.segments, "samples": found.samples}
                row = {"scene": name, "wanted": asked, "chosen": found.segments, "expected": target.expected}
                row |= {"photons": found.photons, "pilot_seconds": pilot} | _measured(stage, truth, **chosen)
                rows.append(row)
                error, seconds = float(row["relative_rmse"]), float(row["cpu_seconds"])
                print(
                    f"  {name:18s} {asked:6.3f} {found.photons:8d} {found.segments:3d} {target.expected:6.3f} "
                    f"{error:6.3f} {error / asked:9.2f} {truth.error:6.3f} {pilot:8.1f} {seconds:8.1f} "
                    f"{pilot / seconds:6.1f}",
                    flush=True,
                )
    return rows


def _measured(stage: Path, truth: Truth, **settings: Any) -> dict[str, object]:
    """One render compared with the truth."""
    picture = stage.with_suffix(".exr")
    start = time.process_time()
    result = tpdwarp.render(
        stage,
        picture,
        frames=FRAME,
        camera=CAMERA,
        image_width=truth.irradiance.shape[1],
        aovs=("irradiance",),
        exposure=1.0,
        **{"samples": SAMPLES, **settings},
    )
    seconds = time.process_time() - start
    found = channel(picture, "irradiance.R")
    difference, mean = (found - truth.irradiance)[truth.mask], truth.irradiance[truth.mask].mean()
    energy = result.energy[float(FRAME)]
    receivers = sum(watts for name, watts in truth.energy.items() if name.startswith("/"))
    return {
        "relative_rmse": float(np.sqrt(np.mean(difference**2)) / mean),
        "truth_error": truth.error,
        "irradiance_ratio": float(found[truth.mask].mean() / mean),
        "deposited": energy.deposited / energy.sent,
        "true_deposited": receivers / truth.energy["sent"],
        "segments": int(energy.counts["segments traced"]),
        "lost": {cause: watts / energy.sent for cause, watts in energy.lost.items() if watts},
        "cpu_seconds": seconds,
    }


def channel(path: Path, name: str) -> np.ndarray:
    """One channel of an image, shape [height, width] float64."""
    pixels = oiio.ImageBuf(str(path))
    return pixels.get_pixels(oiio.FLOAT)[:, :, pixels.spec().channelindex(name)].astype(np.float64)


def _print(row: dict[str, Any]) -> None:
    slope = "" if row["slope"] is None else f"{row['slope']:.2f}"
    causes = ", ".join(f"{cause} {share:.1e}" for cause, share in row["lost"].items())
    print(
        f"  {row['scene']:22s} {row['settings']:9s} {row['photons']:8d} {row['relative_rmse']:9.4f} {slope:>6s} "
        f"{row['irradiance_ratio']:6.3f} {row['deposited']:7.4f} {row['true_deposited']:7.4f} "
        f"{row['beside']:7.4f} {row['true_beside']:7.4f} "
        f"{sum(row['lost'].values()):8.1e} {row['cpu_seconds']:6.2f}  {causes}",
        flush=True,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures errors on moving solids.")
    parser.add_argument("scene", nargs="*", help=f"which of {', '.join(SCENES)}; by default all that have a truth")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_PHOTONS[0]} photons and default settings only")
    parser.add_argument("--most", action="store_true", help=f"also {MOST_PHOTONS} photons")
    parser.add_argument("--photons", type=int, action="append", help="photons a frame, in place of the usual numbers")
    parser.add_argument("--settings", choices=SETTINGS, action="append", help="one: one segment; all by default")
    parser.add_argument("--best", action="store_true", help="automatic segments beside fixed numbers of them")
    parser.add_argument("--target-error", type=float, action="append", help="asks for this error")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    options = parser.parse_args()
    for name in options.scene:
        if name not in SCENES:
            parser.error(f"there is no scene {name!r}; there are {', '.join(SCENES)}")
    photons = tuple(options.photons or ((*PHOTONS, MOST_PHOTONS) if options.most else PHOTONS))
    if options.target_error:
        rows = compare_targets(options.scene, options.target_error)
    elif options.best:
        rows = [row for count in options.photons or (1 << 16,) for row in compare_segments(options.scene, count)]
    elif options.quick:
        rows = run(options.scene or QUICK_SCENES, QUICK_PHOTONS, ("default",))
    else:
        rows = run(options.scene, photons, options.settings or tuple(SETTINGS))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
