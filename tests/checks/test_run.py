"""A check of sequences: every frame is judged, in order, and one that is broken harms no other."""

import json
import threading
import time
from xml.etree import ElementTree

import numpy as np
import pytest

import tpdwarp
from tests.checks.images import channels, write, write_sequence
from tpdwarp.checks import run
from tpdwarp.checks.frames import ComparedFrame
from tpdwarp.checks.limits import GroupLimits, Limits
from tpdwarp.checks.run import check
from tpdwarp.cli import main
from tpdwarp.errors import FrameError, InputError
from tpdwarp.jobs.progress import Progress

FREE = Limits(all=GroupLimits(**dict.fromkeys(vars(GroupLimits()), float("inf"))), groups={})


@pytest.fixture
def baseline(tmp_path):
    return write_sequence(tmp_path / "b", 3)


def test_the_public_name_is_this_check():
    assert tpdwarp.check is check


def test_a_sequence_is_the_same_as_itself(baseline):
    result = check(baseline, baseline)
    assert result.ok and [(f.name, f.status) for f in result.frames] == [(n, "same") for n in "123"]


def test_a_broken_frame_is_its_own_failure(tmp_path, baseline):
    frames = write_sequence(tmp_path / "a", 4)
    (frames / "wave.0002.exr").write_bytes(b"no image")
    result = check(frames, baseline)
    assert [f.status for f in result.frames] == ["same", "failed", "same", "failed"]
    assert [f.findings[0].kind for f in result.failed] == ["unreadable", "extra frame"]


def test_what_nobody_thought_of_is_that_frames_failure_too(baseline, monkeypatch):
    def fail_at_2(image, *rest):
        raise MemoryError("no room")

    monkeypatch.setattr("tpdwarp.checks.frames.measure", fail_at_2)
    result = check(baseline, baseline)
    assert {f.findings[0].kind for f in result.frames} == {"not compared"} and len(result.failed) == 3


def test_a_frame_swapped_with_its_neighbour_is_found(tmp_path, baseline):
    frames = write_sequence(tmp_path / "a", 3)
    one, two = frames / "wave.0001.exr", frames / "wave.0002.exr"
    one.rename(frames / "x")
    two.rename(one)
    (frames / "x").rename(two)
    assert [f.status for f in check(frames, baseline).frames] == ["failed", "failed", "failed"]
    # The third frame is right; that the picture jumps there is flicker, and the finding says whose.
    last = check(frames, baseline).frames[2].findings
    assert {f.kind for f in last} == {"flicker"} and str(last[0]).endswith("since frame 2, which failed")


def test_flicker_is_the_change_of_the_difference_and_blind_to_what_stays(tmp_path, baseline):
    offsets = {1: 0.125, 2: 0.125, 3: 0.25}
    frames = tmp_path / "a"
    for frame, offset in offsets.items():
        values = channels(frame)
        for name in "RGB":
            values[name] = values[name] + np.float32(offset)
        write(frames, frame, values=values)
    found = [frame.measures["beauty"] for frame in check(frames, baseline, limits=FREE).frames]
    levels = [np.sqrt(np.mean([np.square(channels(f)[name]) for name in "RGB"])) for f in (1, 2, 3)]
    assert found[0].flicker is None
    # Values below 4 round to at most 2^-10 as halves.
    assert found[1].flicker * levels[1] == pytest.approx(0, abs=2**-10)
    assert found[2].flicker * levels[2] == pytest.approx(0.125, abs=2**-10)
    assert found[1].change == pytest.approx(found[1].baseline_change, rel=1e-2)


def test_limits_beside_the_baseline_are_used_and_named(tmp_path, baseline):
    values = channels(2)
    values["R"] = values["R"] * np.float32(1.02)
    frames = write_sequence(tmp_path / "a", 3)
    write(frames, 2, values=values)
    assert not check(frames, baseline).ok
    (baseline / "tpdwarp-check.toml").write_text(
        "[all]\nfail_percent = 100\nrmse = 1\ncoarse = 1\nflicker = 1\nenergy = 1\n"
        "[groups.beauty]\nflip_mean = 1\nflip_high = 1\n"
    )
    result = check(frames, baseline)
    assert result.ok and result.limits_file == str(baseline / "tpdwarp-check.toml")
    single = check(frames / "wave.0002.exr", baseline / "wave.0002.exr")
    assert single.ok and single.limits_file == result.limits_file
    assert not check(frames, baseline, limits=Limits()).ok


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_frames_in_memory_are_bounded_and_results_in_order(baseline, tmp_path, monkeypatch, threads):
    """Frames finish in any order; results come in theirs, and no more than threads + 1 are under way or waiting."""
    started, consumed, most = 0, 0, 0
    lock = threading.Lock()
    real = run.compare_surely

    def slowly(pair, *rest) -> ComparedFrame:
        nonlocal started, most
        with lock:
            started += 1
            most = max(most, started - consumed)
        time.sleep(0.01 if int(pair.frame) % 3 else 0.03)
        return real(pair, *rest)

    class Counting(Progress):
        def end(self, outcome):
            nonlocal consumed
            with lock:
                consumed += 1

    long = write_sequence(tmp_path / "long", 12)
    monkeypatch.setattr(run, "compare_surely", slowly)
    result = check(long, long, threads=threads, progress=Counting())
    assert [frame.frame for frame in result.frames] == list(range(1, 13))
    assert threads <= most <= threads + 2


def test_progress_tells_of_every_frame_and_of_failures(tmp_path, baseline):
    said = []

    class Listening(Progress):
        def start(self, count):
            said.append(count)

        def end(self, outcome):
            said.append((outcome.frame, outcome.status))

    frames = write_sequence(tmp_path / "a", 3)
    (frames / "wave.0002.exr").unlink()
    check(frames, baseline, progress=Listening())
    assert said == [3, (1, "compared"), (2, "failed"), (3, "compared")]


@pytest.mark.parametrize("which", ["frames", "baseline"])
def test_a_place_that_is_empty_or_not_there_cannot_be_compared(tmp_path, baseline, which):
    (tmp_path / "empty").mkdir()
    for place in ("empty", "nowhere"):
        places = {"frames": baseline, "baseline": baseline} | {which: tmp_path / place}
        with pytest.raises(InputError, match=place):
            check(**places)


def test_fewer_than_no_threads_are_refused(baseline):
    with pytest.raises(InputError, match=r"^threads must be 0 or more, not -1"):
        check(baseline, baseline, threads=-1)


def test_json_holds_all_that_was_measured(tmp_path, baseline):
    frames = write_sequence(tmp_path / "a", 2)
    result = check(frames, baseline, json=tmp_path / "o.json", limits=FREE)
    read = json.loads((tmp_path / "o.json").read_text())
    assert read["ok"] is False and read["counts"]["failed"] == 1 == len(result.failed)
    assert [frame["status"] for frame in read["frames"]] == ["same", "same", "failed"]
    assert read["frames"][0]["measures"]["beauty"]["rmse"] == 0
    assert read["limits"]["all"]["rmse"] is None
    assert read["frames"][2]["findings"][0]["kind"] == "missing frame"


def test_junit_has_a_test_a_frame_and_survives_control_characters(tmp_path, baseline):
    frames = write_sequence(tmp_path / "a", 3)
    write(frames, 2, **{"tpdwarp:camera": "/Cam\x1bera<&>\x00"})
    write(frames, 3, **{"tpdwarp:version": "2"})
    check(frames, baseline, junit=tmp_path / "o.xml")
    root = ElementTree.parse(tmp_path / "o.xml").getroot()
    suite = root.find("testsuite")
    assert root.tag == "testsuites" and suite.get("tests") == "3" and suite.get("failures") == "1"
    cases = suite.findall("testcase")
    assert [case.get("name") for case in cases] == ["frame 1", "frame 2", "frame 3"]
    assert [len(case.findall("failure")) for case in cases] == [0, 1, 0]
    failure = cases[1].find("failure")
    assert "tpdwarp:camera" in failure.get("message") and "wave.0002.exr" in failure.text
    assert "tpdwarp:version" in cases[2].find("system-out").text


# What the schema of Jenkins' xUnit plug-in (junit-10.xsd) allows of each element; its time is digits and a point.
JENKINS = {
    "testsuites": ({"name", "time", "tests", "failures", "errors"}, {"testsuite"}),
    "testsuite": ({"name", "time", "tests", "failures", "errors", "skipped", "timestamp"}, {"testcase"}),
    "testcase": ({"name", "classname", "time"}, {"failure", "system-out"}),
    "failure": ({"type", "message"}, set()),
    "system-out": (set(), set()),
}


def test_junit_has_only_what_the_strictest_of_its_readers_allows(tmp_path, baseline):
    frames = write_sequence(tmp_path / "a", 4)
    write(frames, 2, **{"tpdwarp:camera": "/Other", "tpdwarp:version": "2"})
    check(frames, baseline, junit=tmp_path / "o.xml", report=tmp_path / "r.html")
    elements = list(ElementTree.parse(tmp_path / "o.xml").getroot().iter())
    assert {element.tag for element in elements} == set(JENKINS)
    for element in elements:
        attributes, children = JENKINS[element.tag]
        assert set(element.attrib) <= attributes and {child.tag for child in element} <= children
        assert element.get("time", "0").replace(".", "", 1).isdigit()


def test_no_report_is_written_over_what_is_compared(tmp_path, baseline):
    frames = write_sequence(tmp_path / "a", 3)
    limits = baseline / "tpdwarp-check.toml"
    limits.write_text("")
    (tmp_path / "link.html").symlink_to(baseline / "wave.0001.exr")
    kept = {path: path.read_bytes() for folder in (frames, baseline) for path in folder.iterdir()}
    for kind in ("report", "junit", "json"):
        for output, said in (
            (frames / "wave.0002.exr", "is a frame that is checked"),
            (baseline / "wave.0003.exr", "is part of the baseline"),
            (tmp_path / "a" / ".." / "b" / "wave.0003.exr", "is part of the baseline"),
            (limits, "is the limits file"),
        ):
            with pytest.raises(InputError, match=said):
                check(frames, baseline, **{kind: output})
    with pytest.raises(InputError, match="is written by report and by json"):
        check(frames, baseline, report=tmp_path / "r", json=tmp_path / "r")
    assert {path: path.read_bytes() for path in kept} == kept


def test_a_report_that_cannot_be_written_costs_no_other(tmp_path, baseline, monkeypatch):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(run, "write_report", full)
    with pytest.raises(FrameError, match=r"r.html: cannot be written: No space left"):
        check(baseline, baseline, report=tmp_path / "r.html", junit=tmp_path / "r.xml", json=tmp_path / "r.json")
    assert (tmp_path / "r.xml").exists() and (tmp_path / "r.json").exists()
    assert main(["check", str(baseline), str(baseline), "--report", str(tmp_path / "r.html")]) == 2


def test_the_unexpected_is_not_taken_for_a_difference(baseline, monkeypatch, capsys):
    def broken(*arguments, **options):
        raise IndexError("out of range")

    monkeypatch.setattr("tpdwarp.checks.table.table_lines", broken)
    assert main(["check", str(baseline), str(baseline)]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == "error: internal: IndexError: out of range"
