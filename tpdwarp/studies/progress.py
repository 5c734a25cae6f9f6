"""What is shown while a study is under way."""

from __future__ import annotations

import sys

from tpdwarp.errors import InputError
from tpdwarp.jobs.progress import BarProgress, Progress

KINDS = ("auto", "bar", "plain", "none")


class StudyProgress(Progress):
    """Shows nothing; the base of those that do."""

    def step(self, label: str) -> None:
        """Rendering of what ``label`` names begins."""

    def done(self, label: str, seconds: float, fresh: bool) -> None:
        """It is over.

        Args:
            label: What was rendered.
            seconds: How long it took.
            fresh: Whether it was rendered now, and not kept from an earlier study.
        """


class PlainStudyProgress(StudyProgress):
    """A line on standard error for everything rendered."""

    def start(self, count: int) -> None:
        self._count, self._number = count, 0

    def done(self, label: str, seconds: float, fresh: bool) -> None:
        self._number += 1
        self.message(f"{self._number}/{self._count} {label}: {f'{seconds:.2f} s' if fresh else 'kept from before'}")


class BarStudyProgress(BarProgress, StudyProgress):
    """The bar of a sequence, over what is rendered."""

    def step(self, label: str) -> None:
        self._draw(label)

    def done(self, label: str, seconds: float, fresh: bool) -> None:
        self._done += 1
        if fresh:
            self._worked += 1
            self._seconds += seconds
        self._draw(label)


def study_progress_of(kind: str | StudyProgress | None) -> StudyProgress:
    """The progress called ``kind``; ``auto`` is the bar on a terminal and plain lines elsewhere, None shows nothing.

    Raises:
        InputError: There is no such kind.
    """
    if isinstance(kind, StudyProgress):
        return kind
    if kind == "auto":
        kind = "bar" if sys.stderr.isatty() else "plain"
    makers = {"bar": BarStudyProgress, "plain": PlainStudyProgress, "none": StudyProgress, None: StudyProgress}
    if kind not in makers:
        raise InputError(f"--progress must be one of {', '.join(KINDS)}, not {kind!r}")
    return makers[kind]()
