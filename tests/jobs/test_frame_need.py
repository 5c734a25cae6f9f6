"""What a frame will need is known before it is begun, and one that needs too much is not."""

import logging
import subprocess
import sys

import pytest
from pxr import Gf, Usd, UsdGeom

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import InputError

SMALL = {"image_width": 12, "samples": 1, "photons": 64}


def test_frames_that_need_too_much_are_refused_in_one_line(tmp_path, caplog):
    stage = write_stage(tmp_path / "stage.usda")
    with pytest.raises(InputError) as refusal:
        tpdwarp.render(stage, tmp_path / "a.##.exr", photons=2**28, estimator="pd", image_width=12, max_memory=8e9)
    assert str(refusal.value).startswith(f"{stage}: a frame would need about 300 GB of memory (4 triangles, 26843545")
    assert list(tmp_path.iterdir()) == [tmp_path / "stage.usda"]
    with caplog.at_level(logging.INFO, "tpdwarp"):
        tpdwarp.render(stage, tmp_path / "a.##.exr", max_memory=8e9, **SMALL)
    (said,) = [record.getMessage() for record in caplog.records if "a frame needs about" in record.getMessage()]
    assert "4 triangles, 64 photons, 96 pixels" in said


def test_photons_that_come_in_strips_of_the_light_need_no_more_memory_than_one_of_these(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    needs = [tpdwarp.info(stage, photons=count)["memory_of_a_frame"]["bytes"] for count in (2**21, 2**28)]
    assert needs[0] == needs[1] < 3 * 2**30


def test_info_says_what_a_frame_will_need(tmp_path):
    memory = tpdwarp.info(write_stage(tmp_path / "stage.usda"), photons=10**6, image_width=600)["memory_of_a_frame"]
    assert (memory["triangles"], memory["photons"], memory["pixels"]) == (4, 10**6, 600 * 400)
    assert 1e9 < memory["bytes"] < 3e9


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"photons": 2**20, "image_width": 16}, {"photons": 64, "image_width": 1024}])
def test_the_estimate_is_within_a_factor_of_two(tmp_path, options):
    stage = write_stage(tmp_path / "stage.usda")
    script = (
        "import resource, sys, tpdwarp\n"
        f"tpdwarp.render(sys.argv[1], sys.argv[2], frames=1, **{options!r})\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, stage, tmp_path / "a.##.exr"], capture_output=True, text=True, timeout=900
    )
    estimate = tpdwarp.info(stage, frames=1, **options)["memory_of_a_frame"]["bytes"]
    assert estimate / 2 < int(done.stdout) < estimate * 2


def test_the_look_at_what_a_frame_needs_is_of_that_frame(tmp_path, caplog):
    path = write_stage(tmp_path / "stage.usda", frames=1)
    stage = Usd.Stage.Open(str(path))
    many = UsdGeom.PointInstancer.Define(stage, "/World/Many")
    UsdGeom.Cube.Define(stage, "/World/Many/Cube").CreateSizeAttr(0.01)
    many.CreatePrototypesRel().SetTargets(["/World/Many/Cube"])
    many.CreateProtoIndicesAttr([0])
    many.CreatePositionsAttr().Set([Gf.Vec3f(0, 0, 1)], 1)
    many.CreateVelocitiesAttr().Set([Gf.Vec3f(0, 0, 1)], 1)
    stage.Save()
    tpdwarp.render(path, tmp_path / "a.exr", frames=1, exposure=1.0, **SMALL)
    assert not [record for record in caplog.records if "outside the animation" in record.getMessage()]
