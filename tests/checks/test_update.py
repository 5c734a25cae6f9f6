"""A baseline is replaced as a whole or not at all, and says who did it and why."""

import json
import os

import numpy as np
import pytest

from tests.checks.images import channels, write, write_sequence
from tests.checks.test_frames import write_raw
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
    folder = write_sequence(tmp_path / "a", 2)
    write(folder, 2, values={name: plane * 2 for name, plane in channels(2).items()})
    write(folder, 4)
    return folder


def test_the_new_frames_take_the_old_names_and_the_rest_stays(tmp_path, frames, baseline):
    assert update_baseline(check(frames, baseline), " brighter\nnow ")
    now = contents(baseline)
    assert set(now) == {"old.0001.exr", "old.0002.exr", "wave.0004.exr", "README", RECORD_FILE}
    assert now["old.0002.exr"] == (frames / "wave.0002.exr").read_bytes() and now["README"] == b"kept"
    assert check(frames, baseline / "old.####.exr", new=True).frames[0].status == "same"
    record = json.loads(now[RECORD_FILE])
    assert record["reason"] == "brighter now" and "@" in record["who"] and record["time"].endswith("Z")
    assert [change["frame"] for change in record["changes"]] == ["2", "3", "4"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_records_are_added_to_records(frames, baseline):
    update_baseline(check(frames, baseline), "one")
    write(frames, 1, values=channels(9))
    update_baseline(check(frames, baseline), "two")
    lines = (baseline / RECORD_FILE).read_text().splitlines()
    assert [json.loads(line)["reason"] for line in lines] == ["one", "two"]


def test_equal_frames_replace_nothing(baseline):
    before = contents(baseline)
    assert not update_baseline(check(baseline, baseline), "why not")
    assert contents(baseline) == before


def test_no_reason_no_update(frames, baseline):
    before = contents(baseline)
    with pytest.raises(InputError, match="--reason"):
        update_baseline(check(frames, baseline), "  ")
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
    assert update_baseline(check(frames, baseline), "the disk was full")
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
        update_baseline(result, "unlucky")
    assert contents(baseline) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
