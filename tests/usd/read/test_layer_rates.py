"""Layers whose rates mean nothing: read with the default, said, and never waited for."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import pytest
from pxr import Sdf, Usd

from tpdwarp.errors import InputError
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

MOVER = """#usda 1.0
(
    defaultPrim = "W"
)
def Xform "W" {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 24: (3, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "C" {}
}
"""
ROOTS = {
    "sublayer": "#usda 1.0\n(\n    subLayers = [@mover.usda@]\n)\n",
    "reference": '#usda 1.0\ndef Xform "W" (\n    references = @mover.usda@\n)\n{\n}\n',
}


def written(folder, root: str, bad: str, rate: float) -> str:
    """A stage of two layers, one of which, ``bad``, has this rate."""
    for name, text in (("root", ROOTS[root]), ("mover", MOVER)):
        layer = Sdf.Layer.CreateNew(str(folder / f"{name}.usda"))
        layer.ImportFromString(text)
        if name == bad:
            layer.pseudoRoot.SetInfo("timeCodesPerSecond", rate)
        layer.Save()
        del layer
    return str(folder / "root.usda")


# In a process of its own, as USD's search cannot be stopped from within.
READ = """
import sys
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
scene = StageScene.open(sys.argv[1], Settings())
print([float(scene.at(Shutter.still(t)).meshes[0].points[:, 0].mean()) for t in (0.0, 12.0, 24.0)])
print(scene.warnings.messages)
"""


@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize("bad", ["root", "mover"])
def test_a_layer_of_no_time_codes_a_second_is_read_with_the_default(tmp_path, root, bad):
    path = written(tmp_path, root, bad, 0.0)
    before = [(tmp_path / f"{name}.usda").read_text() for name in ("root", "mover")]
    done = subprocess.run([sys.executable, "-c", READ, path], capture_output=True, text=True, timeout=120, check=True)
    places, said = done.stdout.splitlines()
    assert json.loads(places) == pytest.approx([0.0, 1.5, 3.0])
    assert "timeCodesPerSecond: holds 0" in said
    assert [(tmp_path / f"{name}.usda").read_text() for name in ("root", "mover")] == before


@pytest.mark.parametrize("rate", [-1.0, math.inf, 1e30])
def test_other_rates_that_mean_nothing_count_as_the_default_too(tmp_path, rate):
    scene = StageScene.open(written(tmp_path, "sublayer", "root", rate), Settings())
    places = [scene.at(Shutter.still(t)).meshes[0].points[:, 0].mean() for t in (0.0, 12.0, 24.0)]
    assert places == pytest.approx([0.0, 1.5, 3.0])
    assert sum("timeCodesPerSecond" in message for message in scene.warnings.messages) == 1


def test_a_stage_of_someone_else_with_such_a_layer_is_refused(tmp_path):
    stage = Usd.Stage.Open(written(tmp_path, "sublayer", "mover", 0.0))
    with pytest.raises(InputError, match="time codes per second"):
        StageScene.open(stage, Settings())
