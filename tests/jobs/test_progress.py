import io
import re

import pytest

from tpdwarp.errors import InputError
from tpdwarp.jobs.progress import (
    AlfProgress,
    BarProgress,
    OccasionalProgress,
    OpenJobProgress,
    PlainProgress,
    Progress,
    clock,
    pace,
    progress_of,
)
from tpdwarp.jobs.results import FrameOutcome

WRITTEN = FrameOutcome(1, "written", "out/1.exr", total_seconds=2.0)
SKIPPED = FrameOutcome(2, "skipped", "out/2.exr")
FAILED = FrameOutcome(3, "failed", "out/3.exr", "the disk is full", total_seconds=2.0)


def show(progress, outcomes, count):
    progress.start(count)
    for outcome in outcomes:
        progress.begin(outcome.frame)
        progress.end(outcome)
    progress.finish()


def screen(text):
    """What a terminal shows in the end, line by line."""
    lines = []
    for line in text.split("\n"):
        lines.append(line.split("\r\x1b[K")[-1])
    return lines


def test_plain_progress_is_one_line_a_frame():
    stream = io.StringIO()
    show(PlainProgress(stream), [WRITTEN, SKIPPED, FAILED], 3)
    assert stream.getvalue().splitlines() == [
        "frame 1 (1/3) written out/1.exr, 2.00 s",
        "frame 2 (2/3) skipped out/2.exr, 0.00 s",
        "frame 3 (3/3) failed out/3.exr: the disk is full",
    ]


def test_alf_progress_runs_from_0_to_100_percent():
    stream = io.StringIO()
    show(AlfProgress(stream), [WRITTEN, SKIPPED, FAILED], 3)
    percents = [int(found) for found in re.findall(r"^ALF_PROGRESS (\d+)%$", stream.getvalue(), re.MULTILINE)]
    assert percents == [0, 33, 66, 100]
    assert len(stream.getvalue().splitlines()) == len(percents)


def test_the_bar_stays_on_one_line_and_counts_failures():
    stream = io.StringIO()
    show(BarProgress(stream), [WRITTEN, SKIPPED, FAILED], 3)
    lines = screen(stream.getvalue())
    assert len(lines) == 2 and lines[1] == ""
    assert "3/3" in lines[0] and "1 failed" in lines[0]
    assert max(map(len, screen(stream.getvalue()))) < 80


def test_the_time_left_is_that_of_frames_worked_on_not_of_those_skipped(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("tpdwarp.jobs.progress.time.monotonic", lambda: now[0])
    stream = io.StringIO()
    progress = BarProgress(stream)
    progress.start(5)
    progress.end(SKIPPED)
    now[0] += 2
    progress.end(WRITTEN)
    # Three frames are left, and the one worked on took two seconds.
    assert "0:02 gone, 2.0 s a frame, 0:06 left" in screen(stream.getvalue())[0]


def test_the_pace_is_that_of_all_processes_together():
    assert pace(10.0, 0, 5) == ""
    assert pace(10.0, 40, 20) == "0:10 gone, 4.0 frames/s, 0:05 left"
    assert pace(90.0, 10, 3) == "1:30 gone, 9.0 s a frame, 0:27 left"


def test_open_job_progress_runs_from_0_to_100_and_says_what_failed():
    stream = io.StringIO()
    show(OpenJobProgress(stream), [WRITTEN, SKIPPED, FAILED], 3)
    assert stream.getvalue().splitlines() == [
        "openjd_progress: 0.0",
        "openjd_progress: 33.3",
        "openjd_progress: 66.7",
        "openjd_status: frame 3 failed: the disk is full",
        "openjd_progress: 100.0",
    ]


def test_occasional_progress_says_a_line_an_interval_and_nothing_of_what_is_over_sooner(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("tpdwarp.jobs.progress.time.monotonic", lambda: now[0])
    stream = io.StringIO()
    progress = OccasionalProgress(stream, interval=10)
    progress.start(100)
    for _ in range(25):
        now[0] += 1
        progress.end(FAILED if now[0] == 105 else WRITTEN)
    progress.finish()
    assert stream.getvalue().splitlines() == [
        "10/100 frames, 1 failed, 0:10 gone, 1.0 s a frame, 1:30 left",
        "20/100 frames, 1 failed, 0:20 gone, 1.0 s a frame, 1:20 left",
    ]
    quick = io.StringIO()
    show(OccasionalProgress(quick, interval=10), [WRITTEN, FAILED], 2)
    assert quick.getvalue() == ""


def test_messages_stand_on_lines_of_their_own_above_the_bar():
    stream = io.StringIO()
    bar = BarProgress(stream)
    bar.start(2)
    bar.begin(1)
    bar.message("warning: careful")
    bar.end(WRITTEN)
    bar.finish()
    lines = screen(stream.getvalue())
    assert lines[0] == "warning: careful"
    assert lines[1].startswith("[") and lines[2:] == [""]


def test_the_bar_says_where_a_frame_stands_by_how_long_the_one_before_took(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("tpdwarp.jobs.progress.time.monotonic", lambda: now[0])
    stream = io.StringIO()
    bar = BarProgress(stream, interval=0.5)
    bar.start(2)

    def shown(seconds: float, stage: str) -> str:
        now[0] += seconds
        bar.stage(stage)
        return screen(stream.getvalue())[0]

    bar.begin(1)
    assert "trace" not in shown(0.1, "trace")
    # How long a first frame takes nobody knows.
    assert "frame 1 gather, " in shown(1.0, "gather")
    bar.end(WRITTEN)
    bar.begin(2)
    share = 1.0 / WRITTEN.total_seconds
    assert f"frame 2 view {min(99, int(100 * share))}%" in shown(1.0, "view")


def test_a_narrow_terminal_gets_a_short_line(monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    stream = io.StringIO()
    show(BarProgress(stream), [WRITTEN, FAILED], 2)
    assert all(len(part) < 30 for part in re.split(r"\r\x1b\[K|\n", stream.getvalue()))


def test_clock_reads_as_a_clock():
    assert [clock(seconds) for seconds in (0, 59.6, 61, 3600, 3725)] == ["0:00", "1:00", "1:01", "1:00:00", "1:02:05"]


def test_auto_is_a_bar_on_a_terminal_and_plain_elsewhere(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stderr", terminal)
    assert isinstance(progress_of("auto"), BarProgress)
    monkeypatch.setattr("sys.stderr", io.StringIO())
    assert isinstance(progress_of("auto"), PlainProgress)


def test_nothing_is_shown_unless_asked_for(capsys):
    for kind in (None, "none"):
        show(progress_of(kind), [WRITTEN], 1)
    assert capsys.readouterr() == ("", "")


def test_progress_may_be_an_object_and_not_any_word():
    mine = Progress()
    assert progress_of(mine) is mine
    with pytest.raises(InputError, match=r"^progress must be one of auto, bar, plain, alf, openjd, none"):
        progress_of("wheel")
