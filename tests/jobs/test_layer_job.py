"""A debug layer made in several runs, or by several processes, is that of one undisturbed run."""

import json
import subprocess
import sys
import threading
from functools import partial

import numpy as np
import pytest
from pxr import Sdf, Usd

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import FrameError
from tpdwarp.jobs import frame_work
from tpdwarp.jobs.photon_parts import PhotonParts
from tpdwarp.usd.write.debug_layer import DebugLayerWriter

SMALL = {"image_width": 12, "samples": 1, "photons": 256}


def content(layer):
    """All that a layer holds, in order: values, times, metadata."""
    found = {}
    opened = Sdf.Layer.OpenAsAnonymous(str(layer))

    def visit(path):
        if path.IsPropertyPath():
            spec = opened.GetAttributeAtPath(path)
            found[str(path)] = np.array(spec.default) if spec.HasDefaultValue() else None
            for time in opened.ListTimeSamplesForPath(path):
                found[f"{path}@{time}"] = np.array(opened.QueryTimeSample(path, time))

    opened.Traverse(Sdf.Path.absoluteRootPath, visit)
    notes = dict(opened.customLayerData["tpdwarp"])
    # Seconds differ from run to run.
    notes["statistics"] = {
        frame: {name: value for name, value in json.loads(text).items() if name != "seconds"}
        for frame, text in json.loads(notes["statistics"]).items()
    }
    found["notes"] = repr(notes)
    return found


def assert_same(layer, other):
    one, two = content(layer), content(other)
    assert list(one) == list(two)
    for name, value in one.items():
        np.testing.assert_array_equal(value, two[name], err_msg=name)


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda", frames=4)


@pytest.fixture
def traced(monkeypatch):
    """Frames rendered and frames traced, as they come."""
    seen = {"rendered": [], "traced": []}
    for done, name in (("rendered", "render_frame"), ("traced", "trace_frame")):

        def seeing(context, shutter, *size, noted, real, **more):
            noted.append(shutter.frame)
            return real(context, shutter, *size, **more)

        monkeypatch.setattr(frame_work, name, partial(seeing, noted=seen[done], real=getattr(frame_work, name)))
    return seen


@pytest.mark.parametrize("curves", [None, 40])
def test_a_layer_in_two_runs_is_that_of_one(stage, tmp_path, curves, monkeypatch):
    options = {"curves": curves, **SMALL}
    tpdwarp.render(stage, tmp_path / "one.##.exr", debug_layer=tmp_path / "one.usdc", **options)

    class Killed(BaseException):
        pass

    store = PhotonParts.store

    def killed_at_3(self, frame, photons, statistics, paths):
        if frame == 3:
            raise Killed
        store(self, frame, photons, statistics, paths)

    two = {"debug_layer": tmp_path / "two.usdc", "skip_existing": True, **options}
    with monkeypatch.context() as patched:
        patched.setattr(PhotonParts, "store", killed_at_3)
        with pytest.raises(Killed):
            tpdwarp.render(stage, tmp_path / "two.##.exr", **two)
    assert not (tmp_path / "two.usdc").exists()
    result = tpdwarp.render(stage, tmp_path / "two.##.exr", **two)
    assert (result.skipped, result.written) == ((1, 2), (3, 4))
    assert_same(tmp_path / "one.usdc", tmp_path / "two.usdc")
    assert not (tmp_path / "two.usdc.parts").exists()


def test_photons_that_were_kept_are_not_traced_again(stage, tmp_path, traced):
    options = {"skip_existing": True, "debug_layer": tmp_path / "a.usdc", **SMALL}
    tpdwarp.render(stage, tmp_path / "a.##.exr", frames="1:2", **options)
    # That layer was complete: of frames of which nothing is kept the photons are traced.
    tpdwarp.render(stage, tmp_path / "a.##.exr", **options)
    assert traced == {"rendered": [1, 2, 3, 4], "traced": [1, 2]}
    tpdwarp.render(stage, tmp_path / "a.##.exr", **options)
    assert traced == {"rendered": [1, 2, 3, 4], "traced": [1, 2]}


def test_photons_alone_go_on_where_they_were_stopped_with_their_statistics(stage, tmp_path, traced, monkeypatch):
    layer = tmp_path / "a.usdc"
    add_frame = DebugLayerWriter.add_frame

    def no_room(self, time, record, smoothing, paths):
        raise FrameError("no room")

    monkeypatch.setattr(DebugLayerWriter, "add_frame", no_room)
    first = tpdwarp.write_photons(stage, layer, photons=64)
    assert first.problems == ("no room",) and not layer.exists()
    monkeypatch.setattr(DebugLayerWriter, "add_frame", add_frame)
    for _ in range(2):
        result = tpdwarp.write_photons(stage, layer, photons=64, skip_existing=True, stats=tmp_path / "s.json")
        assert result.skipped == (1, 2, 3, 4) and traced["traced"] == [1, 2, 3, 4]
        assert [outcome.energy for outcome in result.outcomes] == [outcome.energy for outcome in first.outcomes]
    tpdwarp.write_photons(stage, layer, photons=64)
    assert traced["traced"] == [1, 2, 3, 4] * 2


def test_what_a_killed_process_has_kept_is_used(stage, tmp_path, traced):
    script = (
        "import os, sys, tpdwarp\nfrom tpdwarp.jobs import frame_work\nreal = frame_work.write_frame\n"
        "def write(path, *more):\n    real(path, *more)\n    if '03' in path: os.kill(os.getpid(), 9)\n"
        "frame_work.write_frame = write\n"
        "tpdwarp.render(sys.argv[1], sys.argv[2], debug_layer=sys.argv[3],"
        " image_width=12, samples=1, photons=256)\n"
    )
    out, layer = tmp_path / "a.##.exr", tmp_path / "a.usdc"
    ended = subprocess.run([sys.executable, "-c", script, stage, out, layer], timeout=300)
    assert ended.returncode == -9
    result = tpdwarp.render(stage, out, debug_layer=layer, skip_existing=True, **SMALL)
    assert result.ok and traced == {"rendered": [4], "traced": []}
    tpdwarp.render(stage, tmp_path / "b.##.exr", debug_layer=tmp_path / "b.usdc", **SMALL)
    assert_same(layer, tmp_path / "b.usdc")
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_two_renders_at_once_make_one_layer(stage, tmp_path, traced):
    layer, results = tmp_path / "a.usdc", []

    def one():
        results.append(tpdwarp.render(stage, tmp_path / "a.##.exr", debug_layer=layer, **SMALL))

    threads = [threading.Thread(target=one) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [result.ok for result in results] == [True, True]
    assert sorted(traced["rendered"]) == [1, 2, 3, 4] and traced["traced"] == []
    assert Usd.Stage.Open(str(layer)).GetPrimAtPath("/TPD/Photons").GetAttribute("points").GetNumTimeSamples() == 4
    assert not (tmp_path / "a.usdc.parts").exists()


def test_a_layer_without_its_view_is_not_complete(stage, tmp_path, traced):
    options = {"skip_existing": True, "debug_layer": tmp_path / "a.debug.usdc", **SMALL}
    tpdwarp.render(stage, tmp_path / "a.##.exr", **options)
    (tmp_path / "a.view.usda").unlink()
    tpdwarp.render(stage, tmp_path / "a.##.exr", **options)
    assert traced["traced"] == [1, 2, 3, 4] and (tmp_path / "a.view.usda").exists()
