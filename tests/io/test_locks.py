"""A lock is held by one, and by nobody once its holder has ended, however it ended."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import tpdwarp
from tpdwarp.io.locks import FileLock

HOLDER = """
import sys
from tpdwarp.io.locks import FileLock
print(FileLock(sys.argv[1]).acquire(), flush=True)
sys.stdin.read()
"""


def holder(path):
    environment = {**os.environ, "PYTHONPATH": str(Path(tpdwarp.__file__).parent.parent)}
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, path], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "True\n"
    return process


def test_a_lock_is_held_by_one_and_leaves_no_file(tmp_path):
    first, second = FileLock(tmp_path / "a"), FileLock(tmp_path / "a")
    assert first.acquire() and not second.acquire()
    first.release()
    first.release()
    assert not (tmp_path / "a").exists()
    assert second.acquire()
    second.release()


def test_another_process_holds_it_until_it_is_killed(tmp_path):
    process = holder(tmp_path / "a")
    lock = FileLock(tmp_path / "a")
    assert not lock.acquire()
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert (tmp_path / "a").exists() and lock.acquire()
    lock.release()
    process.communicate()


def test_a_lock_on_a_file_that_was_replaced_is_none(tmp_path):
    first = FileLock(tmp_path / "a")
    assert first.acquire()
    (tmp_path / "a").unlink()
    second = FileLock(tmp_path / "a")
    assert second.acquire() and (tmp_path / "a").exists()


def test_who_cannot_lock_does_not_wait(tmp_path):
    assert FileLock(tmp_path / "none" / "a").acquire()
    (tmp_path / "elsewhere").write_text("precious")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    lock = FileLock(tmp_path / "link")
    assert lock.acquire()
    lock.release()
    assert (tmp_path / "link").is_symlink() and (tmp_path / "elsewhere").read_text() == "precious"
