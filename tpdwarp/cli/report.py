"""What the command line says about a sequence: warnings while it runs, its result at the end."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tpdwarp.cli.outcome import DONE, FAILED, debugging
from tpdwarp.errors import logger
from tpdwarp.io.frame_names import frame_text
from tpdwarp.io.terminal import printable, say
from tpdwarp.jobs.progress import Progress

if TYPE_CHECKING:
    from tpdwarp.jobs.results import SequenceResult


@contextmanager
def warnings_shown(shown: Progress) -> Iterator[None]:
    """While entered, the program's warnings appear on stderr, one line each, without breaking a progress bar."""
    printer = _Printer(shown)
    level = logger.level
    logger.addHandler(printer)
    if debugging():
        logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(printer)
        logger.setLevel(level)


def report(result: SequenceResult, quiet: bool) -> int:
    """Says what became of a sequence; failures on stderr, the rest on stdout.

    Args:
        result: What became of it.
        quiet: Whether only failures are worth a line.

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
        if result.target is not None:
            chosen = f"{result.target.photons} photons, {result.target.segments} segments"
            say(
                f"{chosen} for an error of {result.target.wanted:g} (expected {result.target.expected:.3g})", sys.stdout
            )
        skipped = f", {len(result.skipped)} skipped" if result.skipped else ""
        done = f"{len(result.written)} of {len(result.outcomes)} frames done"
        say(f"{done}{skipped}, {result.seconds:.1f} s", sys.stdout)
    return DONE if result.ok else FAILED


class _Printer(logging.Handler):
    def __init__(self, shown: Progress) -> None:
        super().__init__(logging.DEBUG if debugging() else logging.WARNING)
        self._shown = shown

    def emit(self, record: logging.LogRecord) -> None:
        lines = [f"{record.levelname.lower()}: {printable(' '.join(record.getMessage().split()))}"]
        if record.exc_info:
            lines.append(logging.Formatter().formatException(record.exc_info))
        self._shown.message("\n".join(lines))
