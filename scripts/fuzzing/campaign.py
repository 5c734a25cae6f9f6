"""Runs cases one after the other in a worker process, which may crash or hang without ending the campaign."""

from __future__ import annotations

import json
import queue
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from usd_scenes.hostile.patience import Patience

ROOT = Path(__file__).resolve().parents[2]
MEMORY = 8 << 30
PATIENCE = 60.0
"""Seconds of processor time after which a case hangs, or seconds in which it does nothing; the slowest take a few.

A busy machine may give it much less than that, and kernels that nothing has used yet take ten to compile.
"""
CASES_A_WORKER = 1000


@dataclass(frozen=True)
class Finding:
    """A case that went wrong: its number, what was done to the stage, the command line, and what is wrong."""

    seed: int
    changes: tuple[str, ...]
    arguments: tuple[str, ...]
    faults: tuple[str, ...]
    errors: str


def run(
    first: int, last: int, seconds: float, binary: bool = False, keep: Path | None = None
) -> Iterator[Finding | int]:
    """Cases ``first`` … ``last`` until the time is up: each that goes wrong, and the exit code of each that does not.

    Args:
        keep: A folder for the stages that went wrong.
    """
    ends = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        seed = first
        while seed <= last and time.monotonic() < ends:
            for outcome in _work(seed, min(last, seed + CASES_A_WORKER - 1), ends, binary, Path(folder)):
                seed = outcome["seed"] + 1
                if not outcome["faults"]:
                    yield outcome["code"]
                    continue
                if keep is not None:
                    _keep(outcome, Path(folder), keep)
                yield Finding(
                    outcome["seed"],
                    tuple(outcome["changes"]),
                    tuple(outcome["arguments"]),
                    tuple(outcome["faults"]),
                    outcome["errors"],
                )


def _work(first: int, last: int, ends: float, binary: bool, folder: Path) -> Iterator[dict]:
    """Outcomes of one worker; if it dies or hangs, that is the last one's."""
    command = [sys.executable, "-m", "scripts.fuzzing.worker", str(first), str(last), str(folder), str(int(binary))]
    worker = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, preexec_fn=_limited)
    lines: queue.Queue[str | None] = queue.Queue()
    reader = threading.Thread(target=lambda: [*map(lines.put, worker.stdout), lines.put(None)], daemon=True)
    reader.start()
    current: dict | None = None
    patience = Patience(worker.pid, PATIENCE)
    try:
        while time.monotonic() < ends:
            try:
                line = lines.get(timeout=PATIENCE)
                patience.renew()
            except queue.Empty:
                if not patience.ended():
                    continue
                worker.kill()
                yield _ended(current, first, f"hangs: no end after {PATIENCE:g} s")
                return
            if line is None:
                if worker.wait() != 0:
                    yield _ended(current, first, f"the process dies of {worker.returncode}")
                return
            current = json.loads(line)
            if "faults" in current:
                yield current
    finally:
        worker.kill()
        worker.wait()


def _ended(current: dict | None, first: int, fault: str) -> dict:
    blank = {"seed": first, "changes": [], "arguments": [], "errors": "", "code": -1}
    return {**blank, **(current or {}), "faults": [fault]}


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _keep(outcome: dict, folder: Path, keep: Path) -> None:
    keep.mkdir(parents=True, exist_ok=True)
    for path in folder.glob(f"{outcome['seed']}.usd*"):
        shutil.copy(path, keep)
    (keep / f"{outcome['seed']}.txt").write_text(
        "\n".join([*outcome["changes"], " ".join(outcome["arguments"]), *outcome["faults"], outcome["errors"]]) + "\n"
    )
