"""A stage is rendered again as its baseline was; limits are found from other seeds."""

import json
import shutil

import pytest

import tpdwarp
from tests.checks.images import write_sequence
from tests.small_stage import write_stage
from tpdwarp.checks.calibrate import calibrate
from tpdwarp.checks.limits import Limits, read_limits
from tpdwarp.checks.render import MOST, recipe_of
from tpdwarp.checks.run import check
from tpdwarp.cli import main
from tpdwarp.errors import InputError
from tpdwarp.presets import PRESETS

SMALL = {
    "image_width": 24,
    "samples": 2,
    "photons": 100,
    "shutter": (-0.125, 0.375),
    "aovs": ("caustic", "Z"),
    # On a lattice other seeds change next to nothing.
    "emission": "jittered",
}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered")
    stage = write_stage(folder / "s.usda", frames=3)
    layer = folder / "b" / "w.debug.usdc"
    tpdwarp.render(stage, folder / "b" / "w.####.exr", frames="1,3", debug_layer=layer, threads=1, **SMALL)
    return stage, folder / "b"


def test_a_recipe_holds_all_that_makes_the_picture_and_nothing_of_the_machine(rendered):
    recipe = recipe_of(rendered[1])
    assert recipe.frames == (1.0, 3.0) and recipe.name == "w.####.exr" and recipe.layer == "w.debug.usdc"
    assert {name: recipe.settings[name] for name in SMALL} == SMALL
    assert not {"threads", "device"} & set(recipe.settings)


def test_rendering_by_the_recipe_gives_the_same_frames_and_photons(rendered, tmp_path):
    result = check(tmp_path / "a", rendered[1], render=rendered[0], threads=2)
    # Threads may sum in another order; beyond that nothing differs.
    assert result.ok and [frame.name for frame in result.frames] == ["1", "3", "photons 1", "photons 3"]
    assert all(measures.rmse < 1e-3 for frame in result.frames for measures in frame.measures.values())


def test_the_command_renders_into_a_folder_or_for_the_moment(rendered, tmp_path, capsys):
    stage, baseline = map(str, rendered)
    assert main(["check", "--render", stage, baseline]) == 0
    assert main(["check", "--render", stage, str(tmp_path / "kept"), baseline]) == 0
    assert (tmp_path / "kept" / "w.0003.exr").exists()
    dark = write_stage(tmp_path / "dark.usda", glass=False)
    capsys.readouterr()
    assert main(["check", "--render", dark, baseline]) == 1
    assert "failed" in capsys.readouterr().out
    assert main(["check", baseline]) == 2
    assert main(["check", "--calibrate", stage, baseline, baseline]) == 2


def test_frames_that_do_not_say_how_they_were_rendered_are_refused(rendered, tmp_path):
    bare = write_sequence(tmp_path / "bare", 1, **{"tpdwarp:settings": None})
    with pytest.raises(InputError, match="does not say how it was rendered"):
        check(tmp_path / "a", bare, render=rendered[0])
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="numbered frames"):
        check(tmp_path / "a", tmp_path / "empty", render=rendered[0])


def test_calibrated_limits_let_another_seed_pass_that_the_defaults_stop(rendered, tmp_path):
    stage, baseline = rendered[0], tmp_path / "b"
    shutil.copytree(rendered[1], baseline)
    limits = calibrate(stage, baseline, seeds=10, false_alarms=0.01)
    # A file keeps six digits.
    read = read_limits(baseline / "tpdwarp-check.toml")
    assert read.of("beauty").rmse == pytest.approx(limits.of("beauty").rmse, rel=1e-5)
    assert read.calibration["seeds"] == 10 and "0.01 false alarms" in read.calibration["note"]
    for group in ("beauty", "caustic", "Z"):
        for name, value in vars(Limits().of(group)).items():
            if name not in ("warn_absolute", "warn_relative"):
                assert getattr(limits.of(group), name) >= value
    recipe = recipe_of(baseline)
    other = tmp_path / "other"
    tpdwarp.render(stage, other / recipe.name, frames=recipe.frames, **{**recipe.settings, "seed": 99})
    shutil.copy(baseline / "w.debug.usdc", other)
    assert not check(other, baseline, limits=Limits()).ok
    assert check(other, baseline).ok


@pytest.mark.parametrize("arguments", [{"seeds": 3}, {"false_alarms": 0.0}, {"false_alarms": 0.7}])
def test_calibrating_by_too_little_is_refused(rendered, arguments):
    with pytest.raises(InputError, match="must"):
        calibrate(*rendered, **arguments)


def test_no_output_is_written_over_the_scene_or_a_frame_to_be(rendered, tmp_path):
    stage, baseline = rendered
    shot = tmp_path / "shot.usda"
    shot.write_text(f"#usda 1.0\n(\n    subLayers = [@{stage}@]\n)\n")
    kept = {path: path.read_bytes() for path in (shot, *baseline.iterdir())}
    for output, said in (
        (shot, "is part of the scene"),
        (stage, "is part of the scene"),
        (baseline / "w.0001.exr", "is part of the baseline"),
        (tmp_path / "a" / "w.0003.exr", "is written by json and by frames"),
    ):
        with pytest.raises(InputError, match=said):
            check(tmp_path / "a", baseline, render=shot, json=output)
    with pytest.raises(InputError, match="is part of the baseline"):
        check(baseline, baseline, render=shot)
    with pytest.raises(InputError, match="is part of the baseline"):
        calibrate(shot, baseline, limits=baseline / "w.0003.exr")
    assert {path: path.read_bytes() for path in kept} == kept


@pytest.mark.parametrize(
    ("name", "value"), [("samples", 100_000), ("photons", 2**27), ("segments", 5000), ("image_width", 10**6)]
)
def test_a_baseline_that_asks_for_endless_work_is_refused(rendered, tmp_path, name, value):
    settings = {**recipe_of(rendered[1]).settings, name: value}
    hostile = write_sequence(tmp_path / "b", 1, **{"tpdwarp:settings": json.dumps(settings)})
    with pytest.raises(InputError, match=f"asks for {name} "):
        check(tmp_path / "a", hostile, render=rendered[0])
    assert not (tmp_path / "a").exists()


def test_every_preset_may_be_a_baseline():
    for preset in PRESETS.values():
        assert all(preset.get(name, 0) in ("auto", None) or preset.get(name, 0) <= most for name, most in MOST.items())
