"""Every file that a stage is made of is known, and what any of them holds."""

from pathlib import Path

import pytest

from tests.small_stage import write_stage
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

SUB = """#usda 1.0
def Shader "Wood"
{
    asset inputs:file = @./plain.png@
    asset inputs:tiles = @./tiles.<UDIM>.png@
}
def "Moving" (
    clips = {
        dictionary default = {
            asset[] assetPaths = [@./clip.usda@]
            asset manifestAssetPath = @./clip.usda@
            string primPath = "/Moving"
            double2[] active = [(0, 0)]
            double2[] times = [(0, 0)]
        }
    }
)
{
}
"""
CLIP = """#usda 1.0
def "Moving"
{
    float x.timeSamples = {
        1: 1,
    }
}
"""


@pytest.fixture
def stage(tmp_path: Path) -> str:
    root = write_stage(tmp_path / "stage.usda")
    text = Path(root).read_text().replace("(\n", "(\n    subLayers = [@./missing.usda@, @./sub.usda@]\n", 1)
    Path(root).write_text(text)
    (tmp_path / "sub.usda").write_text(SUB)
    (tmp_path / "clip.usda").write_text(CLIP)
    for name in ("plain.png", "tiles.1001.png", "tiles.1002.png", "tiles.x.png"):
        (tmp_path / name).write_text(name)
    return root


def test_layers_clips_textures_and_their_tiles_are_used(stage, tmp_path):
    files = StageScene.open(stage, Settings()).used_files()
    names = ["clip.usda", "plain.png", "stage.usda", "sub.usda", "tiles.1001.png", "tiles.1002.png"]
    assert files == [str(tmp_path / name) for name in names]


@pytest.mark.parametrize("changed", ["plain.png", "clip.usda", "sub.usda"])
def test_the_digest_changes_with_any_file_and_with_nothing_else(stage, tmp_path, changed):
    def digest():
        source = StageScene.open(stage, Settings())
        return source.content_digest(source.used_files())

    before = digest()
    assert digest() == before
    (tmp_path / changed).write_text((tmp_path / changed).read_text() + "\n")
    assert digest() != before


def test_what_cannot_be_composed_is_said_in_a_line(stage):
    (error,) = StageScene.open(stage, Settings()).composition_errors()
    assert "missing.usda" in error and "\n" not in error and len(error) <= 240
