"""The statistics of a sequence, written while it is under way or when it is over."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

from tpdwarp.errors import FrameError, InputError, logger
from tpdwarp.io.outputs import FilePath
from tpdwarp.jobs.frame_loop import reason_of
from tpdwarp.jobs.results import FrameOutcome, SequenceResult
from tpdwarp.jobs.statistics import StatisticsLines, statistics_of, write_statistics
from tpdwarp.rendering.error_target import ErrorTarget
from tpdwarp.settings import Settings


class SequenceReports:
    """Gathers what becomes of frames.

    Args:
        scene: The stage's file.
        stats: The statistics file; None where none is wanted. One called ``.jsonl`` grows with every frame.
        resume: Whether the lines of an earlier run stay in it.

    Raises:
        InputError: It cannot be written.
    """

    def __init__(self, scene: str, stats: FilePath | None, resume: bool) -> None:
        self._scene, self._stats = scene, stats
        self._problems: list[str] = []
        self._lines: StatisticsLines | None = None
        if stats is not None and os.fspath(stats).lower().endswith(".jsonl"):
            try:
                self._lines = StatisticsLines(stats, resume)
            except (OSError, FrameError) as error:
                raise InputError(f"cannot be written: {reason_of(error)}", file=os.fspath(stats)) from error

    def add(self, outcome: FrameOutcome) -> None:
        """Notes what became of a frame; that it cannot be written costs no frame."""
        if self._lines is None:
            return
        try:
            self._lines.add(outcome)
        except OSError as error:
            if not self._problems:
                self._problems.append(reason_of(error))

    def finished(
        self,
        settings: Settings,
        target: ErrorTarget | None,
        outcomes: Sequence[FrameOutcome],
        problems: Sequence[str],
        seconds: float,
        anew: Mapping[str, int] | None = None,
    ) -> SequenceResult:
        """The result of the sequence, whose statistics are written."""
        result = SequenceResult(tuple(outcomes), seconds, (*problems, *self._problems), target, dict(anew or {}))
        if self._stats is None or self._lines is not None:
            return result
        try:
            write_statistics(self._stats, statistics_of(self._scene, settings, result))
        except Exception as error:
            logger.debug("statistics", exc_info=error)
            return replace(result, problems=(*result.problems, reason_of(error)))
        return result
