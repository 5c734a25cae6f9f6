"""Pictures on disk are the pictures that were kept there, and their file goes with them."""

import gc
import os

import pytest

from tpdwarp.checks.picture_store import PictureStore
from tpdwarp.errors import FrameError


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_pictures_come_back_whatever_was_kept_and_read_in_between():
    store = PictureStore()
    first = store.keep({"a": b"one", "b": b""})
    assert first["a"] == b"one"
    second = store.keep({"a": bytes(100_000)})
    assert dict(first) == {"a": b"one", "b": b""} and dict(second) == {"a": bytes(100_000)}
    assert "b" in first and "c" not in first and len(second) == 1


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="counts open files as Linux lists them")
def test_the_file_is_closed_with_the_last_mapping():
    gc.collect()
    before = open_files()
    kept = PictureStore().keep({"a": b"one"})
    assert open_files() == before + 1 and kept["a"] == b"one"
    del kept
    gc.collect()
    assert open_files() == before


def test_a_full_disk_is_said(monkeypatch):
    store = PictureStore()
    store._file = open("/dev/full", "r+b", buffering=0)  # noqa: SIM115
    with pytest.raises(FrameError, match="No space left"):
        store.keep({"a": b"one"})
