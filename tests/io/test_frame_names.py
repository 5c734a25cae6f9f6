import math
import os

import pytest

from tpdwarp.errors import InputError
from tpdwarp.io.frame_names import FrameNames, frame_text


@pytest.mark.parametrize(
    ("template", "frame", "path"),
    [
        ("out/wave.####.exr", 12, "out/wave.0012.exr"),
        ("wave#.png", 7, "wave7.png"),
        ("wave_######.exr", 3, "wave_000003.exr"),
        ("wave.##.exr", 12345, "wave.12345.exr"),
        ("wave.####.exr", -3, "wave.-003.exr"),
        ("wave.###.##.exr", 1.5, "wave.001.50.exr"),
        ("wave.###.##.exr", -1.5, "wave.-01.50.exr"),
        ("#.exr", 0, "0.exr"),
        ("sh#t/wave.##.exr", 1, "sh#t/wave.01.exr"),
        ("wave.exr", 5, "wave.exr"),
    ],
)
def test_the_placeholder_gives_way_to_the_padded_frame(template, frame, path):
    names = FrameNames(template)
    names.check([frame])
    assert names.path(frame) == os.path.normpath(path)


def test_several_frames_need_a_placeholder():
    FrameNames("wave.exr").check([1])
    with pytest.raises(InputError, match=r"^wave\.exr: 2 frames need .*wave\.####\.exr"):
        FrameNames("wave.exr").check([1, 2])


def test_fractions_need_as_many_decimals_as_they_have():
    FrameNames("wave.##.##.exr").check([1.25])
    with pytest.raises(InputError, match=r"frame 1\.25 needs decimals in the name \(wave\.####\.##\.exr\)"):
        FrameNames("wave.##.#.exr").check([1, 1.25])


def test_two_placeholders_are_refused():
    with pytest.raises(InputError, match="more than one place"):
        FrameNames("a##b##.exr")


def test_the_default_time_has_no_number():
    names = FrameNames("wave.exr")
    names.check([math.nan])
    assert names.path(math.nan) == "wave.exr"
    with pytest.raises(InputError, match="default time"):
        FrameNames("wave.##.exr").check([math.nan])


def test_frames_are_written_as_people_write_them():
    assert [frame_text(frame) for frame in (12.0, 0.5, -1.0, 1234567.5, math.nan)] == [
        "12",
        "0.5",
        "-1",
        "1234567.5",
        "default",
    ]
