"""What the frames of a sequence share: looked at and decided once, before the first of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.rendering.error_target import ErrorTarget
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene


@dataclass(frozen=True)
class SequencePlan:
    """A sequence that is about to be rendered.

    Attributes:
        source: The stage.
        files: What it is made of.
        frames: Time codes; NaN for the default time.
        settings: The settings, without an open choice.
        target: What photons and segments were chosen for; None where they were given.
        fingerprint: What the frames depend on.
        strict: Whether what USD warns of counts as an error.
        max_memory: Bytes that a frame may need.
    """

    source: StageScene
    files: StageFiles
    frames: tuple[float, ...]
    settings: Settings
    target: ErrorTarget | None
    fingerprint: Fingerprint
    strict: bool = False
    max_memory: float = math.inf
