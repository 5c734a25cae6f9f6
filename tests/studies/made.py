"""Solutions written down by hand."""

from __future__ import annotations

import numpy as np

from tpdwarp.settings import Settings
from tpdwarp.studies.cases import Case
from tpdwarp.studies.measures import errors_of
from tpdwarp.studies.result import ExposureResult, Measured, StudyResult
from tpdwarp.studies.solutions import Solution
from tpdwarp.studies.truth import Truth

HEIGHT, WIDTH = 16, 24


def solution(level: float = 1.0, noise: float = 0.0, frames: int = 1, cpu: float = 1.0, seed: int = 0) -> Solution:
    """Grey frames around ``level`` with noise, that took ``cpu`` seconds."""
    random = np.random.default_rng(seed)
    caustic = (level + noise * random.normal(size=(frames, HEIGHT, WIDTH, 3))).astype(np.float32)
    seconds = {"trace": 0.75 * cpu, "gather": 0.25 * cpu}
    return Solution(caustic, caustic + np.float32(0.5), dict(seconds), seconds, 100.0, 2**20)


def measured(series: str, photons: int, level: float, cpu: float) -> Measured:
    """A case whose error is ``level`` − 1."""
    found = solution(level, cpu=cpu)
    return Measured(Case(series, 1.0, Settings(photons=photons)), errors_of(found, solution()), found)


def study_result(*cases: Measured, failed: dict[str, str] | None = None, left: tuple[str, ...] = ()) -> StudyResult:
    part = ExposureResult(1.0, Truth(solution(), 0.01), cases, failed or {})
    return StudyResult("scene.usda", (1.0,), (WIDTH, HEIGHT), (part,), left, 2.0)


def three_cases() -> StudyResult:
    """One slow and good, one fast and bad, one beaten in both."""
    return study_result(
        measured("tpd K=1", 1024, 1.2, 0.1), measured("tpd K=1", 4096, 1.05, 2.0), measured("pd", 4096, 1.3, 0.5)
    )
