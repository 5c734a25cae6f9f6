"""The table says what failed in a line a frame, and what became of all in the last."""

import pytest

from tests.checks.images import write, write_sequence
from tpdwarp.checks.run import check
from tpdwarp.checks.table import table_lines
from tpdwarp.cli import main


@pytest.fixture
def places(tmp_path):
    frames, baseline = write_sequence(tmp_path / "a", 3), write_sequence(tmp_path / "b", 3)
    write(frames, 2, **{"tpdwarp:version": "2", "tpdwarp:camera": "/Other"})
    write(frames, 3, **{"tpdwarp:version": "2"})
    return frames, baseline


def test_failures_come_first_with_their_gravest_finding(places):
    lines = table_lines(check(*places))
    assert lines[1].split()[:2] == ["2", "failed"] and "tpdwarp:camera" in lines[1] and lines[1].endswith("(+1)")
    assert lines[2].split()[:2] == ["3", "warned"]
    assert lines[-1].startswith("3 frames: 1 failed, 1 warned, 1 same (default limits")
    assert len(lines) == 4


def test_verbose_has_every_frame_and_finding(places):
    lines = table_lines(check(*places), verbose=True)
    assert lines[1].split()[:2] == ["1", "same"]
    assert "  warn metadata: tpdwarp:version is 2, the baseline has 1" in lines


def test_long_sequences_stay_compact(tmp_path, places):
    result = check(write_sequence(tmp_path / "many", 50), write_sequence(tmp_path / "few", 2))
    lines = table_lines(result)
    assert len(lines) < 45 and "and 8 frames more" in lines[-2]


def test_colour_is_only_for_those_who_want_it(places):
    result = check(*places)
    assert not any("\x1b" in line for line in table_lines(result))
    assert any("\x1b[31" in line for line in table_lines(result, color=True))


def test_the_command_exits_0_1_or_2(places, tmp_path, capsys):
    frames, baseline = map(str, places)
    assert main(["check", baseline, baseline]) == 0
    written = {kind: tmp_path / f"out.{kind}" for kind in ("junit", "json", "report")}
    outputs = [part for kind, path in written.items() for part in (f"--{kind}", str(path))]
    assert main(["check", frames, baseline, *outputs]) == 1
    stdout, stderr = capsys.readouterr()
    assert "1 failed" in stdout and "\x1b" not in stdout and stderr == ""
    assert all(path.exists() for path in written.values())
    assert main(["check", frames, f"{tmp_path}/none"]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path}/none: does not exist")
    assert main(["check", frames, baseline, "--update"]) == 2
    assert "--reason" in capsys.readouterr().err


def test_the_command_shows_what_changes_and_then_updates(places, capsys):
    frames, baseline = map(str, places)
    assert main(["check", frames, baseline, "--update", "--reason", "a new camera", "--color", "always"]) == 0
    stdout = capsys.readouterr().out
    assert stdout.index("tpdwarp:camera") < stdout.index("replaced") and "\x1b[31" in stdout
    assert main(["check", frames, baseline]) == 0
