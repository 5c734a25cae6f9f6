"""Names of textures: by receiver, tile and frame."""

from __future__ import annotations

import pytest

from tpdwarp.errors import InputError
from tpdwarp.jobs.texture_names import TextureNames, labels_of, light_layer_path, udim

ONE = [(0, 0)]


def test_udim_numbers_count_ten_columns_from_1001():
    assert [udim(tile) for tile in ((0, 0), (9, 0), (0, 1), (3, 2))] == [1001, 1010, 1011, 1024]


@pytest.mark.parametrize(
    ("template", "tiles", "names"),
    [
        ("a/c.####.exr", {"/F": ONE}, ["a/c.0007.exr"]),
        ("c.exr", {"/F": ONE}, ["c.exr"]),
        ("c.####.exr", {"/W/F": ONE, "/W/G": ONE}, ["c.F.0007.exr", "c.G.0007.exr"]),
        ("c.exr", {"/F": [(0, 0), (1, 0)]}, ["c.1001.exr", "c.1002.exr"]),
        ("c.##.exr", {"/F": [(0, 1)], "/G": ONE}, ["c.F.1011.07.exr", "c.G.07.exr"]),
        ("c.<UDIM>.##.exr", {"/F": ONE}, ["c.1001.07.exr"]),
    ],
)
def test_receivers_and_tiles_stand_before_the_frame(template, tiles, names):
    assert TextureNames(template, tiles).paths(7) == names


def test_receivers_of_one_name_are_told_apart_by_what_is_above_them():
    assert labels_of(["/A/F", "/B/F", "/A/G"]) == {"/A/F": "A_F", "/B/F": "B_F", "/A/G": "G"}
    assert labels_of(["/I[0]/F", "/I[1]/F"]) == {"/I[0]/F": "I_0_F", "/I[1]/F": "I_1_F"}


def test_a_tile_without_a_number_is_refused():
    with pytest.raises(InputError, match=r"/F.*UDIM"):
        TextureNames("c.exr", {"/F": [(-1, 0)]})


@pytest.mark.parametrize("template", ["x/c.####.exr", "x/c.exr", "x/c.<UDIM>.####.exr"])
def test_the_light_layer_lies_beside_its_textures(template):
    assert light_layer_path(template).as_posix() == "x/c.light.usda"
