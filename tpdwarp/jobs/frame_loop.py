"""The loop over the frames of a sequence, which goes on past frames that fail."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING

from tpdwarp.errors import FrameError, InputError, logger, shortened
from tpdwarp.io.frame_names import frame_text
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.stopping import raise_if_asked

if TYPE_CHECKING:
    from tpdwarp.usd.write.debug_layer import DebugLayerWriter


def run_frames(
    frames: Sequence[float],
    work: Callable[[float], FrameOutcome],
    path_of: Callable[[float], str],
    shown: Progress,
    layer: DebugLayerWriter | None,
) -> tuple[list[FrameOutcome], list[str]]:
    """Works through ``frames``, past those that fail, then completes the debug layer.

    Args:
        frames: Time codes.
        work: Does one frame.
        path_of: The file of a frame, for the outcome of one that failed.
        shown: Is told what happens.
        layer: A debug layer to which ``work`` adds; completed if any frame came through, else dropped.

    Returns:
        What became of each frame, and what failed beyond them, one line each.

    Raises:
        InputError: That is how every frame failed; the first such error.
        BrokenPipeError: Nobody listens to the progress any more.
    """
    outcomes: list[FrameOutcome] = []
    problems: list[str] = []
    try:
        with layer if layer is not None else nullcontext():
            shown.start(len(frames))
            try:
                refusal = _work_through(frames, work, path_of, shown, outcomes)
            finally:
                shown.finish()
            if refusal is not None:
                raise refusal
            if layer is not None and all(outcome.status == "failed" for outcome in outcomes):
                raise FrameError(f"{layer.path}: is not written, for no frame could be traced")
    except (InputError, BrokenPipeError):
        raise
    except Exception as error:
        logger.debug("after the last frame", exc_info=error)
        problems.append(reason_of(error))
    return outcomes, problems


def _work_through(
    frames: Sequence[float],
    work: Callable[[float], FrameOutcome],
    path_of: Callable[[float], str],
    shown: Progress,
    outcomes: list[FrameOutcome],
) -> InputError | None:
    """Works through ``frames``; gives the first :class:`InputError` if that is how every frame failed."""
    refusal: InputError | None = None
    refused = 0
    for frame in frames:
        raise_if_asked()
        shown.begin(frame)
        started = time.perf_counter()
        try:
            outcome = work(frame)
        except Exception as error:
            if isinstance(error, InputError):
                refused += 1
                refusal = refusal or error
            logger.debug(f"frame {frame_text(frame)}", exc_info=error)
            outcome = FrameOutcome(frame, "failed", path_of(frame), reason_of(error))
        outcome = replace(outcome, total_seconds=time.perf_counter() - started)
        outcomes.append(outcome)
        shown.end(outcome)
    return refusal if refused == len(frames) else None


def reason_of(error: Exception) -> str:
    """Why something failed, in one line."""
    if isinstance(error, FrameError | InputError):
        text = str(error)
    elif isinstance(error, MemoryError):
        text = "out of memory (try fewer --photons, fewer --samples or a smaller --imageWidth)"
    elif isinstance(error, OSError):
        text = ": ".join(str(part) for part in (error.filename, error.strerror or error) if part)
    else:
        text = f"internal: {type(error).__name__}: {shortened(str(error))}"
    return " ".join(text.split())
