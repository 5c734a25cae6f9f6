"""Error against time as a picture: doubly logarithmic, an SVG element that a page can hold."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

from tpdwarp.errors import InputError

_SVG = "http://www.w3.org/2000/svg"
_INCHES = (9.5, 5.5)
# Ten colours are all that readers tell apart; further series have other markers.
_COLORS, _MARKERS = 10, "osD^v"
# A fixed salt makes the same plot the same bytes; text stays text, which can be searched and needs no fonts.
_STYLE = {"svg.hashsalt": "tpdwarp", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 10}
_FRONT = "front"
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))


@dataclass(frozen=True)
class Series:
    """Points that belong together: name, and (x, y, what to say of it) each, in the order they are joined."""

    name: str
    points: Sequence[tuple[float, float, str]]


def matplotlib_module() -> ModuleType:
    """Matplotlib, which only reports of studies need.

    Raises:
        InputError: It is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise InputError("study --report needs Matplotlib (pip install 'tpdwarp[study]')") from error
    return matplotlib


def log_plot(
    series: Sequence[Series],
    front: Sequence[tuple[float, float]],
    x_label: str,
    y_label: str,
    floor: float | None = None,
) -> str:
    """Draws series over two logarithmic axes; the same arguments give the same text.

    Args:
        series: What is drawn; values above 0. A browser shows a point's note when the mouse rests on it.
        front: Points of the Pareto front, the fastest first.
        x_label, y_label: What the axes show.
        floor: Where the truth's own noise lies.

    Returns:
        An SVG element.

    Raises:
        InputError: Matplotlib is not installed.
    """
    matplotlib = matplotlib_module()
    from matplotlib.figure import Figure

    notes: dict[str, str] = {}
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=_INCHES, layout="constrained")
        axes = figure.add_subplot()
        _prepare(axes, x_label, y_label)
        named = {}
        for number, one in enumerate(series):
            color = f"C{number % _COLORS}"
            marker = _MARKERS[number // _COLORS % len(_MARKERS)]
            places = [(x, y) for x, y, _ in one.points]
            (line,) = axes.plot(*_columns(places), color=color, marker=marker, label=one.name)
            named[line] = one.name
            for place, (x, y, note) in enumerate(one.points):
                name = f"point-{number}-{place}"
                notes[name] = note
                axes.plot([x], [y], color=color, marker=marker, gid=name)
        if front:
            (line,) = axes.plot(*_columns(front), color="0.82", linewidth=9, zorder=1, solid_capstyle="round")
            line.set_gid(_FRONT)
            named[line] = "Pareto front"
        if floor:
            named[axes.axhline(floor, color="0.5", linestyle=":", zorder=1)] = "noise of truth"
        legend = figure.legend(list(named), list(named.values()), loc="outside right upper", frameon=False)
        for text in legend.get_texts():
            text.set_parse_math(False)
        drawn = io.BytesIO()
        figure.savefig(drawn, format="svg", metadata=_NO_METADATA)
    return _element(drawn.getvalue(), notes)


def _prepare(axes: Any, x_label: str, y_label: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(x_label, parse_math=False)
    axes.set_ylabel(y_label, parse_math=False)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def _columns(points: Sequence[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def _element(drawn: bytes, notes: dict[str, str]) -> str:
    """The picture as an element of a page, with the notes as titles of its points.

    Names of groups are dropped, because a page with several plots would have each of them several times; the front's
    becomes its class. Names that are referred to (markers, clip paths) are hashes of what they name, so that equal
    names mean equal things.
    """
    root = ElementTree.fromstring(drawn)
    for group in root.iter(f"{{{_SVG}}}g"):
        name = group.attrib.pop("id", "")
        if name == _FRONT:
            group.set("class", name)
        if name in notes:
            title = ElementTree.Element(f"{{{_SVG}}}title")
            title.text = notes[name]
            group.insert(0, title)
    ElementTree.register_namespace("", _SVG)
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    return ElementTree.tostring(root, encoding="unicode")
