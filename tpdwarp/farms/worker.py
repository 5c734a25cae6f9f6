"""What runs on a worker of a farm: chunks of a sequence, of which the worker opens the stage once."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

from distributed import get_worker

from tpdwarp.errors import InputError, logger, shortened
from tpdwarp.farms.order import Order, told
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.memory import memory_allowed
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.frame_loop import FrameLoop
from tpdwarp.jobs.frame_work import RenderWork
from tpdwarp.jobs.layer_job import DebugLayerJob
from tpdwarp.jobs.opening import opened
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.products import contexts_of
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.jobs.statistics import versions
from tpdwarp.settings import Settings


class UnfitWorker(Exception):
    """A worker that would render other frames than its client; its address comes first, then the reason."""


@dataclass(frozen=True)
class ChunkResult:
    """What became of a chunk.

    Attributes:
        outcomes: One a frame, as JSON.
        refused: How many frames failed because the stage cannot be used.
        refusal: The first such error in one line, or empty.
        anew: How many frames that were there were rendered anew, by reason.
    """

    outcomes: tuple[str, ...]
    refused: int
    refusal: str
    anew: tuple[tuple[str, int], ...]


def render_chunk(order: Order, frames: tuple[float, ...]) -> ChunkResult:
    """Renders frames of a sequence, past those that fail; each is told of as it ends, on the topic ``order.name``.

    Raises:
        UnfitWorker: This worker sees another stage, or has other versions of program or libraries.
    """
    worker = get_worker()

    def tell(kind: str, text: str) -> None:
        worker.log_event(order.name, {"kind": kind, "text": text})

    with _warnings_told(tell):
        work, names = _work_for(order)
        before = dict(work.existing.anew)
        loop = FrameLoop(work, names.path, Progress(), order.persistence, lambda outcome: tell("frame", told(outcome)))
        refusal = ""
        try:
            loop.run(frames, None)
        except InputError as error:
            refusal = str(error)
        anew = {reason: count - before.get(reason, 0) for reason, count in work.existing.anew.items()}
    refusal = refusal or next((o.reason for o in loop.outcomes if o.status == "failed"), "")
    return ChunkResult(tuple(map(told, loop.outcomes)), loop.refused, refusal, tuple(anew.items()))


# A worker has one stage open; another sequence on the same cluster takes turns at the price of opening it again.
@lru_cache(maxsize=1)
def _work_for(order: Order) -> tuple[RenderWork, FrameNames]:
    """Opens the stage and checks that everything is as the client has it.

    Raises:
        UnfitWorker: It is not.
    """
    me = get_worker().address
    mine, wanted = versions(), json.loads(order.versions)
    for name, version in wanted.items():
        if mine.get(name) != version:
            raise UnfitWorker(f"{me} has {name} {mine.get(name)}, not {version}")
    settings = Settings(
        **{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in json.loads(order.settings).items()
        }
    )
    try:
        asked = None if order.default_time else order.frames
        source, frames = opened(order.scene, settings, asked, order.default_time, order.strict, order.max_memory)
        files = StageFiles(source)
    except InputError as error:
        raise UnfitWorker(f"{me} cannot open the stage: {shortened(str(error))}") from error
    if files.digest != order.stage:
        raise UnfitWorker(f"{me} sees another version of {order.scene} or of one of its files")
    fingerprint, memory = Fingerprint.of(settings, files.digest), memory_allowed(order.max_memory)
    plan = SequencePlan(source, files, frames, settings, order.target, fingerprint, order.strict, memory)
    layer = DebugLayerJob(order.layer, plan, order.curves, order.skip_existing) if order.layer else None
    names = FrameNames(order.out)
    return RenderWork(plan, names, layer, contexts_of([plan])[0], order.skip_existing, order.begun), names


@contextmanager
def _warnings_told(tell: Callable[[str, str], None]) -> Iterator[None]:
    """While entered, warnings go to the client in place of the worker's own log."""
    handler = _Teller(tell)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


class _Teller(logging.Handler):
    def __init__(self, tell: Callable[[str, str], None]) -> None:
        super().__init__(logging.WARNING)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell("warning", " ".join(record.getMessage().split()))
