"""Renders that are ended by a signal at a random moment, and resumed."""

from __future__ import annotations

import random
import resource
import shutil
import signal
import statistics
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from scripts.fault_injection.program import (
    cpu_seconds,
    finish,
    layer_values,
    leftovers,
    lost,
    pixels,
    render,
    run,
    start,
    statistics_lines,
)
from scripts.fault_injection.table import Row

ASKED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Signals are heard between steps of Python; what is native in between takes less than that.
PROMPT_SECONDS = 2.0


def kill_at_random(
    scene: Path,
    reference: Mapping[str, dict[str, np.ndarray]],
    folder: Path,
    count: int,
    seed: int,
    span: float,
    tell: Callable[[str], None],
) -> list[Row]:
    """Ends ``count`` renders, each going on where the last stopped.

    Args:
        scene: The stage.
        reference: Frames of a render that was left alone.
        folder: Where to work.
        count: How many.
        seed: Of moments and signals.
        span: Seconds over which the moments are spread.
        tell: Is given a line for each.
    """
    moments = random.Random(seed)
    codes: dict[str, Counter[int]] = {number.name: Counter() for number in (*ASKED, signal.SIGKILL)}
    waits: list[tuple[float, float]] = []
    torn = left = crashed = 0
    out = folder / "kills"
    extras = ["--debug-layer", out / "a.debug.usdc", "--stats", out / "a.jsonl", "--skip-existing-frames"]
    arguments = render(scene, out / "a.####.exr", *extras)
    shutil.rmtree(out, ignore_errors=True)
    for index in range(count):
        number = moments.choice((*ASKED, signal.SIGKILL))
        before = set(leftovers(out)) if out.exists() else set()
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        process = start(arguments)
        time.sleep(moments.uniform(0, span))
        over = process.poll() is not None
        at_signal = 0.0 if over else cpu_seconds(process)
        process.send_signal(number)
        ended = finish(process)
        now = resource.getrusage(resource.RUSAGE_CHILDREN)
        after_signal = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime - at_signal
        crashed += ended.crashed
        if not over:
            codes[number.name][ended.code] += 1
            if number in ASKED:
                waits.append((ended.seconds, after_signal))
        behind: set[str] = set()
        if out.exists():
            torn += sum(planes is None for planes in pixels(out).values())
            # A killed one leaves its own, until a later render has come as far as sweeping them.
            if number in ASKED and not over:
                behind = set(leftovers(out)) - before
            left += len(behind)
            if over:
                shutil.rmtree(out)
        when = "after its end" if over else ""
        hidden = f" left behind: {', '.join(sorted(behind))}" if behind else ""
        tell(f"{index + 1}/{count} {number.name} {when} code {ended.code} {ended.err.strip()}{hidden}")
    last = run(arguments)
    missing = lost(out, reference)
    quiet = folder / "undisturbed"
    run(render(scene, quiet / "a.####.exr", "--debug-layer", quiet / "a.debug.usdc", "--stats", quiet / "a.jsonl"))
    rows = []
    for name, counted in codes.items():
        wanted = 128 + signal.Signals[name].value
        # A render whose last frame is just done may be quicker than the signal.
        good = all(code in (wanted, 0) for code in counted)
        did = ", ".join(f"{code}: {times}" for code, times in sorted(counted.items())) or "not drawn"
        rows.append(Row(f"{name} at random moments", f"exit {wanted}", did, 0, good))
    rows.append(_promptness(waits))
    rows.append(Row("… crashes and hangs", "none", str(crashed), 0, crashed == 0))
    rows.append(Row("… hidden files left (not after KILL)", "none", str(left), 0, left == 0))
    for what, name, read in (
        ("debug layer", "a.debug.usdc", layer_values),
        ("statistics, but for seconds and tries", "a.jsonl", statistics_lines),
    ):
        agrees = read(out / name) == read(quiet / name)
        did = "the same" if agrees else "another"
        rows.append(Row(f"… its {what}", "that of an undisturbed render", did, 0, agrees))
    rows.append(
        Row(
            "… resumed after the last",
            "the pixels of an undisturbed render",
            f"code {last.code}, {torn} torn, {len(leftovers(out))} hidden files",
            missing,
            last.code == 0 and not missing and not torn and not leftovers(out),
        )
    )
    return rows


def _promptness(waits: list[tuple[float, float]]) -> Row:
    """How soon renders ended: on a machine that others keep busy, their own processor time tells."""
    must = f"within {PROMPT_SECONDS:g} s, of processor time if busy"
    if not waits:
        return Row("… until it has ended", must, "none drawn", 0, True)
    walls, works = zip(*waits, strict=True)
    did = f"median {statistics.median(walls):.1f} s ({statistics.median(works):.1f} s of work), "
    did += f"slowest {max(walls):.1f} s ({max(works):.1f} s of work)"
    return Row("… until it has ended", must, did, 0, all(min(pair) < PROMPT_SECONDS for pair in waits))
