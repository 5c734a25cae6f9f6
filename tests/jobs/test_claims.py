"""Frames are claimed by one render at a time."""

import inspect
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType

import pytest

from tpdwarp.io.locks import FileLock
from tpdwarp.jobs import claims
from tpdwarp.jobs.claims import ClaimedElsewhere, Claims, claim_path, sweep_claims
from tpdwarp.stopping import Stopped


def test_a_frame_is_claimed_by_one_and_free_afterwards(tmp_path):
    path = str(tmp_path / "a.exr")
    with Claims().held(path):
        with pytest.raises(ClaimedElsewhere), Claims().held(path):
            pass
        with Claims().held(str(tmp_path / "b.exr")):
            pass
    with pytest.raises(RuntimeError), Claims().held(path):
        raise RuntimeError
    with Claims().held(path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_claims_that_nobody_holds_are_swept_and_those_held_stay(tmp_path):
    (tmp_path / ".left.exr.claim").write_bytes(b"")
    with Claims().held(str(tmp_path / "a.exr")):
        sweep_claims(str(tmp_path))
        assert [path.name for path in tmp_path.iterdir()] == [".a.exr.claim"]


def test_a_folder_that_takes_no_claims_can_be_rendered_into():
    with Claims().held("/proc/a.exr"):
        pass


def test_a_claim_without_a_sign_of_life_expires(tmp_path, monkeypatch):
    monkeypatch.setattr(claims, "EXPIRES_SECONDS", 0.2)
    path = str(tmp_path / "a.exr")
    other, waiting = FileLock(claim_path(path)), Claims()
    assert other.acquire()
    with pytest.raises(ClaimedElsewhere), waiting.held(path):
        pass
    time.sleep(0.3)
    with waiting.held(path):
        pass
    other.release()


def test_a_claim_that_shows_signs_of_life_does_not_expire(tmp_path, monkeypatch):
    monkeypatch.setattr(claims, "EXPIRES_SECONDS", 0.5)
    monkeypatch.setattr(claims, "BEAT_SECONDS", 0.05)
    path, waiting = str(tmp_path / "a.exr"), Claims()
    with Claims().held(path):
        for _ in range(10):
            with pytest.raises(ClaimedElsewhere), waiting.held(path):
                pass
            time.sleep(0.1)


def test_a_signal_between_any_two_steps_leaves_no_claim_behind(tmp_path):
    path = str(tmp_path / "a.exr")

    def claimed() -> None:
        with Claims().held(path):
            pass

    step = 0
    while _signalled_at(step, claimed):
        assert list(tmp_path.iterdir()) == [], f"step {step}"
        step += 1
    # Some dozens of instructions, and none left over.
    assert step > 50 and list(tmp_path.iterdir()) == []


def _signalled_at(number: int, call: Callable[[], None]) -> bool:
    """Whether ``call`` was left by a signal, before that instruction of the files that lock and claim."""
    files = {inspect.getfile(FileLock), inspect.getfile(Claims)}
    count = 0

    def trace(frame: FrameType, event: str, _: object) -> object:
        nonlocal count
        if frame.f_code.co_filename not in files:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            count += 1
            if count == number + 1:
                raise Stopped(signal.SIGTERM)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except Stopped:
        return True
    finally:
        sys.settrace(before)
    return False
