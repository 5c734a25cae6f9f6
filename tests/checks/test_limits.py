"""Limits are written as they are read, keep defaults where nothing is said, and refuse what they do not know."""

import math
from dataclasses import replace

import pytest

from tpdwarp.checks.limits import GroupLimits, Limits, MetadataLimits, SequenceLimits, read_limits, write_limits
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
    # The beauty's FLIP has defaults of its own.
    assert read == replace(limits, groups={**limits.groups, "beauty": {**Limits().groups["beauty"], "flip_mean": 0.25}})
    assert (tmp_path / "a.toml").read_text().startswith("# Two\n# lines\n")


def test_an_empty_file_is_the_defaults(tmp_path):
    (tmp_path / "a.toml").write_text("")
    assert read_limits(tmp_path / "a.toml") == Limits()


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
