"""The report stands alone, stays small, and works in a browser: keys, sliders, filters, without an error."""

import html.parser
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.checks.images import channels, write, write_sequence
from tpdwarp.checks.frames import compare_frame
from tpdwarp.checks.limits import Limits
from tpdwarp.checks.report import write_report
from tpdwarp.checks.run import check, picture_width
from tpdwarp.checks.sequences import Pair
from tpdwarp.html.pictures import shrunk

BROWSER = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000", "--window-size=1400,2000")


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    """Five frames: the second with a hot pixel, the third missing, the others the same."""
    folder = tmp_path_factory.mktemp("report")
    frames, baseline = write_sequence(folder / "a <i>", 5), write_sequence(folder / "b", 5)
    values = channels(2)
    values["R"][5, 31] = values["caustic.R"][5, 31] = 40
    write(frames, 2, values=values, **{"tpdwarp:camera": "</script><b>"})
    (frames / "wave.0003.exr").unlink()
    check(frames, baseline, report=folder / "r.html")
    return folder / "r.html"


def driven(report: Path, script: str) -> dict:
    """What ``script``, the body of an asynchronous function in the open report, returns; errors are collected."""
    page = report.read_text()
    watch = "<script>window.errors = []; addEventListener('error', e => errors.push(e.message));" + (
        "addEventListener('unhandledrejection', e => errors.push(String(e.reason)));</script>"
    )
    drive = (
        "<script>const key = k => document.activeElement.dispatchEvent(new KeyboardEvent('keydown',"
        "{key: k, bubbles: true})); const wait = () => new Promise(r => setTimeout(r, 150));"
        "const pixel = (canvas, x, y) => [...canvas.getContext('2d').getImageData(x, y, 1, 1).data];"
        f"(async () => {{ await wait(); const out = await (async () => {{ {script} }})();"
        "const pre = document.createElement('pre'); pre.id = 'out';"
        "pre.textContent = JSON.stringify({out, errors}); document.body.append(pre); })();</script>"
    )
    page = page.replace("<meta charset", f"{watch}<meta charset", 1).replace("</body>", f"{drive}</body>")
    driven_page = report.with_name("driven.html")
    driven_page.write_text(page)
    command = [BROWSER, *FLAGS, "--dump-dom", driven_page.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=60).stdout
    found = re.search(r'<pre id="out">(.*?)</pre>', shown, re.DOTALL)
    assert found, shown[-2000:]
    result = json.loads(html.unescape(found[1]))
    assert result["errors"] == []
    return result["out"]


@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_a_browser_shows_the_first_failure_and_obeys_keys_sliders_and_filters(report):
    out = driven(
        report,
        """
        const seen = {};
        const title = () => document.getElementById('name').textContent;
        const wipe = document.getElementById('wipe');
        seen.first = title();
        seen.size = [wipe.width, wipe.height];
        key(' '); seen.split1 = state.split; key(' '); seen.split0 = state.split;
        splitAt(0); const base = pixel(wipe, 31, 5);
        splitAt(100); const hot = pixel(wipe, 31, 5);
        seen.flips = hot[0] - base[0];
        const slider = document.getElementById('split');
        slider.value = 20; slider.dispatchEvent(new Event('input'));
        seen.slid = state.split;
        const grey = pixel(wipe, 2, 2)[0];
        key(']'); key(']'); seen.stops = state.stops; seen.brighter = pixel(wipe, 2, 2)[0] - grey;
        key('['); key('[');
        seen.zooms = document.querySelectorAll('canvas.zoom').length;
        seen.labels = [...document.querySelectorAll('#pictures canvas')].filter(c => !c.closest('[hidden]')
          && !c.getAttribute('aria-label')).length;
        key('g'); await wait(); seen.group = state.group;
        key('n'); await wait(); seen.next = title();
        seen.pictureless = document.getElementById('pictures').hidden;
        key('p'); await wait(); seen.back = title();
        key('n'); await wait();
        key('ArrowRight'); await wait(); seen.right = title();
        key('f'); seen.failures = rows.filter(r => !r.parentElement.hidden).length;
        seen.jumped = title();
        key('f'); seen.all = rows.filter(r => !r.parentElement.hidden).length;
        seen.top = scrollY;
        seen.curves = document.querySelectorAll('figure.curves').length;
        return seen;
        """,
    )
    assert out["first"] == "Frame 2: ✗ failed" and out["size"] == [40, 24]
    assert (out["split1"], out["split0"]) == (100, 0) and out["slid"] == 20
    # The hot pixel lies in a picture of half grey; JPEG spreads it, but not away.
    assert out["flips"] > 60
    assert out["stops"] == 1 and out["brighter"] > 10
    assert out["zooms"] >= 2 and out["labels"] == 0 and out["group"] == "caustic"
    assert out["next"] == "Frame 3: ✗ failed" and out["pictureless"] is True
    assert out["back"] == out["first"] and out["right"] == "Frame 4: ✓ the same"
    assert out["failures"] == 2 and out["all"] == 5
    assert out["jumped"] == "Frame 3: ✗ failed"
    assert out["curves"] >= 4 and out["top"] == 0


class Tags(html.parser.HTMLParser):
    """Collects what a page refers to, and its tags."""

    def __init__(self) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.references += [value for name, value in attributes if name in ("src", "href", "srcset", "action")]


def test_the_page_refers_to_nothing_outside_itself_and_forbids_it(report):
    text = report.read_text()
    tags = Tags()
    tags.feed(text)
    assert tags.references == ["#main"]
    assert "default-src 'none'" in text and "@import" not in text and "url(" not in text


def test_names_and_messages_cannot_become_markup(report):
    tags = Tags()
    tags.feed(report.read_text())
    assert "i" not in tags.tags and "b" not in tags.tags


def test_equal_pictures_are_kept_once_and_passing_ones_small(tmp_path):
    wide = {name: np.tile(plane, (20, 20)) for name, plane in channels().items()}
    same, other = write(tmp_path / "a", values=wide), write(tmp_path / "b", values=wide)
    pair = Pair("1", 1.0, (str(same),), (str(other),))
    found = compare_frame(pair, Limits(), 480).comparison
    assert set(found.pictures) == {"beauty.b", "caustic.b"}
    # 500 such frames make a page of a few megabytes.
    assert sum(map(len, found.pictures.values())) < 30_000


def test_pictures_of_longer_sequences_are_smaller_so_that_all_together_are_bounded():
    areas = [count * picture_width(count) ** 2 for count in range(60, 540, 7)]
    assert max(areas) <= 1.01 * areas[0] and picture_width(3) == 480 and picture_width(5000) == 160


def test_pictures_beyond_what_a_page_holds_are_left_out_least_needed_first_and_said(report, tmp_path, monkeypatch):
    result = check(report.parent / "a <i>", report.parent / "b", report=tmp_path / "r.html")
    failing = next(frame for frame in result.failed if frame.pictures)
    of_beauty = sum(len(data) for name, data in failing.pictures.items() if name.startswith("beauty."))
    monkeypatch.setattr("tpdwarp.checks.report.MOST_PICTURE_BYTES", of_beauty)
    write_report(tmp_path / "small.html", result)
    text = (tmp_path / "small.html").read_text()
    blocks = re.findall(r'id="pictures-(\d+)">(.*?)</script>', text)
    assert [index for index, _ in blocks] == ["1"]
    assert set(json.loads(blocks[0][1])["sources"]) == {n for n in failing.pictures if n.startswith("beauty.")}
    summaries = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])["frames"]
    assert [frame["leftOut"] for frame in summaries] == [
        ["beauty", "caustic"],
        ["caustic"],
        [],
        ["beauty", "caustic"],
        ["beauty", "caustic"],
    ]


def test_a_hot_pixel_stays_visible_in_a_small_difference(tmp_path):
    difference = np.zeros((300, 2000), np.float32)
    difference[123, 1777] = 5
    small = shrunk(difference, 480, keep_peaks=True)
    assert small.shape == (60, 400) and small.max() == 5 and small[24, 355] == 5


def test_a_long_report_is_written_in_the_order_of_its_frames(report, tmp_path):
    frames = report.parent
    result = check(frames / "a <i>", frames / "b")
    many = replace(result, frames=tuple(replace(result.frames[0], name=str(k), frame=float(k)) for k in range(500)))
    write_report(tmp_path / "long.html", many)
    text = (tmp_path / "long.html").read_text()
    assert text.count('class="row"') == 500 and "500 frames within limits" in text
    assert (tmp_path / "long.html").stat().st_size < 2_000_000
