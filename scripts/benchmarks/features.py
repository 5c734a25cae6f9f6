"""What a stage that has none of them pays for features: the shipped wave against the commit before they came.

Shapes, subdivision, textures, domes, curves, dialects of materials and lights with extent are compiled in and paid for
only where a stage has them, so that the wave takes no longer than before (asked: within 2 %). Both trees render the
same frames by turns, in processes of their own, through the function that users call; medians of the turns count. A few
frames are rendered first, so that kernels are compiled. Both have one segment: since then the number of segments is
chosen from the stage by default, which is no feature of stages and takes a few frames' time once a call.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# The commit before stages without a camera were framed, the first of these features.
BEFORE = "eb383e6"
ASKED = 1.02
# An odd number has a middle. Chosen, not derived: with seven the median of a quiet machine's ratio keeps to 1 %.
TURNS = 7
ROWS = {
    "wave": {"image_width": 512, "photons": 1 << 14},
    "wave-small": {"image_width": 128, "photons": 1 << 12},
    "wave-photons": {"image_width": 256, "photons": 1 << 18, "samples": 1},
}
_FRAMES = """
import json, sys, time, tpdwarp
stage, image, options = sys.argv[1], sys.argv[2], {"camera": "TopOrtho", "segments": 1, **json.loads(sys.argv[3])}
assert tpdwarp.render(stage, image, frames="1:2", **options).ok
start = time.process_time()
assert tpdwarp.render(stage, image, frames="3:8", **options).ok
print(json.dumps([time.process_time() - start, time.process_time()]))
"""


def run(only: Sequence[str] = ()) -> dict[str, dict[str, float]]:
    """Median CPU seconds of six frames and of the whole process, before and now, and their ratios, by row."""
    if unknown := [name for name in only if name not in ROWS]:
        raise SystemExit(f"there is no row {unknown[0]!r}; there are {', '.join(ROWS)}")
    if subprocess.run(["git", "cat-file", "-e", BEFORE], cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode:
        print(f"  skipped: this clone does not hold commit {BEFORE}")
        return {}
    print(f"  {'six frames':14s} {'before':>8s} {'now':>8s} {'ratio':>6s}   {'process':>8s} {'now':>8s} {'ratio':>6s}")
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", tree, BEFORE], cwd=ROOT, check=True)
        try:
            for name, settings in ROWS.items():
                if not only or name in only:
                    rows[name] = _compared(settings, {"before": tree, "now": ROOT}, Path(folder))
                    _print(name, rows[name])
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", tree], cwd=ROOT, check=True)
    return rows


def _compared(settings: dict[str, int], trees: dict[str, Path], folder: Path) -> dict[str, float]:
    """Medians of both trees by turns, after one turn that is not counted: it compiles."""
    taken: dict[str, list[tuple[float, float]]] = {which: [] for which in trees}
    for turn in range(TURNS + 1):
        for which, root in trees.items():
            measured = _measured(root, settings, folder / f"{which}.{turn}.####.exr")
            taken[which] += [measured] if turn else []
    row = {}
    for which, found in taken.items():
        row[f"frames {which}"], row[f"process {which}"] = map(statistics.median, zip(*found, strict=True))
    # Of each turn by itself: what disturbs the machine for longer than a turn disturbs both.
    for number, what in enumerate(("frames", "process")):
        pairs = zip(taken["now"], taken["before"], strict=True)
        row[f"{what} ratio"] = statistics.median(now[number] / before[number] for now, before in pairs)
    return row


def _measured(root: Path, settings: dict[str, int], image: Path) -> tuple[float, float]:
    stage = ROOT / "usd_scenes" / "wave.usdc"
    command = [sys.executable, "-c", _FRAMES, str(stage), str(image), json.dumps(settings)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    # Users keep compiled modules of Python from one process to the next.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(command, cwd=root, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    frames, process = json.loads(done.stdout.splitlines()[-1])
    return frames, process


def _print(name: str, row: dict[str, float]) -> None:
    parts = [
        f"{row[f'{what} before']:8.2f} {row[f'{what} now']:8.2f} {row[f'{what} ratio']:6.3f}"
        for what in ("frames", "process")
    ]
    kept = "" if row["frames ratio"] <= ASKED else f"   asked {ASKED}"
    print(f"  {name:14s} {'   '.join(parts)}{kept}", flush=True)


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1:])))
