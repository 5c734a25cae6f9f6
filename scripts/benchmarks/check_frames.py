"""Checks of long sequences of noisy 1080p frames as a process: speed, cores used, peak memory.

Before that, the comparison of pixels beside OpenImageIO's.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from tpdwarp.checks.limits import LIMITS_FILE, GroupLimits
from tpdwarp.checks.pixels import compare_pixels, largest_channel
from tpdwarp.io.images import write_frame

WIDTH, HEIGHT = 1920, 1080
REPEATS = 7
COUNTS = (50, 200, 1000)
DISTINCT = 4
# Every so many frames one is a tenth brighter, one is its baseline to the last bit, and one is cut short.
BRIGHTER, EQUAL, TRUNCATED = 50, 10, 97
# What calibration writes for noise such as this, so that most frames pass and their pictures are those of passing ones.
NOISY_LIMITS = (
    "[all]\nfail_absolute = 0.4\nwarn_absolute = 0.4\nrmse = 0.15\ncoarse = 0.02\nflicker = 0.1\n"
    "[groups.beauty]\nflip_mean = 0.1\nflip_high = 0.2\n"
)


def picture(number: int, seed: int) -> dict[str, np.ndarray]:
    """Bands of a caustic over a textured floor with the noise of few samples: beauty, caustic, alpha and depth."""
    generator = np.random.default_rng(seed)
    x = np.linspace(0, 1, WIDTH, dtype=np.float32)
    y = np.linspace(0, 1, HEIGHT, dtype=np.float32)[:, None]

    def noise(deviation: float) -> np.ndarray:
        return 1 + deviation * generator.standard_normal((HEIGHT, WIDTH), dtype=np.float32)

    bands = sum(np.exp(-40 * (np.sin(8 * x + k + 0.1 * number) + np.sin(11 * y + 2 * k)) ** 2) for k in range(6))
    caustic, floor = 0.3 * bands * noise(0.08), (0.2 + 0.1 * np.sin(40 * x) * np.sin(30 * y)) * noise(0.02)
    channels = {"A": np.ones((HEIGHT, WIDTH), np.float32), "Z": 5 + x + y}
    for name, tint in zip("RGB", (1.0, 0.9, 0.7), strict=True):
        channels |= {name: np.float32(tint) * (floor + caustic), f"caustic.{name}": np.float32(tint) * caustic}
    return channels


def make_frames(folder: Path) -> None:
    """A few frames of either side; sequences of any length are links to them."""
    folder.mkdir()
    metadata = {"tpdwarp:settings": json.dumps({"photons": 65536}), "framesPerSecond": 24.0}
    for number in range(DISTINCT):
        for side in range(2):
            channels = picture(number, seed=2 * number + side)
            write_frame(folder / f"{'ab'[side]}{number}.exr", channels, metadata)
            if side == 0:
                brighter = {name: plane * np.float32(1.1) for name, plane in channels.items() if name not in "AZ"}
                write_frame(folder / f"brighter{number}.exr", channels | brighter, metadata)
        whole = (folder / f"a{number}.exr").read_bytes()
        (folder / f"truncated{number}.exr").write_bytes(whole[: len(whole) // 2])


def link_sequence(made: Path, folder: Path, count: int, equal: bool = False) -> tuple[Path, Path]:
    """Folders of ``count`` frames and their baseline; ``equal`` ones throughout, or noisy ones with a few faults."""
    frames, baseline = folder / "frames", folder / "baseline"
    for place in (frames, baseline):
        place.mkdir(parents=True)
    for frame in range(1, count + 1):
        number = frame % DISTINCT
        kind = "a"
        for every, named in ((BRIGHTER, "brighter"), (EQUAL, "b"), (TRUNCATED, "truncated")):
            kind = named if frame % every == 0 else kind
        os.link(made / f"{'b' if equal else kind}{number}.exr", frames / f"f.{frame:04d}.exr")
        os.link(made / f"b{number}.exr", baseline / f"f.{frame:04d}.exr")
    (baseline / LIMITS_FILE).write_text(NOISY_LIMITS)
    return frames, baseline


def checked(frames: Path, baseline: Path, report: Path) -> dict[str, float]:
    """Runs ``tpdwarp check`` and measures the process."""
    command = [sys.executable, "-m", "tpdwarp", "check", str(frames), str(baseline), "--report", str(report)]
    start = time.perf_counter()
    process = subprocess.Popen([*command, "--junit", f"{report}.xml"], stdout=subprocess.PIPE, text=True)
    said = process.stdout.read() if process.stdout else ""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - start
    count = len(list(baseline.glob("*.exr")))
    cpu = usage.ru_utime + usage.ru_stime
    memory, page = usage.ru_maxrss / 1024, report.stat().st_size / 2**20
    print(f"  {count:5d}  {count / seconds:8.2f}  {cpu / count:11.2f}  {cpu / seconds:5.2f}", end="")
    print(f"  {memory:8.0f}  {page:8.1f}  {said.splitlines()[-1].partition(' (')[0]}", flush=True)
    return {"frames": count, "seconds": seconds, "cpu seconds": cpu, "peak MiB": memory, "report MiB": page}


def cpu_seconds(work: Callable[[], object]) -> float:
    """CPU seconds of one call, all threads together; the median of a few."""
    found = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return statistics.median(found)


def pixel_comparisons() -> dict[str, float]:
    """CPU seconds to compare three channels of a noisy 1080p image: here, and with OpenImageIO on one thread.

    OpenImageIO gives no map of the differences, so it is measured with and without one made beside it.
    """
    image, baseline = (np.stack([picture(0, seed)[name] for name in "RGB"], axis=-1) for seed in (0, 1))
    limits = GroupLimits()
    fail, warn = (limits.fail_absolute, limits.fail_relative), (limits.warn_absolute, limits.warn_relative)

    def theirs() -> object:
        buffers = [oiio.ImageBuf(pixels) for pixels in (image, baseline)]
        relative = {"failrelative": fail[1], "warnrelative": warn[1], "nthreads": 1}
        return oiio.ImageBufAlgo.compare(*buffers, fail[0], warn[0], **relative)

    return {
        "compare_pixels": cpu_seconds(lambda: compare_pixels(image, baseline, fail, warn)),
        "ImageBufAlgo.compare": cpu_seconds(theirs),
        "ImageBufAlgo.compare and a map": cpu_seconds(lambda: (theirs(), largest_channel(np.abs(image - baseline)))),
    }


def run() -> list[dict[str, object]]:
    """Frames a second, CPU seconds a frame, cores kept busy, peak resident memory and size of the report."""
    results: list[dict[str, object]] = []
    print(f"comparing the pixels of {WIDTH} × {HEIGHT} × 3 floats, CPU s")
    for what, seconds in pixel_comparisons().items():
        print(f"  {what:32s} {seconds:.3f}", flush=True)
        results.append({"what": what, "cpu seconds": seconds})
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        make_frames(folder / "made")
        print(f"{WIDTH} × {HEIGHT}, half floats: beauty, caustic, alpha; depth in float; {os.cpu_count()} cores")
        print("  frames  frames/s  CPU s/frame  cores  peak MiB  page MiB  found")
        for what, counts, equal in (("noisy, with faults", COUNTS, False), ("equal to the bit", COUNTS[1:2], True)):
            print(f" {what}")
            for count in counts:
                frames, baseline = link_sequence(folder / "made", folder / f"{what} {count}", count, equal)
                found = checked(frames, baseline, folder / "report.html")
                results.append({"what": what, **found})
    return results
