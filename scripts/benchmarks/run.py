#!/usr/bin/env python3
"""Runs the benchmarks of this folder and prints what they measured; --json keeps it.

    .venv/bin/python scripts/benchmarks/run.py                 # all of them
    .venv/bin/python scripts/benchmarks/run.py frame_time      # one
    .venv/bin/python scripts/benchmarks/run.py speed --only wave --only torus      # some rows of one
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
CASES = (
    "frame_time", "accuracy", "presets", "comparison", "target_error", "rounding", "check_frames", "solids", "house",
    "speed", "features", "efficiency", "peers", "large", "extent", "gpu", "memory", "farm",
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description="Runs tpdwarp's benchmarks.")
    parser.add_argument("case", nargs="*", help=f"which of {', '.join(CASES)}; all by default")
    parser.add_argument("--json", type=Path, help="also write the results to this file")
    parser.add_argument("--only", action="append", metavar="ROW", help="only this row of one of them")
    options = parser.parse_args()
    for case in options.case:
        if case not in CASES:
            parser.error(f"there is no benchmark {case!r}; there are {', '.join(CASES)}")
    sys.path.insert(0, str(FOLDER))
    results = {}
    for case in options.case or CASES:
        print(f"== {case}", flush=True)
        run = importlib.import_module(case).run
        results[case] = run(options.only) if options.only else run()
        if options.json:
            options.json.write_text(json.dumps(results, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
