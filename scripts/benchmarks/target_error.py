"""The error that --target-error asks for beside the one that comes out, against light that has converged."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from truths import FRAMES, SCENES, WIDTH, kept_truth, light_of, relative_error, truth_of

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tpdwarp.jobs.opening import open_scene, shutter_of, spread_shutters
from tpdwarp.rendering.error_target import settled
from tpdwarp.settings import Settings

WANTED = (0.1, 0.05, 0.02)
# Relative RMSE that truths are to have, and the levels after which they are left as they are.
EXACT, LEVELS = 0.005, 5
# Where a truth errs by more than this part of what is wanted, it tells nothing.
LARGEST_PART = 0.3
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "wave": ("wave", {}),
    "wave, exposure 0": ("wave", {"exposure": 0.0}),
    "wave, exposure 3": ("wave", {"exposure": 3.0}),
    "wave, from above": ("wave", {"camera": "TopOrtho"}),
    "wave, cubic motion": ("wave", {"motion": "cubic"}),
    "cylinder, exposure 0": ("cylinder", {"exposure": 0.0}),
    "cylinder, from above": ("cylinder", {"camera": "TopOrtho"}),
    "cylinder, exposure 2": ("cylinder", {"camera": "TopOrtho", "exposure": 2.0}),
    "mirror": ("mirror", {}),
    "mirror, exposure 0": ("mirror", {"exposure": 0.0}),
    "mirror, from above": ("mirror", {"camera": "TopOrtho"}),
    "mirror, exposure 3": ("mirror", {"exposure": 3.0}),
    "sea": ("sea", {}),
    "sea, exposure 0": ("sea", {"exposure": 0.0}),
    "sea, exposure 3": ("sea", {"exposure": 3.0}),
}


def run() -> list[dict[str, object]]:
    """For each case and wanted error: what was chosen, the error expected, and the true one at the same samples.

    The pilot's CPU time is given in frames.
    """
    print(f"relative RMSE at {WIDTH} pixels across, frames {', '.join(map(str, FRAMES))}")
    titles = f"{'photons':>9s} {'K':>3s} {'expected':>9s} {'true':>7s} {'true/wanted':>12s} {'pilot':>6s}"
    print(f"  {'case':22s} {'wanted':>7s} {titles}")
    results = []
    for name, (scene, changes) in CASES.items():
        base = Settings(image_width=WIDTH, aovs=("caustic",), **{"exposure": 1.0, **changes})
        source = open_scene(SCENES / f"{scene}.usdc", base, False)
        size = source.resolution()
        spread = spread_shutters(source, base)
        shutters = [shutter_of(source, frame, base) for frame in FRAMES]
        truth = kept_truth(name) or truth_of(source, shutters, base, size, EXACT, LEVELS)
        print(f"  {name:22s} truth errs by {truth.error:.4f} ({truth.segments} × {truth.photons})")
        for wanted in WANTED:
            start = time.process_time()
            chosen, target = settled(source, Settings.of(base, target_error=wanted), spread, *size)
            settling = time.process_time() - start
            start = time.process_time()
            error = relative_error(light_of(source, shutters, chosen, size), truth.light)
            pilot = settling / (time.process_time() - start) * len(shutters)
            row = (target.photons, target.segments, target.expected, error, error / wanted, pilot)
            print(
                f"  {name:22s} {wanted:7.2f} {row[0]:9d} {row[1]:3d} {row[2]:9.4f} {row[3]:7.4f} {row[4]:12.2f} "
                f"{row[5]:6.1f}",
                flush=True,
            )
            keys = ("case", "wanted", "photons", "segments", "expected", "true", "ratio", "pilot")
            results.append(
                {**dict(zip(keys, (name, wanted, *map(float, row)), strict=True)), "truth_error": truth.error}
            )
    told = [row["ratio"] for row in results if row["truth_error"] <= LARGEST_PART * row["wanted"]]
    ratios = np.array(told)
    within = np.mean((ratios > 0.5) & (ratios < 2))
    print(
        f"  true/wanted from {ratios.min():.2f} to {ratios.max():.2f}; {within:.0%} in 0.5 … 2; "
        f"{len(results) - len(told)} left out, whose truth has not converged"
    )
    return results
