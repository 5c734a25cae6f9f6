"""The result of a check as one self-contained HTML page."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from tpdwarp.checks.findings import CheckResult, FrameComparison, GroupMeasures
from tpdwarp.checks.limits import BEAUTY
from tpdwarp.checks.pictures import ZOOM
from tpdwarp.html.curves import curve_figure
from tpdwarp.html.page import data_block, escape, write_page

# Bytes of pictures in a page, a third less than they take in it: browsers open it at once, and servers take it.
MOST_PICTURE_BYTES = 24e6

_MARKS = {"same": "✓", "passed": "✓", "warned": "!", "failed": "✗"}
_COLUMNS = {
    "failed_percent": ("pixels beyond limit [%]", "fail_percent"),
    "hard": ("largest / peak", "hard"),
    "rmse": ("relative RMSE", "rmse"),
    "coarse": ("RMSE, shrunk", "coarse"),
    "flip_mean": ("FLIP mean", "flip_mean"),
    "flip_high": ("FLIP high", "flip_high"),
    "energy": ("energy", "energy"),
    "flicker": ("flicker", "flicker"),
}


def write_report(path: str | os.PathLike[str], result: CheckResult) -> None:
    """Writes the page. Pictures are part of it and are decoded only when their frame is looked at.

    Raises:
        FrameError: The file cannot be written.
    """
    scripts = (("tpdwarp.html", "pictures.js"), ("tpdwarp.checks", "report.js"))
    title = f"{_verdict(result)} – tpdwarp check"
    write_page(path, title, _parts(result), scripts)


def _parts(result: CheckResult) -> Iterator[str]:
    yield "<header>" + _head(result) + "</header>"
    yield '<main id="main">'
    yield _charts(result)
    yield _viewer(result)
    yield "</main>"
    yield _help()
    left_out = _left_out(result.frames)
    summaries = [_summary(frame, result, left_out.get(index, ())) for index, frame in enumerate(result.frames)]
    yield data_block("data", {"zoom": ZOOM, "frames": summaries})
    for index, frame in enumerate(result.frames):
        sources = {
            name: f"data:image/{_kind(data)};base64,{base64.b64encode(data).decode()}"
            for name, data in frame.pictures.items()
            if _group(name) not in left_out.get(index, ())
        }
        if sources:
            yield data_block(f"pictures-{index}", {"sources": sources, "scales": dict(frame.scales)})


def _left_out(frames: Sequence[FrameComparison]) -> dict[int, list[str]]:
    """Channel groups whose pictures find no room in the page, by index of the frame.

    The beauty of frames that failed comes first, then what else is beyond its limits, then the beauty of the others.
    """
    sizes: dict[tuple[int, int, str], int] = {}
    for index, frame in enumerate(frames):
        noted = frame.status in ("failed", "warned")
        beyond = {finding.group for finding in frame.findings}
        for name, data in frame.pictures.items():
            group = _group(name)
            rank = (0 if noted else 2) if group == BEAUTY else 1 if group in beyond else 3
            sizes[rank, index, group] = sizes.get((rank, index, group), 0) + len(data)
    left_out: dict[int, list[str]] = {}
    total = 0
    for (_, index, group), size in sorted(sizes.items()):
        total += size
        if total > MOST_PICTURE_BYTES:
            left_out.setdefault(index, []).append(group)
    return left_out


def _group(name: str) -> str:
    return name.rpartition(".")[0]


def _kind(data: bytes) -> str:
    return "png" if data[:4] == b"\x89PNG" else "jpeg"


def _verdict(result: CheckResult) -> str:
    count = len(result.frames)
    if result.failed:
        return f"{len(result.failed)} of {count} frames failed"
    warned = f", {len(result.warned)} with warnings" if result.warned else ""
    return f"{count} frame{'s' * (count != 1)} within limits{warned}"


def _head(result: CheckResult) -> str:
    status = "failed" if result.failed else "warned" if result.warned else "passed"
    calibrated = result.limits.calibration.get("note", "")
    note = f' <span class="soft">({escape(calibrated)})</span>' if calibrated else ""
    return (
        f'<h1>tpdwarp check</h1><p class="verdict {status}">{_MARKS[status]} {escape(_verdict(result))}</p>'
        f"<p>A <code>{escape(result.frames_path)}</code> against B <code>{escape(result.baseline_path)}</code>, "
        f"limits <code>{escape(result.limits_file or 'defaults')}</code>{note}</p>"
        "<noscript><p>The pictures and the list of frames need scripts, which this browser does not run.</p></noscript>"
    )


def _charts(result: CheckResult) -> str:
    frames = [frame for frame in result.frames if BEAUTY in frame.measures and frame.frame is not None]
    places = [frame.frame for frame in frames if frame.frame is not None]
    if len(set(places)) < 2 or places != sorted(places):
        return ""
    measures = [frame.measures[BEAUTY] for frame in frames]
    limits = result.limits.of(BEAUTY)

    def values(name: str) -> list[float | None]:
        return [getattr(entry, name) for entry in measures]

    figures = (
        ("Energy, sum over the beauty", {"A": values("total"), "B": values("baseline_total")}, None),
        ("Energy, relative difference", {"A less B": values("energy")}, limits.energy),
        ("Change from frame to frame, RMS", {"A": values("change"), "B": values("baseline_change")}, None),
        ("Flicker, relative", {"A less B": values("flicker")}, limits.flicker),
        ("Difference, relative RMSE", {"A less B": values("rmse")}, limits.rmse),
        ("FLIP, mean", {"A and B": values("flip_mean")}, limits.flip_mean),
    )
    charts = "".join(curve_figure(title, places, curves, limit=limit) for title, curves, limit in figures)
    return f'<section class="card" aria-label="Curves over time"><div class="charts">{charts}</div></section>'


def _viewer(result: CheckResult) -> str:
    rows = "".join(
        f'<li data-status="{frame.status}"><button type="button" class="row"{_hint(frame)}>'
        f'<span class="{frame.status}" aria-hidden="true">{_MARKS[frame.status]}</span> {escape(frame.name)} '
        f'<span class="soft">{frame.status}{_first_kind(frame)}</span></button></li>'
        for index, frame in enumerate(result.frames)
    )
    filters = "".join(
        f'<button type="button" data-filter="{name}" aria-pressed="{str(name == "all").lower()}">{label}</button>'
        for name, label in (("all", "All"), ("failed", "Failures"), ("noted", "Failures and warnings"))
    )
    panels = "".join(
        f'<figure data-panel="{name}"><figcaption>{label}</figcaption><canvas></canvas></figure>'
        for name, label in (
            ("a", "A, checked"),
            ("b", "B, baseline"),
            ("difference", "Difference"),
            ("flip", "FLIP"),
        )
    )
    return f"""<div class="viewer">
<nav class="card" aria-label="Frames"><div class="bar" role="group" aria-label="Filter">{filters}</div>
<ol class="frames">{rows}</ol></nav>
<section class="card" aria-label="Frame">
<div class="bar"><button type="button" id="before">← Before</button><button type="button" id="after">After →</button>
<label>Group <select id="group"></select></label>
<label>Exposure <input type="range" id="exposure" min="-8" max="8" step="0.5" value="0">
<output id="stops">0</output> stops</label></div>
<h2 id="name" aria-live="polite"></h2><ul id="findings"></ul>
<p id="no-pictures" class="soft" hidden>There are no pictures of this.</p>
<p id="left-out" class="soft" hidden></p>
<div id="pictures"><figure><figcaption>Left of the line A, right of it B. Move over the picture or the slider;
<kbd>space</kbd> flips.</figcaption><div id="stage"><canvas id="wipe"></canvas></div>
<label class="wide">A ↔ B <input type="range" id="split" min="0" max="100" value="50"></label></figure>
<div class="panels">{panels}</div>
<h3>Histogram of all channels</h3><canvas id="histogram"></canvas>
<p class="soft">Pixels over value, both logarithmic: A <span class="key-a">line</span>,
B <span class="key-b">filled</span>.</p>
<div id="worst"><h3>Worst pixels</h3><div class="scroll"><table><thead><tr><th>Pixel</th><th>A</th><th>B</th>
<th>A, around it</th><th>B, around it</th></tr></thead><tbody></tbody></table></div></div></div>
<div id="measured"><h3>Measured</h3><div class="scroll"><table><thead></thead><tbody></tbody></table></div></div>
</section></div>"""


def _help() -> str:
    keys = {
        "← →": "frame before, after",
        "n p": "next, previous failure",
        "space": "flip A and B",
        "[ ]": "darker, brighter",
        "g": "next channel group",
        "f": "failures only, or all",
    }
    listed = " · ".join(
        f"{' '.join(f'<kbd>{key}</kbd>' for key in name.split())} {what}" for name, what in keys.items()
    )
    return f'<footer class="soft"><p>Keys: {listed}</p></footer>'


def _summary(frame: FrameComparison, result: CheckResult, left_out: Collection[str]) -> dict[str, Any]:
    return {
        "name": frame.name,
        "frame": frame.frame,
        "status": frame.status,
        "path": frame.path,
        "baseline": frame.baseline,
        "findings": [[finding.severity, finding.kind, str(finding)] for finding in frame.findings],
        "measures": {group: _measured(group, found, result) for group, found in frame.measures.items()},
        "worst": {
            group: [[pixel.column, pixel.row, _short(pixel.value), _short(pixel.baseline)] for pixel in found.worst]
            for group, found in frame.measures.items()
            if f"{group}.zoom" in frame.pictures and group not in left_out
        },
        "leftOut": list(left_out),
    }


def _measured(group: str, found: GroupMeasures, result: CheckResult) -> list[list[Any]]:
    limits = result.limits.of(group)
    rows = []
    for name, (label, limit_name) in _COLUMNS.items():
        value, limit = getattr(found, name), getattr(limits, limit_name)
        rows.append([label, None if value is None else float(f"{value:.4g}"), limit if math.isfinite(limit) else None])
    return rows


def _short(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.4g}" for value in values)


def _hint(frame: FrameComparison) -> str:
    """What the row leaves out where it is too narrow."""
    return f' title="{escape(frame.findings[0])}"' if frame.findings else ""


def _first_kind(frame: FrameComparison) -> str:
    kinds = dict.fromkeys(finding.kind for finding in frame.failures or frame.findings)
    return f": {escape(', '.join(kinds))}" if kinds else ""
