"""What laying the house anew changed: frames of the shipped scenes before and after it, bit by bit, and their time.

Both commits are checked out side by side and rendered by turns, so that a noisy machine is noisy for both.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

ROOT = Path(__file__).resolve().parents[2]
# The last commit of the old house, and the first one whose rooms and words are all in place.
BEFORE, AFTER = "bea2861", "0e33542"
AOVS = "caustic,direct,irradiance,motion,photons,Z,N,P"
CASES: dict[str, tuple[str, ...]] = {
    **{f"{scene}, defaults": (scene,) for scene in ("wave", "cylinder", "mirror", "sea")},
    **{f"{scene}, auto": (scene, "--segments", "auto") for scene in ("wave", "cylinder", "mirror", "sea")},
    "wave, paper": ("wave", "--preset", "paper"),
    "wave, distribution": ("wave", "--estimator", "distribution", "--accumulation-times", "8"),
    "sea, pd": ("sea", "--estimator", "pd"),
    "mirror, cubic": ("mirror", "--motion", "cubic", "--samples", "16"),
}
TURNS = 3


def run() -> list[dict[str, object]]:
    """For each case: whether all channels of both commits are the same bits, and the ratio of their seconds a frame."""
    if subprocess.run(["git", "cat-file", "-e", BEFORE], cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode:
        print(f"  skipped: this clone does not hold commit {BEFORE}")
        return []
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder:
        trees = {commit: _checked_out(commit, Path(folder)) for commit in (BEFORE, AFTER)}
        try:
            for name, (scene, *options) in CASES.items():
                seconds: dict[str, list[float]] = {commit: [] for commit in trees}
                for turn in range(TURNS):
                    for commit, tree in trees.items():
                        seconds[commit].append(_render(tree, scene, options, Path(folder) / f"{commit}.exr"))
                    if turn == 0:
                        same = _same(Path(folder) / f"{BEFORE}.exr", Path(folder) / f"{AFTER}.exr")
                        # The first turn compiles.
                        seconds = {commit: [] for commit in trees}
                ratio = statistics.median(seconds[AFTER]) / statistics.median(seconds[BEFORE])
                rows.append({"case": name, "identical": same, "seconds_ratio": ratio})
                print(f"  {name:22s} {'identical' if same else 'DIFFERENT'}   {ratio:5.2f} × the time", flush=True)
        finally:
            for tree in trees.values():
                subprocess.run(["git", "worktree", "remove", "--force", tree], cwd=ROOT, check=True)
    return rows


def _checked_out(commit: str, folder: Path) -> Path:
    tree = folder / f"tree-{commit}"
    subprocess.run(["git", "worktree", "add", "--quiet", "--detach", tree, commit], cwd=ROOT, check=True)
    return tree


def _render(tree: Path, scene: str, options: list[str], out: Path) -> float:
    """Renders a frame with the package of ``tree``; gives its seconds without start-up."""
    stats = out.with_suffix(".json")
    command = [sys.executable, "-m", "tpdwarp", "render", f"usd_scenes/{scene}.usdc", out, "--frames", "5"]
    command += ["--photons", "16384", "--imageWidth", "256", "--exposure", "1", "--aov", AOVS, "--stats", stats]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    subprocess.run([*command, *options, "--progress", "none"], cwd=tree, env=environment, check=True)
    (frame,) = json.loads(stats.read_text())["frames"]
    return float(frame["seconds"]["total"])


def _same(a: Path, b: Path) -> bool:
    first, second = (oiio.ImageBuf(str(path)) for path in (a, b))
    if first.spec().channelnames != second.spec().channelnames:
        return False
    return np.array_equal(first.get_pixels(oiio.FLOAT), second.get_pixels(oiio.FLOAT), equal_nan=True)
