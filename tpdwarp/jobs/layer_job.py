"""The debug layer of a sequence: photons are kept frame by frame, and made a layer when all frames are there."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.frame_names import frame_text
from tpdwarp.jobs.claims import ClaimedElsewhere, Claims
from tpdwarp.jobs.existing_frames import STATISTICS, KeptFrame, kept_frame
from tpdwarp.jobs.photon_parts import PhotonParts
from tpdwarp.photons.paths import PhotonPaths
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.stopping import pause
from tpdwarp.usd.read.debug_layer import DebugLayerReader
from tpdwarp.usd.write.debug_layer import DebugLayerWriter, check_debug_layer, refuse_non_finite, view_path

if TYPE_CHECKING:
    from tpdwarp.io.outputs import FilePath
    from tpdwarp.jobs.plan import SequencePlan

# How often a layer that another process writes is looked for.
POLL_SECONDS = 0.5


class DebugLayerJob:
    """Makes the debug layer of one sequence, alone or together with other processes that render the same.

    Args:
        path: The layer.
        plan: The sequence.
        curves: At most so many photons a frame; None for all.
        resume: Whether what earlier runs have made counts.

    Raises:
        InputError: The layer cannot be written there.
    """

    def __init__(self, path: FilePath, plan: SequencePlan, curves: int | None, resume: bool) -> None:
        check_debug_layer(path, plan.source.file, curves)
        self.path = path
        self._plan, self._curves = plan, curves
        self._parts = PhotonParts(path, plan.fingerprint, curves)
        self._parts.sweep()
        self._claims = Claims()
        self._resumes = resume
        # What stands there is written anew, unless another process does so meanwhile.
        self._stale = None if resume else _state(view_path(path))
        self._kept = self._statistics_of_layer() if resume else None

    def lacks(self, frame: float) -> bool:
        """Whether a frame has to be traced for the layer, though its image is there."""
        return self._kept is None and self._parts.load(frame) is None and self._statistics_of_layer() is None

    def kept(self, frame: float) -> KeptFrame | None:
        """What earlier runs have noted of a frame that need not be traced again; None where it must be."""
        if not self._resumes:
            return None
        return self._parts.kept(frame) if self._kept is None else self._kept.get(frame_text(frame), KeptFrame())

    def add(self, frame: float, photons: PhotonRecord, statistics: str, paths: PhotonPaths | None = None) -> None:
        """Keeps the photons of a frame.

        Args:
            frame: Which frame.
            photons: Its photons.
            statistics: What :func:`tpdwarp.jobs.existing_frames.statistics_text` says of it.
            paths: Paths of some of them.

        Raises:
            FrameError: They are not finite, or cannot be written.
            OSError: They cannot be written.
        """
        refuse_non_finite(photons, frame, self.path)
        self._parts.store(frame, photons, statistics, paths)

    def complete(self, frames: Sequence[float]) -> None:
        """Writes the layer, unless it is there already.

        Args:
            frames: Frames that came through. Where some of the sequence are missing, photons stay for another run.

        Raises:
            FrameError: It cannot be written.
            InputError: Likewise.
        """
        while True:
            try:
                with self._claims.held(str(self.path)):
                    if self._kept is None and self._statistics_of_layer() is None:
                        self._write(frames)
                    if len(frames) == len(self._plan.frames):
                        self._parts.remove()
                return
            except ClaimedElsewhere:
                pause(POLL_SECONDS)

    def _write(self, frames: Sequence[float]) -> None:
        plan = self._plan
        numbered = [frame for frame in plan.frames if not math.isnan(frame)]
        notes = {"fingerprint": self._fingerprint_of(frames), "statistics": json.dumps(self._parts.texts(frames))}
        writer = DebugLayerWriter(
            self.path,
            plan.source.file,
            plan.settings.as_dict(),
            (min(numbered), max(numbered)) if numbered else (plan.source.start, plan.source.end),
            plan.source.shutter(numbered[0], plan.settings).exposure if numbered else 0.0,
            plan.source.time_codes_per_second,
            plan.source.frames_per_second,
            plan.source.up_axis,
            plan.source.meters_per_unit,
            self._curves,
            notes,
        )
        with writer:
            for frame in frames:
                kept = self._parts.load(frame)
                if kept is None:
                    raise FrameError(f"{self._parts.path(frame)}: is missing or damaged (render the sequence again)")
                writer.add_frame(frame, kept.photons, plan.settings.smoothing, kept.paths)

    def _fingerprint_of(self, frames: Sequence[float]) -> str:
        text = "\n".join([*map(self._plan.fingerprint.text, frames), f"curves={self._curves}"])
        return hashlib.sha256(text.encode()).hexdigest()

    def _statistics_of_layer(self) -> dict[str, KeptFrame] | None:
        """Statistics of the frames of the layer, where it is that of the whole sequence; None where it is not."""
        state = _state(view_path(self.path))
        if state is None or state == self._stale:
            return None
        try:
            provenance = DebugLayerReader(self.path).provenance
            if provenance.get("fingerprint") != self._fingerprint_of(self._plan.frames):
                return None
            texts = json.loads(provenance["statistics"])
            return {name: kept_frame({STATISTICS: text}) for name, text in texts.items()}
        except (InputError, KeyError, TypeError, ValueError, AttributeError):
            return None


def _state(path: Path) -> tuple[int, int] | None:
    """Which file this is, and when it was last written; None where there is none."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns
