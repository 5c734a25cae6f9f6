"""Stages of strangers do nothing but be rendered or refused.

Whatever their names and sizes, no code of theirs is run, no file is written elsewhere, and a terminal shows what they
are called and nothing else.
"""

import contextlib
import io
import json
import os
import time
import xml.etree.ElementTree
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from pxr import Plug

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.cli import main
from tpdwarp.io.images import write_frame

# Escapes, line breaks, marks that turn writing round, markup, and what shells and file systems take for something else.
WICKED = "\x1b[2J\x07\n\r\u202e\u2066<>&\"'`$;%{}#|*?~.. \\é語"
file_names = st.text(st.sampled_from(WICKED), min_size=1, max_size=40).filter(
    lambda name: "/" not in name and name.strip(". ") and len(name.encode()) < 200
)
wicked_numbers = st.sampled_from([0, 1, -1, 7, 2**31 - 1, -(2**31), 10**6, 3 * 10**8])
quick = settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


def ran(*arguments):
    """Exit code, and all lines that were printed."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return code, out.getvalue().splitlines(), err.getvalue().splitlines()


def everything(folder):
    return sorted(os.path.join(path, name) for path, _, names in os.walk(folder) for name in names)


@quick
@given(file_names)
@example("\x1b]0;title\x07")
@example("a\nframe 9 (9:9) written b, 1.00 s")
def test_a_terminal_shows_names_and_nothing_else(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("names")
    stage = write_stage(folder / f"{name}.usda", frames=1)
    small = ["-w", 8, "--samples", 1, "--photons", 16, "--progress", "plain"]
    code, out, err = ran("render", stage, folder / f"{name}.####.exr", *small)
    assert code in (0, 2)
    assert all(line.isprintable() for line in [*out, *err])
    assert sum(line.startswith("frame ") for line in out) == (code == 0)
    assert len(everything(folder)) == (2 if code == 0 else 1)


_STAGE = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 2
)
def Mesh "M"
{{
    int[] faceVertexCounts = [{counts}]
    int[] faceVertexIndices = [{indices}]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
}}
def PointInstancer "I"
{{
    rel prototypes = </M>
    int[] protoIndices = [{indices}]
    int64[] ids = [{ids}]
    point3f[] positions = [(0, 0, 0)]
}}
def RenderSettings "S"
{{
    uniform int2 resolution = ({width}, {height})
    rel products = </S/P>

    def RenderProduct "P"
    {{
        token productName = "../../elsewhere.exr"
    }}
}}
"""


@quick
@given(st.lists(wicked_numbers, max_size=4), st.lists(wicked_numbers, max_size=4), wicked_numbers, wicked_numbers)
@example([3], [0, 1, 2], 2**31 - 1, 2**31 - 1)
def test_sizes_of_all_kinds_end_soon_in_a_frame_or_a_line(tmp_path_factory, counts, indices, width, height):
    folder = tmp_path_factory.mktemp("sizes") / "deep" / "er"
    folder.mkdir(parents=True)
    stage = folder / "s.usda"
    lists = {name: ", ".join(map(str, values)) for name, values in (("counts", counts), ("indices", indices))}
    # Pictures as large as are rendered take longer than anybody tests.
    height = height if width * height < 0 or width * height > 2**30 else 1
    width = width if width * height < 10**6 or width * height > 2**30 else 16
    stage.write_text(_STAGE.format(**lists, ids=lists["indices"], width=width, height=height))
    started = time.process_time()
    code, _, err = ran("render", stage, folder / "a.####.exr", "-f", 1, "--samples", 1, "--photons", 16)
    assert time.process_time() - started < 20
    wrong = [line for line in err if line.startswith("error: ")]
    assert code in (0, 1, 2) and (code == 0) == (not wrong)
    assert code != 2 or len(wrong) == 1
    made = {os.path.relpath(path, folder.parent.parent) for path in everything(folder.parent.parent)}
    assert made <= {"deep/er/s.usda", "deep/er/a.0001.exr"}


def test_plugins_beside_a_stage_are_not_loaded(tmp_path):
    info = {
        "Type": "python",
        "Name": "wicked",
        "Root": ".",
        "Info": {"Types": {"WickedFormat": {"bases": ["SdfFileFormat"], "formatId": "wicked", "extensions": ["evil"]}}},
    }
    for folder in (tmp_path, tmp_path / "plugin"):
        folder.mkdir(exist_ok=True)
        (folder / "plugInfo.json").write_text(json.dumps({"Plugins": [info]}))
        (folder / "wicked.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    (tmp_path / "a.evil").write_text("#usda 1.0\n")
    stage = tmp_path / "root.usda"
    text = (tmp_path / "stage.usda", write_stage(tmp_path / "stage.usda", frames=1))[0].read_text()
    stage.write_text(text.replace("(\n", "(\n    subLayers = [@./a.evil@]\n", 1))
    tpdwarp.render(stage, tmp_path / "a.##.exr", image_width=8, samples=1, photons=16)
    assert not (tmp_path / "ran").exists()
    assert "wicked" not in [plugin.name for plugin in Plug.Registry().GetAllPlugins()]


@quick
@given(file_names, file_names)
@example("\"><script>alert(1)<script>", "a]]>")
def test_reports_hold_names_as_text(tmp_path_factory, name, other):
    folder = tmp_path_factory.mktemp("reports")
    for side, names in (("ours", {name, "same"}), ("theirs", {other, "same"})):
        (folder / side).mkdir()
        for one in names:
            planes = {channel: np.full((4, 4), 0.5, np.float32) for channel in "RGBA"}
            write_frame(folder / side / f"{one}.0001.exr", planes, {"tpdwarp:scene": name})
    reports = ["--report", folder / "r.html", "--junit", folder / "r.xml"]
    code, _, err = ran("check", folder / "ours", folder / "theirs", *reports)
    assert code in (0, 1, 2) and all(line.isprintable() for line in err)
    if (folder / "r.xml").exists():
        xml.etree.ElementTree.parse(folder / "r.xml")
        seen = _Scripts()
        seen.feed((folder / "r.html").read_text())
        # Names are among the data of the page, never its code.
        assert seen.scripts and "alert" not in "".join(seen.scripts)


class _Scripts(HTMLParser):
    """The text of all scripts that are run."""

    def __init__(self):
        super().__init__()
        self.scripts, self._inside = [], False

    def handle_starttag(self, tag, attrs):
        self._inside = tag == "script" and dict(attrs).get("type") != "application/json"
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_endtag(self, tag):
        self._inside = False

    def handle_data(self, data):
        if self._inside:
            self.scripts.append(data)


@pytest.mark.parametrize("text", ["[channels]\nwidth = 0", "a = " + "[" * 5000, "a = " + "9" * 5000, "\x00", "[[["])
def test_limits_of_strangers_can_do_no_more_than_be_wrong(tmp_path, text):
    for side in ("ours", "theirs"):
        (tmp_path / side).mkdir()
        write_frame(tmp_path / side / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in "RGBA"}, {})
    (tmp_path / "theirs" / "tpdwarp-check.toml").write_text(text)
    code, _, err = ran("check", tmp_path / "ours", tmp_path / "theirs")
    assert code == 2 and len(err) == 1 and err[0].startswith("error: ") and len(err[0]) < 600
