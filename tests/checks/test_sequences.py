"""Frames pair up by number, whatever their padding; by name where there are several series."""

from pathlib import Path

import pytest

from tpdwarp.checks.sequences import frame_file, image_pairs
from tpdwarp.errors import InputError


def touch(folder: Path, *names: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"")
    return folder


def pairs(a: Path, b: Path) -> list[tuple[str, list[str], list[str]]]:
    return [
        (pair.name, [Path(f).name for f in pair.files], [Path(f).name for f in pair.baselines])
        for pair in image_pairs(a, b)
    ]


@pytest.mark.parametrize(
    ("name", "series", "frame"),
    [
        ("wave.0012.exr", "wave", 12),
        ("wave.012.50.exr", "wave", 12.5),
        ("wave_-003.exr", "wave", -3),
        ("0007.png", "", 7),
        ("v2.wave.0001.exr", "v2.wave", 1),
        ("still.exr", "still", None),
        ("take2.exr", "take2", None),
    ],
)
def test_names_are_taken_apart(name, series, frame):
    found = frame_file(Path("out") / name)
    assert (found.series, found.frame) == (series, frame)


def test_frames_pair_by_number_in_order_whatever_they_are_called(tmp_path):
    a = touch(tmp_path / "a", "new.0010.exr", "new.0009.exr", "notes.txt", ".new.0011.exr")
    b = touch(tmp_path / "b", "old.9.exr", "old.10.exr", "tpdwarp-check.toml")
    assert pairs(a, b) == [("9", ["new.0009.exr"], ["old.9.exr"]), ("10", ["new.0010.exr"], ["old.10.exr"])]


def test_missing_extra_and_duplicate_frames_are_kept_apart(tmp_path):
    a = touch(tmp_path / "a", "w.1.exr", "w.0001.exr", "w.3.exr")
    b = touch(tmp_path / "b", "w.1.exr", "w.2.exr")
    assert pairs(a, b) == [
        ("1", ["w.0001.exr", "w.1.exr"], ["w.1.exr"]),
        ("2", [], ["w.2.exr"]),
        ("3", ["w.3.exr"], []),
    ]


def test_several_series_pair_by_name(tmp_path):
    a = touch(tmp_path / "a", "left.1.exr", "right.1.exr")
    b = touch(tmp_path / "b", "left.1.exr", "still.exr")
    assert pairs(a, b) == [
        ("left 1", ["left.1.exr"], ["left.1.exr"]),
        ("right 1", ["right.1.exr"], []),
        ("still", [], ["still.exr"]),
    ]


def test_a_template_takes_its_own_files_only(tmp_path):
    a = touch(tmp_path / "a", "w.1.exr", "w.2.exr", "other.1.exr", "w.x.exr")
    assert [name for name, *_ in pairs(a / "w.####.exr", a / "w.#.exr")] == ["1", "2"]


def test_two_images_are_a_pair_whatever_they_are_called(tmp_path):
    a = touch(tmp_path / "a", "w.1.exr", "fine.exr")
    assert pairs(a / "w.1.exr", a / "fine.exr") == [("w.1", ["w.1.exr"], ["fine.exr"])]


def test_one_image_against_a_folder_misses_no_other_frame(tmp_path):
    a = touch(tmp_path / "a", "w.2.exr")
    b = touch(tmp_path / "b", "w.1.exr", "w.2.exr")
    assert pairs(a / "w.2.exr", b) == [("2", ["w.2.exr"], ["w.2.exr"])]


@pytest.mark.parametrize("name", ["none", "none.####.exr", "a/w.####.exr"])
def test_a_place_that_does_not_exist_is_refused(tmp_path, name):
    a = touch(tmp_path / "a", "x.1.exr")
    with pytest.raises(InputError, match=name.partition("####")[0]):
        image_pairs(a, tmp_path / name)
