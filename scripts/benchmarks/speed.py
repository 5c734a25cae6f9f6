"""CPU seconds of frames against an earlier commit, by turns in one run, and against what was asked of them.

Both trees render the same scenes in processes of their own, so that a noisy machine is noisy for both: the ratios
count. A process renders with few photons first, so that what it measures is a further frame of a sequence. Rows are run
alone with ``run.py speed --only ROW``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
# Run as a program it measures the package that PYTHONPATH names.
if __name__ != "__main__":
    sys.path.insert(0, str(ROOT))

# The commit before faint light was gathered on rasters.
BEFORE = "f57e6d1"
# Cases that took less than this many CPU seconds before are measured twice: short ones are the noisier.
SHORT = 15.0
# Photons of the frame that is not measured.
WARM_PHOTONS = 1024


@dataclass(frozen=True)
class Case:
    """A scene with its options, and what a further frame of it is to cost.

    Attributes:
        what: In words.
        scene: A shipped stage, or a name of ``usd_scenes.solids``.
        settings: Of the render; the truth that is kept for a solid is compared with where they name no size.
        asked: CPU seconds that were asked for; None where only a ratio was.
        asked_ratio: How many times less than before.
    """

    what: str
    scene: str
    settings: dict[str, Any]
    asked: float | None = None
    asked_ratio: float | None = None


TOP = {"camera": "TopOrtho"}
CASES = {
    "cylinder": Case("cylinder 512², 65 k photons, 4 samples", "cylinder", {"image_width": 512, **TOP}, 2.0, 20.0),
    "ball": Case("ball gliding, 96², 65 k photons", "ball-gliding", {}, 1.0),
    "ball-large": Case("ball gliding, 256², 65 k photons", "ball-gliding", {"image_width": 256}, 1.0),
    "torus": Case("torus turning, 96², 65 k photons", "torus-turning-10", {}, 1.0),
    "blob": Case("blob turning, 96², 65 k photons", "blob-turning", {}, 1.0),
    "cube": Case("cube turning, 96², 65 k photons", "cube-turning", {}),
    "tumbler": Case(
        "tumbler with ice, 720 wide, 16 k photons", "tumbler", {"image_width": 720, "photons": 1 << 14}, 4.0
    ),
    "wave": Case(
        "wave 512², 16 k photons, 4 samples", "wave", {"image_width": 512, "photons": 1 << 14, **TOP}, 0.5
    ),
    "wave-million": Case(
        "wave 512², 1 M photons, 1 sample", "wave",
        {"image_width": 512, "photons": 1_000_000, "samples": 1, **TOP}, 4.0,
    ),
    "wave-large": Case(
        "wave 2048², 16 k photons, 1 sample", "wave",
        {"image_width": 2048, "photons": 1 << 14, "samples": 1, **TOP}, 3.0,
    ),
    "sea": Case(
        "sea 480 wide, 16 k photons, 16 samples", "sea", {"image_width": 480, "photons": 1 << 14, "samples": 16},
        None, 10.0,
    ),
    "sea-large": Case(
        "sea 1920 wide, 16 k photons, 16 samples", "sea", {"image_width": 1920, "photons": 1 << 14, "samples": 16},
        None, 10.0,
    ),
}  # fmt: skip
FRAMES = {"wave": 3, "cylinder": 5, "sea": 5, "tumbler": 5}
# Solids are frame 1 of their stages.
SOLID_FRAME = 1


def run(only: Sequence[str] = ()) -> list[dict[str, object]]:
    """For each case: CPU seconds of a further frame before and now, by stage, their ratio, and errors where known.

    Args:
        only: Names of cases; none for all.
    """
    if unknown := [name for name in only if name not in CASES]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(CASES)}")
    if subprocess.run(["git", "cat-file", "-e", BEFORE], cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode:
        print(f"  skipped: this clone does not hold commit {BEFORE}")
        return []
    rows: list[dict[str, object]] = []
    print(f"  {'what':44s} {'before':>8s} {'now':>8s} {'ratio':>6s} {'asked':>8s}  error before, now; stages now")
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", tree, BEFORE], cwd=ROOT, check=True)
        try:
            for name, case in CASES.items():
                if not only or name in only:
                    rows.append({"case": name, "what": case.what, **_compared(case, tree, Path(folder))})
                    _print(rows[-1])
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", tree], cwd=ROOT, check=True)
    return rows


def _compared(case: Case, tree: Path, folder: Path) -> dict[str, object]:
    """Both trees by turns: the least of each, since others on the machine only ever add."""
    stage = _stage(case.scene, folder)
    trees = {"before": tree, "now": ROOT}
    found = {which: [_measured(root, case, stage)] for which, root in trees.items()}
    if found["before"][0]["cpu_seconds"] < SHORT:
        for which, root in trees.items():
            found[which].append(_measured(root, case, stage))
    least = {which: min(taken, key=lambda one: one["cpu_seconds"]) for which, taken in found.items()}
    return {
        "cpu_seconds_before": least["before"]["cpu_seconds"],
        "cpu_seconds": least["now"]["cpu_seconds"],
        "ratio": least["before"]["cpu_seconds"] / least["now"]["cpu_seconds"],
        "process_before": min(one["process"] for one in found["before"]),
        "process": min(one["process"] for one in found["now"]),
        "asked": case.asked,
        "asked_ratio": case.asked_ratio,
        "error_before": least["before"]["error"],
        "error": least["now"]["error"],
        "stages": least["now"]["stages"],
    }


def _stage(scene: str, folder: Path) -> Path:
    shipped = ROOT / "usd_scenes" / f"{scene}.usdc"
    if shipped.exists():
        return shipped
    from usd_scenes.solids import write

    return write(scene, folder)


def _measured(root: Path, case: Case, stage: Path) -> dict[str, Any]:
    """One process of the package in ``root``: its CPU seconds, those of its frame, and the frame's error."""
    request = json.dumps({"scene": case.scene, "stage": str(stage), "settings": case.settings})
    environment = {**os.environ, "PYTHONPATH": str(root)}
    start = os.times()
    done = subprocess.run(
        [sys.executable, str(Path(__file__).resolve()), request],
        cwd=root, env=environment, check=True, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    end = os.times()
    process = end.children_user + end.children_system - start.children_user - start.children_system
    return {**json.loads(done.stdout.splitlines()[-1]), "process": process}


def _further_frame(request: dict[str, Any]) -> dict[str, Any]:
    """Renders a frame after another one, with whatever package is on the path."""
    import time
    from dataclasses import replace

    import numpy as np

    from tpdwarp.clock import Clock
    from tpdwarp.rendering.context import RenderContext
    from tpdwarp.rendering.frame import render_frame
    from tpdwarp.settings import Settings
    from tpdwarp.usd.read.stage import StageScene

    truth, options = None, dict(request["settings"])
    if request["scene"] not in FRAMES:
        options |= {"exposure": 1.0, "aovs": ("irradiance",), "camera": "/World/Camera"}
        if "image_width" not in options:
            from usd_scenes.kept_truths import kept_truth
            from usd_scenes.solids import SCENES

            truth = kept_truth(SCENES[request["scene"]]())
            options["image_width"] = truth.irradiance.shape[1]
    settings = Settings(**options)
    source = StageScene.open(request["stage"], settings)
    context = RenderContext(source, settings)
    shutter = source.shutter(FRAMES.get(request["scene"], SOLID_FRAME), settings)
    render_frame(RenderContext(source, replace(settings, photons=WARM_PHOTONS)), shutter, *source.resolution())
    context.segmentation.count(shutter, Clock())
    clock, start = Clock(), time.process_time()
    frame = render_frame(context, shutter, *source.resolution(), clock)
    seconds = time.process_time() - start
    error = None
    if truth is not None:
        difference = (frame.channels["irradiance.R"] - truth.irradiance)[truth.mask]
        error = float(np.sqrt(np.mean(difference**2)) / truth.irradiance[truth.mask].mean())
    stages = {**clock.cpu_seconds, "in no stage": seconds - sum(clock.cpu_seconds.values())}
    return {"cpu_seconds": seconds, "stages": stages, "error": error}


def _print(row: dict[str, Any]) -> None:
    asked = f"{row['asked']:.2f}" if row["asked"] else f"{row['asked_ratio']:.0f} ×" if row["asked_ratio"] else ""
    errors = f"{row['error_before']:.4f}, {row['error']:.4f}; " if row["error"] is not None else ""
    stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in row["stages"].items() if seconds >= 0.005)
    print(
        f"  {row['what']:44s} {row['cpu_seconds_before']:8.2f} {row['cpu_seconds']:8.2f} {row['ratio']:6.2f} "
        f"{asked:>8s}  {errors}{stages}",
        flush=True,
    )


if __name__ == "__main__":
    print(json.dumps(_further_frame(json.loads(sys.argv[1]))))
