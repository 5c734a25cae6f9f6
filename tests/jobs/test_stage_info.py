import pytest

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import InputError


def test_a_stage_says_what_it_holds_and_requires(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    found = tpdwarp.info(stage, exposure=0.5)
    assert {mesh["path"] for mesh in found["meshes"]} == {"/World/Pane", "/World/Floor"}
    (run,) = found["requirements"]
    assert (run["first"], run["last"], run["frames"]) == (1, 3, 3)
    assert run["refraction"] and not run["reflection"]
    assert list(run["moving_meshes"]) == ["/World/Pane"] and run["differentials"] == ["u", "v", "t"]


def test_frames_that_require_the_same_are_one_run(tmp_path):
    stage = write_stage(tmp_path / "stage.usda", frames=6)
    text = (tmp_path / "stage.usda").read_text()
    assert "6: " in text
    # The pane rests from frame 3 to 5, and moves on to frame 6.
    for frame in (4, 5):
        start = text.index(f"            {frame}: ")
        text = text[:start] + text[text.index("\n", start) + 1 :]
    rest = next(line for line in text.splitlines() if line.strip().startswith("3: "))
    text = text.replace(rest, rest + "\n" + rest.replace("3: ", "5: ", 1))
    (tmp_path / "stage.usda").write_text(text)
    runs = tpdwarp.info(stage, exposure=1.0)["requirements"]
    assert [(run["first"], run["last"], run["frames"]) for run in runs] == [(1, 2, 2), (3, 4, 2), (5, 6, 2)]
    assert [run["differentials"] for run in runs] == [["u", "v", "t"], ["u", "v"], ["u", "v", "t"]]


def test_the_frames_asked_for_are_looked_at(tmp_path):
    stage = write_stage(tmp_path / "stage.usda", camera=False)
    (run,) = tpdwarp.info(stage, frames="2:3")["requirements"]
    assert (run["first"], run["last"], run["frames"]) == (2, 3, 2)
    (run,) = tpdwarp.info(write_stage(tmp_path / "b.usda", glass=False), frames=2)["requirements"]
    assert not run["refraction"]


def test_a_missing_stage_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.usda: no such file"):
        tpdwarp.info(tmp_path / "none.usda")
