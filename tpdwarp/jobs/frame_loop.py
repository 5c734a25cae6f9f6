"""The loop over the frames of a sequence, which goes on past frames that fail."""

from __future__ import annotations

import errno
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tpdwarp.errors import FrameError, InputError, logger, shortened
from tpdwarp.io.frame_names import frame_text
from tpdwarp.jobs.claims import ClaimedElsewhere
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.stopping import pause, raise_if_asked, time_limit

if TYPE_CHECKING:
    from tpdwarp.jobs.layer_job import DebugLayerJob

# How long frames that other processes render are left alone before they are looked for again.
CLAIM_POLL_SECONDS = 0.5
# So many frames in a row that fail while the disk is full end the sequence: space may come back, but not soon.
FAILURES_ON_A_FULL_DISK = 3
# Before a second try; a busy file server is over a hiccup by then. Doubled for every further one.
RETRY_SECONDS = 0.5
# How the reason of a frame begins that other frames beside it may have left without memory.
OUT_OF_MEMORY = "out of memory"
_PROBE_BYTES = 1 << 16
_FULL = (errno.ENOSPC, errno.EDQUOT)


@dataclass(frozen=True)
class Persistence:
    """How long a sequence keeps trying.

    Attributes:
        frame_timeout: Seconds that a frame may take, for each try; None for no limit.
        retries: How often a frame that failed is tried again.
        max_failures: So many frames in a row that fail end the sequence; None for no limit.

    Raises:
        InputError: A number makes no sense.
    """

    frame_timeout: float | None = None
    retries: int = 0
    max_failures: int | None = None

    def __post_init__(self) -> None:
        if self.frame_timeout is not None and not 0 < self.frame_timeout < 1e9:
            raise InputError(f"--frame-timeout must be above 0 seconds, not {self.frame_timeout}")
        if self.retries < 0:
            raise InputError(f"--retries must be 0 or more, not {self.retries}")
        if self.max_failures is not None and self.max_failures < 1:
            raise InputError(f"--max-failures must be above 0, not {self.max_failures}")


class FrameLoop:
    """Works through frames, past those that fail, then completes the debug layer.

    Args:
        work: Does one frame.
        path_of: The file of a frame, for the outcome of one that failed.
        shown: Shows what happens.
        persistence: How long to keep trying.
        ended: Is given every outcome as it is known.

    Attributes:
        outcomes: What became of each frame.
        problems: What failed beyond them, one line each.
        refused: How many failed because the input cannot be used.
    """

    def __init__(
        self,
        work: Callable[[float], FrameOutcome],
        path_of: Callable[[float], str],
        shown: Progress,
        persistence: Persistence | None = None,
        ended: Callable[[FrameOutcome], None] | None = None,
    ) -> None:
        self._work, self._path_of, self._shown = work, path_of, shown
        self._persistence, self._ended = persistence or Persistence(), ended
        self.outcomes: list[FrameOutcome] = []
        self.problems: list[str] = []
        self._refusal: InputError | None = None
        self.refused = self._failures = self._failures_on_full = 0
        self._layer_path = ""

    def run(self, frames: Sequence[float], layer: DebugLayerJob | None) -> None:
        """Works through ``frames``.

        Args:
            frames: Time codes.
            layer: A debug layer to which the work adds; completed if any frame came through.

        Raises:
            InputError: That is how every frame failed; the first such error.
            BrokenPipeError: Nobody listens to the progress any more.
        """
        run_together([self], frames, [layer], self._shown)

    def step(self, frame: float) -> bool:
        """Works on one frame, and notes what became of it; false where another process renders it."""
        outcome = self._given_up(frame) or self._one(frame)
        if outcome is None:
            return False
        self.outcomes.append(outcome)
        if self._ended is not None:
            self._ended(outcome)
        self._shown.end(outcome)
        return True

    def begin(self, layer: DebugLayerJob | None) -> None:
        """Makes ready for a sequence whose photons go to ``layer``."""
        self._layer_path = "" if layer is None else str(layer.path)

    def conclude(self, frames: Sequence[float], layer: DebugLayerJob | None) -> InputError | None:
        """Sorts the outcomes and completes the layer; returns the error that every frame failed with, if it is that."""
        places = {frame: place for place, frame in enumerate(frames)}
        self.outcomes.sort(key=lambda outcome: places.get(outcome.frame, 0))
        if self._refusal is not None and self.refused == len(frames):
            return self._refusal
        if layer is not None:
            self.problems += layer_problems(layer, self.outcomes)
        return None

    def _one(self, frame: float) -> FrameOutcome | None:
        """What became of a frame; None where another process renders it."""
        self._shown.begin(frame)
        started = time.perf_counter()
        tries = 0
        while True:
            tries += 1
            try:
                with time_limit(self._persistence.frame_timeout):
                    outcome = self._work(frame)
                self._failures = self._failures_on_full = 0
                break
            except ClaimedElsewhere:
                return None
            except Exception as error:
                logger.debug(f"frame {frame_text(frame)}", exc_info=error)
                refused = isinstance(error, InputError)
                # Input stays what it is.
                if not refused and tries <= self._persistence.retries:
                    logger.warning(f"frame {frame_text(frame)} is tried again: {reason_of(error)}")
                    pause(RETRY_SECONDS * 2 ** (tries - 1))
                    continue
                if refused:
                    self.refused += 1
                    self._refusal = self._refusal or error
                self._failures += 1
                full = disk_is_full(self._path_of(frame) or self._layer_path)
                self._failures_on_full = self._failures_on_full + 1 if full else 0
                outcome = FrameOutcome(frame, "failed", self._path_of(frame), reason_of(error))
                break
        return replace(outcome, total_seconds=time.perf_counter() - started, tries=tries)

    def _given_up(self, frame: float) -> FrameOutcome | None:
        """The outcome of a frame that is not begun, for there is no hope for it; None while there is."""
        most = self._persistence.max_failures
        if self._failures_on_full >= FAILURES_ON_A_FULL_DISK:
            reason = f"not begun, for the disk was full for {self._failures_on_full} frames in a row"
        elif most is not None and self._failures >= most:
            reason = f"not begun, for {self._failures} frames in a row failed (--max-failures)"
        else:
            return None
        return FrameOutcome(frame, "failed", self._path_of(frame), reason, tries=0)


def run_together(
    loops: Sequence[FrameLoop], frames: Sequence[float], layers: Sequence[DebugLayerJob | None], shown: Progress
) -> None:
    """Works through the same frames of several sequences, frame by frame.

    Args:
        loops: One a sequence.
        frames: Time codes.
        layers: The debug layer of each sequence; completed if any of its frames came through.
        shown: Shows what happens.

    Raises:
        InputError: That is how every frame of a sequence failed; the first such error.
        BrokenPipeError: Nobody listens to the progress any more.
    """
    for loop, layer in zip(loops, layers, strict=True):
        loop.begin(layer)
    try:
        shown.start(len(frames) * len(loops))
        try:
            _work_through([(loop, frame) for frame in frames for loop in loops])
        finally:
            shown.finish()
    except BrokenPipeError:
        raise
    except Exception as error:
        logger.debug("after the last frame", exc_info=error)
        loops[0].problems.append(reason_of(error))
    refusals = [loop.conclude(frames, layer) for loop, layer in zip(loops, layers, strict=True)]
    for refusal in refusals:
        if refusal is not None:
            raise refusal


def _work_through(steps: Sequence[tuple[FrameLoop, float]]) -> None:
    """Takes ``steps``; frames that other processes render are looked for again at the end."""
    left = list(steps)
    while left:
        elsewhere: list[tuple[FrameLoop, float]] = []
        for loop, frame in left:
            raise_if_asked()
            if not loop.step(frame):
                elsewhere.append((loop, frame))
        if len(elsewhere) == len(left):
            pause(CLAIM_POLL_SECONDS)
        left = elsewhere


def layer_problems(layer: DebugLayerJob, outcomes: Sequence[FrameOutcome]) -> list[str]:
    """Completes a debug layer with the frames that came through.

    Returns:
        Why it is not written, in one line; nothing where it is.
    """
    done = [outcome.frame for outcome in outcomes if outcome.status != "failed"]
    if not done:
        return [f"{layer.path}: is not written, for no frame could be traced"]
    try:
        layer.complete(done)
    except (FrameError, InputError, OSError, MemoryError) as error:
        logger.debug("debug layer", exc_info=error)
        return [reason_of(error)]
    return []


def disk_is_full(path: str) -> bool:
    """Whether the folder of ``path`` has no room for as much as 64 kB, or no more than its user may take."""
    try:
        with tempfile.TemporaryFile(dir=os.path.dirname(os.path.abspath(path))) as probe:
            probe.write(bytes(_PROBE_BYTES))
            probe.flush()
            os.fsync(probe.fileno())
    except OSError as error:
        return error.errno in _FULL
    return False


def reason_of(error: Exception) -> str:
    """Why something failed, in one line."""
    if isinstance(error, FrameError | InputError):
        text = str(error)
    elif isinstance(error, MemoryError):
        text = f"{OUT_OF_MEMORY} (try fewer --photons, fewer --samples or a smaller --imageWidth)"
    elif isinstance(error, OSError):
        text = ": ".join(str(part) for part in (error.filename, error.strerror or error) if part)
    else:
        text = f"internal: {type(error).__name__}: {shortened(str(error))}"
    return " ".join(text.split())
