"""What a study found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tpdwarp.studies.cases import Case
from tpdwarp.studies.measures import Errors
from tpdwarp.studies.solutions import Solution
from tpdwarp.studies.truth import Truth


@dataclass(frozen=True, eq=False)
class Measured:
    """One case and how it did.

    Attributes:
        case: What was rendered.
        errors: How far it is from the truth.
        solution: What came out, and what it cost.
    """

    case: Case
    errors: Errors
    solution: Solution

    @property
    def cpu(self) -> float:
        """CPU seconds a frame, but for what is planned once for a whole animation."""
        return sum(seconds for stage, seconds in self.solution.cpu_seconds.items() if stage != "plan")


@dataclass(frozen=True, eq=False)
class ExposureResult:
    """Everything at one exposure.

    Attributes:
        exposure: Length of the shutter in frames.
        truth: What is measured against.
        measured: The cases, in the order in which they were rendered.
        failed: Why a case could not be rendered, by its label.
    """

    exposure: float
    truth: Truth
    measured: tuple[Measured, ...]
    failed: dict[str, str]

    @property
    def front(self) -> tuple[Measured, ...]:
        """The Pareto front: cases that none beats in both CPU time and error, the fastest first."""
        return pareto_front(self.measured)


@dataclass(frozen=True, eq=False)
class StudyResult:
    """A study.

    Attributes:
        scene: The stage.
        frames: Time codes rendered.
        size: Width and height in pixels.
        exposures: What was found at each exposure.
        left: Cases that the time limit left out, in words.
        seconds: How long it took.
    """

    scene: str
    frames: tuple[float, ...]
    size: tuple[int, int]
    exposures: tuple[ExposureResult, ...]
    left: tuple[str, ...]
    seconds: float

    @property
    def failed(self) -> dict[str, str]:
        """Why cases could not be rendered, by their labels."""
        return {label: reason for result in self.exposures for label, reason in result.failed.items()}


def pareto_front(measured: Sequence[Measured]) -> tuple[Measured, ...]:
    """Cases that none beats in both CPU time and error, the fastest first."""
    front: list[Measured] = []
    for candidate in sorted(measured, key=lambda found: (found.cpu, found.errors.rmse)):
        if not front or candidate.errors.rmse < front[-1].errors.rmse:
            front.append(candidate)
    return tuple(front)


def rows_of(result: StudyResult) -> list[dict[str, Any]]:
    """Every measurement as a flat row of plain values; seconds and bytes are a frame's, ``cpu`` by stage follow."""
    rows = []
    for part in result.exposures:
        front = part.front
        for found in part.measured:
            settings, solution = found.case.settings, found.solution
            tdpm, outside = settings.estimator == "tdpm", found.case.outside
            rows.append(
                {
                    "exposure": part.exposure,
                    "method": found.case.series if outside else settings.estimator,
                    "preset": found.case.preset,
                    "photons": None if outside else settings.photons,
                    "segments": None if outside else settings.segments,
                    "kernel": "" if tdpm or outside else settings.kernel,
                    "neighbours": settings.tdpm_neighbours if tdpm else None,
                    "between": settings.tdpm_between if tdpm else None,
                    **asdict(found.errors),
                    "landed": solution.landed,
                    "memory": solution.memory,
                    "on_front": any(found is other for other in front),
                    "cpu": found.cpu,
                    **{f"cpu.{stage}": seconds for stage, seconds in sorted(solution.cpu_seconds.items())},
                    "seconds": float(np.sum(list(solution.seconds.values()))),
                }
            )
    return rows
