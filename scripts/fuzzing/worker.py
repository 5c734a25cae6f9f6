"""The process that runs cases: a line of JSON before each, and one after it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from tpdwarp.usd.read import stage
from usd_scenes.hostile.cases import make_case
from usd_scenes.hostile.judge import clean, judge


def main(first: int, last: int, folder: Path, binary: bool) -> None:
    # Larger pictures take longer, and show nothing that smaller ones do not.
    stage.MOST_PIXELS = 100_000
    out = sys.stdout
    for seed in range(first, last + 1):
        case = make_case(seed, folder, binary)
        told = {"seed": seed, "changes": case.changes, "arguments": case.arguments}
        print(json.dumps(told), file=out, flush=True)
        verdict = judge(case)
        told |= {"code": verdict.code, "faults": verdict.faults, "errors": verdict.errors[-6000:]}
        print(json.dumps(told), file=out, flush=True)
        if not verdict.faults:
            clean(case)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), sys.argv[4] == "1")
