"""Error against time as a picture: doubly logarithmic, in SVG that stands on its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

COLORS = ("#0b6bcb", "#d1440c", "#2e8b57", "#8a4fbf", "#b8860b", "#c2185b", "#00838f", "#6d4c41", "#546e7a", "#7cb342")
_WIDTH, _HEIGHT = 760, 480
_LEFT, _RIGHT, _TOP, _BOTTOM = 70, 200, 20, 50


@dataclass(frozen=True)
class Series:
    """Points that belong together: name, and (x, y, what to say of it) each, in the order they are joined."""

    name: str
    points: Sequence[tuple[float, float, str]]


def log_plot(
    series: Sequence[Series],
    front: Sequence[tuple[float, float]],
    x_label: str,
    y_label: str,
    floor: float | None = None,
) -> str:
    """An SVG element.

    Args:
        series: What is drawn; values above 0.
        front: Points of the Pareto front, the fastest first.
        x_label, y_label: What the axes show.
        floor: Where the truth's own noise lies.
    """
    points = [(x, y) for one in series for x, y, _ in one.points]
    xs, ys = _decades([x for x, _ in points]), _decades([y for _, y in points] + ([floor] if floor else []))
    across, down = _scale(xs, _LEFT, _WIDTH - _RIGHT), _scale(ys, _HEIGHT - _BOTTOM, _TOP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
        f'role="img" font-family="sans-serif" font-size="12">'
    ]
    for ticks, place, vertical in ((xs, across, True), (ys, down, False)):
        parts += _grid(ticks, place, vertical)
    middle_x, middle_y = (_LEFT + _WIDTH - _RIGHT) / 2, (_TOP + _HEIGHT - _BOTTOM) / 2
    parts.append(f'<text x="{middle_x}" y="{_HEIGHT - 10}" text-anchor="middle">{escape(x_label)}</text>')
    turned = f'x="16" y="{middle_y}" transform="rotate(-90 16 {middle_y})"'
    parts.append(f'<text {turned} text-anchor="middle">{escape(y_label)}</text>')
    if floor:
        x, y = _WIDTH - _RIGHT, down(floor)
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{x}" stroke="#888" stroke-dasharray="2 4"/>')
        parts.append(f'<text x="{x - 4}" y="{y - 4:.1f}" text-anchor="end" fill="#666">noise of truth</text>')
    if front:
        path = "L".join(f"{across(x):.1f} {down(y):.1f}" for x, y in front)
        parts.append(
            f'<path class="front" d="M{path}" fill="none" stroke="#000" stroke-opacity="0.18" stroke-width="9" '
            'stroke-linejoin="round" stroke-linecap="round"/>'
        )
    for number, one in enumerate(series):
        color = COLORS[number % len(COLORS)]
        path = "L".join(f"{across(x):.1f} {down(y):.1f}" for x, y, _ in one.points)
        parts.append(f'<path d="M{path}" fill="none" stroke="{color}" stroke-width="1.5"/>')
        for x, y, note in one.points:
            place = f'cx="{across(x):.1f}" cy="{down(y):.1f}"'
            parts.append(f'<circle {place} r="4" fill="{color}"><title>{escape(note)}</title></circle>')
        y = _TOP + 14 + 18 * number
        parts.append(f'<circle cx="{_WIDTH - _RIGHT + 18}" cy="{y - 4}" r="4" fill="{color}"/>')
        parts.append(f'<text x="{_WIDTH - _RIGHT + 28}" y="{y}">{escape(one.name)}</text>')
    if front:
        y = _TOP + 14 + 18 * len(series)
        parts.append(
            f'<path d="M{_WIDTH - _RIGHT + 8} {y - 4}h16" stroke="#000" stroke-opacity="0.18" stroke-width="9"/>'
            f'<text x="{_WIDTH - _RIGHT + 28}" y="{y}">Pareto front</text>'
        )
    return "\n".join([*parts, "</svg>"])


def _decades(values: Sequence[float]) -> tuple[int, int]:
    """Exponents of the powers of ten between which ``values`` lie."""
    if not values:
        return 0, 1
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    return low, max(high, low + 1)


def _scale(decades: tuple[int, int], start: float, end: float) -> Callable[[float], float]:
    low, high = decades

    def place(value: float) -> float:
        return start + (end - start) * (math.log10(value) - low) / (high - low)

    return place


def _grid(decades: tuple[int, int], place: Callable[[float], float], vertical: bool) -> list[str]:
    lines = []
    for exponent in range(decades[0], decades[1] + 1):
        for digit in (1, 2, 5) if exponent < decades[1] else (1,):
            at = place(digit * 10.0**exponent)
            shade = "#bbb" if digit == 1 else "#eee"
            label = f"{digit * 10.0**exponent:g}"
            if vertical:
                lines.append(f'<path d="M{at:.1f} {_TOP}V{_HEIGHT - _BOTTOM}" stroke="{shade}"/>')
                lines.append(f'<text x="{at:.1f}" y="{_HEIGHT - _BOTTOM + 16}" text-anchor="middle">{label}</text>')
            else:
                lines.append(f'<path d="M{_LEFT} {at:.1f}H{_WIDTH - _RIGHT}" stroke="{shade}"/>')
                lines.append(f'<text x="{_LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{label}</text>')
    return lines
