"""Wall time of the whole process for one 512 × 512 frame of the wave, with and without compiled kernels."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENE = Path(__file__).resolve().parents[2] / "usd_scenes" / "wave.usdc"
WARM_RUNS = 5


def run() -> dict[str, float]:
    """Seconds: cold (empty kernel cache), warm (median and least of several)."""
    with tempfile.TemporaryDirectory() as folder:
        # As a user has it: what Python compiles is kept as well.
        environment = {**os.environ, "WARP_CACHE_PATH": f"{folder}/kernels", "PYTHONPYCACHEPREFIX": f"{folder}/modules"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)

        def timed(*arguments: str) -> float:
            start = time.perf_counter()
            subprocess.run([sys.executable, "-m", "tpdwarp", *arguments], env=environment, check=True)
            return time.perf_counter() - start

        render = ("render", str(SCENE), f"{folder}/wave.exr", "-f", "3", "-cam", "TopOrtho", "-w", "512")
        options = ("--photons", "16384", "--samples", "4", "--progress", "none")
        cold = timed(*render, *options)
        warm = [timed(*render, *options) for _ in range(WARM_RUNS)]
    result = {"cold": cold, "warm median": statistics.median(warm), "warm least": min(warm)}
    print(f"one 512 × 512 frame, 16384 photons, 4 samples a pixel, {os.cpu_count()} cores, whole process:")
    for name, seconds in result.items():
        print(f"  {name:12s} {seconds:6.2f} s")
    return result
