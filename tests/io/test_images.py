"""What is written to an image is what is read back, at the depth its format promises."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.images import (
    EXTENSIONS,
    HALF_MAXIMUM,
    check_format,
    encode_srgb,
    exact_rate,
    read_image,
    write_frame,
    write_pixels,
)

COLOR_CHANNELS = ["R", "G", "B", "A", "caustic.R", "caustic.G", "caustic.B", "direct.R", "direct.G", "direct.B"]
FLOAT_CHANNELS = ["Z", "N.X", "N.Y", "N.Z", "P.X", "P.Y", "P.Z", "motion.X", "irradiance.R", "photons"]


def frame(names: list[str], height: int = 3, width: int = 5) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(7)
    return {name: generator.uniform(0.1, 1.0, (height, width)).astype(np.float32) for name in names}


def srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def test_exr_keeps_colours_to_half_and_measures_to_float(tmp_path: Path) -> None:
    channels = frame(COLOR_CHANNELS + FLOAT_CHANNELS)
    channels["Z"][0, 0] = 1e10
    channels["photons"][0, 0] = 2**24 - 1
    write_frame(tmp_path / "a.exr", channels, {})
    read, _ = read_image(tmp_path / "a.exr")
    assert sorted(read) == sorted(channels)
    for name in COLOR_CHANNELS:
        np.testing.assert_array_equal(read[name], channels[name].astype(np.float16).astype(np.float32), err_msg=name)
    for name in FLOAT_CHANNELS:
        np.testing.assert_array_equal(read[name], channels[name], err_msg=name)


def test_exr_is_zipped_scan_lines_with_the_beauty_first(tmp_path: Path) -> None:
    channels = frame(["Z", "caustic.R", "A", "B", "G", "R"])
    write_frame(tmp_path / "a.exr", channels, {})
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert spec.channelnames[:4] == ("R", "G", "B", "A")
    assert spec.getattribute("compression") == "zip" and spec.tile_width == 0
    assert "lin_rec709" in spec.getattribute("oiio:ColorSpace")


@pytest.mark.parametrize("value", [1e9, np.nextafter(np.float32(HALF_MAXIMUM), np.float32(np.inf)), -1e9])
def test_colours_beyond_half_are_limited_to_its_largest(tmp_path: Path, value: float) -> None:
    channels = frame(["R", "G", "B", "A"])
    channels["G"][1, 2] = value
    write_frame(tmp_path / "a.exr", channels, {})
    assert read_image(tmp_path / "a.exr")[0]["G"][1, 2] == np.sign(value) * HALF_MAXIMUM
    assert channels["G"][1, 2] == np.float32(value), "the caller's pixels are not touched"


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_pixel_that_is_not_finite_is_named_and_nothing_written(tmp_path: Path, extension: str, value: float) -> None:
    channels = frame(["R", "G", "B", "A"])
    channels["B"][2, 4] = value
    with pytest.raises(FrameError, match=r"channel B .*pixel \(4, 2\)"):
        write_frame(tmp_path / f"a{extension}", channels, {})
    assert not list(tmp_path.iterdir())


def test_exr_attributes_come_back_as_they_were_given(tmp_path: Path) -> None:
    metadata = {
        "worldToCamera": np.arange(16, dtype=np.float64).reshape(4, 4),
        "worldToNDC": np.eye(4) * 0.5,
        "framesPerSecond": 24000 / 1001,
        "expTime": 0.5,
        "capDate": "2020:01:02 03:04:05",
        "Software": "tpdwarp",
        "tpdwarp:frame": 12,
        "tpdwarp:shutter": (0.0, 0.5),
        "tpdwarp:fluxSent": np.float64(1.25),
        "tpdwarp:settings": json.dumps({"photons": 65536, "mask": ["/A"]}),
    }
    write_frame(tmp_path / "a.exr", frame(["R", "G", "B", "A"]), metadata)
    _, read = read_image(tmp_path / "a.exr")
    for name, value in metadata.items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(read[name], value)
        else:
            assert read[name] == value, name


@pytest.mark.parametrize(
    ("value", "stored"),
    [
        (True, 1),
        (2**31 - 1, 2**31 - 1),
        (2**40, str(2**40)),
        (np.array([1, 2, 3]), (1.0, 2.0, 3.0)),
        ([0.5] * 4, (0.5,) * 4),
        ({"lost": {"grazing": 0.5}}, '{"lost": {"grazing": 0.5}}'),
        ([1] * 5, "[1, 1, 1, 1, 1]"),
        (["a", "b"], '["a", "b"]'),
    ],
)
def test_no_type_of_attribute_is_dropped(tmp_path: Path, value: object, stored: object) -> None:
    write_frame(tmp_path / "a.exr", frame(["R", "G", "B"]), {"tpdwarp:value": value, "tpdwarp:none": None})
    _, read = read_image(tmp_path / "a.exr")
    assert read["tpdwarp:value"] == stored
    assert "tpdwarp:none" not in read


def test_attribute_of_unknown_type_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        write_frame(tmp_path / "a.exr", frame(["R", "G", "B"]), {"tpdwarp:value": object()})


@pytest.mark.parametrize(
    ("rate", "fraction"),
    [(24, (24, 1)), (25, (25, 1)), (23.976, (24000, 1001)), (29.97, (30000, 1001)), (59.94, (60000, 1001)),
     (12.5, (25, 2)), (0.5, (1, 2))],
)  # fmt: skip
def test_frame_rates_become_the_fractions_they_stand_for(rate: float, fraction: tuple[int, int]) -> None:
    assert exact_rate(rate).as_integer_ratio() == fraction


# Half a step of rounding, and what the transfer curve's single-precision table may add.
@pytest.mark.parametrize(("extension", "tolerance"), [(".png", 0.5 / 255), (".tif", 0.5 / 65535)])
def test_display_formats_hold_srgb_of_the_colour_without_its_alpha(
    tmp_path: Path, extension: str, tolerance: float
) -> None:
    straight = frame(["R", "G", "B"])
    alpha = np.linspace(0.2, 1.0, 15, dtype=np.float32).reshape(3, 5)
    channels = {name: values * alpha for name, values in straight.items()} | {"A": alpha, "Z": alpha}
    write_frame(tmp_path / f"a{extension}", channels, {"worldToCamera": np.eye(4)})
    read, _ = read_image(tmp_path / f"a{extension}")
    assert list(read) == ["R", "G", "B", "A"]
    np.testing.assert_allclose(read["A"], alpha, rtol=0, atol=tolerance * 1.01)
    for name, values in straight.items():
        np.testing.assert_allclose(read[name], srgb(values), rtol=0, atol=tolerance + 1e-5, err_msg=name)


@pytest.mark.parametrize("extension", [".jpg", ".jpeg"])
def test_jpeg_shows_the_beauty_over_black(tmp_path: Path, extension: str) -> None:
    channels = {name: np.full((16, 16), 0.25, np.float32) for name in "RGBA"}
    write_frame(tmp_path / f"a{extension}", channels, {})
    read, _ = read_image(tmp_path / f"a{extension}")
    assert list(read) == ["R", "G", "B"]
    # A flat grey block survives but for the rounding of its mean (quantum 1/8 of 2/255 or less) and of the pixel.
    np.testing.assert_allclose(read["G"], srgb(np.array(0.25)), rtol=0, atol=1.5 / 255)


def test_srgb_encoding_ignores_color_configurations_of_other_programs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OCIO", str(tmp_path / "studio.ocio"))
    ramp = np.linspace(0, 1, 48, dtype=np.float32).reshape(4, 4, 3)
    np.testing.assert_allclose(encode_srgb(ramp), srgb(ramp), rtol=0, atol=1e-5)


@pytest.mark.parametrize("name", ["a", "a.gif", "a.exr.bak", "frame.####"])
def test_unknown_formats_are_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError) as refusal:
        check_format(name)
    assert all(extension in str(refusal.value) for extension in EXTENSIONS)


@pytest.mark.parametrize("name", ["a.exr", "b.####.PNG", "c/d.jpeg", "e.tif"])
def test_known_formats_are_accepted(name: str) -> None:
    check_format(name)


def test_formats_without_layers_refuse_them() -> None:
    check_format("a.exr", ("Z", "N"))
    with pytest.raises(InputError, match="Z, N"):
        check_format("a.png", ("Z", "N"))


def test_frame_that_cannot_be_written_fails_and_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match=r"missing/a\.exr"):
        write_frame(tmp_path / "missing" / "a.exr", frame(["R", "G", "B", "A"]), {})


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_frame_that_finds_the_disk_full_fails_and_leaves_nothing(tmp_path: Path, extension: str) -> None:
    """In a process of its own, because one of the writers would end it."""
    program = f"""
import resource, numpy as np
from tpdwarp.errors import FrameError
from tpdwarp.io.images import write_frame
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, resource.RLIM_INFINITY))
noise = np.random.default_rng(1).random((200, 200), dtype=np.float32)
try:
    write_frame({str(tmp_path / f"a{extension}")!r}, dict.fromkeys("RGBA", noise), {{}})
except FrameError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith(str(tmp_path / f"a{extension}") + ": cannot be written")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size", [2, 16])
def test_a_small_frame_for_which_there_is_no_room_at_all_fails(tmp_path: Path, size: int) -> None:
    """It fits into what its writer holds until it closes the file."""
    program = f"""
import resource, signal, numpy as np
from tpdwarp.errors import FrameError
from tpdwarp.io.images import write_frame
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
try:
    write_frame({str(tmp_path / "a.exr")!r}, dict.fromkeys("RGBA", np.ones(({size}, {size}), np.float32)), {{}})
except FrameError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith(str(tmp_path / "a.exr") + ": cannot be written"), done
    assert not list(tmp_path.iterdir())


def test_png_that_came_out_short_fails_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write_half(temporary: str, *others: Any) -> None:
        write_pixels(temporary, *others)
        os.truncate(temporary, os.path.getsize(temporary) // 2)

    monkeypatch.setattr("tpdwarp.io.images.write_pixels", write_half)
    with pytest.raises(FrameError, match=r"a\.png: cannot be written: it came out damaged"):
        write_frame(tmp_path / "a.png", frame(["R", "G", "B", "A"]), {})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("extension", [".exr", ".png", ".tif"])
def test_truncated_file_is_not_taken_for_an_image(tmp_path: Path, extension: str) -> None:
    generator = np.random.default_rng(1)
    write_frame(tmp_path / f"a{extension}", {name: generator.random((64, 64)) for name in "RGBA"}, {})
    whole = (tmp_path / f"a{extension}").read_bytes()
    (tmp_path / f"a{extension}").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=rf"a\{extension}"):
        read_image(tmp_path / f"a{extension}")


def test_file_that_is_no_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.exr").write_bytes(b"no image")
    for name in ("a.exr", "missing.exr"):
        with pytest.raises(InputError, match=name):
            read_image(tmp_path / name)
