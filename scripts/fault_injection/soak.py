"""A farm of this machine whose workers are killed at random while it renders a long sequence."""

from __future__ import annotations

import contextlib
import random
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from scripts.fault_injection.program import ROOT, finish, leftovers, lost, pixels, start
from scripts.fault_injection.table import Row

SIZE = ("-w", "128", "--samples", "1", "--photons", "4096", "--threads", "1", "--workers", "2", "--progress", "none")
# Workers killed, each after a random number of frames: one that is started anew needs some seconds to be of use.
KILLS = 8
SLOWEST = 1.3
# The client's memory after the first tenth of the frames and at the end.
GROWTH = 1.02
TIMEOUT = 3600.0


def soak(folder: Path, frames: int, seed: int, tell: Callable[[str], None]) -> list[Row]:
    """Renders ``frames`` frames twice: left alone, and with workers killed at random moments.

    Args:
        folder: Where to work.
        frames: How many.
        seed: Of moments and victims.
        tell: Is given a line now and then.
    """
    quiet, quiet_growth, _ = _farm(folder / "quiet", frames, None, tell)
    reference = pixels(folder / "quiet")
    disturbed, growth, killed = _farm(folder / "soak", frames, random.Random(seed), tell)
    missing = lost(folder / "soak", reference)
    whole = not missing and len(reference) == frames
    hidden = len(leftovers(folder / "soak"))
    times = f"{disturbed:.0f} s, undisturbed {quiet:.0f} s: {disturbed / quiet:.2f}"
    memory = f"{growth:.3f}, undisturbed {quiet_growth:.3f}"
    must_memory = f"at most {GROWTH:g} of that after a tenth"
    return [
        Row(f"a farm of {frames} frames, {killed} kills", "no frame lost", f"{hidden} hidden", missing, whole),
        Row("… time", f"within {SLOWEST:g} of an undisturbed one", times, 0, disturbed < SLOWEST * quiet),
        Row("… memory of its client", must_memory, memory, 0, max(growth, quiet_growth) < GROWTH),
    ]


def _farm(out: Path, frames: int, draw: random.Random | None, tell: Callable[[str], None]) -> tuple[float, float, int]:
    """Seconds, growth of the client's memory, and how many workers were killed."""
    out.mkdir()
    scene = ROOT / "usd_scenes" / "wave.usdc"
    started = time.monotonic()
    process = start(["farm", scene, out / "a.###.##.exr", "-f", f"1:{1 + 0.25 * (frames - 1)}x0.25", *SIZE])
    client = psutil.Process(process.pid)
    done = early = late = 0
    killed, kills = 0, sorted(draw.randrange(1, frames) for _ in range(KILLS)) if draw else []
    while process.poll() is None and time.monotonic() - started < TIMEOUT:
        time.sleep(0.2)
        with contextlib.suppress(psutil.Error):
            done = len(list(out.glob("*.exr")))
            # One that has just ended holds nothing.
            late = client.memory_info().rss or late
            early = late if done <= frames // 10 else early
        if kills and done >= kills[0]:
            kills.pop(0)
            with contextlib.suppress(psutil.Error, IndexError):
                # Helpers of Python and Dask are small.
                workers = [child for child in client.children(recursive=True) if child.memory_info().rss > 100 << 20]
                draw.choice(workers).kill()
                killed += 1
                tell(f"killed a worker after {done} frames")
    seconds = time.monotonic() - started
    finish(process, timeout=10)
    return seconds, late / early, killed
