"""Mutated stages through the command line: it succeeds with finite pixels, or says in one line what is wrong where."""

from __future__ import annotations

import pytest

from scripts.fuzzing.campaign import Finding, run
from scripts.fuzzing.cases import make_case
from scripts.fuzzing.judge import judge

SECONDS = 45.0
# An idle machine does several times as many.
FEWEST = 20


@pytest.mark.slow
def test_whatever_a_layer_holds_is_rendered_or_refused_in_one_line():
    outcomes = list(run(0, 999, SECONDS))
    findings = [outcome for outcome in outcomes if isinstance(outcome, Finding)]
    assert not findings, "\n".join(f"{found.seed}: {found.changes} {found.faults}" for found in findings)
    assert len(outcomes) >= FEWEST
    # Both ends are reached: stages that survive, and stages that do not.
    assert min(outcomes.count(code) for code in (0, 2)) > 0.1 * len(outcomes)


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


@pytest.mark.parametrize(
    "fault, line", [("an internal error", "internal: ValueError: no"), ("neither an error", "Traceback (most recent")]
)
def test_the_judge_sees_what_must_not_be(fault, line, tmp_path, monkeypatch):
    def broken(arguments: list[str]) -> int:
        import sys

        print(f"error: {arguments[1]}: {line}" if "internal" in line else line, file=sys.stderr)
        return 1

    monkeypatch.setattr("scripts.fuzzing.judge.main", broken)
    assert any(fault in found for found in judge(make_case(1, tmp_path)).faults)
