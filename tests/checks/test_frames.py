"""Every kind of difference between two frames is found and called by its name; equal frames are the same."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.checks.images import HEIGHT, WIDTH, channels, metadata, write
from tpdwarp.checks import frames
from tpdwarp.checks.findings import FrameComparison
from tpdwarp.checks.frames import compare_frame
from tpdwarp.checks.limits import GroupLimits, Limits, MetadataLimits, SequenceLimits
from tpdwarp.checks.sequences import Pair
from tpdwarp.io.images import set_attribute, write_frame

DEFAULTS = Limits()


def compared(a: Path | None, b: Path | None, limits: Limits = DEFAULTS) -> FrameComparison:
    pair = Pair("1", 1.0, (str(a),) if a else (), (str(b),) if b else ())
    return compare_frame(pair, limits).comparison


def kinds(comparison: FrameComparison) -> dict[str, str]:
    return {finding.kind: finding.severity for finding in comparison.findings}


@pytest.fixture
def baseline(tmp_path: Path) -> Path:
    return write(tmp_path / "b")


def test_equal_frames_are_the_same_though_written_at_other_times(tmp_path, baseline):
    other = write(tmp_path / "a", **{"tpdwarp:renderSeconds": 77.0})
    found = compared(other, baseline)
    assert found.status == "same" and found.findings == () and found.identical
    assert set(found.measures) == {"beauty", "alpha", "caustic", "Z"}
    assert found.measures["beauty"].rmse == 0 and found.measures["beauty"].flip_mean == 0


def test_equal_files_are_decoded_once_and_measured_as_equal_pixels_are(tmp_path, baseline, monkeypatch):
    decoded = []
    real = frames.read_stored
    monkeypatch.setattr(frames, "read_stored", lambda path: decoded.append(path) or real(path))
    again = write(tmp_path / "again", **{"tpdwarp:renderSeconds": 77.0})
    pixels_alone = compared(again, baseline)
    assert len(decoded) == 2
    (tmp_path / "copy.exr").write_bytes(baseline.read_bytes())
    bytes_too = compared(tmp_path / "copy.exr", baseline)
    assert len(decoded) == 3
    assert bytes_too.measures == pixels_alone.measures and bytes_too.status == "same"


@pytest.mark.parametrize(
    ("other", "same"), [(b"x" * 2**20 + b"ab", True), (b"x" * 2**20 + b"ac", False), (b"x" * 2**20, False)]
)
def test_files_are_the_same_where_every_byte_is(tmp_path, other, same):
    (tmp_path / "a").write_bytes(b"x" * 2**20 + b"ab")
    (tmp_path / "b").write_bytes(other)
    paths = str(tmp_path / "a"), str(tmp_path / "b")
    assert frames.same_bytes(*paths) is same and frames.same_bytes(*reversed(paths)) is same
    assert not frames.same_bytes(paths[0], str(tmp_path / "none"))


def test_rounding_to_half_is_no_difference(tmp_path, baseline):
    values = channels()
    nudged = {name: plane * np.float32(1 + 4e-4) for name, plane in values.items()}
    found = compared(write(tmp_path / "a", values=nudged), baseline)
    assert found.status == "passed", found.findings


def test_one_percent_dimmer_is_found_by_its_energy_and_measured_exactly(tmp_path, baseline):
    values = {n: plane * np.float32(0.99 if n[-1] in "RGB" else 1) for n, plane in channels().items()}
    found = compared(write(tmp_path / "a", values=values), baseline)
    assert kinds(found)["energy"] == "fail"
    # Halves round each pixel by up to 2^-11 of it; a sum of hundreds does far better than that.
    assert found.measures["beauty"].energy == pytest.approx(-0.01, abs=2**-11)
    assert found.measures["beauty"].rmse == pytest.approx(0.01, abs=2**-11)


def test_nan_and_infinity_fail_in_either_image_and_name_their_pixel(tmp_path, baseline):
    for value in (np.nan, np.inf):
        path = write_raw(tmp_path / "a.exr", channels(), {"Z": (7, 3, value)})
        finding = next(f for f in compared(path, baseline).findings if f.kind == "not finite")
        assert finding.group == "Z" and finding.place == (7, 3) and "(7, 3)" in finding.message
        assert not finding.of_baseline and finding.severity == "fail"
        turned = next(f for f in compared(baseline, path).findings if f.kind == "not finite")
        assert turned.of_baseline


def test_nan_in_both_fails_too(tmp_path):
    path = write_raw(tmp_path / "a.exr", channels(), {"R": (0, 0, np.nan)})
    assert compared(path, path).status == "failed"


def test_limits_cannot_switch_off_nan(tmp_path, baseline):
    path = write_raw(tmp_path / "a.exr", channels(), {"R": (0, 0, np.nan)})
    wide = dict.fromkeys(vars(GroupLimits()), float("inf"))
    assert compared(path, baseline, Limits(all=GroupLimits(**wide), groups={})).status == "failed"


def test_one_hot_pixel_is_found_and_located(tmp_path, baseline):
    values = channels()
    values["G"][5, 31] = 40
    found = compared(write(tmp_path / "a", values=values), baseline)
    assert "hard" in kinds(found)
    worst = found.measures["beauty"].worst[0]
    assert (worst.column, worst.row) == (31, 5) and worst.value[1] == 40


def test_a_pixel_fails_only_beyond_both_its_limits(tmp_path, baseline):
    values = channels()
    values["R"] = values["R"] + np.float32(0.05)
    path = write(tmp_path / "a", values=values)
    off = {name: float("inf") for name in ("hard", "rmse", "energy", "flicker", "warn_absolute")}
    for absolute, relative, fails in ((0.04, 0.01, True), (0.06, 0.01, False), (0.04, 0.5, False)):
        limits = Limits(all=GroupLimits(fail_absolute=absolute, fail_relative=relative, **off), groups={})
        assert ("pixels" in kinds(compared(path, baseline, limits))) is fails


def test_another_size_is_said_and_nothing_else_measured(tmp_path, baseline):
    small = {name: plane[:-1] for name, plane in channels().items()}
    found = compared(write(tmp_path / "a", values=small), baseline)
    assert kinds(found) == {"size": "fail"} and found.measures == {}
    assert f"{WIDTH} × {HEIGHT - 1}" in found.findings[0].message


def test_pixels_that_lie_elsewhere_are_said(tmp_path, baseline):
    moved = write_raw(tmp_path / "a.exr", channels(), origin=(3, 2))
    message = next(f.message for f in compared(moved, baseline).findings if f.kind == "size")
    assert "(3, 2, 0, 0, 40, 24)" in message and "(0, 0, 0, 0, 40, 24)" in message


def test_parts_beyond_the_first_are_not_passed_over_in_silence(tmp_path, baseline):
    specs = []
    for name in ("left", "right"):
        spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "half")
        spec.attribute("name", name)
        specs.append(spec)
    output = oiio.ImageOutput.create(str(tmp_path / "two.exr"))
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    assert output.open(str(tmp_path / "two.exr"), specs) and output.write_image(pixels)
    assert output.open(str(tmp_path / "two.exr"), specs[1], "AppendSubimage") and output.write_image(pixels)
    output.close()
    assert kinds(compared(tmp_path / "two.exr", baseline))["parts"] == "fail"
    assert kinds(compared(tmp_path / "two.exr", tmp_path / "two.exr")) == {"parts": "warn"}


@pytest.mark.parametrize("size", [(1, 1), (2, 9), (9, 1)])
def test_tiny_images_are_compared_too(tmp_path, size):
    values = {name: np.full(size, 0.5, np.float32) for name in "RGB"}
    a = write(tmp_path / "a", values=values)
    b = write(tmp_path / "b", values={**values, "R": values["R"] * 2})
    assert {"rmse", "flip_mean"} <= set(kinds(compared(a, b)))


def test_missing_and_extra_channels_are_named(tmp_path, baseline):
    without = {name: plane for name, plane in channels().items() if not name.startswith("caustic")}
    path = write(tmp_path / "a", values=without)
    missing, extra = compared(path, baseline), compared(baseline, path)
    assert kinds(missing) == {"missing channels": "fail"} and "caustic.G" in missing.findings[0].message
    assert kinds(extra) == {"extra channels": "warn"} and "caustic.G" in extra.findings[0].message
    assert "caustic" not in missing.measures and "beauty" in missing.measures


def test_float_in_place_of_half_is_a_difference_of_type(tmp_path, baseline):
    path = write_raw(tmp_path / "a.exr", {n: p.astype(np.float16).astype(np.float32) for n, p in channels().items()})
    found = compared(path, baseline)
    assert kinds(found)["pixel type"] == "fail" and "R is float, the baseline's half" in str(found.findings)


@pytest.mark.parametrize(
    ("change", "kind", "severity"),
    [
        ({"tpdwarp:settings": '{"photons": 65, "seed": 0, "threads": 2, "exposure": 0.5}'}, "settings", "fail"),
        ({"tpdwarp:settings": '{"photons": 64, "seed": 1, "threads": 2, "exposure": 0.5}'}, "settings", "warn"),
        ({"tpdwarp:settings": '{"photons": 64, "seed": 0, "threads": 9, "exposure": 0.5}'}, None, None),
        (
            {"tpdwarp:settings": '{"photons": 64, "seed": 0, "threads": 9, "exposure": 0.5, "new": 1}'},
            "settings",
            "warn",
        ),
        ({"tpdwarp:settings": "no JSON"}, "metadata", "fail"),
        ({"tpdwarp:shutterClose": 1.75}, "metadata", "fail"),
        ({"tpdwarp:shutterClose": None}, "metadata", "fail"),
        ({"tpdwarp:version": "2"}, "metadata", "warn"),
        ({"worldToCamera": np.diag([1, 1, 1.1, 1])}, "metadata", "fail"),
        ({"worldToCamera": np.diag([1, 1, 1 + 1e-7, 1])}, None, None),
    ],
)
def test_metadata_is_compared_by_weight(tmp_path, baseline, change, kind, severity):
    expected = {kind: severity} if kind else {}
    assert kinds(compared(write(tmp_path / "a", **change), baseline)) == expected


def test_ignored_attributes_are_for_the_limits_to_say(tmp_path, baseline):
    other = write(tmp_path / "a", **{"tpdwarp:version": "2"})
    limits = Limits(metadata=MetadataLimits(fail=("tpdwarp:ver*",), warn=()))
    assert kinds(compared(other, baseline, limits)) == {"metadata": "fail"}


def test_a_truncated_file_is_that_frames_failure(tmp_path, baseline):
    whole = baseline.read_bytes()
    for length in (0, 3, 300, len(whole) // 2):
        cut = tmp_path / f"cut.{length}.exr"
        cut.write_bytes(whole[:length])
        found = compared(cut, baseline)
        assert kinds(found) == {"unreadable": "fail"} and cut.name in found.findings[0].message
    assert compared(baseline, cut).findings[0].of_baseline


def test_missing_and_extra_frames_are_said_as_the_rules_say(baseline):
    assert kinds(compared(None, baseline)) == {"missing frame": "fail"}
    assert kinds(compared(baseline, None)) == {"extra frame": "fail"}
    lenient = Limits(sequence=SequenceLimits(extra_frames="warn", missing_frames="ignore"))
    assert kinds(compared(baseline, None, lenient)) == {"extra frame": "warn"}
    assert kinds(compared(None, baseline, lenient)) == {}


def test_background_depths_swamp_nothing_and_are_counted(tmp_path):
    """A ray that hits nothing has depth 1e10: one such pixel more is one pixel, and hides no other."""
    values = channels()
    values["Z"][:4] = 1e10
    reference = write(tmp_path / "b", values=values)
    moved = {name: plane.copy() for name, plane in values.items()}
    moved["Z"][4, 0] = 1e10
    found = compared(write(tmp_path / "a", values=moved), reference).measures["Z"]
    assert found.failed_percent == pytest.approx(100 / (WIDTH * HEIGHT)) and found.rmse == 0 and found.hard == 0
    assert (found.worst[0].column, found.worst[0].row) == (0, 4) and found.worst[0].value == (np.float32(1e10),)
    moved["Z"][10:] *= np.float32(1.01)
    found = compared(write(tmp_path / "c", values=moved), reference).measures["Z"]
    assert 0.005 < found.rmse < 0.011


def test_png_is_compared_as_it_is_stored_and_seen_in_linear_light(tmp_path):
    values = {name: np.clip(plane, 0, 1) for name, plane in channels().items() if name in "RGB"}
    for name, scale in (("a", 1.0), ("b", 0.9)):
        write_frame(tmp_path / f"{name}.png", {n: p * np.float32(scale) for n, p in values.items()}, {})
    found = compared(tmp_path / "a.png", tmp_path / "b.png")
    assert {"rmse", "flip_mean", "energy"} <= set(kinds(found))


def write_raw(
    path: Path,
    values: dict[str, np.ndarray],
    pixels: dict[str, tuple[int, int, float]] | None = None,
    origin: tuple[int, int] = (0, 0),
) -> Path:
    """Writes channels as float, with single pixels (column, row, value) set, past the checks of the program."""
    names = list(values)
    stacked = np.stack([values[name] for name in names], axis=-1)
    for name, (column, row, value) in (pixels or {}).items():
        stacked[row, column, names.index(name)] = value
    spec = oiio.ImageSpec(WIDTH, HEIGHT, len(names), "float")
    spec.channelnames = tuple(names)
    spec.x, spec.y = origin
    for name, value in metadata().items():
        set_attribute(spec, name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(stacked) and output.close()
    return path
