"""Rendering and tracing sequences to files: one frame after the other, past those that fail."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

from tpdwarp.device import Launcher
from tpdwarp.errors import InputError, logger
from tpdwarp.io.files import check_writable
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.images import check_format, write_frame
from tpdwarp.jobs.energy_warnings import EnergyWatch
from tpdwarp.jobs.frame_loop import reason_of, run_frames
from tpdwarp.jobs.frame_metadata import frame_metadata
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.jobs.results import FrameOutcome, SequenceResult
from tpdwarp.jobs.statistics import statistics_of, write_statistics
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.rendering.error_target import ErrorTarget, settled
from tpdwarp.rendering.frame import render_frame, trace_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.default_time import DefaultTimeScene
from tpdwarp.usd.read.frame_specs import frames_of
from tpdwarp.usd.read.stage import StageScene
from tpdwarp.usd.write.debug_layer import DebugLayerWriter

Frames = str | float | Iterable[float] | None
FilePath = str | os.PathLike[str]

DEFAULT_TIME = math.nan


def render(
    scene: FilePath,
    out: FilePath,
    *,
    frames: Frames = None,
    default_time: bool = False,
    progress: str | Progress | None = None,
    debug_layer: FilePath | None = None,
    curves: int | None = None,
    stats: FilePath | None = None,
    skip_existing: bool = False,
    **settings: Any,
) -> SequenceResult:
    """Renders frames of a USD stage to image files.

    A frame that fails does not end the sequence; the result says which did, and why.

    Args:
        scene: The stage.
        out: Image file, with ``####`` where the frame number goes (see :class:`tpdwarp.io.frame_names.FrameNames`).
        frames: A specification such as ``1:24,30:40x2``, a frame, or several; None for the stage's whole range
            (its first frame where nothing changes).
        default_time: Render the default time (values that are not time samples) in place of frames.
        progress: ``auto``, ``bar``, ``plain``, ``alf``, ``none``, a :class:`tpdwarp.jobs.progress.Progress`, or None,
            which shows nothing.
        debug_layer: Also write the photons to this USD layer, and a view layer beside it.
        curves: At most so many photons a frame in the debug layer; None for all.
        stats: Also write statistics to this JSON file.
        skip_existing: Leave frames alone whose files are there. With a debug layer their photons are traced still.
        **settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: The input or the settings cannot be used, an output cannot be written where it is asked for, or
            no frame at all could be rendered because of the input.
    """
    started = time.perf_counter()
    chosen = chosen_settings(settings)
    shown = progress_of(progress)
    names = FrameNames(out)
    check_format(names.template, chosen.aovs)
    if curves is not None and debug_layer is None:
        raise InputError("--curves thins a debug layer (add --debug-layer)")
    source, wanted = _open(scene, chosen, frames, default_time)
    names.check(wanted)
    width, height = source.resolution()
    for path in (names.path(wanted[0]), stats):
        _check_output(path, source)
    watch = EnergyWatch(source)
    chosen, target = _settled(source, chosen)
    layer = None if debug_layer is None else _debug_layer(debug_layer, source, chosen, wanted, curves)

    def render_one(frame: float) -> FrameOutcome:
        shutter, path = shutter_of(source, frame, chosen), names.path(frame)
        skipped = skip_existing and _is_complete(path)
        if skipped and layer is None:
            return FrameOutcome(frame, "skipped", path)
        made = trace_frame(source, shutter, chosen) if skipped else render_frame(source, shutter, chosen, width, height)
        watch(frame, shutter, made.energy)
        # The image first: a debug layer that cannot be written makes the frame fail, but costs no image.
        if not skipped:
            write_frame(path, made.channels, frame_metadata(source, frame, shutter, chosen, made, target))
        if layer is not None:
            layer.add_frame(frame, made.photons, chosen.smoothing)
        status = "skipped" if skipped else "written"
        return FrameOutcome(frame, status, path, "", len(made.photons), made.energy, dict(made.seconds))

    outcomes, problems = run_frames(wanted, render_one, names.path, shown, layer)
    return _finished(source, chosen, target, outcomes, problems, started, stats)


def write_photons(
    scene: FilePath,
    layer: FilePath,
    *,
    frames: Frames = None,
    default_time: bool = False,
    progress: str | Progress | None = None,
    curves: int | None = None,
    stats: FilePath | None = None,
    **settings: Any,
) -> SequenceResult:
    """Traces the photons of frames of a USD stage and writes them as a debug layer, with a view layer beside it.

    The stage needs no camera. Arguments are those of :func:`render`.

    Raises:
        InputError: As for :func:`render`.
    """
    started = time.perf_counter()
    chosen = chosen_settings(settings)
    shown = progress_of(progress)
    source, wanted = _open(scene, chosen, frames, default_time)
    _check_output(stats, source)
    chosen, target = _settled(source, chosen)
    writer = _debug_layer(layer, source, chosen, wanted, curves)
    watch = EnergyWatch(source)

    def trace_one(frame: float) -> FrameOutcome:
        shutter = shutter_of(source, frame, chosen)
        traced = trace_frame(source, shutter, chosen)
        watch(frame, shutter, traced.energy)
        writer.add_frame(frame, traced.photons, chosen.smoothing)
        return FrameOutcome(frame, "traced", "", "", len(traced.photons), traced.energy, dict(traced.seconds))

    outcomes, problems = run_frames(wanted, trace_one, lambda frame: "", shown, writer)
    return _finished(source, chosen, target, outcomes, problems, started, stats)


def trace_photons(scene: FilePath, frame: float, **settings: Any) -> PhotonRecord:
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
    source = open_scene(scene, chosen, math.isnan(frame))
    chosen, _ = _settled(source, chosen)
    return trace_frame(source, shutter_of(source, frame, chosen), chosen).photons


def chosen_settings(changes: Mapping[str, Any]) -> Settings:
    """The default settings with ``changes``; lists are taken for tuples.

    Raises:
        InputError: A name or a value is not usable.
    """
    plain = {name: tuple(value) if isinstance(value, list) else value for name, value in changes.items()}
    return Settings.of(None, **plain)


def open_scene(scene: FilePath, settings: Settings, default_time: bool) -> StageScene:
    """The stage, at its default time if that is asked for.

    Raises:
        InputError: The stage cannot be used.
    """
    return (DefaultTimeScene if default_time else StageScene).open(os.fspath(scene), settings)


def shutter_of(source: StageScene, frame: float, settings: Settings) -> Shutter:
    """The shutter of a frame; a still where ``frame`` is NaN, the default time.

    Raises:
        InputError: The camera's shutter cannot be used.
    """
    return Shutter.still(source.start) if math.isnan(frame) else source.shutter(frame, settings)


def frames_asked(frames: Frames, default_time: bool) -> tuple[float, ...] | None:
    """The frames a caller names; None where that is the stage's whole range.

    Raises:
        InputError: They cannot be understood, or are none.
    """
    if default_time:
        if frames is not None:
            raise InputError("--default-time takes the place of --frames (leave one out)")
        return (DEFAULT_TIME,)
    if frames is None:
        return None
    if isinstance(frames, str):
        return frames_of(frames)
    try:
        listed = (frames,) if isinstance(frames, Real) else tuple(frames)
        chosen = tuple(dict.fromkeys(float(frame) for frame in listed))
    except (TypeError, ValueError):
        raise InputError(f"--frames {frames!r}: these are no frames (give numbers, or a text like '1:24')") from None
    if not chosen or not all(map(math.isfinite, chosen)):
        raise InputError(f"--frames {frames!r}: there must be at least one, and all finite")
    return chosen


def _open(
    scene: FilePath, settings: Settings, frames: Frames, default_time: bool
) -> tuple[StageScene, tuple[float, ...]]:
    asked = frames_asked(frames, default_time)
    # Tried here, so that a missing device is refused once and not by every frame.
    Launcher(settings.device, settings.threads)
    source = open_scene(scene, settings, default_time)
    return source, asked or source.frames()


def _settled(source: StageScene, settings: Settings) -> tuple[Settings, ErrorTarget | None]:
    """Settings without an open choice of photons, and what they were chosen for, if for anything."""
    if settings.target_error is None:
        return settings, None
    return settled(source, settings, spread_shutters(source, settings), *source.resolution())


def spread_shutters(source: StageScene, settings: Settings) -> list[Shutter]:
    """Shutters of whole frames spread over the animation.

    Between frames they would see corners in the ways of vertices, which frames that open on a time sample do not see.

    Raises:
        InputError: The camera's shutter cannot be used.
    """
    offsets = (round(still.middle - source.start) for still in source.reference_shutters())
    frames = [min(source.start + offset, source.end) for offset in dict.fromkeys(offsets)]
    return [shutter_of(source, frame, settings) for frame in frames]


def _check_output(path: FilePath | None, source: StageScene) -> None:
    if path is None:
        return
    check_writable(path)
    if os.path.realpath(path) == os.path.realpath(source.file):
        raise InputError("is the scene itself (choose another name)", file=os.fspath(path))


def _is_complete(path: str) -> bool:
    # Frames are given their names only when complete; an empty file is what other programs leave on a full disk.
    return os.path.isfile(path) and os.path.getsize(path) > 0


def _debug_layer(
    path: FilePath, source: StageScene, settings: Settings, frames: Sequence[float], curves: int | None
) -> DebugLayerWriter:
    numbered = [frame for frame in frames if not math.isnan(frame)]
    return DebugLayerWriter(
        path,
        source.file,
        settings.as_dict(),
        (min(numbered), max(numbered)) if numbered else (source.start, source.end),
        source.shutter(numbered[0], settings).exposure if numbered else 0.0,
        source.time_codes_per_second,
        source.frames_per_second,
        source.up_axis,
        source.meters_per_unit,
        curves=curves,
    )


def _finished(
    source: StageScene,
    settings: Settings,
    target: ErrorTarget | None,
    outcomes: Sequence[FrameOutcome],
    problems: Sequence[str],
    started: float,
    stats: FilePath | None,
) -> SequenceResult:
    result = SequenceResult(tuple(outcomes), time.perf_counter() - started, tuple(problems), target)
    if stats is None:
        return result
    try:
        write_statistics(stats, statistics_of(source.file, settings, result))
    except Exception as error:
        logger.debug("statistics", exc_info=error)
        return replace(result, problems=(*result.problems, reason_of(error)))
    return result
