"""Faults of what checks and studies keep."""

from __future__ import annotations

import random
import shutil
import time
from collections.abc import Iterator

from scripts.fault_injection.bench import Bench, how_ended
from scripts.fault_injection.program import FRAMES, finish, leftovers, lost, pixels, render, run, start
from scripts.fault_injection.table import Row

UPDATES = 12
SEED = 3


def updates(bench: Bench) -> Iterator[Row]:
    """A baseline is the old one or the new one, whatever ends the update."""
    new, baseline = bench.new("updates/new"), bench.rendered("updates/baseline")
    update = ["check", new, baseline, "--update", "--reason", "a fault is injected"]
    run(render(bench.scene, new / "a.####.exr", "--seed", 7))
    for path in sorted(new.glob("*.exr"))[3:]:
        path.unlink()
    ended = run(update)
    missing = lost(baseline, bench.reference)
    good = ended.code == 2 and ended.one_line and not missing
    yield Row(f"a baseline updated from 3 of {FRAMES} frames", "exit 2, all are kept", how_ended(ended), missing, good)

    run(render(bench.scene, new / "a.####.exr", "--seed", 7, "--skip-existing-frames"))
    others = pixels(new)
    began = time.monotonic()
    run(update)
    span = time.monotonic() - began
    draw = random.Random(SEED)
    mixed = left = old = 0
    for _ in range(UPDATES):
        baseline = bench.rendered("updates/baseline")
        process = start(update)
        # The replacement itself is the end of an update.
        time.sleep(draw.uniform(0.5, 1.05) * span)
        process.kill()
        finish(process)
        run(["check", new, baseline])
        kept = not lost(baseline, bench.reference)
        old += kept
        mixed += not kept and lost(baseline, others) > 0
        left += len(leftovers(baseline.parent)) + len(leftovers(baseline))
    told = f"{old} the old one, {UPDATES - old - mixed} the new one, {mixed} neither, {left} hidden"
    yield Row(
        f"{UPDATES} updates of a baseline are killed", "the old one or the new one", told, mixed, not mixed + left
    )


def study_cache(bench: Bench) -> Iterator[Row]:
    """What a study keeps is made anew where it is damaged."""
    folder = bench.new("study")
    arguments: list[object] = ["study", bench.scene, "-w", 16, "-f", 3, "--methods", "tpd", "--photons", "1024,2048"]
    arguments += ["--segments", 1, "--truth-photons", 1024, "--truth-times", 2, "--truth-samples", 1, "--samples", 1]
    arguments += ["--cache", folder / "cache", "--progress", "none", "--json", folder / "a.json"]
    first = run(arguments)
    kept = sorted((folder / "cache").glob("*.npz"))
    for place, path in enumerate(kept):
        data = bytearray(path.read_bytes())
        # In the header, in the data, at the end.
        at = (10, len(data) // 2, len(data) - 30)[place % 3]
        data[at : at + 20] = bytes(byte ^ 0x5A for byte in data[at : at + 20])
        path.write_bytes(data)
    ended = run(arguments)
    words = sum("damaged" in line for line in ended.err.splitlines())
    good = first.code == ended.code == 0 and bool(kept) and 0 < words <= len(kept)
    shutil.rmtree(folder)
    yield Row(
        f"{len(kept)} solutions of a study have flipped bytes", "made anew, with a word", how_ended(ended), 0, good
    )
