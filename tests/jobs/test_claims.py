"""Frames are claimed by one render at a time."""

import pytest

from tpdwarp.jobs.claims import ClaimedElsewhere, claimed, sweep_claims


def test_a_frame_is_claimed_by_one_and_free_afterwards(tmp_path):
    path = str(tmp_path / "a.exr")
    with claimed(path):
        with pytest.raises(ClaimedElsewhere), claimed(path):
            pass
        with claimed(str(tmp_path / "b.exr")):
            pass
    with pytest.raises(RuntimeError), claimed(path):
        raise RuntimeError
    with claimed(path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_claims_that_nobody_holds_are_swept_and_those_held_stay(tmp_path):
    (tmp_path / ".left.exr.claim").write_bytes(b"")
    with claimed(str(tmp_path / "a.exr")):
        sweep_claims(str(tmp_path))
        assert [path.name for path in tmp_path.iterdir()] == [".a.exr.claim"]


def test_a_folder_that_takes_no_claims_can_be_rendered_into():
    with claimed("/proc/a.exr"):
        pass
