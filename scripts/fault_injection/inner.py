"""Faults inside a process, and between processes that share kernels: launches that fail, caches that are cold."""

from __future__ import annotations

import os
import random
import shutil
import time
from collections import Counter
from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom

from scripts.fault_injection.bench import Bench, how_ended
from scripts.fault_injection.program import FRAMES, Ended, finish, leftovers, lost, render, run, start
from scripts.fault_injection.table import Row

# Counts launches of chunks of all threads, and fails at the one that is asked for.
FAILS_AT = """
import itertools, signal, sys, threading
import warp as wp
whole, count, one = wp.launch, itertools.count(1), threading.Lock()
number, error = int(sys.argv.pop(1)), {"memory": MemoryError, "interrupt": KeyboardInterrupt, "failed": RuntimeError}[
    sys.argv.pop(1)
]
def launch(*arguments, **options):
    with one:
        at = next(count)
    if at == number:
        raise error("injected")
    return whole(*arguments, **options)
wp.launch = launch
from tpdwarp.cli import main
code = main()
print("launches", next(count) - 1, file=sys.stderr if number else sys.stdout)
raise SystemExit(code)
"""
INJECTIONS = 6
# Fixed, for the launch that fails is a matter of chance only to the one who looks for faults.
SEED = 5
COLD = 4
SLOWEST_COLD = 1.3


def failing_launches(bench: Bench) -> Iterator[Row]:
    """A launch that fails costs the frame that it belongs to, whatever its other threads are doing."""
    out = bench.new("launches")
    arguments = render(bench.scene, out / "a.####.exr")

    def injected(number: int, error: str) -> Ended:
        shutil.rmtree(out)
        return finish(start(arguments, program=("-c", FAILS_AT, str(number), error)))

    launches = int(injected(0, "failed").out.rsplit("launches", 1)[1])
    draw = random.Random(SEED)
    for error, code in (("memory", 1), ("failed", 1), ("interrupt", 130)):
        codes: Counter[int] = Counter()
        missing = hidden = 0
        for _ in range(INJECTIONS):
            ended = injected(draw.randrange(launches // (2 * FRAMES), launches + 1), error)
            codes[ended.code] += 1
            hidden += len(leftovers(out)) if out.exists() else 0
            # An interruption ends the sequence; of the others each may cost one frame.
            missing += max(lost(out, bench.reference) - 1, 0) if error != "interrupt" else 0
        did = ", ".join(f"{name}: {times}" for name, times in sorted(codes.items())) + f"; {hidden} hidden files"
        good = set(codes) <= {code} and not missing and not hidden
        yield Row(
            f"{INJECTIONS} launches of {launches} fail: {error}", f"exit {code}, at most its frame", did, missing, good
        )


def broken_points(bench: Bench) -> Iterator[Row]:
    """Points that are not numbers in one frame cost that frame."""
    folder = bench.new("points")
    scene = folder / "scene.usdc"
    shutil.copy2(bench.scene, scene)
    stage = Usd.Stage.Open(str(scene))
    mesh = max(
        (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)),
        key=lambda mesh: len(mesh.GetPointsAttr().Get()),
    )
    points = np.array(mesh.GetPointsAttr().Get())
    broken = points.copy()
    broken[0] = np.nan
    for time_code in range(FRAMES + 3):
        mesh.GetPointsAttr().Set(broken if time_code == 5 else points, float(time_code))
    stage.Save()
    out = folder / "out"
    ended = run(render(scene, out / "a.####.exr"))
    # The shutters of the frames beside it reach into what lies between this sample and the next.
    missing = max(lost(out, bench.reference) - 3, 0)
    named = "frame 5" in ended.err and "points" in ended.err
    yield Row(
        "points of frame 5 are not numbers",
        "exit 1, named, others made",
        how_ended(ended),
        missing,
        ended.code == 1 and named,
    )
    damaged = folder / "damaged.usdc"
    data = bench.scene.read_bytes()
    damaged.write_bytes(data[: len(data) // 2])
    ended = run(render(damaged, out / "b.####.exr"))
    yield Row(
        "a crate that ends in its middle", "exit 2, one line", how_ended(ended), 0, ended.code == 2 and ended.one_line
    )


def cold_caches(bench: Bench) -> Iterator[Row]:
    """Of several processes that start without kernels one compiles, and the others wait for it."""
    temporary = bench.new("cold")

    def seconds(count: int) -> tuple[float, int]:
        cache = bench.new("cold/cache")
        changes = {"WARP_CACHE_PATH": str(cache), "TMPDIR": str(temporary)}
        began = time.monotonic()
        processes = [
            start([*render(bench.scene, temporary / f"{index}" / "a.####.exr", frames=1), "--threads", 1], changes)
            for index in range(count)
        ]
        codes = [finish(process).code for process in processes]
        return time.monotonic() - began, sum(code != 0 for code in codes)

    alone, failed_alone = seconds(1)
    together, failed = seconds(COLD)
    # Each is ready with its first frame, which is rendered COLD times; more processes than cores share these.
    good = not failed + failed_alone and together < SLOWEST_COLD * alone
    did = f"{alone:.0f} s alone, {together:.0f} s together: {together / alone:.2f} ({os.cpu_count()} cores)"
    yield Row(f"{COLD} processes start on one cold cache", f"ready within {SLOWEST_COLD} × one", did, failed, good)
