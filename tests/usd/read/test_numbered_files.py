"""Asset paths with places for the numbers of frames and tiles."""

import os

import pytest
from pxr import Sdf, Usd

from tpdwarp.usd.read.numbered_files import all_files, changes_by_frame, file_at, files_at, is_tiled


@pytest.fixture
def named(tmp_path):
    """Makes files, and an asset attribute that names what is given."""
    stages = []

    def make(path, *files):
        for file in files:
            (tmp_path / file).parent.mkdir(exist_ok=True)
            (tmp_path / file).touch()
        stages.append(Usd.Stage.CreateNew(str(tmp_path / "stage.usda")))
        attribute = stages[-1].DefinePrim("/Prim").CreateAttribute("file", Sdf.ValueTypeNames.Asset)
        attribute.Set(path)
        return attribute

    return make


@pytest.mark.parametrize(
    "name, file",
    [
        ("a.<frame>.png", "a.0007.png"),
        ("a.<frame>.png", "a.7.png"),
        ("a.<frame:3>.png", "a.007.png"),
        ("a.<f4>.png", "a.0007.png"),
        ("a.{frame}.png", "a.7.png"),
        ("a.{04frame}.png", "a.0007.png"),
        ("a.$F4.png", "a.0007.png"),
        ("a_$F.png", "a_7.png"),
        ("a.${F3}.png", "a.007.png"),
        ("a.%04d.png", "a.0007.png"),
        ("a.####.png", "a.0007.png"),
        ("a 7/ä.##.png", "a 7/ä.07.png"),
    ],
)
def test_a_place_for_the_frame_takes_its_number(named, tmp_path, name, file):
    attribute = named(f"./{name}", file)
    assert changes_by_frame(attribute, 7.0)
    # A frame lasts to the next.
    for time in (7.0, 7.75):
        assert os.path.samefile(file_at(attribute, time), tmp_path / file)
    assert not os.path.exists(file_at(attribute, 8.0))
    assert [os.path.basename(found) for found in all_files(str(tmp_path / name))] == [os.path.basename(file)]


@pytest.mark.parametrize("name", ["a#1.png", "$Fred.png", "a.png", "%d.png"])
def test_a_file_that_is_called_so_is_that_file(named, tmp_path, name):
    attribute = named(f"./{name}", name)
    assert not changes_by_frame(attribute, 7.0)
    assert os.path.samefile(file_at(attribute, 7.0), tmp_path / name)
    assert all_files(str(tmp_path / name)) == [str(tmp_path / name)]


@pytest.mark.parametrize(
    "name, files",
    [
        ("a.<UDIM>.png", ("a.1001.png", "a.1012.png")),
        ("a.<udim>.png", ("a.1001.png", "a.1012.png")),
        ("a.%(UDIM)d.png", ("a.1001.png", "a.1012.png")),
        ("a_<UVTILE>.png", ("a_u1_v1.png", "a_u2_v2.png")),
        ("a.<UDIM>.####.png", ("a.1001.0007.png", "a.1012.0007.png")),
    ],
)
def test_a_place_for_the_tile_finds_all_there_are(named, tmp_path, name, files):
    attribute = named(f"./{name}", *files)
    assert is_tiled(attribute, 7.0)
    found = files_at(attribute, 7.0)
    assert {place: os.path.basename(path) for place, path in found.items()} == {(0, 0): files[0], (1, 1): files[1]}
    assert {os.path.basename(path) for path in all_files(str(tmp_path / name))} == set(files)


def test_what_is_not_there_is_named_as_it_is_authored(named):
    attribute = named("./none.####.png")
    assert file_at(attribute, 7.0) == "./none.####.png"
    for path in ("./none.<UDIM>.png", ""):
        attribute.Set(path)
        assert files_at(attribute, 7.0) == {}
