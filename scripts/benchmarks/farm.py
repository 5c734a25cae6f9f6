"""A hundred 256 × 256 frames of the wave: one process with one thread against two workers with one thread each."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tpdwarp.io.images import read_image

SCENE = Path(__file__).resolve().parents[2] / "usd_scenes" / "wave.usdc"
FRAMES = "1:24.76x0.24"
HALVES = ("1:12.76x0.24", "13:24.76x0.24")


def run() -> dict[str, float]:
    """Wall seconds of both, start and end included, and their ratio; the machine's load before and after.

    Two processes that know nothing of each other, with half of the frames each, show what the machine itself allows:
    cores that share their caches, or belong to others as well, are slower together.
    """
    with tempfile.TemporaryDirectory() as folder:

        def command(kind: str, name: str, frames: str, *options: object) -> list[str]:
            size = ("-f", frames, "-w", 256, "--threads", 1, "--progress", "none")
            arguments = [kind, SCENE, f"{folder}/{name}.##.##.exr", *size, *options]
            return [sys.executable, "-m", "tpdwarp", *map(str, arguments)]

        def timed(*commands: list[str]) -> float:
            started = time.perf_counter()
            codes = [process.wait() for process in [subprocess.Popen(each) for each in commands]]
            if any(codes):
                raise RuntimeError(f"ended with {codes}")
            return time.perf_counter() - started

        before = os.getloadavg()[0]
        one = timed(command("render", "one", FRAMES))
        two = timed(command("farm", "two", FRAMES, "--workers", 2))
        halves = timed(*(command("render", "half", frames) for frames in HALVES))
        made = sorted(Path(folder).glob("one.*.exr"))
        same = sum(_pixels(path) == _pixels(path.with_name(f"two{path.name[3:]}")) for path in made)
    result = {"one process": one, "two workers": two, "ratio": two / one, "halves": halves, "bound": halves / one}
    print(f"{len(made)} frames, load {before:.1f} before and {os.getloadavg()[0]:.1f} after, {os.cpu_count()} cores:")
    print(f"  one process {one:.1f} s, two workers {two:.1f} s: {two / one:.2f}; {same} frames are the same")
    print(f"  two processes with half of the frames each {halves:.1f} s: {halves / one:.2f}")
    return result


def _pixels(path: Path) -> dict[str, bytes]:
    return {name: plane.tobytes() for name, plane in read_image(path)[0].items()}
