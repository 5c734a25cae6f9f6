"""No output is an input, nor another output."""

import os

import pytest

from tpdwarp.errors import InputError
from tpdwarp.io.outputs import check_outputs


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.usda"
    path.write_text("scene")
    return path


def test_outputs_apart_from_each_other_and_from_inputs_are_fine(scene, tmp_path):
    frames = [tmp_path / f"a.{frame}.exr" for frame in range(3)]
    check_outputs({"--stats": tmp_path / "a.json", "--debug-layer": None}, {"is the scene": [scene]}, frames)


@pytest.mark.parametrize("by", ["name", "other name", "symbolic link", "hard link", "linked folder"])
def test_an_input_is_known_by_any_of_its_names(scene, tmp_path, by, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").symlink_to(tmp_path)
    names = {
        "name": scene,
        "other name": "./scene.usda",
        "symbolic link": tmp_path / "symbolic.json",
        "hard link": tmp_path / "hard.json",
        "linked folder": tmp_path / "folder" / "scene.usda",
    }
    names["symbolic link"].symlink_to(scene)
    os.link(scene, names["hard link"])
    for outputs, frames in (({"--stats": names[by]}, ()), ({}, [tmp_path / "a.1.exr", names[by]])):
        with pytest.raises(InputError, match="is read by the scene"):
            check_outputs(outputs, {"is read by the scene": [scene]}, frames)
    assert scene.read_text() == "scene"


@pytest.mark.parametrize("exists", [False, True])
def test_two_outputs_of_one_name_are_refused_with_both_their_options(tmp_path, exists):
    path = tmp_path / "a.1.exr"
    if exists:
        path.write_text("x")
    with pytest.raises(InputError, match="is written by stats and by frames"):
        check_outputs({"--stats": path}, {}, [path])
    with pytest.raises(InputError, match="is written by csv and by json"):
        check_outputs({"--csv": path, "--json": path}, {})
