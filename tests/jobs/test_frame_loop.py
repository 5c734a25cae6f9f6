"""Frames that fail are tried again where that is asked for, and end the sequence only where there is no hope."""

import time

import pytest

from tpdwarp.errors import FrameError, InputError
from tpdwarp.jobs import frame_loop
from tpdwarp.jobs.claims import ClaimedElsewhere
from tpdwarp.jobs.frame_loop import FrameLoop, Persistence, disk_is_full
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome


class Work:
    """Renders nothing; fails at frames of choice, each time with the next of its errors."""

    def __init__(self, errors):
        self.errors, self.tries = {frame: list(of) for frame, of in errors.items()}, []

    def __call__(self, frame):
        self.tries.append(frame)
        if self.errors.get(frame):
            raise self.errors[frame].pop(0)
        return FrameOutcome(frame, "written")


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(frame_loop, "RETRY_SECONDS", 0.0)
    monkeypatch.setattr(frame_loop, "CLAIM_POLL_SECONDS", 0.0)


def loop_of(work, tmp_path, frames, **persistence):
    loop = FrameLoop(work, lambda frame: str(tmp_path / f"{frame}.exr"), Progress(), Persistence(**persistence))
    loop.run(frames, None)
    return loop


def test_a_frame_that_fails_is_tried_again_as_often_as_asked_for(tmp_path):
    work = Work({2: [FrameError("busy"), OSError(5, "Input/output error")], 3: [FrameError("no")] * 9})
    outcomes = loop_of(work, tmp_path, [1, 2, 3], retries=2).outcomes
    assert work.tries == [1, 2, 2, 2, 3, 3, 3]
    assert [(outcome.status, outcome.tries) for outcome in outcomes] == [("written", 1), ("written", 3), ("failed", 3)]


def test_unusable_input_is_not_tried_again(tmp_path):
    work = Work({1: [InputError("x")] * 9})
    loop_of(work, tmp_path, [1, 2], retries=3)
    assert work.tries == [1, 2]


def test_a_frame_over_its_time_fails_alone(tmp_path):
    def work(frame):
        if frame == 2:
            time.sleep(60)
        return FrameOutcome(frame, "written")

    started = time.monotonic()
    outcomes = loop_of(work, tmp_path, [1, 2, 3], frame_timeout=0.2).outcomes
    assert [outcome.status for outcome in outcomes] == ["written", "failed", "written"]
    assert "took longer than 0.2 s" in outcomes[1].reason and time.monotonic() - started < 30


def test_so_many_failures_in_a_row_end_the_sequence(tmp_path):
    work = Work({frame: [FrameError("no")] for frame in (1, 3, 4, 5)})
    outcomes = loop_of(work, tmp_path, range(1, 9), max_failures=3).outcomes
    assert work.tries == [1, 2, 3, 4, 5]
    assert [outcome.status for outcome in outcomes] == ["failed", "written"] + ["failed"] * 6
    assert "3 frames in a row failed" in outcomes[-1].reason and outcomes[-1].tries == 0


def test_a_full_disk_ends_the_sequence_after_three_frames(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_loop, "disk_is_full", lambda path: True)
    work = Work({frame: [FrameError("cannot be written")] for frame in range(9)})
    outcomes = loop_of(work, tmp_path, range(9)).outcomes
    assert work.tries == [0, 1, 2] and "the disk was full" in outcomes[8].reason


def test_a_disk_with_room_and_a_folder_that_is_gone_are_not_full(tmp_path):
    assert not disk_is_full(str(tmp_path / "a.exr"))
    assert not disk_is_full(str(tmp_path / "gone" / "a.exr"))
    assert list(tmp_path.iterdir()) == []


def test_frames_that_others_render_are_looked_for_again_at_the_end(tmp_path):
    work = Work({1: [ClaimedElsewhere(), ClaimedElsewhere()]})
    outcomes = loop_of(work, tmp_path, [1, 2, 3]).outcomes
    assert work.tries == [1, 2, 3, 1, 1]
    assert [outcome.frame for outcome in outcomes] == [1, 2, 3]


@pytest.mark.parametrize("wrong", [{"frame_timeout": 0.0}, {"retries": -1}, {"max_failures": 0}])
def test_numbers_without_sense_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(InputError, match=f"{name} must be"):
        Persistence(**wrong)
