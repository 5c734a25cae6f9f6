"""A baseline is replaced as a whole or not at all, and says who did it and why."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from tests.checks.images import channels, write, write_sequence
from tests.checks.test_frames import write_raw
from tpdwarp.checks.limits import Limits, SequenceLimits
from tpdwarp.checks.run import check
from tpdwarp.checks.update import RECORD_FILE, update_baseline
from tpdwarp.errors import InputError


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def baseline(tmp_path):
    folder = write_sequence(tmp_path / "b", 3, name="old")
    (folder / "README").write_text("kept")
    return folder


@pytest.fixture
def frames(tmp_path):
    """Frame 1 as in the baseline, 2 brighter, 3 missing, and 4 new."""
    folder = write_sequence(tmp_path / "a", 2)
    write(folder, 2, values={name: plane * 2 for name, plane in channels(2).items()})
    write(folder, 4)
    return folder


def test_the_new_frames_take_the_old_names_and_the_rest_stays(tmp_path, frames, baseline):
    assert update_baseline(check(frames, baseline), " brighter\nnow ", drop_missing=True)
    now = contents(baseline)
    assert set(now) == {"old.0001.exr", "old.0002.exr", "wave.0004.exr", "README", RECORD_FILE}
    assert now["old.0002.exr"] == (frames / "wave.0002.exr").read_bytes() and now["README"] == b"kept"
    assert check(frames, baseline / "old.####.exr", new=True).frames[0].status == "same"
    record = json.loads(now[RECORD_FILE])
    assert record["reason"] == "brighter now" and "@" in record["who"] and record["time"].endswith("Z")
    assert [change["frame"] for change in record["changes"]] == ["2", "3", "4"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_records_are_added_to_records(frames, baseline):
    update_baseline(check(frames, baseline), "one", drop_missing=True)
    write(frames, 1, values=channels(9))
    update_baseline(check(frames, baseline), "two", drop_missing=True)
    lines = (baseline / RECORD_FILE).read_text().splitlines()
    assert [json.loads(line)["reason"] for line in lines] == ["one", "two"]


def test_equal_frames_replace_nothing(baseline):
    before = contents(baseline)
    assert not update_baseline(check(baseline, baseline), "why not")
    assert contents(baseline) == before


def test_no_reason_no_update(frames, baseline):
    before = contents(baseline)
    with pytest.raises(InputError, match="reason"):
        update_baseline(check(frames, baseline), "  ")
    assert contents(baseline) == before


def test_frames_that_are_missing_stay_unless_they_may_go(frames, baseline):
    before = contents(baseline)
    with pytest.raises(InputError, match=r"lacks 1 of 4 frames of the baseline: 3 \(drop_missing"):
        update_baseline(check(frames, baseline), "half a render")
    # Whether a check counts them is another matter.
    ignored = Limits(sequence=SequenceLimits(missing_frames="ignore"))
    with pytest.raises(InputError, match="lacks 1 of 4 frames"):
        update_baseline(check(frames, baseline, limits=ignored), "half a render")
    assert contents(baseline) == before


def test_a_broken_frame_becomes_no_baseline(frames, baseline):
    before = contents(baseline)
    write_raw(frames / "wave.0001.exr", channels(), {"R": (0, 0, np.nan)})
    with pytest.raises(InputError, match="no fit baseline"):
        update_baseline(check(frames, baseline), "hm")
    (frames / "wave.0001.exr").write_bytes(b"")
    with pytest.raises(InputError, match="no fit baseline"):
        update_baseline(check(frames, baseline), "hm")
    assert contents(baseline) == before


def test_a_broken_baseline_can_be_replaced(frames, baseline):
    (baseline / "old.0001.exr").write_bytes(b"")
    assert update_baseline(check(frames, baseline), "the disk was full", drop_missing=True)
    assert (baseline / "old.0001.exr").read_bytes() == (frames / "wave.0001.exr").read_bytes()


def test_a_first_baseline_is_made(tmp_path, frames):
    result = check(frames, tmp_path / "deep" / "new", new=True)
    assert {frame.findings[0].kind for frame in result.frames} == {"extra frame"}
    assert update_baseline(result, "first")
    assert set(contents(tmp_path / "deep" / "new")) == {*contents(frames), RECORD_FILE}


def test_a_single_image_is_replaced_in_its_folder(frames, baseline):
    result = check(frames / "wave.0002.exr", baseline / "old.0002.exr")
    assert update_baseline(result, "one only")
    assert (baseline / "old.0002.exr").read_bytes() == (frames / "wave.0002.exr").read_bytes()
    assert (baseline / RECORD_FILE).exists() and (baseline / "old.0003.exr").exists()


def test_a_failure_half_way_leaves_the_old_baseline(tmp_path, frames, baseline, monkeypatch):
    before, result, real = contents(baseline), check(frames, baseline), os.rename

    def fail_for_the_new(source, target):
        if str(source).endswith(".new"):
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(os, "rename", fail_for_the_new)
    with pytest.raises(InputError, match="No space left"):
        update_baseline(result, "unlucky", drop_missing=True)
    assert contents(baseline) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def stopped_between_the_renames(frames, baseline, how):
    """Runs an update in another process that ends, by ``how``, when the baseline's folder has lost its name."""
    code = f"""
import os, signal
from tpdwarp.checks.run import check
from tpdwarp.checks.update import update_baseline
real = os.rename
def rename(source, target):
    if str(source).endswith(".new"):
        {how}
    real(source, target)
os.rename = rename
update_baseline(check({str(frames)!r}, {str(baseline)!r}), "unlucky", drop_missing=True)
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).returncode


def test_an_update_that_is_interrupted_leaves_the_old_baseline(tmp_path, frames, baseline):
    before = contents(baseline)
    assert stopped_between_the_renames(frames, baseline, "raise KeyboardInterrupt") != 0
    assert contents(baseline) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_after_an_update_that_was_killed_the_next_check_finds_the_old_baseline(tmp_path, frames, baseline, caplog):
    before = contents(baseline)
    killed = "os.kill(os.getpid(), signal.SIGKILL)"
    assert stopped_between_the_renames(frames, baseline, killed) == -signal.SIGKILL
    assert not baseline.exists()
    assert [frame.status for frame in check(frames, baseline).frames] == ["same", "failed", "failed", "failed"]
    assert contents(baseline) == before and "the baseline is the old one again" in caplog.text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_an_update_under_way_in_another_process_is_left_alone(tmp_path, frames, baseline):
    under_way = f"""
import tpdwarp.checks.update as update
update.finish_interrupted_update({str(baseline)!r})
"""
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {under_way!r}], check=True)"
    # Were the folders swept from outside, the update would fail at its second rename.
    assert stopped_between_the_renames(frames, baseline, code) == 0
    assert (baseline / "old.0002.exr").read_bytes() == (frames / "wave.0002.exr").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
