import json
import re

import pytest

from tests.small_stage import write_stage
from tpdwarp.cli import main
from tpdwarp.errors import FrameError
from tpdwarp.io.images import read_image
from tpdwarp.jobs import frame_work

SMALL = ["-w", "12", "--samples", "1", "--photons", "64"]


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda")


def test_render_writes_frames_statistics_and_the_debug_layer(stage, tmp_path, capsys):
    out = tmp_path / "out"
    extras = ["--debug-layer", str(out / "a.debug.usdc"), "--stats", str(out / "a.json"), "--aov", "Z"]
    code = main(["render", stage, str(out / "a.##.exr"), "-f", "1-2", *SMALL, *extras, "--progress", "plain"])
    stdout, stderr = capsys.readouterr()
    assert code == 0 and stderr == ""
    assert sorted(path.name for path in out.iterdir()) == [
        "a.01.exr",
        "a.02.exr",
        "a.debug.usdc",
        "a.json",
        "a.view.usda",
    ]
    assert re.match(r"frame 1 \(1/2\) written \S*a\.01\.exr, [\d.]+ s\nframe 2 \(2/2\) ", stdout)
    assert "2 of 2 frames done" in stdout.splitlines()[-1]
    assert "Z" in read_image(out / "a.01.exr")[0]
    assert len(json.loads((out / "a.json").read_text())["frames"]) == 2


def test_failed_frames_are_listed_at_the_end_with_code_1(stage, tmp_path, capsys, monkeypatch):
    real = frame_work.render_frame

    def fail_at_2(context, shutter, *size, **more):
        if shutter.frame == 2:
            raise FrameError("the lamp blew")
        return real(context, shutter, *size, **more)

    monkeypatch.setattr(frame_work, "render_frame", fail_at_2)
    assert main(["render", stage, str(tmp_path / "a.##.exr"), *SMALL, "--progress", "none"]) == 1
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert stderr == "error: frame 2: the lamp blew\nerror: 1 of 3 frames failed: 2\n"
    assert (tmp_path / "a.03.exr").exists() and not (tmp_path / "a.02.exr").exists()


def test_warnings_are_lines_on_stderr_whatever_the_progress(tmp_path, capsys):
    matte = write_stage(tmp_path / "matte.usda", glass=False)
    for progress in ("plain", "alf", "none"):
        assert main(["render", matte, str(tmp_path / "a.##.exr"), *SMALL, "--progress", progress]) == 0
        stdout, stderr = capsys.readouterr()
        assert "warning:" not in stdout
        assert re.fullmatch(rf"warning: {re.escape(matte)}: [^\n]*there can be no caustic[^\n]*\n", stderr)


def test_alf_progress_is_all_there_is_on_stdout(stage, tmp_path, capsys):
    assert main(["render", stage, str(tmp_path / "a.##.exr"), *SMALL, "--progress", "alf"]) == 0
    assert capsys.readouterr().out == "".join(f"ALF_PROGRESS {percent}%\n" for percent in (0, 33, 66, 100))


def test_existing_frames_are_skipped_on_demand_and_stale_ones_rendered_anew_with_a_reason(stage, tmp_path, capsys):
    arguments = ["render", stage, str(tmp_path / "a.##.exr"), *SMALL, "--skip-existing-frames", "--progress", "none"]
    assert main([*arguments, "-f", "2"]) == 0
    before = (tmp_path / "a.02.exr").stat().st_mtime_ns
    assert main([*arguments, "--progress", "plain"]) == 0
    assert "2 of 3 frames done, 1 skipped" in capsys.readouterr().out
    assert (tmp_path / "a.02.exr").stat().st_mtime_ns == before
    assert main([*arguments, "--seed", "3", "--progress", "plain"]) == 0
    out, err = capsys.readouterr()
    assert err == (
        f"warning: {tmp_path / 'a.01.exr'}: is of other settings (seed 0, now 3) and rendered anew, "
        "as others of its kind will be\n"
    )
    assert "rendered anew: 3 of other settings" in out


def test_photons_writes_the_layer_and_its_view(tmp_path, capsys):
    blind = write_stage(tmp_path / "blind.usda", camera=False)
    layer = tmp_path / "o" / "shot.debug.usdc"
    options = ["-f", "1,3", "--photons", "64", "--curves", "9", "--progress", "plain"]
    assert main(["photons", blind, str(layer), *options]) == 0
    stdout, stderr = capsys.readouterr()
    assert stderr == "" and "frame 3 (2/2) traced, " in stdout
    assert sorted(path.name for path in layer.parent.iterdir()) == ["shot.debug.usdc", "shot.view.usda"]


def test_info_prints_text_or_json(stage, capsys):
    assert main(["info", stage, "--exposure", "0.5"]) == 0
    text = capsys.readouterr().out
    assert "/World/Pane" in text and "moving meshes /World/Pane" in text and "differentials u v t" in text
    assert main(["info", stage, "--exposure", "0.5", "--json"]) == 0
    holdings = json.loads(capsys.readouterr().out)
    assert holdings["requirements"][0]["moving_meshes"] == ["/World/Pane"]


def test_info_says_what_it_warns_of_once_and_power_with_its_unit(tmp_path, capsys):
    camera_less = write_stage(tmp_path / "a.usda", camera=False)
    text = (tmp_path / "a.usda").read_text()
    (tmp_path / "b.usda").write_text(text.replace("inputs:angle = 0", "inputs:specular = 0.5"))
    assert main(["info", str(tmp_path / "b.usda")]) == 0
    stdout, stderr = capsys.readouterr()
    assert stderr == "" and "inputs:specular" in stdout
    assert ", unit W/m2, moves no, extent a disc of 0.53 degrees" in stdout
    assert main(["info", camera_less]) == 0


def test_an_unusable_prim_is_named_in_one_line(tmp_path, capsys):
    broken = write_stage(tmp_path / "broken.usda", broken=(1, 2, 3))
    assert main(["render", broken, str(tmp_path / "a.##.exr"), *SMALL, "--progress", "none"]) == 2
    stdout, stderr = capsys.readouterr()
    assert re.fullmatch(rf"error: {re.escape(broken)}: /World/Pane\.points: [^\n]*\n", stderr) and stdout == ""
