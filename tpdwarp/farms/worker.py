"""What runs on a worker of a farm: chunks of sequences, of which the worker opens the stage once."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache

from distributed import get_worker

from tpdwarp.errors import InputError, logger, shortened
from tpdwarp.farms.order import Order, name_of, told
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.memory import memory_allowed
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.frame_loop import FrameLoop, run_together
from tpdwarp.jobs.frame_work import RenderWork
from tpdwarp.jobs.layer_job import DebugLayerJob
from tpdwarp.jobs.opening import open_scene, opened
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.products import contexts_of
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.jobs.statistics import versions
from tpdwarp.settings import Settings
from tpdwarp.usd.read.render_settings import EACH_PRODUCT
from tpdwarp.usd.read.stage import StageLike, StageScene


class UnfitWorker(Exception):
    """A worker that would render other frames than its client; its address comes first, then the reason."""


@dataclass(frozen=True)
class ChunkResult:
    """What became of a chunk of one sequence.

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


def render_chunk(orders: tuple[Order, ...], frames: tuple[float, ...]) -> tuple[ChunkResult, ...]:
    """Renders the same frames of sequences, past those that fail, and gives what became of each sequence.

    Each frame is told of as it ends, on the topic :func:`.order.name_of`, with the name of its sequence.

    Raises:
        UnfitWorker: This worker sees another stage, or has other versions of program or libraries.
    """
    worker, topic = get_worker(), name_of(orders)

    def tell(kind: str, text: str, sequence: str = "") -> None:
        worker.log_event(topic, {"kind": kind, "text": text, "sequence": sequence})

    def teller(order: Order) -> Callable[[FrameOutcome], None]:
        return lambda outcome: tell("frame", told(outcome), order.name)

    with _warnings_told(tell):
        works = _works_for(orders)
        before = [dict(work.existing.anew) for work, _ in works]
        shown = Progress()
        loops = [
            FrameLoop(work, names.path, shown, order.persistence, teller(order))
            for order, (work, names) in zip(orders, works, strict=True)
        ]
        # That all frames fail because of the input is told with their outcomes.
        with suppress(InputError):
            run_together(loops, frames, [None] * len(loops), shown)
    results = []
    for loop, (work, _), earlier in zip(loops, works, before, strict=True):
        anew = {reason: count - earlier.get(reason, 0) for reason, count in work.existing.anew.items()}
        refusal = next((o.reason for o in loop.outcomes if o.status == "failed"), "")
        results.append(ChunkResult(tuple(map(told, loop.outcomes)), loop.refused, refusal, tuple(anew.items())))
    return tuple(results)


# A worker has one stage open; another sequence on the same cluster takes turns at the price of opening it again.
@lru_cache(maxsize=1)
def _works_for(orders: tuple[Order, ...]) -> list[tuple[RenderWork, FrameNames]]:
    """Opens the stage and checks that everything is as the client has it; several sequences are products of it.

    Raises:
        UnfitWorker: It is not.
    """
    me, first = get_worker().address, orders[0]
    mine, wanted = versions(), json.loads(first.versions)
    for name, version in wanted.items():
        if mine.get(name) != version:
            raise UnfitWorker(f"{me} has {name} {mine.get(name)}, not {version}")
    try:
        plans = _plans(orders)
    except InputError as error:
        raise UnfitWorker(f"{me} cannot open the stage: {shortened(str(error))}") from error
    for order, plan in zip(orders, plans, strict=True):
        if plan.files.digest != order.stage:
            raise UnfitWorker(f"{me} sees another version of {order.scene} or of one of its files")
    works = []
    for order, plan, context in zip(orders, plans, contexts_of(plans), strict=True):
        layer = DebugLayerJob(order.layer, plan, order.curves, order.skip_existing) if order.layer else None
        names = FrameNames(order.out)
        works.append((RenderWork(plan, names, layer, context, order.skip_existing, order.begun), names))
    return works


def _plans(orders: tuple[Order, ...]) -> list[SequencePlan]:
    """The sequences as this worker sees them.

    Raises:
        InputError: The stage cannot be used.
    """
    scene: StageLike | StageScene = orders[0].scene
    together = len(orders) > 1
    if together:
        any_product = replace(_settings_of(orders[0]), product=EACH_PRODUCT)
        scene = open_scene(scene, any_product, orders[0].default_time, orders[0].max_memory)
    plans = []
    for order in orders:
        settings, asked = _settings_of(order), None if order.default_time else order.frames
        seen = scene.with_product(settings.product) if together else scene
        source, frames = opened(seen, settings, asked, order.default_time, order.strict, order.max_memory)
        files = StageFiles(source)
        fingerprint, memory = Fingerprint.of(settings, files.digest), memory_allowed(order.max_memory)
        plans.append(SequencePlan(source, files, frames, settings, order.target, fingerprint, order.strict, memory))
    return plans


def _settings_of(order: Order) -> Settings:
    found = json.loads(order.settings).items()
    return Settings(**{name: tuple(value) if isinstance(value, list) else value for name, value in found})


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
