"""Curves as SVG, with axes, a legend and words for those who do not see them.

They are written by hand, and not by Matplotlib as a study's plots are, for two reasons. ``check`` runs in every
project's CI, where Matplotlib and what it needs would be 100 MB more to install. And these curves are controls of their
page: they take its colours in light and dark, have a cursor at the frame that is shown, and a click on them shows
another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tpdwarp.html.page import escape

_WIDTH, _HEIGHT = 560, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 70, 8, 10, 26
_STYLES = ("first", "second", "third", "fourth")


def curve_figure(
    title: str,
    places: Sequence[float],
    curves: Mapping[str, Sequence[float | None]],
    limit: float | None = None,
) -> str:
    """A figure with curves over frames, as HTML.

    Curves differ in dashes as well as in colour. A lone value is a dot; None interrupts a curve.

    Args:
        title: What is shown, with its unit.
        places: Frame numbers, rising.
        curves: Values by name, one a place; at most four curves.
        limit: A level to mark, and its negative where values go below 0; or None.
    """
    values = [value for curve in curves.values() for value in curve if value is not None and math.isfinite(value)]
    if not values or not places:
        return ""
    shown_limit = limit if limit is not None and math.isfinite(limit) else None
    low, high = _range([*values, 0.0] if shown_limit is None else [*values, 0.0, shown_limit])
    first, last = places[0], places[-1]

    def x(place: float) -> float:
        share = (place - first) / (last - first) if last > first else 0.5
        return _LEFT + share * (_WIDTH - _LEFT - _RIGHT)

    def y(value: float) -> float:
        return _TOP + (high - value) / (high - low) * (_HEIGHT - _TOP - _BOTTOM)

    marks = [
        f'<line class="axis" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y(v):.1f}" y2="{y(v):.1f}"/>' for v in (low, high)
    ]
    marks += [f'<text x="{_LEFT - 6}" y="{y(v) + 4:.1f}" text-anchor="end">{v:.3g}</text>' for v in (low, high)]
    ends = ((first, "start"), (last, "end")) if last > first else ((first, "middle"),)
    marks += [f'<text x="{x(v):.1f}" y="{_HEIGHT - 8}" text-anchor="{side}">{v:.6g}</text>' for v, side in ends]
    marks.append(f'<text x="{_WIDTH / 2}" y="{_HEIGHT - 8}" text-anchor="middle">frame</text>')
    for level in (shown_limit, -shown_limit) if shown_limit is not None else ():
        if low <= level <= high:
            at = y(level)
            marks.append(f'<line class="limit" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>')
    legend = []
    for style, (name, curve) in zip(_STYLES, curves.items(), strict=False):
        for run in _runs(places, curve):
            points = [f"{x(place):.1f},{y(value):.1f}" for place, value in run]
            if len(points) == 1:
                horizontal, vertical = points[0].split(",")
                marks.append(f'<circle class="dot {style}" cx="{horizontal}" cy="{vertical}" r="3"/>')
            else:
                marks.append(f'<polyline class="curve {style}" points="{" ".join(points)}"/>')
        legend.append(
            f'<span class="key"><svg width="26" height="10" aria-hidden="true"><line class="curve {style}" '
            f'x1="0" x2="26" y1="5" y2="5"/></svg> {escape(name)}</span>'
        )
    if shown_limit is not None:
        legend.append(
            '<span class="key"><svg width="26" height="10" aria-hidden="true"><line class="limit" '
            f'x1="0" x2="26" y1="5" y2="5"/></svg> limit {shown_limit:.3g}</span>'
        )
    words = f"{title}, frame {first:.6g} to {last:.6g}, values from {min(values):.3g} to {max(values):.3g}"
    return (
        f'<figure class="curves" data-first="{first!r}" data-last="{last!r}" data-left="{_LEFT / _WIDTH:.4f}" '
        f'data-right="{1 - _RIGHT / _WIDTH:.4f}"><figcaption>{escape(title)} {"".join(legend)}</figcaption>'
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(words)}">{"".join(marks)}'
        f'<line class="cursor" x1="-9" x2="-9" y1="{_TOP}" y2="{_HEIGHT - _BOTTOM}"/></svg></figure>'
    )


def _range(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    return (low, high) if high > low else (low, low + 1.0)


def _runs(places: Sequence[float], curve: Sequence[float | None]) -> list[list[tuple[float, float]]]:
    runs: list[list[tuple[float, float]]] = [[]]
    for place, value in zip(places, curve, strict=True):
        if value is None or not math.isfinite(value):
            runs.append([])
        else:
            runs[-1].append((place, value))
    return [run for run in runs if run]
