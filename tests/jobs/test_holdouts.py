"""Frames behind what another renderer saw nearer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tpdwarp
from tpdwarp.errors import InputError
from tpdwarp.io.image_region import ImageRegion
from tpdwarp.io.images import read_image, write_frame
from tpdwarp.jobs.holdouts import Holdouts, slope

SMALL = {"photons": 256, "image_width": 24, "samples": 1}
WAVE = Path(__file__).resolve().parents[2] / "usd_scenes" / "wave.usdc"


def host(path, depth, **names):
    """Writes a host's image."""
    black = np.zeros_like(depth)
    write_frame(path, {"R": black, "G": black, "B": black, "A": black, **names, "Z": depth}, {})
    return path


@pytest.fixture(scope="module")
def plain():
    return tpdwarp.render_frame(WAVE, 2, **SMALL, aovs=["caustic", "Z", "N"]).channels


def test_what_lies_behind_a_board_of_the_host_is_black_and_transparent(tmp_path, plain):
    board = plain["Z"].copy()
    board[:, :7] *= 0.5
    host(tmp_path / "host.0002.exr", board)
    held = tpdwarp.render_frame(
        WAVE, 2, **SMALL, aovs=["caustic", "Z", "N"], holdout=tmp_path / "host.####.exr"
    ).channels
    for name, values in plain.items():
        is_light = name in ("R", "G", "B", "A") or name.startswith("caustic")
        np.testing.assert_array_equal(held[name][:, :7], 0 if is_light else values[:, :7])
        np.testing.assert_array_equal(held[name][:, 7:], values[:, 7:])


def test_a_host_that_sees_the_same_surfaces_hides_none_of_them():
    # A floor seen at a grazing angle: anywhere within a pixel its depth is another, and half floats round it.
    rows = np.linspace(5, 90, 40, dtype=np.float32)[:, None] * np.ones((1, 30), np.float32)
    rows[10:20, 10:20] = 4.0
    channels = {"R": np.ones_like(rows), "Z": rows}
    for shift in (-1.0, 1.0):
        other = rows + np.where(rows > 4.0, shift * (90 - 5) / 39, 0.0)
        elsewhere = np.float32(np.float16(other))
        assert Held(elsewhere).applied(1, channels, ImageRegion.whole(30, 40))["R"].all()


def test_a_silhouette_is_no_slope():
    depth = np.full((8, 8), 9.0, np.float32)
    depth[:, 4:] = 3.0
    assert not slope(depth).any()


def test_only_the_part_that_is_rendered_is_compared(tmp_path, plain):
    board = plain["Z"].copy()
    board[:, 12:] *= 0.5
    host(tmp_path / "host.exr", board)
    options = {**SMALL, "holdout": str(tmp_path / "host.exr"), "crop": (8, 0, 16, 6)}
    held = tpdwarp.render_frame(WAVE, 2, **options).channels
    assert held["A"].shape == (6, 8)
    assert held["A"][:, :4].all()
    assert not held["A"][:, 4:].any()


def test_a_frame_is_rendered_anew_when_its_host_changes(tmp_path, plain, caplog):
    path = host(tmp_path / "host.0002.exr", plain["Z"])
    options = {**SMALL, "frames": 2, "holdout": tmp_path / "host.####.exr"}
    out = tmp_path / "f.####.exr"
    tpdwarp.render(WAVE, out, **options)
    (again,) = tpdwarp.render(WAVE, out, **options, skip_existing=True).outcomes
    assert again.status == "skipped"
    host(path, plain["Z"] * np.float32(0.5))
    (anew,) = tpdwarp.render(WAVE, out, **options, skip_existing=True).outcomes
    assert anew.status == "written"
    assert "of another holdout" in caplog.text
    assert not read_image(tmp_path / "f.0002.exr")[0]["A"].any()


def test_a_host_without_depth_or_of_another_size_is_refused(tmp_path):
    black = np.zeros((4, 6), np.float32)
    write_frame(tmp_path / "plain.exr", {"R": black, "G": black, "B": black, "A": black}, {})
    write_frame(tmp_path / "normals.exr", {"R": black, "G": black, "B": black, "A": black, "N.Z": black}, {})
    channels = {"R": black, "Z": black}
    for name in ("plain.exr", "normals.exr"):
        with pytest.raises(InputError, match="has no depth"):
            Holdouts(str(tmp_path / name)).applied(1, channels, ImageRegion.whole(6, 4))
    host(tmp_path / "small.exr", black)
    with pytest.raises(InputError, match="6 × 4 pixels, the frame 12 × 8"):
        Holdouts(str(tmp_path / "small.exr")).applied(1, channels, ImageRegion.whole(12, 8))


def test_depths_are_found_by_the_names_of_other_programs(tmp_path):
    near = np.full((4, 6), 1.0, np.float32)
    black = np.zeros_like(near)
    for index, name in enumerate(("ViewLayer.Depth.Z", "depth.V", "Depth")):
        path = tmp_path / f"{index}.exr"
        write_frame(path, {"R": black, "G": black, "B": black, "A": black, "N.Z": black, name: near}, {})
        held = Holdouts(str(path)).applied(1, {"R": near, "Z": 5 * near}, ImageRegion.whole(6, 4))
        assert not held["R"].any()


def test_a_frame_does_not_overwrite_its_host(tmp_path, plain):
    path = host(tmp_path / "f.0002.exr", plain["Z"])
    with pytest.raises(InputError, match="is read by holdout"):
        tpdwarp.render(WAVE, tmp_path / "f.####.exr", frames=2, **SMALL, holdout=tmp_path / "f.####.exr")
    assert read_image(path)[0].keys() == {"R", "G", "B", "A", "Z"}


class Held(Holdouts):
    """Holdouts by a depth that lies in no file."""

    def __init__(self, depth):
        super().__init__("host.exr")
        self._given = depth

    def _depth(self, frame, region):
        return self._given
