"""The table of faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tpdwarp.io.terminal import printable


@dataclass(frozen=True)
class Row:
    """One fault.

    Attributes:
        fault: What was done.
        must: What must happen.
        did: What did happen.
        lost: Frames that are missing, torn or wrong and could have been made.
        good: Whether it is as it must be.
    """

    fault: str
    must: str
    did: str
    lost: int
    good: bool


def table_lines(rows: Sequence[Row], widths: tuple[int, int, int] = (44, 44, 60)) -> list[str]:
    """The table as lines of text."""
    lines = [f"   {'fault':{widths[0]}} {'must':{widths[1]}} {'did':{widths[2]}} lost"]
    for row in rows:
        cells = [_cut(text, width) for text, width in zip((row.fault, row.must, row.did), widths, strict=True)]
        lines.append(f"{'ok' if row.good else '!!'} {' '.join(cells)} {row.lost:4d}")
    return lines


def _cut(text: str, width: int) -> str:
    text = printable(text)
    return f"{text if len(text) <= width else text[: width - 1] + '…':{width}}"
