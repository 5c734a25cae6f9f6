"""Limits are written as they are read, keep defaults where nothing is said, and refuse what they do not know."""

import math
from dataclasses import replace

import pytest

from tpdwarp.checks.limits import (
    GroupLimits,
    Limits,
    MetadataLimits,
    SequenceLimits,
    limits_beside,
    read_limits,
    write_limits,
)
from tpdwarp.cli import main
from tpdwarp.errors import InputError


def test_what_is_written_is_what_is_read(tmp_path):
    limits = Limits(
        all=GroupLimits(rmse=0.125, energy=math.inf),
        groups={"beauty": {"flip_mean": 0.25}, "odd name": {"hard": 0.5}, "Z": {"fail_absolute": 1e-7}},
        sequence=SequenceLimits(extra_frames="warn"),
        metadata=MetadataLimits(fail=("a*", 'quo"ted'), warn=()),
        calibration={"seeds": 8, "note": "by\nhand"},
    )
    write_limits(tmp_path / "a.toml", limits, "Two\nlines")
    read = read_limits(tmp_path / "a.toml")
    # Some groups have defaults of their own.
    own = {**Limits().groups["beauty"], "flip_mean": 0.25}
    assert read == replace(limits, groups={**Limits().groups, **limits.groups, "beauty": own})
    assert (tmp_path / "a.toml").read_text().startswith("# Two\n# lines\n")


def test_an_empty_file_is_the_defaults(tmp_path):
    (tmp_path / "a.toml").write_text("")
    assert read_limits(tmp_path / "a.toml") == Limits()


def test_the_command_writes_the_defaults_once_where_a_check_finds_them(tmp_path, capsys):
    baseline = tmp_path / "b"
    assert main(["check", "--write-limits", str(baseline)]) == 2
    assert f"error: {baseline}: does not exist" in capsys.readouterr().err
    baseline.mkdir()
    assert main(["check", "--write-limits", str(baseline)]) == 0
    written = limits_beside(baseline)
    assert capsys.readouterr().out == f"{written} written\n" and read_limits(written) == Limits()
    written.write_text("[all]\nrmse = 0.5\n")
    assert main(["check", "--write-limits", str(baseline)]) == 2
    assert f"error: {written}: is there already" in capsys.readouterr().err
    assert read_limits(written).all.rmse == 0.5
    other = tmp_path / "other.toml"
    assert main(["check", "--write-limits", str(baseline), "--limits", str(other)]) == 0
    assert read_limits(other) == Limits()
    assert main(["check", "--write-limits", "frames", str(baseline)]) == 2


def test_every_table_of_the_written_file_is_explained(tmp_path):
    write_limits(tmp_path / "a.toml", Limits())
    lines = (tmp_path / "a.toml").read_text().splitlines()
    tables = [index for index, line in enumerate(lines) if line.startswith("[") and not line.startswith("[groups.")]
    assert len(tables) == 5 and all(lines[index - 1].startswith("# ") for index in tables)
    assert max(map(len, lines)) <= 120


def test_a_group_of_lights_has_the_limits_of_all_lights_and_its_own(tmp_path):
    path = tmp_path / "tpdwarp-check.toml"
    path.write_text("[groups.caustic]\nrmse = 0.2\nhard = 0.9\n[groups.caustic_key]\nrmse = 0.4\n")
    limits = read_limits(path)
    assert (limits.of("caustic_key").rmse, limits.of("caustic_key").hard) == (0.4, 0.9)
    assert limits.of("caustic_rim") == limits.of("caustic")


def test_groups_change_only_what_they_name(tmp_path):
    (tmp_path / "a.toml").write_text("[all]\nrmse = 0.5\n[groups.caustic]\nenergy = 0.25\n")
    limits = read_limits(tmp_path / "a.toml")
    assert limits.of("caustic") == replace(GroupLimits(), rmse=0.5, energy=0.25)
    assert limits.of("Z") == replace(GroupLimits(), rmse=0.5)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[all]\nrmsee = 1", r"\[all\] knows no 'rmsee'"),
        ("[al]\nrmse = 1", r"knows no table \[al\]"),
        ("rmse = 1", "outside a table"),
        ("[all]\nrmse = 'x'", "must be a number"),
        ("[all]\nrmse = -1", "must be a number, 0 or more"),
        ("[all]\nrmse = true", "must be a number"),
        ("[all]\nrmse = nan", "must be a number"),
        ("[groups]\nrmse = 1", "holds tables"),
        ("[groups.Z]\nx = 1", r"\[groups.Z\] knows no 'x'"),
        ("[sequence]\nextra_frames = 'maybe'", "must be one of fail, warn, ignore"),
        ("[metadata]\nfail = 'x'", "must be a list of names"),
        ("[all", "is no TOML"),
    ],
)
def test_what_is_no_limit_is_refused_with_the_files_name(tmp_path, text, complaint):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=rf"a\.toml: .*{complaint}"):
        read_limits(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[flip]\nwidth = 0\n", "[flip] width must be a whole number above 0, not 0"),
        ("[flip]\nwidth = inf\n", "[flip] width must be a whole number above 0, not inf"),
        ("[flip]\npercentile = 101\n", "[flip] percentile must be a number from 0 to 100, not 101"),
        ("[flip]\nmaximum_luminance = 0.0\n", "[flip] maximum_luminance must be a number above 0, not 0.0"),
        ("[all]\nrmse = " + 2000 * "[" + 2000 * "]", "is nested too deeply"),
        ("[all]\nrmse = " + 200 * "[" + 200 * "]", "[all] rmse must be a number, 0 or more, not [["),
        ("[all]\nrmse = " + 5000 * "9", "is no TOML"),
        ("[all]\nrmse = " + 4000 * "9", "[all] rmse must be a number, 0 or more, not 99"),
        ("[all]\nrmse = 0x" + 5000 * "f", "[all] rmse must be a number, 0 or more, not that"),
        ("[calibration]\nmade = 2020-01-01\n", "[calibration] made must be text or a number"),
    ],
)
def test_limits_that_would_end_a_check_half_way_are_refused_in_a_short_line(tmp_path, text, complaint):
    file = tmp_path / "a.toml"
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        read_limits(file)
    assert str(refused.value).startswith(f"{file}: {complaint}") and len(str(refused.value)) < 500
