"""Mutated stages through the command line: it succeeds with finite pixels, or says in one line what is wrong where."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.waiting_worker import ENDS, WAITS, WORKS
from usd_scenes.hostile.cases import make_case
from usd_scenes.hostile.judge import judge
from usd_scenes.hostile.patience import Patience

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 45
# An idle machine does several times as many.
FEWEST = 20


@pytest.mark.slow
def test_whatever_a_layer_holds_is_rendered_or_refused_in_one_line():
    command = [sys.executable, "scripts/fuzz_usd.py", "--seconds", str(SECONDS), "--count", "1000"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = done.stdout.splitlines()[-1]
    assert int(summary.split()[0]) >= FEWEST
    # Both ends are reached: stages that survive, and stages that do not.
    counts = {int(code): int(count) for count, code in re.findall(r"(\d+) with exit code (\d+)", summary)}
    assert min(counts.get(code, 0) for code in (0, 2)) > 0.1 * sum(counts.values())


def test_a_case_is_the_same_every_time_it_is_made(tmp_path):
    folders = [tmp_path / name for name in "ab"]
    for folder in folders:
        folder.mkdir()
    for seed in range(12):
        one, other = (make_case(seed, folder) for folder in folders)
        assert one.changes == other.changes
        assert [part.replace(str(folders[0]), "") for part in one.arguments] == [
            part.replace(str(folders[1]), "") for part in other.arguments
        ]


@pytest.mark.parametrize("kind, hangs", [(WAITS, True), (WORKS, True), (ENDS, False)])
def test_a_case_hangs_by_what_it_takes_of_the_processor_and_not_by_the_clock(kind, hangs):
    worker = subprocess.Popen([sys.executable, "-m", "tests.fuzz.waiting_worker", str(kind)], cwd=ROOT)
    try:
        patience = Patience(worker.pid, 1.0)
        found = False
        while worker.poll() is None and not found:
            try:
                worker.wait(timeout=patience.seconds)
            except subprocess.TimeoutExpired:
                found = patience.ended()
        assert found == hangs
    finally:
        worker.kill()
        worker.wait()


@pytest.mark.parametrize(
    "fault, line", [("an internal error", "internal: ValueError: no"), ("neither an error", "Traceback (most recent")]
)
def test_the_judge_sees_what_must_not_be(fault, line, tmp_path, monkeypatch):
    def broken(arguments: list[str]) -> int:
        import sys

        print(f"error: {arguments[1]}: {line}" if "internal" in line else line, file=sys.stderr)
        return 1

    monkeypatch.setattr("usd_scenes.hostile.judge.main", broken)
    assert any(fault in found for found in judge(make_case(1, tmp_path)).faults)
