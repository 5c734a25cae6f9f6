"""The result of a check as a compact table for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tpdwarp.checks.findings import CheckResult, Finding, FrameComparison

_COLORS = {"same": "2", "passed": "32", "warned": "33", "failed": "31;1"}
_MOST_ROWS = 40
_COLUMNS = ("frame", "", "RMSE", "FLIP", "worst", "energy", "flicker", "")


def table_lines(result: CheckResult, color: bool = False, verbose: bool = False) -> list[str]:
    """A line a frame that failed or warned, with its first finding, and a last line with the verdict.

    Args:
        result: What a check found.
        color: Whether to use a terminal's colours.
        verbose: Whether frames that passed have lines too, and findings a line each.
    """
    noted = [frame for frame in result.frames if verbose or frame.status in ("failed", "warned")]
    shown = noted if verbose else sorted(noted, key=lambda frame: frame.status != "failed")[:_MOST_ROWS]
    rows = [_row(frame) for frame in shown]
    widths = [max(map(len, column)) for column in zip(_COLUMNS[:-1], *(row[:-1] for row in rows), strict=True)]
    lines = [_line(_COLUMNS, widths)] if rows else []
    for frame, row in zip(shown, rows, strict=True):
        line = _line(row, widths)
        lines.append(_painted(line, _COLORS[frame.status]) if color else line)
        if verbose:
            lines += [f"  {finding.severity} {finding.kind}: {finding}" for finding in _by_weight(frame)[1:]]
    if len(noted) > len(shown):
        lines.append(f"and {len(noted) - len(shown)} frames more (--verbose shows all)")
    lines += _summary(result, color)
    return lines


def _row(frame: FrameComparison) -> tuple[str, ...]:
    measured = frame.measures.values()

    def largest(name: str) -> str:
        values = [abs(value) for value in (getattr(group, name) for group in measured) if value is not None]
        return f"{max(values):.2g}" if values else "-"

    findings = _by_weight(frame)
    first = f"{findings[0].kind}: {findings[0]}" if findings else ""
    if len(findings) > 1:
        first += f" (+{len(findings) - 1})"
    values = [largest(name) for name in ("rmse", "flip_mean", "largest", "energy", "flicker")]
    return (frame.name, frame.status, *values, first)


def _by_weight(frame: FrameComparison) -> list[Finding]:
    return sorted(frame.findings, key=lambda finding: finding.severity != "fail")


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    fitted = [
        cell.ljust(width) if index < 2 else cell.rjust(width)
        for index, (cell, width) in enumerate(zip(cells[:-1], widths, strict=True))
    ]
    return "  ".join([*fitted, cells[-1]]).rstrip()


def _summary(result: CheckResult, color: bool) -> Iterator[str]:
    count = len(result.frames)
    parts = []
    for status in ("failed", "warned", "passed", "same"):
        found = sum(frame.status == status for frame in result.frames)
        if found:
            text = f"{found} {status}"
            parts.append(_painted(text, _COLORS[status]) if color else text)
    limits = result.limits_file or "default limits"
    yield f"{count} frame{'s' * (count != 1)}: {', '.join(parts) or 'none'} ({limits}, {result.seconds:.1f} s)"


def _painted(text: str, code: str) -> str:
    return f"\x1b[{code}m{text}\x1b[0m"
