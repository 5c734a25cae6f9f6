#!/usr/bin/env python3
"""Fuzzes tpdwarp with mutated USD layers and prints every case that goes wrong; exit 1 if any does.

    .venv/bin/python scripts/fuzz_usd.py --seconds 600
    .venv/bin/python scripts/fuzz_usd.py --first 1234 --count 1 --keep /tmp/found     # one case again
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.fuzzing.campaign import Finding, run


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzzes tpdwarp with mutated USD layers.")
    parser.add_argument("--seconds", type=float, default=60.0, help="time that may be spent [60]")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first case [0]")
    parser.add_argument("--count", type=int, default=1_000_000, metavar="N", help="how many cases at most [1000000]")
    parser.add_argument("--binary", action="store_true", help="also change bytes of binary layers")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the stages that go wrong")
    options = parser.parse_args()
    codes: Counter[int] = Counter()
    found = 0
    last = options.first + options.count - 1
    for outcome in run(options.first, last, options.seconds, options.binary, options.keep):
        if not isinstance(outcome, Finding):
            codes[outcome] += 1
            continue
        found += 1
        print(f"case {outcome.seed}: {'; '.join(outcome.changes)}")
        print(f"  tpdwarp {' '.join(outcome.arguments)}")
        for fault in outcome.faults[:5]:
            print(f"  ! {fault[:400]}", flush=True)
    counts = ", ".join(f"{count} with exit code {code}" for code, count in sorted(codes.items()))
    print(f"{found + codes.total()} cases: {found} went wrong; {counts}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
