#!/usr/bin/env python3
"""Injects faults into renders on this machine and prints what became of the frames.

    python scripts/faults.py                     every fault, 20 signals at random moments
    python scripts/faults.py --kills 200 --seed 7
    python scripts/faults.py --only names closed_streams --kills 0
    python scripts/faults.py --only --kills 0 --soak 500      a farm whose workers are killed

All it makes lies in one temporary folder. Exit code 0 where every fault ended as it must, else 1.
"""

from __future__ import annotations

import argparse
import secrets
import shutil
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from scripts.fault_injection import baselines, cases, inner
from scripts.fault_injection.bench import Bench
from scripts.fault_injection.kills import kill_at_random
from scripts.fault_injection.program import ROOT, pixels, render, run
from scripts.fault_injection.soak import soak
from scripts.fault_injection.table import Row, table_lines

CASES = (
    cases.outputs_over_inputs,
    cases.damaged_frames,
    cases.stale_frames,
    cases.closed_streams,
    cases.names,
    cases.stage_written_over,
    cases.folder_gone,
    cases.full_disk,
    cases.two_at_once,
    cases.pipes,
    cases.strangers,
    cases.address_space,
    cases.kernel_caches,
    inner.failing_launches,
    inner.broken_points,
    inner.cold_caches,
    baselines.updates,
    baselines.study_cache,
)


def main() -> int:
    """Injects, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20, metavar="N", help="Renders ended by a signal. [20]")
    parser.add_argument("--seed", type=int, default=None, metavar="N", help="Of moments and signals. [random, printed]")
    parser.add_argument("--only", nargs="*", metavar="NAME", help=f"Of {', '.join(case.__name__ for case in CASES)}.")
    parser.add_argument("--soak", type=int, default=0, metavar="N", help="Frames of a farm with killed workers. [0]")
    options = parser.parse_args()
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    folder = Path(tempfile.mkdtemp(prefix="tpdwarp-faults-"))
    try:
        scene = folder / "scene.usdc"
        shutil.copy2(ROOT / "usd_scenes" / "cylinder.usdc", scene)
        (folder / "reference").mkdir()
        run(render(scene, folder / "reference" / "a.####.exr"))
        started = time.monotonic()
        run(render(scene, folder / "warm" / "a.####.exr"))
        span = time.monotonic() - started
        bench = Bench(scene, folder, pixels(folder / "reference"))
        rows: list[Row] = []
        for case in CASES:
            if options.only is None or case.__name__ in options.only:
                for row in case(bench):
                    rows.append(row)
                    print(table_lines([row])[1], flush=True)
        if options.kills:
            print(f"{options.kills} signals over {span:.1f} s each, --seed {seed}", flush=True)
            rows += kill_at_random(scene, bench.reference, folder, options.kills, seed, span, _tell)
        if options.soak:
            print(f"{options.soak} frames of a farm, --seed {seed}", flush=True)
            rows += soak(folder, options.soak, seed, _tell)
        print("\n".join(["", *table_lines(rows)]))
        return 0 if all(row.good for row in rows) else 1
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
