"""What became of the frames of a sequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.rendering.error_target import ErrorTarget


@dataclass(frozen=True)
class FrameOutcome:
    """What became of one frame.

    Attributes:
        frame: Time code; NaN for the default time.
        status: ``written``, ``traced`` (photons only), ``compared`` (by a check), ``skipped`` (the file was there,
            whole and up to date) or ``failed``.
        path: The frame's file, or empty.
        reason: Why it failed, in one line.
        photons: Photons landed.
        energy: Where the flux went; None where nothing was traced.
        seconds: Seconds by stage.
        total_seconds: Seconds in all, writing included.
        tries: How often it was tried.
    """

    frame: float
    status: Literal["written", "traced", "skipped", "compared", "failed"]
    path: str = ""
    reason: str = ""
    photons: int = 0
    energy: EnergyAccount | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    total_seconds: float = 0.0
    tries: int = 1


@dataclass(frozen=True)
class SequenceResult:
    """What became of a sequence.

    Attributes:
        outcomes: One a frame, in order.
        seconds: Seconds in all.
        problems: What failed beyond single frames (the debug layer, the statistics), one line each.
        target: What was chosen for ``target_error``; None without.
        anew: How many frames whose files were there were rendered anew, by reason.
    """

    outcomes: tuple[FrameOutcome, ...]
    seconds: float
    problems: tuple[str, ...] = ()
    target: ErrorTarget | None = None
    anew: Mapping[str, int] = field(default_factory=dict)

    @property
    def written(self) -> tuple[float, ...]:
        """Frames written (or traced)."""
        return tuple(outcome.frame for outcome in self.outcomes if outcome.status in ("written", "traced"))

    @property
    def skipped(self) -> tuple[float, ...]:
        """Frames left alone, for their files were there."""
        return tuple(outcome.frame for outcome in self.outcomes if outcome.status == "skipped")

    @property
    def failed(self) -> dict[float, str]:
        """Frames that failed, and why."""
        return {outcome.frame: outcome.reason for outcome in self.outcomes if outcome.status == "failed"}

    @property
    def energy(self) -> dict[float, EnergyAccount]:
        """The energy account of every frame traced."""
        return {outcome.frame: outcome.energy for outcome in self.outcomes if outcome.energy is not None}

    @property
    def ok(self) -> bool:
        """Whether nothing failed."""
        return not self.failed and not self.problems
