import json
import logging
import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.files import complete_or_absent
from tpdwarp.io.images import read_image
from tpdwarp.jobs import frame_work, reports
from tpdwarp.jobs.photon_parts import PhotonParts
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.rendering.frame import Frame

SMALL = {"image_width": 12, "samples": 1, "photons": 64}


def some_photons(count=4):
    steps = np.tile([0.1, 0.0, 0.0], (count, 1))
    return PhotonRecord(
        ids=np.arange(count),
        positions=np.zeros((count, 3)),
        normals=np.tile([0.0, 0.0, 1.0], (count, 1)),
        dxdu=steps,
        dxdv=steps[:, [1, 0, 2]],
        dxdt=steps,
        flux=np.ones((count, 3)),
        emission=np.zeros((count, 2)),
        bounces=np.ones(count, np.int32),
        receivers=np.zeros(count, np.int32),
        receiver_paths=("/World/Floor",),
    )


class SomeLanded:
    """Stands in for photons that have landed."""

    def __init__(self):
        self.record = some_photons()
        self.receiver_paths = self.record.receiver_paths

    def __len__(self):
        return len(self.record)


class FakeRenderer:
    """Stands in for the renderer: grey frames, and an exception at frames of choice."""

    def __init__(self, monkeypatch, fail=None, energy=None):
        self.fail, self.rendered, self.traced = fail or {}, [], []
        self.energy = energy or EnergyAccount(sent=2.0, deposited=2.0)
        monkeypatch.setattr(frame_work, "render_frame", self.render)
        monkeypatch.setattr(frame_work, "trace_frame", self.trace)

    def render(self, context, shutter, width, height, clock, paths, region, keeping):
        if shutter.frame in self.fail:
            raise self.fail[shutter.frame]
        self.rendered.append(shutter.frame)
        grey = {name: np.full((height, width), 0.5, np.float32) for name in "RGBA"}
        return Frame(SomeLanded(), self.energy, {"trace": 0.5}, grey, context.source.at(shutter).camera)

    def trace(self, context, shutter, clock, paths):
        if shutter.frame in self.fail:
            raise self.fail[shutter.frame]
        self.traced.append(shutter.frame)
        return Frame(SomeLanded(), self.energy, {"trace": 0.5}, {}, None)


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda")


def files_in(folder):
    return sorted(os.listdir(folder)) if folder.exists() else []


def sampled_frames(layer):
    stage = Usd.Stage.Open(str(layer))
    return stage.GetPrimAtPath("/TPD/Photons").GetAttribute("points").GetTimeSamples()


def test_all_frames_of_the_stage_are_rendered_unless_some_are_named(stage, tmp_path, monkeypatch):
    fake = FakeRenderer(monkeypatch)
    result = tpdwarp.render(stage, tmp_path / "out" / "a.##.exr", **SMALL)
    assert result.written == (1, 2, 3) and result.ok
    assert files_in(tmp_path / "out") == ["a.01.exr", "a.02.exr", "a.03.exr"]
    assert list(result.energy) == [1, 2, 3] and result.energy[2].sent == 2.0
    for frames, expected in (("2:3", [2, 3]), (2, [2]), (np.int64(3), [3]), ([3, 1.0, 3], [3, 1])):
        fake.rendered.clear()
        tpdwarp.render(stage, tmp_path / "out" / "a.##.exr", frames=frames, **SMALL)
        assert fake.rendered == expected


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (FrameError("disk full"), "disk full"),
        (MemoryError(), "out of memory"),
        (OSError(28, "No space left on device", "x.exr"), "x.exr: No space left on device"),
        (ZeroDivisionError("of\nzero"), "internal: ZeroDivisionError: of zero"),
        (InputError("is not finite", "s.usda", "/Mesh.points"), "s.usda: /Mesh.points: is not finite"),
    ],
)
def test_a_failing_frame_does_not_end_the_sequence(stage, tmp_path, monkeypatch, error, reason):
    FakeRenderer(monkeypatch, fail={2: error})
    result = tpdwarp.render(stage, tmp_path / "out" / "a.##.exr", **SMALL)
    assert result.written == (1, 3) and list(result.failed) == [2] and not result.ok
    assert result.failed[2].startswith(reason) and "\n" not in result.failed[2]
    assert files_in(tmp_path / "out") == ["a.01.exr", "a.03.exr"]


def test_input_of_which_no_frame_can_be_rendered_is_unusable_input(stage, tmp_path, monkeypatch):
    error = InputError("is not finite", stage, "/World/Pane.points")
    FakeRenderer(monkeypatch, fail={1: error, 2: error, 3: error})
    with pytest.raises(InputError, match=r"Pane\.points"):
        tpdwarp.render(stage, tmp_path / "o" / "a.##.exr", debug_layer=tmp_path / "o" / "a.usdc", **SMALL)
    assert files_in(tmp_path / "o") == []


def test_a_frame_that_cannot_be_written_fails_alone(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch)
    (tmp_path / "a.02.exr").mkdir()
    result = tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    assert result.written == (1, 3)
    assert str(tmp_path / "a.02.exr") in result.failed[2]


def test_existing_frames_are_skipped_only_when_whole_and_up_to_date(stage, tmp_path, monkeypatch):
    fake = FakeRenderer(monkeypatch)
    tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    (tmp_path / "a.01.exr").write_bytes(b"an image")
    (tmp_path / "a.02.exr").write_bytes(b"")
    kept = (tmp_path / "a.03.exr").stat().st_mtime_ns
    fake.rendered.clear()
    result = tpdwarp.render(stage, tmp_path / "a.##.exr", skip_existing=True, **SMALL)
    assert (result.skipped, result.written, fake.rendered, fake.traced) == ((3,), (1, 2), [1, 2], [])
    assert result.anew == {"damaged": 2} and (tmp_path / "a.03.exr").stat().st_mtime_ns == kept


def test_statistics_of_two_runs_have_every_frame_as_those_of_one(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch, energy=EnergyAccount(3.0, 2.0, 1.0, lost={"a": 0.5}, counts={"landed": 3}))
    tpdwarp.render(stage, tmp_path / "one.##.exr", stats=tmp_path / "one.json", **SMALL)
    tpdwarp.render(stage, tmp_path / "two.##.exr", frames="1:2", **SMALL)
    tpdwarp.render(stage, tmp_path / "two.##.exr", stats=tmp_path / "two.json", skip_existing=True, **SMALL)
    one, two = (json.loads((tmp_path / f"{name}.json").read_text())["frames"] for name in ("one", "two"))
    assert [entry["status"] for entry in two] == ["skipped", "skipped", "written"]
    for name in ("frame", "energy", "photons"):
        assert [entry[name] for entry in one] == [entry[name] for entry in two]
    assert [entry["seconds"]["trace"] for entry in two] == [0.5, 0.5, 0.5]


def test_lines_of_statistics_are_there_as_soon_as_a_frame_has_ended_and_stay(stage, tmp_path, monkeypatch):
    stats = tmp_path / "s.jsonl"
    FakeRenderer(monkeypatch, fail={3: KeyboardInterrupt()})
    with pytest.raises(KeyboardInterrupt):
        tpdwarp.render(stage, tmp_path / "a.##.exr", stats=stats, **SMALL)
    first = stats.read_text()
    assert [json.loads(line)["frame"] for line in first.splitlines()] == [1, 2]
    FakeRenderer(monkeypatch)
    # As a kill in the midst of a line leaves it.
    stats.write_text(first + '{"frame": 3.0, "sta')
    tpdwarp.render(stage, tmp_path / "a.##.exr", stats=stats, skip_existing=True, **SMALL)
    assert stats.read_text().startswith(first)
    entries = [json.loads(line) for line in stats.read_text().splitlines()]
    assert [(entry["frame"], entry["status"]) for entry in entries] == [(1, "written"), (2, "written"), (3, "written")]
    tpdwarp.render(stage, tmp_path / "a.##.exr", stats=stats, **SMALL)
    assert len(stats.read_text().splitlines()) == 3


def test_the_debug_layer_holds_the_photons_of_skipped_frames_too(stage, tmp_path, monkeypatch):
    fake = FakeRenderer(monkeypatch)
    tpdwarp.render(stage, tmp_path / "a.##.exr", frames=2, **SMALL)
    fake.rendered.clear()
    layer = tmp_path / "a.debug.usdc"
    result = tpdwarp.render(stage, tmp_path / "a.##.exr", skip_existing=True, debug_layer=layer, **SMALL)
    assert (result.skipped, fake.rendered, fake.traced) == ((2,), [1, 3], [2])
    assert sampled_frames(layer) == [1, 2, 3]
    assert (tmp_path / "a.view.usda").exists()


def test_outputs_do_not_destroy_what_the_stage_is_made_of_nor_each_other(stage, tmp_path, monkeypatch):
    fake = FakeRenderer(monkeypatch)
    sub = tmp_path / "sub.usda"
    sub.write_text("#usda 1.0\n")
    (tmp_path / "root.usda").write_text("#usda 1.0\n(\n    subLayers = [@./sub.usda@, @./stage.usda@]\n)\n")
    out, root = tmp_path / "a.##.exr", tmp_path / "root.usda"
    for outputs, message in (
        ({"debug_layer": sub}, "is read by the scene"),
        ({"stats": sub}, "is read by the scene"),
        ({"debug_layer": tmp_path / "sub.view.usda", "stats": tmp_path / "sub.view.usda"}, "is written by"),
        ({"debug_layer": tmp_path / "b.usdc", "stats": tmp_path / "b.view.usda"}, "its view layer"),
        ({"stats": tmp_path / "a.02.exr"}, "is written by stats and by frames"),
    ):
        with pytest.raises(InputError, match=message):
            tpdwarp.render(root, out, frames="1:3", **outputs, **SMALL)
    with pytest.raises(InputError, match="is read by the scene"):
        tpdwarp.write_photons(root, sub)
    assert fake.rendered == [] and sub.read_text() == "#usda 1.0\n"
    assert files_in(tmp_path) == ["root.usda", "stage.usda", "sub.usda"]


def test_what_usd_warns_of_is_an_error_when_strict(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch)
    root = tmp_path / "root.usda"
    root.write_text("#usda 1.0\n(\n    subLayers = [@./gone.usda@, @./stage.usda@]\n)\n")
    assert tpdwarp.render(root, tmp_path / "a.##.exr", frames=1, **SMALL).ok
    with pytest.raises(InputError, match=r"gone\.usda.* \(strict\)"):
        tpdwarp.render(root, tmp_path / "a.##.exr", frames=1, strict=True, **SMALL)


def test_leftovers_of_killed_renders_are_swept(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with complete_or_absent(tmp_path / "a.01.exr") as temporary:
        own = os.path.basename(temporary)
        Path(temporary).write_bytes(b"")
    left = own.replace(f"-{os.getpid():x}-", f"-{ended.pid:x}-")
    (tmp_path / left).write_bytes(b"half")
    (tmp_path / ".a.02.exr.claim").write_bytes(b"")
    tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    assert files_in(tmp_path) == ["a.01.exr", "a.02.exr", "a.03.exr", "stage.usda"]


def test_two_renders_into_one_folder_share_the_frames(stage, tmp_path, monkeypatch):
    fake = FakeRenderer(monkeypatch)
    real, first = fake.render, []

    def render_and_begin_another(*given, **more):
        if not first:
            first.append(threading.Thread(target=tpdwarp.render, args=(stage, tmp_path / "a.##.exr"), kwargs=SMALL))
            first[0].start()
            while len(fake.rendered) < 2:
                time.sleep(0.01)
        return real(*given, **more)

    monkeypatch.setattr(frame_work, "render_frame", render_and_begin_another)
    result = tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    first[0].join()
    # The second found the first frame claimed, and made the others meanwhile.
    assert sorted(fake.rendered) == [1, 2, 3]
    assert result.ok and len(result.outcomes) == 3 and files_in(tmp_path)[-1] == "stage.usda"


def test_a_sequence_that_fails_throughout_leaves_no_debug_layer_and_says_so(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch, fail={frame: FrameError("no") for frame in (1, 2, 3)})
    layer = tmp_path / "o" / "a.usdc"
    result = tpdwarp.render(stage, tmp_path / "o" / "a.##.exr", debug_layer=layer, **SMALL)
    assert len(result.failed) == 3 and str(layer) in result.problems[0]
    assert files_in(tmp_path / "o") == []


def test_a_debug_layer_that_cannot_be_written_fails_the_frame_but_costs_no_image(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch)
    store = PhotonParts.store

    def refuse_2(self, frame, photons, statistics, paths):
        if frame == 2:
            raise FrameError("2.npz: No space left on device")
        store(self, frame, photons, statistics, paths)

    monkeypatch.setattr(PhotonParts, "store", refuse_2)
    result = tpdwarp.render(stage, tmp_path / "a.##.exr", debug_layer=tmp_path / "a.usdc", **SMALL)
    assert result.failed == {2.0: "2.npz: No space left on device"}
    assert all((tmp_path / f"a.0{frame}.exr").exists() for frame in (1, 2, 3))
    assert sampled_frames(tmp_path / "a.usdc") == [1, 3]


def test_an_interruption_leaves_what_was_complete_and_nothing_else(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch, fail={2: KeyboardInterrupt()})
    out = tmp_path / "o"
    with pytest.raises(KeyboardInterrupt):
        tpdwarp.render(stage, out / "a.##.exr", debug_layer=out / "a.usdc", stats=out / "a.json", **SMALL)
    # Photons of the frame that is done wait for a second run.
    assert files_in(out) == ["a.01.exr", "a.usdc.parts"]


@pytest.mark.parametrize(
    ("out", "options", "message"),
    [
        ("o/a.##.tga", {}, "unknown"),
        ("o/a##", {}, "no extension"),
        ("o/a.##.png", {"aovs": ("Z",)}, "beauty only"),
        ("o/a.exr", {}, "3 frames need"),
        ("o/a.##.exr", {"frames": "1:2x0.5"}, "decimals"),
        ("o/a.##.exr", {"frames": "x"}, "^frames "),
        ("o/a.##.exr", {"frames": []}, "^frames "),
        ("o/a.##.exr", {"frames": [math.nan]}, "^frames "),
        ("o/a.exr", {"frames": "1", "default_time": True}, "^default_time "),
        ("o/a.##.exr", {"curves": 3}, "^curves .*add debug_layer"),
        ("o/a.##.exr", {"debug_layer": "stage.usda"}, "is the scene itself"),
        ("o/a.##.exr", {"stats": "stage.usda"}, "is the scene itself"),
        ("o/a.##.exr", {"photons": 0}, "^photons "),
        ("o/a.##.exr", {"phtons": 3}, "phtons"),
        ("o/a.##.exr", {"purposes": ("rendr",)}, "^purposes "),
        ("o/a.##.exr", {"device": "abacus"}, "^device: "),
        ("stage.usda/a.##.exr", {}, "cannot be written"),
    ],
)
def test_what_cannot_work_is_refused_before_any_frame(stage, tmp_path, monkeypatch, out, options, message):
    fake = FakeRenderer(monkeypatch)
    monkeypatch.chdir(tmp_path)
    before = (tmp_path / "stage.usda").read_bytes()
    with pytest.raises(InputError, match=message):
        tpdwarp.render(stage, out, **{**SMALL, **options})
    assert fake.rendered == [] and files_in(tmp_path / "o") == []
    assert (tmp_path / "stage.usda").read_bytes() == before


def test_tracing_says_nothing_of_a_missing_camera(tmp_path, monkeypatch, caplog):
    fake = FakeRenderer(monkeypatch)
    blind = write_stage(tmp_path / "blind.usda", camera=False)
    result = tpdwarp.write_photons(blind, tmp_path / "a.debug.usdc", photons=64)
    assert result.written == (1, 2, 3) and fake.traced == [1, 2, 3] and fake.rendered == []
    assert sampled_frames(tmp_path / "a.debug.usdc") == [1, 2, 3] and not caplog.records


def test_losing_more_than_a_hundredth_of_the_flux_is_warned_about_once(stage, tmp_path, monkeypatch, caplog):
    lossy = EnergyAccount(sent=100.0, deposited=97.0, lost={"bounces": 2.5, "grazing": 0.5})
    FakeRenderer(monkeypatch, energy=lossy)
    tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    assert [record.getMessage() for record in caplog.records if "loses" in record.getMessage()] == [
        f"{stage}: frame 1 loses 3.0% of the flux sent (bounces 2.5%, grazing 0.5%); the statistics have every frame"
    ]
    caplog.clear()
    FakeRenderer(monkeypatch, energy=EnergyAccount(sent=100.0, deposited=99.0, lost={"bounces": 1.0}))
    tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    assert not caplog.records


def test_a_scene_without_specular_surfaces_is_rendered_with_one_warning(tmp_path, monkeypatch, caplog):
    FakeRenderer(monkeypatch, energy=EnergyAccount())
    matte = write_stage(tmp_path / "matte.usda", glass=False)
    result = tpdwarp.render(matte, tmp_path / "a.##.exr", **SMALL)
    assert result.written == (1, 2, 3)
    assert sum("there can be no caustic" in record.getMessage() for record in caplog.records) == 1
    caplog.clear()
    tpdwarp.render(write_stage(tmp_path / "glass.usda"), tmp_path / "a.##.exr", **SMALL)
    assert not any("no caustic" in record.getMessage() for record in caplog.records)


def test_statistics_have_every_frame_with_its_energy_and_seconds(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch, fail={2: FrameError("no")})
    tpdwarp.render(stage, tmp_path / "a.##.exr", stats=tmp_path / "s" / "a.json", seed=5, **SMALL)
    statistics = json.loads((tmp_path / "s" / "a.json").read_text())
    assert [(frame["frame"], frame["status"]) for frame in statistics["frames"]] == [
        (1, "written"),
        (2, "failed"),
        (3, "written"),
    ]
    first, second, _ = statistics["frames"]
    assert first["energy"]["sent"] == 2.0 and first["seconds"]["trace"] == 0.5 and first["photons"] == 4
    assert second["reason"] == "no" and second["energy"] is None
    assert statistics["settings"]["seed"] == 5 and statistics["versions"]["tpdwarp"] == tpdwarp.__version__


def test_statistics_that_cannot_be_written_are_a_problem_not_the_end(stage, tmp_path, monkeypatch):
    FakeRenderer(monkeypatch)

    def refuse(path, statistics):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(reports, "write_statistics", refuse)
    result = tpdwarp.render(stage, tmp_path / "a.##.exr", stats=tmp_path / "a.json", **SMALL)
    assert result.written == (1, 2, 3) and not result.ok
    assert result.problems == (f"{tmp_path / 'a.json'}: No space left on device",)


def test_tracebacks_of_failed_frames_go_to_the_debug_log(stage, tmp_path, monkeypatch, caplog):
    FakeRenderer(monkeypatch, fail={2: ZeroDivisionError("x")})
    with caplog.at_level(logging.DEBUG, "tpdwarp"):
        tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    (record,) = [record for record in caplog.records if record.exc_info]
    assert record.levelno == logging.DEBUG and record.exc_info[0] is ZeroDivisionError


def test_a_frame_says_how_it_was_made(stage, tmp_path):
    out = tmp_path / "a.##.exr"
    result = tpdwarp.render(stage, out, frames=2, seed=7, exposure=0.5, aovs=["Z", "caustic"], **SMALL)
    channels, metadata = read_image(tmp_path / "a.02.exr")
    assert {"R", "G", "B", "A", "Z", "caustic.R"} <= set(channels)
    assert channels["R"].shape == (8, 12)
    energy = result.energy[2.0]
    # Light that meets the pane, 2 × 2 units under 1 W/m² a channel, is what photons carry.
    assert energy.sent == pytest.approx(12.0, rel=1e-5)
    assert metadata["tpdwarp:fluxSent"] == pytest.approx(energy.sent)
    assert metadata["tpdwarp:fluxDeposited"] == pytest.approx(energy.deposited)
    assert metadata["tpdwarp:fluxLost"] == pytest.approx(energy.lost_total)
    assert (metadata["tpdwarp:frame"], metadata["tpdwarp:shutterOpen"], metadata["tpdwarp:shutterClose"]) == (2, 2, 2.5)
    assert metadata["framesPerSecond"] == 24 and metadata["expTime"] == pytest.approx(0.5 / 24)
    assert metadata["tpdwarp:seed"] == 7 and json.loads(metadata["tpdwarp:settings"])["photons"] == 64
    assert metadata["tpdwarp:version"] == tpdwarp.__version__ and metadata["tpdwarp:renderSeconds"] > 0
    # The camera looks down from z = 10: the world's origin lies 10 units in front of it, in the image's middle.
    origin = np.array([0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(origin @ metadata["worldToCamera"], [0, 0, 10, 1], atol=1e-6)
    projected = origin @ metadata["worldToNDC"]
    np.testing.assert_allclose(projected[:2] / projected[3], 0.5, atol=1e-6)
    # OpenEXR's NDC: the upper left is (0, 0), so what lies higher in the image has the smaller y.
    above = np.array([0.0, 0.5, 0.0, 1.0]) @ metadata["worldToNDC"]
    assert above[1] / above[3] < 0.5


def test_the_same_render_twice_has_the_same_pixels(stage, tmp_path):
    for name in ("a", "b"):
        tpdwarp.render(stage, tmp_path / f"{name}.exr", frames=2, **SMALL)
    first, second = (read_image(tmp_path / f"{name}.exr")[0] for name in ("a", "b"))
    assert first.keys() == second.keys()
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert first["G"].max() > 0


def test_points_that_are_no_numbers_are_refused_by_prim(tmp_path):
    stage = write_stage(tmp_path / "broken.usda", broken=(1, 2, 3))
    with pytest.raises(InputError) as refusal:
        tpdwarp.render(stage, tmp_path / "a.##.exr", **SMALL)
    assert str(refusal.value).startswith(f"{stage}: /World/Pane.points: ")


def test_traced_photons_are_those_of_the_debug_layer(stage, tmp_path):
    photons = tpdwarp.trace_photons(stage, 2, photons=64)
    tpdwarp.write_photons(stage, tmp_path / "a.usdc", frames=2, photons=64)
    layer = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    points = layer.GetPrimAtPath("/TPD/Photons")
    np.testing.assert_array_equal(points.GetAttribute("ids").Get(2.0), photons.ids)
    np.testing.assert_array_equal(points.GetAttribute("points").Get(2.0), photons.positions.astype(np.float32))


def test_the_default_time_is_rendered_without_a_frame_number(tmp_path):
    text = (tmp_path / "stage.usda").write_text
    stage = write_stage(tmp_path / "moving.usda")
    source = (tmp_path / "moving.usda").read_text()
    still = "point3f[] points = [(-1, -1, 1), (0, -1, 1), (0, 1, 1), (-1, 1, 1)]\n        point3f[] points.timeSamples"
    text(source.replace("point3f[] points.timeSamples", still))
    result = tpdwarp.render(tmp_path / "stage.usda", tmp_path / "a.exr", default_time=True, **SMALL)
    (outcome,) = result.outcomes
    assert outcome.status == "written" and math.isnan(outcome.frame)
    # At its default the pane covers 1 × 2 units, not the 2 × 2 of every frame.
    assert outcome.energy.sent == pytest.approx(6.0, rel=1e-5)
    _, metadata = read_image(tmp_path / "a.exr")
    assert "tpdwarp:frame" not in metadata and "expTime" not in metadata
    with pytest.raises(InputError, match="default time"):
        tpdwarp.render(stage, tmp_path / "a.##.exr", default_time=True, **SMALL)
