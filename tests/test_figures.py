"""What the figures share: sheets, captions and lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tpdwarp.io.images import with_text
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.scene.description import CameraAtShutter
from tpdwarp.usd.read.debug_layer import DebugLayerReader
from tpdwarp.usd.write.debug_layer import DebugLayerWriter
from usd_scenes.drawing import lines, sheets

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "scripts" / "figures"


def test_grey_runs_evenly_between_its_ends_and_stops_there() -> None:
    found = sheets.grey(np.array([[-1.0, 1.0, 2.0, 3.0, 9.0]]), 1.0, 3.0)
    np.testing.assert_array_equal(found[0, :, 0], [0, 0, 128, 255, 255])
    assert found.shape == (1, 5, 3)


def test_tiles_stay_as_they_are_in_their_places_and_captions_lie_beneath() -> None:
    tiles = [[sheets.Tile(np.full((20, 90, 3), 10 * row + column, np.uint8), ("e",)) for column in range(2)]
             for row in range(2)]
    picture = sheets.sheet(tiles)
    pitch = 20 + sheets.LINE_HEIGHT + sheets.GAP
    assert picture.shape == (2 * pitch, 180 + sheets.GAP, 3)
    for row in range(2):
        for column in range(2):
            left = column * (90 + sheets.GAP)
            assert np.all(picture[row * pitch : row * pitch + 20, left : left + 90] == 10 * row + column)
            assert picture[row * pitch + 20 : (row + 1) * pitch, left : left + 90].max() > 100


def test_text_is_drawn_where_it_is_asked_for_and_the_picture_given_is_not_changed() -> None:
    plain = np.zeros((40, 60, 3), np.uint8)
    drawn = with_text(plain, [(30, 30, "H")], 12)
    assert not plain.any()
    rows, columns = np.nonzero(drawn[..., 0])
    assert columns.min() >= 30 and columns.max() < 30 + 12 and rows.min() >= 30 - 12 and rows.max() <= 30


def test_section_of_a_figure_replaces_its_older_one_and_keeps_the_order_of_numbers() -> None:
    def figure(number: int, text: str) -> object:
        return sheets.Figure(number, "title", [], text)

    captions = sheets.HEADING
    for number, text in ((8, "eight"), (1, "one"), (8, "newer")):
        captions = sheets.with_section(captions, figure(number, text))
    assert captions.startswith(sheets.HEADING.strip())
    assert [line for line in captions.splitlines() if line.startswith("##")] == ["## Fig. 1: title", "## Fig. 8: title"]
    assert "newer" in captions and "eight" not in captions


def test_projection_puts_the_corners_of_the_window_on_the_corners_of_the_picture() -> None:
    axes = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    camera = CameraAtShutter("/Camera", True, np.array([5.0, 6.0, 7.0]), axes, (-1.0, 3.0, -2.0, 2.0))
    # Upper left is (left, top), lower right (right, bottom); depth does not count.
    upper_left = camera.position - 1.0 * axes[0] + 2.0 * axes[1] - 4.0 * axes[2]
    lower_right = camera.position + 3.0 * axes[0] - 2.0 * axes[1]
    found = lines.project(np.stack([upper_left, lower_right]), camera, (10, 40))
    np.testing.assert_allclose(found, [[0, 0], [40, 10]], atol=1e-12)


def test_line_through_pixel_centres_covers_them_and_nothing_beside() -> None:
    ends = np.array([[[2.5, 4.5], [8.5, 4.5]]])
    found = lines.draw_lines(np.zeros((9, 12, 3), np.uint8), ends, np.array([[255.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(found[4, 3:8, 0], 255)
    assert not found[..., 1:].any() and not np.delete(found[..., 0], 4, axis=0).any()
    assert not found[4, :2].any() and not found[4, 9:].any()


def test_line_beyond_the_picture_is_cut_off() -> None:
    ends = np.array([[[-50.0, 1.5], [50.0, 1.5]]])
    found = lines.draw_lines(np.zeros((3, 4, 3), np.uint8), ends, np.full((1, 3), 200.0))
    np.testing.assert_array_equal(found[1], 200)


def test_time_differentials_run_from_shutter_open_to_shutter_close(tmp_path: Path) -> None:
    positions, moves = np.array([[0.0, 0, 0], [1, 2, 0]]), np.array([[0.5, 0, 0], [0, -2, 0]])
    axis = np.eye(3)
    record = PhotonRecord(
        np.arange(2), positions, axis[[2, 2]], axis[[0, 0]], axis[[1, 1]], moves, np.ones((2, 3)), np.zeros((2, 2)),
        np.ones(2, np.int32), np.zeros(2, np.int32), ("/Floor",),
    )
    path = tmp_path / "a.debug.usdc"
    scene = ROOT / "usd_scenes" / "wave.usdc"
    with DebugLayerWriter(path, scene, {}, (1, 1), 1.0, 24.0, 24.0, "Z", 1.0) as layer:
        layer.add_frame(1, record, 1.0)
    ends, colors = DebugLayerReader(path).time_differentials(1)
    np.testing.assert_array_equal(ends, np.stack([positions - moves / 2, positions + moves / 2], axis=1))
    assert colors.shape == (2, 3) and not np.array_equal(colors[0], colors[1])


def test_every_figure_has_its_picture_and_its_caption() -> None:
    captions = (ROOT / "docs" / "figures" / "README.md").read_text(encoding="utf-8")
    numbers = [int(path.name.removeprefix("fig").partition("_")[0]) for path in FOLDER.glob("fig*_*.py")]
    assert len(numbers) == len(set(numbers)) >= 5
    for number in numbers:
        assert f"## Fig. {number}: " in captions and f"(fig{number}.png)" in captions
        assert (ROOT / "docs" / "figures" / f"fig{number}.png").is_file()
