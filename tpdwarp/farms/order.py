"""What a worker of a farm has to know of a sequence, and what it tells of its frames."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from tpdwarp.jobs.frame_loop import Persistence
from tpdwarp.jobs.opening import DEFAULT_TIME
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.rendering.error_target import ErrorTarget


@dataclass(frozen=True)
class Order:
    """A sequence as its client planned it; the same on every worker.

    Attributes:
        scene: The stage's absolute path, as all workers see it.
        default_time: Whether its default time is rendered.
        settings: The settings as JSON, without an open choice.
        target: What photons and segments were chosen for.
        stage: Hash of what the stage holds, as the client sees it.
        versions: Versions of program and libraries as JSON, as the client has them.
        out: Absolute pattern of the frames' files.
        frames: All frames of the sequence.
        layer: Absolute path of the debug layer; empty without.
        curves: At most so many photons a frame in it.
        skip_existing: Whether frames stay that are there, whole and up to date.
        begun: When the client began, as ``time.time()`` has it: frames made since then are of this sequence.
        strict: Whether what USD warns of counts as an error.
        persistence: How long a worker keeps trying.
        max_memory: Bytes that a frame may need; None for three quarters of the worker's machine.
    """

    scene: str
    default_time: bool
    settings: str
    target: ErrorTarget | None
    stage: str
    versions: str
    out: str
    frames: tuple[float, ...]
    layer: str
    curves: int | None
    skip_existing: bool
    begun: float
    strict: bool
    persistence: Persistence
    max_memory: float | None

    @property
    def name(self) -> str:
        """Sixteen digits that name what is rendered and where to: the same for the same command."""
        what = (self.scene, self.default_time, self.settings, self.stage, self.versions, self.out, self.layer)
        return hashlib.sha256(repr((*what, self.curves)).encode("utf-8", "surrogateescape")).hexdigest()[:16]


def name_of(orders: Sequence[Order]) -> str:
    """Sixteen digits that name sequences which are rendered together."""
    if len(orders) == 1:
        return orders[0].name
    return hashlib.sha256(" ".join(order.name for order in orders).encode()).hexdigest()[:16]


def key_of(orders: Sequence[Order], frames: tuple[float, ...], attempt: int) -> str:
    """The key of the task that renders ``frames``, such as ``tpdwarp-0123456789abcdef-1:8-0``.

    Args:
        orders: The sequences.
        frames: A chunk of their frames.
        attempt: How often the chunk was handed out before.
    """
    return f"tpdwarp-{name_of(orders)}-{frames[0]:g}:{frames[-1]:g}x{len(frames)}-{attempt}"


def told(outcome: FrameOutcome) -> str:
    """An outcome as JSON."""
    return json.dumps(asdict(outcome))


def heard(text: str) -> FrameOutcome:
    """The outcome that :func:`told` has made JSON of."""
    found: Mapping[str, Any] = json.loads(text)
    energy = None if found["energy"] is None else EnergyAccount(**found["energy"])
    # The default time is no number, and equal to itself only.
    frame = DEFAULT_TIME if math.isnan(found["frame"]) else found["frame"]
    return FrameOutcome(**{**found, "frame": frame, "energy": energy})
