"""A sequence spread over the workers of a Dask cluster: handed out in chunks, followed frame by frame, and not lost by
whatever happens to workers and schedulers.

    chunks      frames that follow each other, each chunk one task
    alone       frames that took a worker down or ran out of memory, one at a time when nothing else is under way
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from distributed import Client, Future, KilledWorker

from tpdwarp.errors import InputError, logger, shortened
from tpdwarp.farms.cluster import CLOSE_SECONDS, Tls, connected, local_cluster
from tpdwarp.farms.order import Order, heard, key_of, name_of
from tpdwarp.farms.worker import ChunkResult, UnfitWorker, render_chunk
from tpdwarp.io.files import file_name
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.memory import memory_allowed
from tpdwarp.jobs.frame_loop import OUT_OF_MEMORY, Persistence, layer_problems, reason_of
from tpdwarp.jobs.layer_job import DebugLayerJob
from tpdwarp.jobs.opening import FilePath, Frames, chosen_settings
from tpdwarp.jobs.outputs import sweep_folder
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.products import Product, joined, products_of
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.jobs.reports import SequenceReports
from tpdwarp.jobs.results import FrameOutcome, SequenceResult
from tpdwarp.jobs.sequence import prepared
from tpdwarp.jobs.statistics import versions
from tpdwarp.stopping import pause
from tpdwarp.usd.read.render_settings import EACH_PRODUCT

# How often it is looked what has become of the chunks.
POLL_SECONDS = 0.1
# A scheduler that is gone is waited for so long: service managers and batch systems start it anew.
PATIENCE_SECONDS = 600.0
# Chunks for each worker: fewer open the stage less often, more end at the same time.
CHUNKS_A_WORKER = 4
LONGEST_CHUNK = 16


def farm(
    scene: FilePath,
    out: FilePath,
    *,
    scheduler: str = "",
    workers: int | None = None,
    chunk: int | None = None,
    dashboard: str = "",
    tls: tuple[str, str, str] | None = None,
    frames: Frames = None,
    default_time: bool = False,
    progress: str | Progress | None = None,
    debug_layer: FilePath | None = None,
    curves: int | None = None,
    stats: FilePath | None = None,
    skip_existing: bool = False,
    strict: bool = False,
    frame_timeout: float | None = None,
    retries: int = 0,
    max_failures: int | None = None,
    max_memory: float | None = None,
    **settings: Any,
) -> SequenceResult:
    """Renders frames of a USD stage to image files, as :func:`tpdwarp.render` does, on the workers of a Dask cluster.

    All workers must see the stage and the folders that are written under the same paths, and have the same versions of
    the program and its libraries; those that do not are left out, and it is said why. Kernels are compiled once a host.

    Args:
        scheduler: Address of a scheduler, such as ``tcp://host:8786``; empty starts one with workers on this machine.
        workers: How many workers are started here; None for as many as cores and memory allow.
        chunk: Frames in one task; None chooses.
        dashboard: Where the dashboard of a scheduler started here listens, ``host:port``; empty for any port of this
            machine's own address.
        tls: PEM files: authorities, certificate, key. Connections are encrypted, and who has no certificate of these
            authorities is refused.
        max_memory: Bytes that the workers started here may take together, or each of another cluster's; None for three
            quarters of their machine.
        scene, out, frames, default_time, progress, debug_layer, curves, stats, skip_existing, strict, frame_timeout,
            retries, max_failures, **settings: As for :func:`tpdwarp.render`.

    Raises:
        InputError: As for :func:`tpdwarp.render`; no scheduler answers; or no worker can render.
    """
    started, begun = time.perf_counter(), time.time()
    chosen = chosen_settings(settings)
    persistence = Persistence(frame_timeout, retries, max_failures)
    _check_counts(workers, chunk)
    shown = progress_of(progress)
    files = {"out": out, "debug_layer": debug_layer, "stats": stats}
    products = (
        products_of(scene, files, chosen, default_time, max_memory)
        if EACH_PRODUCT in file_name(out)
        else [Product(scene, chosen, files)]
    )
    prepared_ones = [
        prepared(
            product.scene, product.files["out"], product.settings, frames, default_time, strict,
            product.files["stats"], product.files["debug_layer"], curves, skip_existing, max_memory,
        )
        for product in products
    ]  # fmt: skip
    wanted = prepared_ones[0][0].frames
    memory = memory_allowed(max_memory)
    here = 0 if scheduler else workers or max(1, min(os.cpu_count() or 1, len(wanted)))
    threads = chosen.threads or (max(1, (os.cpu_count() or 1) // here) if here else 0)
    sequences = []
    for product, (plan, names, layer) in zip(products, prepared_ones, strict=True):
        order = Order(
            scene=os.path.abspath(scene),
            default_time=default_time,
            settings=json.dumps(replace(plan.settings, threads=threads).as_dict(), sort_keys=True),
            target=plan.target,
            stage=plan.files.digest,
            versions=json.dumps(versions(), sort_keys=True),
            out=os.path.abspath(names.template),
            frames=wanted,
            layer="" if layer is None else os.path.abspath(product.files["debug_layer"]),
            curves=curves,
            skip_existing=skip_existing,
            begun=begun,
            strict=strict,
            persistence=persistence,
            max_memory=memory / here if here else max_memory,
        )
        reports = SequenceReports(plan.source.file, product.files["stats"], skip_existing)
        sequences.append(_Sequence(order, names, plan, layer, reports))
    farming = _Farming(sequences, shown, persistence)
    trust = None if tls is None else Tls(*tls)
    try:
        shown.start(len(wanted) * len(sequences))
        try:
            if scheduler:
                farming.on(scheduler, trust, chunk, PATIENCE_SECONDS)
            else:
                with local_cluster(here, memory, dashboard, trust) as address:
                    farming.on(address, trust, chunk, 0.0)
        finally:
            shown.finish()
            # Workers that were killed have left temporaries.
            for folder in {os.path.dirname(one.order.out) for one in sequences}:
                sweep_folder(folder)
        for one in sequences:
            if one.refusal and one.refused == len(wanted):
                raise InputError(one.refusal)
        problems = [[] if one.layer is None else layer_problems(one.layer, one.in_order()) for one in sequences]
    except OSError as error:
        raise InputError(f"{scheduler or 'the local cluster'}: {reason_of(error)}") from error
    seconds = (time.perf_counter() - started) / len(sequences)
    return joined(one.finished(found, seconds) for one, found in zip(sequences, problems, strict=True))


@dataclass
class _Sequence:
    """One of the sequences whose frames are rendered together, and what has become of it.

    Attributes:
        order: What workers have to know of it.
        names: The frames' files.
        plan, layer, reports: As of :func:`tpdwarp.render`.
        outcomes: What has become of frames.
        anew: How many frames that were there were rendered anew, by reason.
        refused: How many frames failed because the stage cannot be used.
        refusal: Why, for the first of them.
    """

    order: Order
    names: FrameNames
    plan: SequencePlan
    layer: DebugLayerJob | None
    reports: SequenceReports
    outcomes: dict[float, FrameOutcome] = field(default_factory=dict)
    anew: Counter[str] = field(default_factory=Counter)
    refused: int = 0
    refusal: str = ""

    def take(self, result: ChunkResult) -> None:
        """Notes what a chunk tells beside the outcomes of its frames."""
        self.anew.update(dict(result.anew))
        self.refused += result.refused
        self.refusal = self.refusal or (result.refusal if result.refused else "")

    def in_order(self) -> list[FrameOutcome]:
        """One outcome a frame, in the order of the sequence."""
        return [self.outcomes[frame] for frame in self.order.frames]

    def finished(self, problems: list[str], seconds: float) -> SequenceResult:
        """The result, whose statistics are written."""
        plan = self.plan
        return self.reports.finished(plan.settings, plan.target, self.in_order(), problems, seconds, self.anew)


class _SchedulerLost(Exception):
    """The scheduler does not answer any more."""


class _Farming:
    """What has become of the frames so far, whatever schedulers and workers they were handed to.

    Args:
        sequences: What is rendered: the same frames of each, which a worker renders one after the other.
        shown: Shows what happens.
        persistence: How long to keep trying.
    """

    def __init__(self, sequences: Sequence[_Sequence], shown: Progress, persistence: Persistence) -> None:
        self._sequences, self._shown, self._persistence = sequences, shown, persistence
        self._orders = tuple(one.order for one in sequences)
        self._frames = self._orders[0].frames
        self._alone: list[float] = []
        self._were_alone: set[float] = set()
        self._attempts: Counter[tuple[float, ...]] = Counter()
        self._unfit: dict[str, str] = {}
        self._said: set[str] = set()
        self._failures = 0
        self._events: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def on(self, address: str, tls: Tls | None, chunk: int | None, patience: float) -> None:
        """Has all frames rendered by the workers of a scheduler.

        Args:
            address: The scheduler's.
            tls: Certificates.
            chunk: Frames in one task; None chooses.
            patience: Seconds to wait for a scheduler that is gone.

        Raises:
            InputError: No worker can render.
            OSError: The scheduler does not answer.
        """
        lost_at: float | None = None
        while self._left():
            try:
                client = connected(address, tls)
            # What Dask raises where certificates are missing is a TypeError.
            except (OSError, ValueError, TypeError) as error:
                if lost_at is None or time.monotonic() - lost_at > patience:
                    raise OSError(f"no scheduler answers ({shortened(str(error))})") from error
                pause(1.0)
                continue
            lost_at = None
            try:
                self._work(client, chunk)
            except _SchedulerLost:
                if patience == 0:
                    raise OSError("the scheduler has ended") from None
                lost_at = time.monotonic()
                logger.warning(f"{address}: the scheduler is gone; its frames are handed out again when it is back")
            finally:
                with contextlib.suppress(Exception):
                    client.close(timeout=CLOSE_SECONDS)

    def _left(self) -> list[float]:
        return [frame for frame in self._frames if self._lacks(frame)]

    def _lacks(self, frame: float) -> bool:
        """Whether any sequence has no outcome of a frame yet."""
        return any(frame not in one.outcomes for one in self._sequences)

    def _work(self, client: Client, chunk: int | None) -> None:
        """Hands out what is left, and returns when nothing is.

        Raises:
            _SchedulerLost: The scheduler does not answer any more.
            InputError: No worker can render.
        """
        client.subscribe_topic(name_of(self._orders), self._events.put)
        together = [frame for frame in self._left() if frame not in self._alone]
        length = chunk or _chunk_length(len(together), sum(client.nthreads().values()))
        under_way = {}
        for start in range(0, len(together), length):
            self._submit(client, tuple(together[start : start + length]), under_way)
        while under_way or self._alone:
            if not under_way:
                frame = self._alone.pop(0)
                self._were_alone.add(frame)
                self._submit(client, (frame,), under_way)
            pause(POLL_SECONDS)
            self._hear()
            for future, frames in list(under_way.items()):
                status = future.status
                if status in ("cancelled", "lost") or client.status not in ("running", "newly-created"):
                    raise _SchedulerLost
                if status == "pending":
                    continue
                del under_way[future]
                self._ended_chunk(client, future, frames, under_way)
            if self._hopeless():
                client.cancel(list(under_way))
                for frame in self._left():
                    reason = f"not begun, for {self._failures} frames in a row failed (--max-failures)"
                    self._fail(frame, reason, tries=0)
                return

    def _submit(self, client: Client, frames: tuple[float, ...], under_way: dict[Future, tuple[float, ...]]) -> None:
        key = key_of(self._orders, frames, self._attempts[frames])
        self._attempts[frames] += 1
        fit = None
        if self._unfit:
            fit = [address for address in client.nthreads() if address not in self._unfit]
            if not fit:
                address, reason = next(iter(self._unfit.items()))
                raise InputError(f"no worker can render: {address} {reason}")
        under_way[client.submit(render_chunk, self._orders, frames, key=key, workers=fit, pure=False)] = frames

    def _ended_chunk(
        self, client: Client, future: Future, frames: tuple[float, ...], under_way: dict[Future, tuple[float, ...]]
    ) -> None:
        """Notes the outcomes of a chunk, or hands out again what is left of one that came to nothing."""
        error = future.exception() if future.status == "error" else None
        if error is None:
            results: tuple[ChunkResult, ...] = future.result()
            for one, result in zip(self._sequences, results, strict=True):
                for text in result.outcomes:
                    self._note(one, heard(text))
                one.take(result)
            return
        left = tuple(frame for frame in frames if self._lacks(frame) and frame not in self._alone)
        if isinstance(error, UnfitWorker):
            address, _, reason = str(error).partition(" ")
            if address not in self._unfit:
                self._unfit[address] = reason
                logger.warning(f"{address} {reason}; it renders nothing")
            self._submit(client, left, under_way)
            return
        first, others = left[:1], left[1:]
        for frame in first:
            if frame in self._were_alone:
                died = isinstance(error, KilledWorker)
                reason = "its worker died every time (see --max-memory)" if died else reason_of(error)
                self._fail(frame, reason)
            else:
                # Frames are rendered in their order, so that this one is to blame.
                self._alone.append(frame)
        if others:
            self._submit(client, others, under_way)

    def _hear(self) -> None:
        """Takes what workers have told meanwhile."""
        with contextlib.suppress(queue.Empty):
            while True:
                _, event = self._events.get_nowait()
                if event["kind"] == "frame":
                    one = next(one for one in self._sequences if one.order.name == event["sequence"])
                    self._note(one, heard(event["text"]))
                elif event["text"] not in self._said:
                    self._said.add(event["text"])
                    logger.warning(event["text"])

    def _fail(self, frame: float, reason: str, tries: int = 1) -> None:
        """Notes that a frame failed in all sequences that have no outcome of it."""
        for one in self._sequences:
            self._note(one, FrameOutcome(frame, "failed", one.names.path(frame), reason, tries=tries))

    def _note(self, one: _Sequence, outcome: FrameOutcome) -> None:
        """Takes the first outcome of a frame, unless another try promises more."""
        frame = outcome.frame
        if frame in one.outcomes or frame in self._alone:
            return
        if outcome.reason.startswith(OUT_OF_MEMORY) and frame not in self._were_alone:
            self._alone.append(frame)
            return
        if outcome.status == "skipped" and not one.order.skip_existing:
            # Made by a worker of this very sequence that could not tell of it any more.
            outcome = replace(outcome, status="written")
        one.outcomes[frame] = outcome
        self._failures = self._failures + 1 if outcome.status == "failed" else 0
        one.reports.add(outcome)
        self._shown.end(outcome)

    def _hopeless(self) -> bool:
        most = self._persistence.max_failures
        return most is not None and self._failures >= most


def _chunk_length(frames: int, threads: int) -> int:
    return max(1, min(LONGEST_CHUNK, -(-frames // (CHUNKS_A_WORKER * max(1, threads)))))


def _check_counts(workers: int | None, chunk: int | None) -> None:
    for name, value in (("workers", workers), ("chunk", chunk)):
        if value is not None and value < 1:
            raise InputError(f"--{name} must be above 0, not {value}")
