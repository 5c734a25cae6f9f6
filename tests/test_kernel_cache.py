"""Kernels run whatever has become of their cache."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import tpdwarp
from tpdwarp import kernel_cache
from tpdwarp.compiler_lock import lock_of
from tpdwarp.io.digests import DIGESTS, has_its_digests

ROOT = Path(tpdwarp.__file__).parent.parent

# Doubles numbers in two kernels of a module each, and says when it is ready and what was warned of.
PROGRAM = """
import logging, sys, time
import numpy as np
import warp as wp
logging.basicConfig(stream=sys.stderr, format="%(message)s")
from tpdwarp.device import Launcher

@wp.kernel(module="unique", enable_backward=False)
def double(base: int, values: wp.array(dtype=wp.int32)):
    i = base + wp.tid()
    values[i] = 2 * values[i]

@wp.kernel(module="unique", enable_backward=False)
def square(base: int, values: wp.array(dtype=wp.int32)):
    i = base + wp.tid()
    values[i] = values[i] * values[i]

launcher = Launcher("cpu", 2)
values = launcher.array(np.arange(2000, dtype=np.int32), wp.int32)
launcher(double, 2000, [values])
launcher(square, 2000, [values])
assert (values.numpy() == 4 * np.arange(2000) ** 2).all()
print("right", wp.config.kernel_cache_dir)
"""


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    (tmp_path / "tmp").mkdir()
    return path


def start(program, cache, **changes):
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "TMPDIR": str(program.parent / "tmp"),
        "WARP_CACHE_PATH": str(cache),
        **changes,
    }
    environment = {name: value for name, value in environment.items() if value is not None}
    return subprocess.Popen(
        [sys.executable, str(program)], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def run(program, cache, **changes):
    process = start(program, cache, **changes)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    word, folder = out.split()
    assert word == "right"
    return Path(folder), err.splitlines()


def modules(cache):
    return sorted(path for path in cache.rglob("wp_*") if path.is_dir())


def test_a_sound_cache_is_used_without_a_word_and_nothing_else_is_left(program, tmp_path):
    cache = tmp_path / "cache"
    for _ in range(2):
        folder, said = run(program, cache)
        assert folder.parent == cache and said == []
    assert len(modules(cache)) == 2
    names = {path.name for path in folder.iterdir()}
    assert all(re.fullmatch(r"wp_(double|square)_\w+", name) and "_p" not in name for name in names)
    assert os.listdir(tmp_path / "tmp") == []


def break_object(module, how):
    (binary,) = module.glob("*.o")
    if how == "no metadata":
        (next(module.glob("*.meta"))).write_bytes(b"")
    elif how == "no sums":
        (module / DIGESTS).unlink()
        binary.write_bytes(b"")
    else:
        data = bytearray(binary.read_bytes())
        data = {"empty": b"", "truncated": data[: len(data) // 2], "flipped": bytes(255 - byte for byte in data)}[how]
        binary.write_bytes(data)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compiled")
    (folder / "program.py").write_text(PROGRAM)
    (folder / "tmp").mkdir()
    run(folder / "program.py", folder / "cache")
    return folder


@pytest.mark.parametrize("how", ["empty", "truncated", "flipped", "no metadata", "no sums"])
def test_damaged_kernels_are_compiled_anew_with_one_line_each(compiled, tmp_path, how):
    # A kernel's name depends on the file that defines it.
    cache = tmp_path / "cache"
    shutil.copytree(compiled / "cache", cache)
    module = modules(cache)[0]
    break_object(module, how)
    _, said = run(compiled / "program.py", cache)
    assert str(module) in said[-1] and said[-1].endswith("compiled anew")
    # Where nothing else tells that an object is damaged, LLVM finds out and has a word of its own.
    assert len(said) == (2 if how == "no sums" else 1)
    assert has_its_digests(str(module)) and (module / DIGESTS).exists()


def test_a_cache_that_cannot_be_written_is_used_for_what_it_holds(compiled, tmp_path):
    cache = tmp_path / "cache"
    shutil.copytree(compiled / "cache", cache)
    # A file where the locks would be: neither locked nor removed.
    for module in modules(cache):
        Path(lock_of(str(module)).path).symlink_to("/dev/full")
    assert run(compiled / "program.py", cache)[1] == []


@pytest.mark.parametrize("case", ["below a file", "home below a file"])
def test_a_cache_that_cannot_be_made_is_replaced_by_one_in_the_temporary_folder(program, tmp_path, case):
    (tmp_path / "file").write_text("")
    changes = {"WARP_CACHE_PATH": str(tmp_path / "file" / "cache")}
    if case == "home below a file":
        # Without a path of its own, the cache lies in the user's folder for such.
        changes = {"WARP_CACHE_PATH": None, "HOME": str(tmp_path / "file"), "XDG_CACHE_HOME": str(tmp_path / "file")}
    folder, said = run(program, "", **changes)
    own = tmp_path / "tmp" / f"tpdwarp-kernels-{os.getuid()}"
    assert folder.parent == own and own.stat().st_mode & 0o777 == 0o700
    assert len(said) == 1 and "cannot keep compiled kernels (Not a directory)" in said[0]


def test_a_full_disk_is_noticed_before_the_compiler_meets_it(program, tmp_path):
    # There is no room for an exabyte in the temporary folder either.
    before, after = PROGRAM.split("from tpdwarp.device")
    full = "from tpdwarp import kernel_cache\nkernel_cache.ROOM_BYTES = 1 << 60\nfrom tpdwarp.device"
    program.write_text(before + full + after)
    process = start(program, tmp_path / "cache")
    _, err = process.communicate(timeout=300)
    assert process.returncode == 1 and err.splitlines()[-1].count("kernels cannot be compiled") == 1
    assert "cannot keep compiled kernels" in err


def test_one_of_several_processes_compiles_and_all_are_right(program, tmp_path):
    cache = tmp_path / "cache"
    processes = [start(program, cache) for _ in range(3)]
    outputs = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert {err for _, err in outputs} == {""} and len(modules(cache)) == 2


def test_other_kernels_are_compiled_meanwhile(program, tmp_path):
    cache = tmp_path / "cache"
    folder, _ = run(program, cache)
    for module in modules(cache):
        shutil.rmtree(module)
    lock = lock_of(str(folder / "wp_of_somebody_else"))
    assert lock.acquire()
    assert run(program, cache)[1] == []
    lock.release()


def test_who_is_killed_while_compiling_holds_nobody_up_and_leaves_nothing(program, tmp_path):
    cache = tmp_path / "cache"
    process = start(program, cache)
    deadline = time.monotonic() + 60
    while not list(cache.rglob("wp_*_p*")) and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert list(cache.rglob("wp_*_p*"))
    _, said = run(program, cache)
    assert said == [] and not list(cache.rglob("wp_*_p*")) and os.listdir(tmp_path / "tmp") == []


def test_a_folder_that_others_may_write_to_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache.tempfile, "tempdir", str(tmp_path))
    first = Path(kernel_cache.own_folder())
    assert first == tmp_path / f"tpdwarp-kernels-{os.getuid()}"
    first.chmod(0o777)
    other = Path(kernel_cache.own_folder())
    assert other != first and other.stat().st_mode & 0o077 == 0
    first.rmdir()
    first.symlink_to(other)
    assert Path(kernel_cache.own_folder()) not in (first, other)
