"""Rendering and tracing sequences to files: one frame after the other, past those that fail."""

from __future__ import annotations

import math
import time
from typing import Any

from tpdwarp.errors import InputError
from tpdwarp.io.files import file_name
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.images import check_format
from tpdwarp.io.memory import memory_allowed
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.frame_loop import FrameLoop, Persistence, run_together
from tpdwarp.jobs.frame_work import RenderWork, TraceWork
from tpdwarp.jobs.layer_job import DebugLayerJob
from tpdwarp.jobs.opening import (
    FilePath,
    Frames,
    chosen_settings,
    open_scene,
    opened,
    settled_settings,
    shutter_of,
    time_of,
    with_render_vars,
)
from tpdwarp.jobs.outputs import prepare_outputs
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.products import Product, contexts_of, joined, products_of
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.jobs.reports import SequenceReports
from tpdwarp.jobs.results import SequenceResult
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import trace_frame
from tpdwarp.rendering.light_groups import LightGroups
from tpdwarp.settings import Settings
from tpdwarp.usd.read.render_settings import EACH_PRODUCT
from tpdwarp.usd.read.stage import StageLike, StageScene


def render(
    scene: StageLike,
    out: FilePath,
    *,
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
    """Renders frames of a USD stage to image files.

    A frame that fails does not end the sequence; the result says which did, and why.

    Args:
        scene: The stage: a file, an ``Sdf.Layer`` or a ``Usd.Stage``.
        out: Image file, with ``####`` where the frame number goes (see :class:`tpdwarp.io.frame_names.FrameNames`).
            With ``<product>`` in it all products of the render settings are rendered, each under its own name; photons
            are traced once for all whose shutters are the same.
        frames: A specification such as ``1:24,30:40x2``, a frame, or several; None for the stage's whole range
            (its first frame where nothing changes).
        default_time: Render the default time (values that are not time samples) in place of frames.
        progress: ``auto``, ``bar``, ``plain``, ``alf``, ``none``, a :class:`tpdwarp.jobs.progress.Progress`, or None,
            which shows nothing.
        debug_layer: Also write the photons to this USD layer, and a view layer beside it.
        curves: At most so many photons a frame in the debug layer; None for all.
        stats: Also write statistics to this file: ``.jsonl`` is a line of JSON for each frame as it ends, other names
            are one JSON document at the end.
        skip_existing: Leave frames alone whose files are there, whole, and made from the same stage with the same
            settings by the same version of the program. For a debug layer they are traced only where an earlier run has
            not kept their photons.
        strict: Take what USD warns of (layers or clips that are missing or damaged, …) for errors.
        frame_timeout: Seconds that a frame may take, for each try; None for no limit.
        retries: How often a frame that failed is tried again.
        max_failures: So many frames in a row that fail end the sequence; None for no limit. A disk that is full ends it
            after three.
        max_memory: Bytes that may be taken; None for three quarters of the machine. Frames that will need more are not
            begun.
        **settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: The input or the settings cannot be used, an output cannot be written where it is asked for, or
            no frame at all could be rendered because of the input.
    """
    started, begun = time.perf_counter(), time.time()
    chosen = chosen_settings(settings)
    persistence = Persistence(frame_timeout, retries, max_failures)
    shown = progress_of(progress)
    files = {"out": out, "debug_layer": debug_layer, "stats": stats}
    products = (
        products_of(scene, files, chosen, default_time, max_memory)
        if EACH_PRODUCT in file_name(out)
        else [Product(scene, chosen, files)]
    )
    sequences = [
        prepared(
            product.scene,
            product.files["out"],
            product.settings,
            frames,
            default_time,
            strict,
            product.files["stats"],
            product.files["debug_layer"],
            curves,
            skip_existing,
            max_memory,
        )
        for product in products
    ]
    plans = [plan for plan, _, _ in sequences]
    works, reports, loops = [], [], []
    for (plan, names, layer), product, context in zip(sequences, products, contexts_of(plans), strict=True):
        works.append(RenderWork(plan, names, layer, context, skip_existing, begun, shown))
        reports.append(SequenceReports(plan.source.file, product.files["stats"], skip_existing))
        loops.append(FrameLoop(works[-1], names.path, shown, persistence, reports[-1].add))
    run_together(loops, plans[0].frames, [layer for _, _, layer in sequences], shown)
    seconds = (time.perf_counter() - started) / len(plans)
    return joined(
        report.finished(plan.settings, plan.target, loop.outcomes, loop.problems, seconds, work.existing.anew)
        for plan, work, report, loop in zip(plans, works, reports, loops, strict=True)
    )


def write_photons(
    scene: StageLike,
    layer: FilePath,
    *,
    frames: Frames = None,
    default_time: bool = False,
    progress: str | Progress | None = None,
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
    """Traces the photons of frames of a USD stage and writes them as a debug layer, with a view layer beside it.

    The stage needs no camera. Arguments are those of :func:`render`; ``skip_existing`` goes on where an earlier run
    stopped.

    Raises:
        InputError: As for :func:`render`.
    """
    started = time.perf_counter()
    chosen = chosen_settings(settings)
    persistence = Persistence(frame_timeout, retries, max_failures)
    shown = progress_of(progress)
    source, wanted = opened(scene, chosen, frames, default_time, strict, max_memory)
    files = StageFiles(source)
    prepare_outputs(source, files, stats, layer)
    plan = planned(source, files, wanted, chosen, strict, max_memory)
    job = DebugLayerJob(layer, plan, curves, skip_existing)
    reports = SequenceReports(source.file, stats, skip_existing)
    loop = FrameLoop(TraceWork(plan, job, shown), lambda frame: "", shown, persistence, reports.add)
    loop.run(wanted, job)
    seconds = time.perf_counter() - started
    return reports.finished(plan.settings, plan.target, loop.outcomes, loop.problems, seconds)


def trace_photons(scene: StageLike, frame: float, **settings: Any) -> PhotonRecord:
    """The photons that land over the shutter of one frame of a USD stage.

    Args:
        scene: The stage; it needs no camera.
        frame: Time code; NaN for the default time.
        **settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: The input or the settings cannot be used.
        FrameError: The frame cannot be traced.
    """
    chosen = chosen_settings(settings)
    moment = time_of(frame, default_time=True)
    source = open_scene(scene, chosen, math.isnan(moment))
    chosen, _ = settled_settings(source, chosen)
    return trace_frame(RenderContext(source, chosen), shutter_of(source, moment, chosen)).photons


def prepared(
    scene: StageLike | StageScene,
    out: FilePath,
    settings: Settings,
    frames: Frames,
    default_time: bool,
    strict: bool,
    stats: FilePath | None,
    debug_layer: FilePath | None,
    curves: int | None,
    skip_existing: bool,
    max_memory: float | None,
) -> tuple[SequencePlan, FrameNames, DebugLayerJob | None]:
    """Looks at all that a sequence of images reads and writes; arguments are those of :func:`render`.

    Returns:
        The plan, the names of the frames' files, and the debug layer if one is wanted.

    Raises:
        InputError: Something cannot be used.
    """
    names = FrameNames(out)
    if EACH_PRODUCT in names.template:
        raise InputError(f"takes no {EACH_PRODUCT} (choose with --product)", names.template)
    groups = ("light groups",) if settings.light_groups else ()
    check_format(names.template, (*settings.aovs, *groups), settings.view)
    if curves is not None and debug_layer is None:
        raise InputError("--curves thins a debug layer (add --debug-layer)")
    source, wanted = opened(scene, settings, frames, default_time, strict, max_memory)
    settings = with_render_vars(settings, source, names.template)
    names.check(wanted)
    source.region()
    files = StageFiles(source)
    written = [names.path(frame) for frame in wanted]
    hosts = [FrameNames(settings.holdout).path(frame) for frame in wanted] if settings.holdout else []
    prepare_outputs(source, files, stats, debug_layer, written, holdouts=hosts)
    plan = planned(source, files, wanted, settings, strict, max_memory)
    layer = None if debug_layer is None else DebugLayerJob(debug_layer, plan, curves, skip_existing)
    return plan, names, layer


def planned(
    source: StageScene,
    files: StageFiles,
    frames: tuple[float, ...],
    settings: Settings,
    strict: bool,
    max_memory: float | None,
) -> SequencePlan:
    """The plan of a sequence, with photons and segments chosen where an error was asked for.

    Raises:
        InputError: The stage cannot be used.
    """
    LightGroups.of(settings.light_groups, source)
    chosen, target = settled_settings(source, settings)
    fingerprint = Fingerprint.of(chosen, files.digest)
    return SequencePlan(source, files, frames, chosen, target, fingerprint, strict, memory_allowed(max_memory))
