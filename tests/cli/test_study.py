import json

import pytest

from tests.small_stage import write_stage
from tpdwarp.cli import main
from tpdwarp.cli.parser import build_parser

TRUTH = ["--truth-photons", "512", "--truth-times", "2", "--truth-samples", "1"]


@pytest.fixture
def arguments(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    return ["study", stage, "-w", "12", "--samples", "1", *TRUTH, "--cache", str(tmp_path / "cache")]


def test_a_study_prints_its_table(arguments, tmp_path, capsys):
    swept = ["--methods", "tpd,pd,tdpm", "--photons", "64,128", "--segments", "1,2", "--tdpm-neighbours", "8"]
    more = ["--tdpm-between", "random,1", "--exposure", "0.5,1", "--presets", "draft", "--progress", "none"]
    out = tmp_path / "study.json"
    assert main([*arguments, *swept, *more, "--json", str(out)]) == 0
    stdout, stderr = capsys.readouterr()
    assert stderr == "" and stdout.count("truth with relative noise") == 2
    # The sign of the rows is explained.
    assert "\n*  " in stdout and stdout.count("\n* on the Pareto front: ") == 1
    # Two exposures, of two numbers of photons with two, one and two ways, and the preset.
    assert len(json.loads(out.read_text())["measured"]) == 2 * (2 * (2 + 1 + 2) + 1)


def test_plain_progress_is_a_line_for_everything_rendered(arguments, capsys):
    short = [*arguments, "--methods", "pd", "--photons", "64", "--progress", "plain"]
    assert main(short) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3 and lines[2].startswith("3/3 pd, 64 photons, exposure 0.5: ")
    assert main(short) == 0
    assert all("kept from before" in line for line in capsys.readouterr().err.splitlines())


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (["--methods", "best"], "--methods knows no 'best'"),
        (["--photons", "1,x"], "invalid list value"),
        (["--progress", "loud"], "--progress must be one of"),
        (["--estimator", "pd"], "unknown arguments"),
    ],
)
def test_wrong_usage_is_one_line_with_code_2(arguments, wrong, said, capsys):
    assert main([*arguments, *wrong]) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == "" and said in stderr and stderr.count("\n") == 1


def test_help_fits_two_screens(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        build_parser(("study",)).parse_args(["study", "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 80 and max(map(len, lines)) <= 110
