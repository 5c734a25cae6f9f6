"""The plug-in renders, compares, fails with a report and updates with a reason, in a project of its own."""

import tomllib
from importlib import metadata
from pathlib import Path

import pytest
import warp as wp

import tpdwarp.checks.run
import tpdwarp.jobs.sequence
from tests.checks.images import write_sequence
from tests.small_stage import write_stage
from tpdwarp.checks.pytest_plugin import assert_frames_match

# Loaded here: pytester forgets what its runs load, and Warp cannot be loaded twice; and before pytester moves the home
# folder, in which compiled kernels are kept.
assert tpdwarp.jobs.sequence and tpdwarp.checks.run
wp.init()

pytest_plugins = ["pytester"]

TEST = """
def test_pane(tpdwarp_frames):
    tpdwarp_frames("pane.usda", frames="1:2", image_width=12, samples=1, photons=64{more})
"""


@pytest.fixture
def run(pytester):
    """Runs pytest in a project that renders a pane; the plug-in is named where it is not installed."""
    installed = any(entry.value == "tpdwarp.checks.pytest_plugin" for entry in metadata.entry_points(group="pytest11"))
    write_stage(pytester.path / "pane.usda")
    pytester.makepyfile(test_it=TEST.format(more=""))
    return lambda *options: pytester.runpytest_inprocess(
        *([] if installed else ["-p", "tpdwarp.checks.pytest_plugin"]), *options
    )


def test_the_package_tells_pytest_of_the_plug_in():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["pytest11"] == {"tpdwarp": "tpdwarp.checks.pytest_plugin"}


def test_a_project_makes_keeps_and_breaks_its_baseline(run, pytester):
    first = run()
    first.assert_outcomes(failed=1)
    first.stdout.fnmatch_lines(["*there is no baseline*--tpdwarp-update*"])
    run("--tpdwarp-update", "--tpdwarp-reason", "first").assert_outcomes(passed=1)
    baseline = pytester.path / "baselines" / "test_it" / "test_pane"
    assert {path.name for path in baseline.glob("*.exr")} == {"frame.0001.exr", "frame.0002.exr"}
    run().assert_outcomes(passed=1)

    pytester.makepyfile(test_it=TEST.format(more=", smoothing=2.0"))
    broken = run("--tpdwarp-reports", str(pytester.path / "reports"))
    broken.assert_outcomes(failed=1)
    broken.stdout.fnmatch_lines(["*2 frames: 2 failed*", "*report: *test_it-test_pane-test_pane.html"])
    assert (pytester.path / "reports" / "test_it-test_pane-test_pane.html").exists()
    run("--tpdwarp-update", "--tpdwarp-reason", "softer light").assert_outcomes(passed=1)
    run().assert_outcomes(passed=1)
    assert "softer light" in (baseline / "tpdwarp-check.history.jsonl").read_text()


def test_an_update_needs_a_reason(run):
    result = run("--tpdwarp-update")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*--tpdwarp-reason*"])


def test_frames_that_are_there_already_can_be_asserted(tmp_path):
    frames, baseline = write_sequence(tmp_path / "a", 2), write_sequence(tmp_path / "b", 3)
    assert assert_frames_match(frames, frames).ok
    with pytest.raises(pytest.fail.Exception, match=r"1 failed.*\n.*r.html"):
        assert_frames_match(frames, baseline, report=tmp_path / "r.html")
