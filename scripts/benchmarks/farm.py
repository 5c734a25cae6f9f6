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


def run() -> dict[str, float]:
    """Wall seconds of both, start and end included, and their ratio; the machine's load before and after."""
    with tempfile.TemporaryDirectory() as folder:

        def timed(command: str, name: str, *options: object) -> float:
            size = ("-f", FRAMES, "-w", 256, "--threads", 1, "--progress", "none")
            arguments = [command, SCENE, f"{folder}/{name}.##.##.exr", *size, *options]
            started = time.perf_counter()
            subprocess.run([sys.executable, "-m", "tpdwarp", *map(str, arguments)], check=True)
            return time.perf_counter() - started

        before = os.getloadavg()[0]
        one, two = timed("render", "one"), timed("farm", "two", "--workers", 2)
        made = sorted(Path(folder).glob("one.*.exr"))
        same = sum(_pixels(path) == _pixels(path.with_name(f"two{path.name[3:]}")) for path in made)
    result = {"one process": one, "two workers": two, "ratio": two / one}
    print(f"{len(made)} frames, load {before:.1f} before and {os.getloadavg()[0]:.1f} after, {os.cpu_count()} cores:")
    print(f"  one process {one:.1f} s, two workers {two:.1f} s: {two / one:.2f}; {same} frames are the same")
    return result


def _pixels(path: Path) -> dict[str, bytes]:
    return {name: plane.tobytes() for name, plane in read_image(path)[0].items()}
