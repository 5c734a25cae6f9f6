"""What the command line says about a sequence: warnings while it runs, its result at the end."""

from __future__ import annotations

import logging
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tpdwarp.cli.outcome import DONE, FAILED, debugging
from tpdwarp.errors import logger
from tpdwarp.io.frame_names import frame_text
from tpdwarp.io.terminal import printable, say
from tpdwarp.jobs.progress import Progress

# File and prim in front of a message.
_PLACES = re.compile(r"^(?:\S+: ){1,2}")
# The summary is to be read at a glance.
_KIND_LENGTH = 72
_MOST_KINDS = 4

# Ways to show progress beside which only failures are worth a line: nobody reads, or a program does.
QUIET = ("alf", "openjd", "none")

if TYPE_CHECKING:
    from tpdwarp.jobs.results import SequenceResult


@contextmanager
def warnings_shown(shown: Progress, level: str = "warning") -> Iterator[Counter[str]]:
    """While entered, what the program logs appears on stderr, one line each, without breaking a progress bar.

    Args:
        shown: What shows the progress.
        level: The least that is shown: ``debug``, ``info``, ``warning`` or ``error``.

    Yields:
        How many warnings there were of each kind, whatever is shown.
    """
    printer = _Printer(shown, logging.DEBUG if debugging() else getattr(logging, level.upper()))
    before = logger.level
    logger.addHandler(printer)
    logger.setLevel(min(printer.least, logging.WARNING))
    try:
        yield printer.kinds
    finally:
        logger.removeHandler(printer)
        logger.setLevel(before)


def report(result: SequenceResult, quiet: bool, warnings: Mapping[str, int] | None = None) -> int:
    """Says what became of a sequence; failures on stderr, the rest on stdout.

    Args:
        result: What became of it.
        quiet: Whether only failures are worth a line.
        warnings: How many warnings there were, by kind.

    Returns:
        The exit code.
    """
    for frame, reason in result.failed.items():
        say(f"error: frame {frame_text(frame)}: {reason}", sys.stderr)
    for problem in result.problems:
        say(f"error: {problem}", sys.stderr)
    if result.failed:
        frames = ",".join(map(frame_text, result.failed))
        say(f"error: {len(result.failed)} of {len(result.outcomes)} frames failed: {frames}", sys.stderr)
    if not quiet:
        for line in summary_lines(result, warnings or {}):
            say(line, sys.stdout)
    return DONE if result.ok else FAILED


def summary_lines(result: SequenceResult, warnings: Mapping[str, int]) -> list[str]:
    """What became of a sequence, in a few lines: why frames were rendered anew, energy, warnings, frames and time."""
    lines = []
    if result.target is not None:
        chosen = f"{result.target.photons} photons, {result.target.segments} segments"
        lines.append(f"{chosen} for an error of {result.target.wanted:g} (expected {result.target.expected:.3g})")
    if result.anew:
        lines.append("rendered anew: " + ", ".join(f"{count} {reason}" for reason, count in result.anew.items()))
    tried = sum(outcome.tries > 1 for outcome in result.outcomes)
    if tried:
        lines.append(f"tried more than once: {tried}")
    sent = sum(energy.sent for energy in result.energy.values())
    if sent > 0:
        shares = {
            name: sum(getattr(energy, field) for energy in result.energy.values()) / sent
            for name, field in (
                ("deposited", "deposited"),
                ("escaped", "escaped"),
                ("absorbed", "absorbed"),
                ("lost", "lost_total"),
            )
        }
        lines.append("energy: " + ", ".join(f"{share:.1%} {name}" for name, share in shares.items()))
    if warnings:
        most = sorted(warnings, key=lambda kind: -warnings[kind])[:_MOST_KINDS]
        more = f"; {len(warnings) - len(most)} more kinds" if len(most) < len(warnings) else ""
        lines.append("warnings: " + "; ".join(f"{warnings[kind]} × {kind}" for kind in most) + more)
    done = f"{len(result.written)} of {len(result.outcomes)} frames done"
    skipped = f", {len(result.skipped)} skipped" if result.skipped else ""
    failed = f", {len(result.failed)} failed" if result.failed else ""
    return [*lines, f"{done}{skipped}{failed}, {result.seconds:.1f} s"]


class _Printer(logging.Handler):
    def __init__(self, shown: Progress, least: int) -> None:
        super().__init__(min(least, logging.WARNING))
        self._shown, self.least = shown, least
        self.kinds: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        text = " ".join(record.getMessage().split())
        if record.levelno == logging.WARNING:
            self.kinds[kind_of(text)] += 1
        if record.levelno < self.least:
            return
        lines = [f"{record.levelname.lower()}: {printable(text)}"]
        if record.exc_info and debugging():
            lines.append(logging.Formatter().formatException(record.exc_info))
        self._shown.message("\n".join(lines))


def kind_of(warning: str) -> str:
    """What a warning says, without the file and the prim that it says it of, in a few words."""
    text = _PLACES.sub("", warning)
    return text if len(text) <= _KIND_LENGTH else text[: _KIND_LENGTH - 2].rsplit(" ", 1)[0] + " …"
