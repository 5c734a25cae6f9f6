"""What a check finds: findings, what was measured, and the result of a whole check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from tpdwarp.checks.limits import Limits

Severity = Literal["fail", "warn"]
Status = Literal["same", "passed", "warned", "failed"]


@dataclass(frozen=True)
class Finding:
    """One difference.

    Attributes:
        severity: ``fail`` or ``warn``.
        kind: What differs: ``missing frame``, ``not finite``, ``rmse``, ``flicker``, ``metadata``, …
        message: The difference in words, with the values.
        group: Channel group, or empty.
        value, limit: What was measured and what is allowed; None where it is no number.
        place: Column and row of the worst pixel, from the top left; None where there is none.
        of_baseline: Whether the baseline itself is at fault.
    """

    severity: Severity
    kind: str
    message: str
    group: str = ""
    value: float | None = None
    limit: float | None = None
    place: tuple[int, int] | None = None
    of_baseline: bool = False

    def __str__(self) -> str:
        return f"{self.group}: {self.message}" if self.group else self.message


@dataclass(frozen=True)
class WorstPixel:
    """A pixel far from its baseline: column and row from the top left, and both values of its channels."""

    column: int
    row: int
    value: tuple[float, ...]
    baseline: tuple[float, ...]


@dataclass(frozen=True)
class GroupMeasures:
    """What was measured on one channel group; see :class:`tpdwarp.checks.limits.GroupLimits` for the meanings.

    Attributes:
        failed_percent, warned_percent: Pixels beyond the limits, in percent.
        largest: Largest difference, in the image's units.
        rms: Root of the mean squared difference, in the image's units.
        hard: The largest difference as a part of the baseline's largest value.
        rmse, coarse, flip_mean, flip_high, energy, flicker: As in the limits; None where not measured. Energy has a
            sign.
        total, baseline_total: Sums over the image and its colour channels.
        change, baseline_change: Root of the mean squared change since the frame before; None where there is none.
        worst: The worst pixels, the worst first.
    """

    failed_percent: float = 0.0
    warned_percent: float = 0.0
    largest: float = 0.0
    rms: float = 0.0
    hard: float = 0.0
    rmse: float = 0.0
    coarse: float = 0.0
    flip_mean: float | None = None
    flip_high: float | None = None
    energy: float | None = None
    flicker: float | None = None
    total: float | None = None
    baseline_total: float | None = None
    change: float | None = None
    baseline_change: float | None = None
    worst: tuple[WorstPixel, ...] = ()


@dataclass(frozen=True)
class FrameComparison:
    """One frame beside its baseline.

    Attributes:
        name: What the frame is called: its number, or the file's name where it has none.
        frame: Its number; None where it has none.
        path, baseline: The two files; empty where there is none.
        findings: What differs.
        measures: What was measured, by channel group; empty where the pixels could not be compared.
        pictures: Encoded pictures for the report, by name (``beauty.a``, ``beauty.difference``, …).
        scales: What the pictures' largest code stands for, by the same names.
        identical: Whether all pixels agree to the last bit.
        seconds: Seconds the comparison took.
    """

    name: str
    frame: float | None = None
    path: str = ""
    baseline: str = ""
    findings: tuple[Finding, ...] = ()
    measures: Mapping[str, GroupMeasures] = field(default_factory=dict)
    pictures: Mapping[str, bytes] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    identical: bool = False
    seconds: float = 0.0

    @property
    def status(self) -> Status:
        severities = {finding.severity for finding in self.findings}
        if "fail" in severities:
            return "failed"
        if "warn" in severities:
            return "warned"
        return "same" if self.identical else "passed"

    @property
    def failures(self) -> tuple[Finding, ...]:
        return tuple(finding for finding in self.findings if finding.severity == "fail")


@dataclass(frozen=True)
class CheckResult:
    """What a check found.

    Attributes:
        frames_path, baseline_path: What was compared.
        frames: One entry a frame, and one a frame of a debug layer, in order.
        limits: The limits used.
        limits_file: Where they came from; empty for the defaults.
        seconds: Seconds in all.
        report: The HTML report, or empty.
    """

    frames_path: str
    baseline_path: str
    frames: tuple[FrameComparison, ...]
    limits: Limits
    limits_file: str = ""
    seconds: float = 0.0
    report: str = ""

    @property
    def failed(self) -> tuple[FrameComparison, ...]:
        return tuple(frame for frame in self.frames if frame.status == "failed")

    @property
    def warned(self) -> tuple[FrameComparison, ...]:
        return tuple(frame for frame in self.frames if frame.status == "warned")

    @property
    def ok(self) -> bool:
        """Whether nothing failed; warnings are no failures."""
        return not self.failed
