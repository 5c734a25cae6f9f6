"""What is shown while a sequence is under way."""

from __future__ import annotations

import shutil
import sys
import time
from typing import TYPE_CHECKING, TextIO

from tpdwarp.errors import InputError
from tpdwarp.io.frame_names import frame_text
from tpdwarp.io.terminal import printable, printable_lines, say

if TYPE_CHECKING:
    from tpdwarp.jobs.results import FrameOutcome

KINDS = ("auto", "bar", "plain", "alf", "openjd", "none")


class Progress:
    """Shows nothing; the base of those that do. Messages go to ``stderr``, whatever is shown."""

    def start(self, count: int) -> None:
        """A sequence of ``count`` frames begins."""

    def begin(self, frame: float) -> None:
        """Work on ``frame`` begins."""

    def stage(self, name: str) -> None:
        """A stage of the work on the frame begins, which may be more than once."""

    def end(self, outcome: FrameOutcome) -> None:
        """A frame has been written, traced, skipped, or has failed."""

    def finish(self) -> None:
        """The sequence is over, well or not."""

    def message(self, line: str) -> None:
        """Prints a line for people to read."""
        say(line, sys.stderr)


class PlainProgress(Progress):
    """One line a frame.

    Args:
        stream: Where to; None for standard output.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._count = self._done = 0

    def start(self, count: int) -> None:
        self._count, self._done = count, 0

    def end(self, outcome: FrameOutcome) -> None:
        self._done += 1
        what = f"{outcome.status} {printable(outcome.path)}".strip()
        note = f": {printable(outcome.reason)}" if outcome.reason else f", {outcome.total_seconds:.2f} s"
        line = f"frame {frame_text(outcome.frame)} ({self._done}/{self._count}) {what}{note}"
        say(line, self._stream)


class AlfProgress(Progress):
    """Lines ``ALF_PROGRESS n%``, as farm wrappers read them.

    Args:
        stream: Where to; None for standard output.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._count = self._done = 0

    def start(self, count: int) -> None:
        self._count, self._done = count, 0
        self._show()

    def end(self, outcome: FrameOutcome) -> None:
        self._done += 1
        self._show()

    def _show(self) -> None:
        say(f"ALF_PROGRESS {100 * self._done // max(1, self._count)}%", self._stream)


class OpenJobProgress(AlfProgress):
    """Lines ``openjd_progress: n``, as schedulers of Open Job Description read them, and what has failed."""

    def end(self, outcome: FrameOutcome) -> None:
        if outcome.status == "failed":
            say(f"openjd_status: frame {frame_text(outcome.frame)} failed: {printable(outcome.reason)}", self._stream)
        super().end(outcome)

    def _show(self) -> None:
        say(f"openjd_progress: {100 * self._done / max(1, self._count):.1f}", self._stream)


class OccasionalProgress(Progress):
    """A line now and then, for logs of long sequences whose frames take no time to speak of.

    Args:
        stream: Where to; None for standard error.
        interval: Seconds between lines; what is over sooner says nothing.
    """

    def __init__(self, stream: TextIO | None = None, interval: float = 10.0) -> None:
        self._stream = stream or sys.stderr
        self._interval = interval
        self._count = self._done = self._failed = 0
        self._started = self._said = 0.0

    def start(self, count: int) -> None:
        self._count, self._done, self._failed = count, 0, 0
        self._started = self._said = time.monotonic()

    def end(self, outcome: FrameOutcome) -> None:
        self._done += 1
        self._failed += outcome.status == "failed"
        now = time.monotonic()
        if now - self._said >= self._interval:
            self._said = now
            failed = f", {self._failed} failed" if self._failed else ""
            times = pace(now - self._started, self._done, self._count - self._done)
            line = f"{self._done}/{self._count} frames{failed}, {times}"
            say(line, self._stream)


class BarProgress(Progress):
    """One line that is drawn over and over, with the time that is left; messages are printed above it.

    Within a frame it says which stage the work is at, and how much of the time is over that the frame before took.

    Args:
        stream: A terminal; None for standard error.
        interval: Seconds between two lines within a frame.
    """

    def __init__(self, stream: TextIO | None = None, interval: float = 0.2) -> None:
        self._stream, self._interval = stream or sys.stderr, interval
        self._count = self._done = self._worked = self._failed = 0
        self._started = self._begun = self._drawn = self._last_seconds = 0.0
        self._frame = self._line = ""

    def start(self, count: int) -> None:
        self._count, self._done, self._worked, self._failed = count, 0, 0, 0
        self._started = time.monotonic()

    def begin(self, frame: float) -> None:
        self._begun, self._frame = time.monotonic(), f"frame {frame_text(frame)}"
        self._draw(self._frame)

    def stage(self, name: str) -> None:
        now = time.monotonic()
        if now - self._drawn < self._interval:
            return
        share = ""
        if self._last_seconds > 0.0:
            share = f" {min(99, int(100.0 * (now - self._begun) / self._last_seconds))}%"
        self._draw(f"{self._frame} {name}{share}")

    def end(self, outcome: FrameOutcome) -> None:
        self._done += 1
        self._failed += outcome.status == "failed"
        self._worked += outcome.status != "skipped"
        if outcome.status not in ("failed", "skipped"):
            self._last_seconds = outcome.total_seconds
        self._draw(f"frame {frame_text(outcome.frame)}")

    def finish(self) -> None:
        if self._line:
            self._stream.write("\n")
            self._stream.flush()
            self._line = ""

    def message(self, line: str) -> None:
        if self._line:
            self._stream.write("\r\x1b[K")
        self._stream.write(f"{printable_lines(line)}\n{self._line}")
        self._stream.flush()

    def _draw(self, what: str) -> None:
        columns = shutil.get_terminal_size().columns - 1
        times = pace(time.monotonic() - self._started, self._worked, self._count - self._done) or "first frame"
        failed = f", {self._failed} failed" if self._failed else ""
        text = f" {self._done}/{self._count} {what}{failed}, {times}"
        width = max(0, min(40, columns - len(text) - 2))
        full = width * self._done // max(1, self._count)
        self._line = f"[{'#' * full}{'.' * (width - full)}]{text}"[: max(0, columns)]
        self._stream.write(f"\r\x1b[K{self._line}")
        self._stream.flush()
        self._drawn = time.monotonic()


def pace(gone: float, worked: int, left: int) -> str:
    """Time gone, rate and time left, as far as they are known; empty before the first frame is done.

    Args:
        gone: Seconds since the sequence was begun.
        worked: Frames that were rendered meanwhile, by however many processes.
        left: Frames to come.
    """
    if not worked:
        return ""
    each = gone / worked
    rate = f"{each:.1f} s a frame" if each >= 1 else f"{1 / max(each, 1e-9):.1f} frames/s"
    return f"{clock(gone)} gone, {rate}, {clock(each * left)} left"


def clock(seconds: float) -> str:
    """``m:ss``, or ``h:mm:ss`` from an hour on."""
    minutes, rest = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def progress_of(kind: str | Progress | None) -> Progress:
    """The progress called ``kind``; ``auto`` is the bar on a terminal and plain lines elsewhere, None shows nothing.

    Raises:
        InputError: There is no such kind.
    """
    if isinstance(kind, Progress):
        return kind
    if kind == "auto":
        kind = "bar" if sys.stderr.isatty() else "plain"
    makers: dict[str | None, type[Progress]] = {
        "bar": BarProgress,
        "plain": PlainProgress,
        "alf": AlfProgress,
        "openjd": OpenJobProgress,
        "none": Progress,
        None: Progress,
    }
    if kind not in makers:
        raise InputError(f"--progress must be one of {', '.join(KINDS)}, not {kind!r}")
    return makers[kind]()
