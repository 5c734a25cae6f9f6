"""Templates of Open Job Description validate, hold what the command line was given, and run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import tpdwarp
from tests.jobs.test_products import wave_from_two_sides
from tests.small_stage import write_stage
from tpdwarp.cli.options import EXPOSURE, MACHINE, METHOD, PICTURE
from tpdwarp.errors import InputError
from tpdwarp.farms.open_job import option_of, range_of
from tpdwarp.io.images import read_image

ROOT = Path(tpdwarp.__file__).parent.parent
SMALL = {"image_width": 8, "samples": 1, "photons": 64}


def openjd(*arguments, **options):
    """Runs the reference command line, with ``tpdwarp`` in reach."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }
    command = [Path(sys.executable).parent / "openjd", *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, **options)


def template(tmp_path, **options):
    stage = write_stage(tmp_path / "stage.usda", frames=5)
    tpdwarp.open_job_template(stage, tmp_path / "out" / "a.##.exr", tmp_path / "t.json", **{**SMALL, **options})
    return tmp_path / "t.json"


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"frames": "1:3,5", "chunk": 1, "strict": True, "frame_timeout": 60, "retries": 2, "max_failures": 3},
        {"shutter": (-0.25, 0.5), "aovs": ("Z", "N"), "segments": "auto", "kernel": "epanechnikov"},
    ],
)
def test_templates_are_valid(tmp_path, options):
    done = openjd("check", template(tmp_path, **options))
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_job_renders_the_frames_that_render_does_and_tells_its_progress(tmp_path):
    path = template(tmp_path, frames="1:3", chunk=2)
    done = openjd("run", path, "--step", "Render", "-p", "Photons=128")
    assert done.returncode == 0, done.stdout + done.stderr
    progress = [line.split("openjd_progress: ")[1] for line in done.stdout.splitlines() if "openjd_progress: " in line]
    assert [float(part) for part in progress] == [0, 50, 100, 0, 100]
    tpdwarp.render(tmp_path / "stage.usda", tmp_path / "b.##.exr", frames="1:3", **{**SMALL, "photons": 128})
    for frame in (1, 2, 3):
        ours, theirs = (read_image(tmp_path / f"{name}.0{frame}.exr")[0] for name in ("out/a", "b"))
        assert all((ours[name] == theirs[name]).all() for name in theirs)


def test_stage_frames_and_settings_are_parameters(tmp_path):
    made = json.loads(template(tmp_path, shutter=(-0.25, 0.5), kernel="epanechnikov").read_text())
    defaults = {entry["name"]: entry["default"] for entry in made["parameterDefinitions"]}
    assert defaults == {
        "Scene": "stage.usda",
        "Out": "out/a.##.exr",
        "Frames": "1-5",
        "FramesPerTask": 10,
        "Photons": 64,
        "Samples": 1,
        "Threads": 0,
        "ImageWidth": 8,
        "Kernel": "epanechnikov",
        "ShutterOpen": -0.25,
        "ShutterClose": 0.5,
    }


def test_a_stage_that_lies_elsewhere_is_named_by_its_whole_path(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    (tmp_path / "jobs").mkdir()
    path = tmp_path / "jobs" / "t.json"
    made = tpdwarp.open_job_template(stage, tmp_path / "a.##.exr", path, **SMALL)
    assert made["parameterDefinitions"][0]["default"] == os.path.realpath(stage)
    assert openjd("check", path).returncode == 0


def test_options_are_those_of_the_command_line():
    for option in (*PICTURE, *EXPOSURE, *METHOD, *MACHINE):
        assert option_of(option.field) in option.flags


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ([1], "1"),
        ([1, 2, 3], "1-3"),
        ([3, 1, 2, 2], "1-3"),
        ([1, 3, 5, 9, 10], "1-5:2,9-10"),
        ([1, 9], "1,9"),
        ([-3, -2, -1, 0], "-3-0"),
        ([-7, -5, -3], "-7--3:2"),
    ],
)
def test_frames_are_ranges_that_both_sides_read(frames, text):
    from openjd.model import IntRangeExpr

    assert range_of(frames) == text
    assert list(IntRangeExpr.from_str(text)) == sorted(set(frames))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": "1:2x0.5", "out": "a.##.##.exr"}, "no whole number"),
        ({"chunk": 0}, "^chunk "),
        ({"template": "t.yaml"}, r"\.json"),
        ({"template": "stage.usda"}, r"\.json"),
        ({"out": "a.##.tga"}, "unknown"),
        ({"retries": -1}, "^retries "),
    ],
)
def test_what_cannot_be_a_job_is_refused(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    write_stage(tmp_path / "stage.usda")
    given = {"out": "a.##.exr", "template": "t.json", **options}
    with pytest.raises(InputError, match=message):
        tpdwarp.open_job_template("stage.usda", given.pop("out"), given.pop("template"), **given)
    assert os.listdir(tmp_path) == ["stage.usda"]


def test_a_task_traces_once_for_all_products(tmp_path):
    stage = wave_from_two_sides(tmp_path)
    options = {"frames": "1:2", "chunk": 2, "photons": 256, "samples": 1}
    tpdwarp.open_job_template(stage, tmp_path / "out" / "<product>.####.exr", tmp_path / "t.json", **options)
    done = openjd("run", tmp_path / "t.json", "--step", "Render")
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("above", "aside"):
        for frame in (1, 2):
            _, metadata = read_image(tmp_path / "out" / f"{name}.000{frame}.exr")
            seconds = json.loads(metadata["tpdwarp:statistics"])["seconds"]
            assert ("trace" in seconds) == (name == "above") and "view" in seconds
