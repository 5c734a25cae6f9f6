"""A frame stays only where it is whole and would be rendered the same now."""

import json

import numpy as np
import pytest

from tpdwarp.io.images import FINGERPRINT, write_frame
from tpdwarp.jobs.existing_frames import STATISTICS, ExistingFrames, statistics_text
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.settings import Settings

SETTINGS = Settings(photons=64, exposure=0.5, aovs=("Z",))
STAGE = "ab" * 32
ENERGY = EnergyAccount(3.0, 1.0, 1.5, 0.25, {"grazing": 0.25}, {"landed": 7})


def write(path, frame=12.0, settings=SETTINGS, stage=STAGE):
    image = np.random.default_rng(1).random((16, 24)).astype(np.float32)
    metadata = {
        FINGERPRINT: Fingerprint.of(settings, stage).text(frame),
        STATISTICS: statistics_text(7, ENERGY, {"trace": 0.5}),
        "tpdwarp:settings": json.dumps(settings.as_dict()),
    }
    write_frame(path, dict.fromkeys("RGBA", image), metadata)
    return str(path)


def existing(settings=SETTINGS, stage=STAGE):
    return ExistingFrames(Fingerprint.of(settings, stage))


@pytest.mark.parametrize("extension", ["exr", "png", "jpg", "tif"])
def test_a_frame_that_would_be_the_same_stays_in_every_format(tmp_path, extension):
    path = write(tmp_path / f"a.{extension}")
    found = existing()
    kept = found.kept(path, 12.0)
    assert kept is not None and not found.anew
    if extension in ("exr", "png"):
        assert (kept.photons, kept.energy, kept.seconds) == (7, ENERGY, {"trace": 0.5})


@pytest.mark.parametrize("extension", ["exr", "png", "jpg", "tif"])
@pytest.mark.parametrize(
    ("changes", "frame", "reason"),
    [
        ({"settings": Settings(photons=128, exposure=0.5, aovs=("Z",))}, 12.0, "of other settings"),
        ({"settings": Settings(photons=64, exposure=0.5)}, 12.0, "of other settings"),
        ({"settings": Settings(photons=64, exposure=0.5, aovs=("Z",), image_width=9)}, 12.0, "of other settings"),
        ({"stage": "cd" * 32}, 12.0, "of another stage"),
        ({}, 13.0, "of another frame"),
    ],
)
def test_what_changes_pixels_makes_a_frame_stale(tmp_path, extension, changes, frame, reason):
    path = write(tmp_path / f"a.{extension}")
    found = existing(**changes)
    assert found.kept(path, frame) is None
    assert found.anew == {reason: 1}


def test_what_changes_no_pixel_does_not(tmp_path):
    path = write(tmp_path / "a.exr")
    assert existing(Settings(photons=64, exposure=0.5, aovs=["Z"], threads=3)).kept(path, 12.0) is not None


def test_another_version_of_the_program_is_said(tmp_path, monkeypatch, caplog):
    path = write(tmp_path / "a.exr")
    monkeypatch.setattr("tpdwarp.jobs.fingerprint.VERSION", "9.9")
    assert existing().kept(path, 12.0) is None
    assert "is of another program (0.1.0, now 9.9) and rendered anew" in caplog.text


def test_changed_settings_are_named_once(tmp_path, caplog):
    found = existing(Settings(photons=128, exposure=0.5))
    for name in ("a.exr", "b.exr"):
        assert found.kept(write(tmp_path / name), 12.0) is None
    assert "(photons 64, now 128; aovs Z, now )" in caplog.text
    assert len(caplog.records) == 1 and found.anew == {"of other settings": 2}


def damaged(path, how):
    whole = path.read_bytes()
    path.write_bytes(
        {
            "empty": b"",
            "one byte": whole[:1],
            "text": b"half of the frames went elsewhere\n",
            "HTML": b"<!DOCTYPE html><html><body>404 Not Found</body></html>",
            "header only": whole[: len(whole) // 8],
            "cut in half": whole[: len(whole) // 2],
            "last bytes missing": whole[:-9],
            "zeroed end": whole[: 2 * len(whole) // 3] + bytes(len(whole) - 2 * len(whole) // 3),
        }[how]
    )


@pytest.mark.parametrize("extension", ["exr", "png", "jpg", "tif"])
@pytest.mark.parametrize(
    "how",
    ["empty", "one byte", "text", "HTML", "header only", "cut in half", "last bytes missing", "zeroed end"],
)
def test_a_file_that_is_not_whole_does_not_stay(tmp_path, extension, how):
    if (extension, how) == ("tif", "last bytes missing"):
        pytest.skip("what TIFF has at its end is no pixel")
    path = tmp_path / f"a.{extension}"
    write(path)
    damaged(path, how)
    found = existing()
    assert found.kept(str(path), 12.0) is None
    assert sum(found.anew.values()) == 1


def test_a_file_that_is_not_there_is_no_news(tmp_path):
    found = existing()
    assert found.kept(str(tmp_path / "a.exr"), 12.0) is None and not found.anew


def test_frames_of_other_programs_are_without_a_fingerprint(tmp_path):
    write_frame(tmp_path / "a.exr", dict.fromkeys("RGBA", np.ones((2, 3), np.float32)), {})
    found = existing()
    assert found.kept(str(tmp_path / "a.exr"), 12.0) is None
    assert found.anew == {"without a fingerprint": 1}
