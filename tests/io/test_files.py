"""Files are complete or absent, and what cannot be written is found out before any work is done."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import tpdwarp
from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.files import check_name, check_writable, complete_or_absent, sweep_temporaries


def listing(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_file_appears_only_when_the_block_has_ended(tmp_path: Path) -> None:
    target = tmp_path / "frame.0001.exr"
    with complete_or_absent(target) as temporary:
        assert Path(temporary).parent == tmp_path and Path(temporary).suffix == ".exr"
        Path(temporary).write_bytes(b"whole")
        assert not target.exists()
    assert target.read_bytes() == b"whole"
    assert listing(tmp_path) == ["frame.0001.exr"]


@pytest.mark.parametrize("interruption", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_interrupted_block_leaves_the_old_file_and_nothing_else(tmp_path: Path, interruption: type) -> None:
    target = tmp_path / "a.usdc"
    target.write_bytes(b"old")
    with pytest.raises(interruption), complete_or_absent(target) as temporary:
        Path(temporary).write_bytes(b"half")
        raise interruption
    assert target.read_bytes() == b"old"
    assert listing(tmp_path) == ["a.usdc"]


def test_abandoned_block_leaves_nothing(tmp_path: Path) -> None:
    block = complete_or_absent(tmp_path / "a.usdc")
    Path(block.__enter__()).write_bytes(b"half")
    del block
    assert listing(tmp_path) == []


def test_block_that_writes_nothing_fails(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match=r"a\.exr"), complete_or_absent(tmp_path / "a.exr"):
        pass
    assert listing(tmp_path) == []


def test_target_that_became_a_folder_fails_and_leaves_no_temporary(tmp_path: Path) -> None:
    target = tmp_path / "a.exr"
    with pytest.raises(FrameError, match=r"a\.exr"), complete_or_absent(target) as temporary:
        Path(temporary).write_bytes(b"whole")
        target.mkdir()
    assert listing(tmp_path) == ["a.exr"]


def test_permissions_are_those_of_an_ordinary_new_file(tmp_path: Path) -> None:
    ordinary = tmp_path / "ordinary"
    ordinary.write_bytes(b"")
    with complete_or_absent(tmp_path / "a") as temporary:
        Path(temporary).write_bytes(b"")
    assert stat.S_IMODE(os.stat(tmp_path / "a").st_mode) == stat.S_IMODE(os.stat(ordinary).st_mode)


def test_a_symbolic_link_is_replaced_and_what_it_names_left_alone(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere.txt"
    elsewhere.write_bytes(b"precious")
    link = tmp_path / "a.exr"
    link.symlink_to(elsewhere)
    check_writable(link)
    with complete_or_absent(link) as temporary:
        Path(temporary).write_bytes(b"whole")
    assert elsewhere.read_bytes() == b"precious"
    assert not link.is_symlink() and link.read_bytes() == b"whole"


def test_linked_folders_are_followed(tmp_path: Path) -> None:
    (tmp_path / "store").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "store")
    check_writable(tmp_path / "out" / "a.exr")
    with complete_or_absent(tmp_path / "out" / "a.exr") as temporary:
        Path(temporary).write_bytes(b"whole")
    assert (tmp_path / "store" / "a.exr").read_bytes() == b"whole"


@pytest.mark.parametrize("url", ["s3://bucket/a.exr", "https://host/a.####.exr", "file:///tmp/a.exr"])
def test_urls_are_refused_and_make_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="is a URL"):
        check_writable(url)
    assert listing(tmp_path) == []


def test_names_that_libraries_take_for_others_are_refused() -> None:
    check_name("größe/波.exr")
    with pytest.raises(InputError, match="no name in UTF-8"):
        check_name(os.fsdecode(b"gr\xf6\xdfe.exr"))
    script = "from tpdwarp.io.files import check_name; import sys; check_name('a.exr'); check_name(sys.argv[1])"
    environment = {**os.environ, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"}
    done = subprocess.run(
        [sys.executable, "-c", script, "größe.exr"], env=environment, capture_output=True, text=True, timeout=60
    )
    assert "PYTHONUTF8=1" in done.stderr


def test_temporaries_of_killed_processes_are_swept_and_those_of_others_left(tmp_path: Path) -> None:
    script = (
        "import os, sys\nfrom tpdwarp.io.files import complete_or_absent\n"
        "block = complete_or_absent(sys.argv[1])\nopen(block.__enter__(), 'w').close()\nprint('made', flush=True)\n"
        "sys.stdin.read() if len(sys.argv) > 2 else os.kill(os.getpid(), 9)"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(tpdwarp.__file__).parent.parent)}
    subprocess.run([sys.executable, "-c", script, tmp_path / "killed.exr"], env=environment, timeout=60)
    living = subprocess.Popen(
        [sys.executable, "-c", script, tmp_path / "living.exr", "stay"],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert living.stdout.readline() == b"made\n"
    (tmp_path / ".mine.tmp.exr").write_bytes(b"")
    assert len(listing(tmp_path)) == 3
    assert sweep_temporaries(tmp_path) == 1
    assert [name.split(".")[1] for name in listing(tmp_path)] == ["living", "mine"]
    living.communicate()


def test_longest_legal_name_can_be_written(tmp_path: Path) -> None:
    target = tmp_path / ("é" * 125 + ".exr")
    check_writable(target)
    with complete_or_absent(target) as temporary:
        Path(temporary).write_bytes(b"whole")
    assert target.exists()


def test_missing_folders_are_made_and_no_file(tmp_path: Path) -> None:
    check_writable(tmp_path / "a" / "b" / "frame.####.exr")
    assert (tmp_path / "a" / "b").is_dir() and listing(tmp_path / "a" / "b") == []


def test_existing_file_is_writable_and_untouched(tmp_path: Path) -> None:
    target = tmp_path / "a.exr"
    target.write_bytes(b"old")
    check_writable(target)
    assert target.read_bytes() == b"old"


def unwritable_paths(tmp_path: Path) -> dict[str, str]:
    (tmp_path / "file").write_bytes(b"")
    os.mkfifo(tmp_path / "pipe.exr")
    return {
        "empty": "",
        "a folder": str(tmp_path),
        "under a file": str(tmp_path / "file" / "a.exr"),
        "deep under a file": str(tmp_path / "file" / "b" / "a.exr"),
        "a pipe": str(tmp_path / "pipe.exr"),
        "a device": "/dev/null",
        "a file system without files": "/proc/a.exr",
        "a file system without folders": "/proc/none/a.exr",
        "too long": str(tmp_path / ("n" * 300 + ".exr")),
        "no name at all": str(tmp_path / "a\0.exr"),
    }


@pytest.mark.parametrize(
    "case",
    [
        "empty",
        "a folder",
        "under a file",
        "deep under a file",
        "a pipe",
        "a device",
        "a file system without files",
        "a file system without folders",
        "too long",
        "no name at all",
    ],
)
def test_unwritable_path_is_refused_in_one_line_that_names_it(tmp_path: Path, case: str) -> None:
    path = unwritable_paths(tmp_path)[case]
    with pytest.raises(InputError) as refusal:
        check_writable(path)
    assert str(refusal.value).startswith(path) and "\n" not in str(refusal.value)


def test_folder_without_write_permission_is_refused(tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("an administrator may write everywhere")
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(InputError, match="locked"):
        check_writable(tmp_path / "locked" / "a.exr")
