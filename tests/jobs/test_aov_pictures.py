"""Channel groups as pictures, files of one depth, and names that people try."""

from __future__ import annotations

import json

import numpy as np
import pytest

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.cli import main
from tpdwarp.errors import InputError
from tpdwarp.io.images import encode_srgb, read_image, read_stored
from tpdwarp.jobs.aov_pictures import picture_of
from tpdwarp.settings import Settings
from tpdwarp.view.film import BACKGROUND_DEPTH

SMALL = {"photons": 64, "samples": 1, "image_width": 12, "threads": 1}
ALPHA = np.ones((1, 2), np.float32)


@pytest.fixture
def small(tmp_path):
    return write_stage(tmp_path / "small.usda")


def plane(*values: float) -> np.ndarray:
    return np.array([values], np.float32)


def test_a_picture_of_light_is_brighter_by_its_stops():
    channels = {"A": ALPHA, **{f"caustic.{c}": plane(0.1, 0.3) for c in "RGB"}}
    np.testing.assert_allclose(picture_of(channels, "caustic", 1.0)["G"], plane(0.2, 0.6))


def test_normals_and_motions_stand_around_a_middle_grey():
    normals = {"A": ALPHA, "N.X": plane(-1, 1), "N.Y": plane(0, 0), "N.Z": plane(0, 0)}
    np.testing.assert_allclose(picture_of(normals, "N", 0.0)["R"], plane(0, 1))
    motions = {"A": ALPHA, "vector.X": plane(-0.5, 0.25), "vector.Y": plane(0, 0)}
    found = picture_of(motions, "vector", 1.0)
    np.testing.assert_allclose(found["R"], plane(0, 0.75))
    np.testing.assert_allclose(found["B"], plane(0.5, 0.5))


def test_depths_darken_with_distance_to_the_background():
    found = picture_of({"A": ALPHA, "Z": plane(1.0, BACKGROUND_DEPTH)}, "Z", 0.0)
    np.testing.assert_allclose(found["G"], plane(0.5, 0.0))


def test_objects_differ_in_colour():
    found = picture_of({"A": ALPHA, "id": plane(17, 18)}, "id", 0.0)
    assert any(found[c][0, 0] != found[c][0, 1] for c in "RGB")


def test_a_png_shows_the_group_asked_for(small, tmp_path):
    tpdwarp.render(small, tmp_path / "a.exr", frames=2, aovs=["irradiance"], **SMALL)
    tpdwarp.render(small, tmp_path / "a.png", frames=2, view="irradiance", view_exposure=-2, **SMALL)
    channels, _ = read_image(tmp_path / "a.exr")
    expected = encode_srgb(np.stack([channels[f"irradiance.{c}"] / 4 for c in "RGB"], axis=-1))
    shown, _ = read_image(tmp_path / "a.png")
    assert expected.max() > 0.3
    # Eight bits.
    np.testing.assert_allclose(shown["G"], np.clip(expected[..., 1], 0, 1), atol=0.51 / 255)


def test_a_view_is_for_formats_that_hold_one_picture(small, tmp_path):
    with pytest.raises(InputError, match="--view is for"):
        tpdwarp.render(small, tmp_path / "a.exr", frames=2, view="caustic", **SMALL)
    with pytest.raises(InputError, match="holds one picture, not Z"):
        tpdwarp.render(small, tmp_path / "a.png", frames=2, view="caustic", aovs=["Z"], **SMALL)


@pytest.mark.parametrize(("exr_type", "depths"), [("half", {"half"}), ("float", {"float"}), ("", {"half", "float"})])
def test_all_channels_have_the_depth_asked_for(small, tmp_path, exr_type, depths):
    tpdwarp.render(small, tmp_path / "a.exr", frames=2, aovs=["Z", "albedo"], exr_type=exr_type, **SMALL)
    assert set(read_stored(tmp_path / "a.exr").depths) == depths


def test_objects_are_named_in_the_metadata(small, tmp_path):
    tpdwarp.render(small, tmp_path / "a.exr", frames=2, aovs=["id"], **SMALL)
    channels, metadata = read_image(tmp_path / "a.exr")
    names = json.loads(metadata["tpdwarp:ids"])
    assert {names[str(int(number))] for number in np.unique(channels["id"]) if number} == {
        "/World/Pane",
        "/World/Floor",
    }


def test_names_that_people_try_are_understood_and_lists_add_up(small, tmp_path):
    assert Settings(aovs=("caustics", "depth", "normal", "position", "Z")).aovs == ("caustic", "Z", "N", "P")
    size = ["--resolution", "9", "4", "--samples", "1", "--photons", "64", "--threads", "1"]
    out = tmp_path / "a.##.exr"
    assert main(["render", small, str(out), "-f", "1", "-f", "3", "--aov", "depth", "--aov", "albedo,id", *size]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["a.01.exr", "a.03.exr"]
    channels, _ = read_image(tmp_path / "a.03.exr")
    assert {"Z", "albedo.R", "id"} <= channels.keys()
    assert channels["R"].shape == (4, 9)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"exr_type": "double"}, "half, float"),
        ({"view": "beauty"}, "knows no 'beauty'"),
        ({"resolution": (0, 4)}, "width and a height"),
        ({"resolution": (4, 4), "image_width": 3}, "leave one out"),
        ({"view_exposure": float("nan")}, "stops"),
    ],
)
def test_settings_of_pictures_that_make_no_sense_are_refused(settings, why):
    with pytest.raises(InputError, match=why):
        Settings(**settings)
