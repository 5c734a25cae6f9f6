"""A study as one HTML page that needs nothing else: plots, tables, and images beside maps of their errors."""

from __future__ import annotations

import base64
import os
from html import escape

import numpy as np

from tpdwarp.io.files import complete_or_absent
from tpdwarp.io.images import encode_srgb, encoded_picture
from tpdwarp.studies.plot import Series, log_plot
from tpdwarp.studies.result import ExposureResult, Measured, StudyResult

MOST_PICTURES = 12
# Quantile of the truth that is shown white, and of the errors at which the maps' colours end.
_WHITE, _STRONG = 0.99, 0.995

_STYLE = """
body { font: 14px/1.4 sans-serif; margin: 2em auto; max-width: 76em; padding: 0 1em; color: #222 }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
td, th { padding: .2em .7em; text-align: right; border-bottom: 1px solid #ddd }
td:first-child, th:first-child { text-align: left }
tr.front { background: #f0f0f0; font-weight: 600 }
.pairs { display: flex; flex-wrap: wrap; gap: 1em }
figure { margin: 0 } img { width: 16em; image-rendering: pixelated } figcaption { max-width: 32em }
"""


def write_report(path: str | os.PathLike[str], result: StudyResult) -> None:
    """Writes the page.

    Raises:
        FrameError: It cannot be written.
        OSError: Likewise.
    """
    with complete_or_absent(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(page(result))


def page(result: StudyResult) -> str:
    """The page as HTML."""
    frames = ", ".join(f"{frame:g}" for frame in result.frames)
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(result.scene)}: error against time</title>',
        f"<style>{_STYLE}</style></head><body>",
        "<h1>Error against time</h1>",
        f"<p>{escape(result.scene)}, frame {frames}, {result.size[0]} × {result.size[1]} pixels. Errors are those of "
        "the light from photons, relative to its mean; times are CPU seconds a frame, all threads together, without "
        "what is planned once for a whole animation.</p>",
    ]
    for part in result.exposures:
        parts += _exposure(part)
    for label, reason in result.failed.items():
        parts.append(f"<p>Failed: {escape(label)}: {escape(reason)}</p>")
    if result.left:
        parts.append(f"<p>Time was up before {len(result.left)} more: {escape('; '.join(result.left))}.</p>")
    return "\n".join([*parts, "</body></html>", ""])


def _exposure(part: ExposureResult) -> list[str]:
    front = part.front
    series = {}
    for found in part.measured:
        series.setdefault(found.case.series, []).append(found)
    lines = [
        Series(name, [(max(found.cpu, 1e-6), max(found.errors.relative_rmse, 1e-9), _note(found)) for found in members])
        for name, members in series.items()
    ]
    ends = [(max(found.cpu, 1e-6), max(found.errors.relative_rmse, 1e-9)) for found in front]
    noise = part.truth.relative_noise
    return [
        f"<h2>Exposure {part.exposure:g} frames</h2>",
        f"<p>The truth is an accumulation whose two halves tell a relative noise of {noise:.2g}; "
        "errors near that are not to be told from none.</p>",
        log_plot(lines, ends, "CPU seconds a frame", "relative RMSE", noise or None),
        "<p>Rows in bold are on the Pareto front: no other case is both faster and closer to the truth.</p>",
        *_table(part, front),
        *_pictures(part, front),
    ]


def _note(found: Measured) -> str:
    return f"{found.case.label}: relative RMSE {found.errors.relative_rmse:.4f}, {found.cpu:.3f} s"


def _table(part: ExposureResult, front: tuple[Measured, ...]) -> list[str]:
    measures = ("relative RMSE", "RMSE", "bias", "FLIP", "flicker")
    head = ("method", "photons", "landed", *measures, "CPU s", "by stage", "MB")
    rows = ["<table><tr>" + "".join(f"<th>{escape(name)}</th>" for name in head) + "</tr>"]
    for found in sorted(part.measured, key=lambda entry: entry.errors.rmse):
        errors, solution = found.errors, found.solution
        stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in solution.cpu_seconds.items())
        cells = (
            found.case.series,
            "-" if found.case.outside else str(found.case.settings.photons),
            f"{solution.landed:.0f}",
            f"{errors.relative_rmse:.4f}",
            f"{errors.rmse:.4g}",
            f"{errors.bias:+.4f}",
            f"{errors.flip:.4f}",
            "–" if errors.flicker is None else f"{errors.flicker:.4f}",
            f"{found.cpu:.3f}",
            stages,
            f"{solution.memory / 2**20:.0f}",
        )
        mark = ' class="front"' if any(found is other for other in front) else ""
        rows.append(f"<tr{mark}>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return [*rows, "</table>"]


def _pictures(part: ExposureResult, front: tuple[Measured, ...]) -> list[str]:
    """The truth, then the front and the best of each series, each beside the map of its errors (first frame)."""
    truth = part.truth.solution.caustic[0]
    best: dict[str, Measured] = {}
    for found in sorted(part.measured, key=lambda entry: entry.errors.rmse):
        best.setdefault(found.case.series, found)
    shown = list(front) + [found for found in best.values() if not any(found is other for other in front)]
    shown = sorted(shown[:MOST_PICTURES], key=lambda entry: entry.errors.rmse)
    white = float(np.quantile(truth, _WHITE)) or 1.0
    errors = [found.solution.caustic[0].astype(np.float64) - truth for found in shown]
    strong = max((float(np.quantile(np.abs(error), _STRONG)) for error in errors), default=1.0) or 1.0
    lines = [
        f"<p>Right: errors, red where too bright, blue where too dark; full colour is {strong:.3g}, "
        f"white on the left is {white:.3g} (radiance from photons, first frame).</p>",
        f'<div class="pairs"><figure>{_image(_colors(truth / white))}<figcaption>truth</figcaption></figure>',
    ]
    for found, error in zip(shown, errors, strict=True):
        pair = _image(_colors(found.solution.caustic[0] / white)) + _image(_signed(error.mean(axis=-1) / strong))
        lines.append(f"<figure>{pair}<figcaption>{escape(_note(found))}</figcaption></figure>")
    return [*lines, "</div>"]


def _image(pixels: np.ndarray) -> str:
    data = base64.b64encode(encoded_picture(pixels, ".png")).decode()
    return f'<img alt="" src="data:image/png;base64,{data}">'


def _colors(linear: np.ndarray) -> np.ndarray:
    """Linear colours as sRGB bytes."""
    return np.rint(255 * np.clip(encode_srgb(np.clip(linear, 0, 1)), 0, 1)).astype(np.uint8)


def _signed(values: np.ndarray) -> np.ndarray:
    """−1 blue, 0 white, 1 red, as bytes, shape [h, w, 3]."""
    strength = np.clip(np.abs(values), 0, 1)[..., None]
    full = np.where((values > 0)[..., None], (178, 24, 43), (33, 102, 172))
    return np.rint(255 + strength * (full - 255.0)).astype(np.uint8)
