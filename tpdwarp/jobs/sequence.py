"""Rendering and tracing sequences to files: one frame after the other, past those that fail."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from tpdwarp.device import Launcher
from tpdwarp.errors import InputError
from tpdwarp.io.files import check_name
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.images import check_format, write_frame
from tpdwarp.jobs.claims import claimed
from tpdwarp.jobs.energy_warnings import EnergyWatch
from tpdwarp.jobs.existing_frames import ExistingFrames
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.frame_loop import FrameLoop, Persistence
from tpdwarp.jobs.frame_metadata import frame_metadata
from tpdwarp.jobs.outputs import prepare_outputs
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.jobs.reports import SequenceReports
from tpdwarp.jobs.results import FrameOutcome, SequenceResult
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.error_target import ErrorTarget, settled
from tpdwarp.rendering.frame import render_frame, trace_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.default_time import DefaultTimeScene
from tpdwarp.usd.read.frame_specs import frames_of
from tpdwarp.usd.read.stage import StageLike, StageScene
from tpdwarp.usd.write.debug_layer import DebugLayerWriter

Frames = str | float | Iterable[float] | None
FilePath = str | os.PathLike[str]

DEFAULT_TIME = math.nan


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
    **settings: Any,
) -> SequenceResult:
    """Renders frames of a USD stage to image files.

    A frame that fails does not end the sequence; the result says which did, and why.

    Args:
        scene: The stage: a file, an ``Sdf.Layer`` or a ``Usd.Stage``.
        out: Image file, with ``####`` where the frame number goes (see :class:`tpdwarp.io.frame_names.FrameNames`).
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
            settings by the same version of the program. With a debug layer their photons are traced still.
        strict: Take what USD warns of (layers or clips that are missing or damaged, …) for errors.
        frame_timeout: Seconds that a frame may take, for each try; None for no limit.
        retries: How often a frame that failed is tried again.
        max_failures: So many frames in a row that fail end the sequence; None for no limit. A disk that is full ends it
            after three.
        **settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: The input or the settings cannot be used, an output cannot be written where it is asked for, or
            no frame at all could be rendered because of the input.
    """
    started, begun = time.perf_counter(), time.time()
    chosen = chosen_settings(settings)
    persistence = Persistence(frame_timeout, retries, max_failures)
    shown = progress_of(progress)
    names = FrameNames(out)
    check_format(names.template, chosen.aovs)
    if curves is not None and debug_layer is None:
        raise InputError("--curves thins a debug layer (add --debug-layer)")
    source, wanted = _open(scene, chosen, frames, default_time, strict)
    names.check(wanted)
    width, height = source.resolution()
    files = StageFiles(source)
    prepare_outputs(source, files, stats, debug_layer, [names.path(frame) for frame in wanted])
    watch = EnergyWatch(source)
    chosen, target = settled_settings(source, chosen)
    fingerprint = Fingerprint.of(chosen, files.digest)
    existing = ExistingFrames(fingerprint)
    layer = None if debug_layer is None else _debug_layer(debug_layer, source, chosen, wanted, curves)
    context = _LazyContext(source, chosen)

    def render_one(frame: float) -> FrameOutcome:
        shutter, path = shutter_of(source, frame, chosen), names.path(frame)
        with claimed(path):
            # What another render of the same has made meanwhile need not be made again.
            kept = existing.kept(path, frame) if skip_existing or _is_newer(path, begun) else None
            if kept is not None and layer is None:
                return FrameOutcome(frame, "skipped", path, "", kept.photons, kept.energy, dict(kept.seconds))
            with files.unchanged(strict):
                if kept is not None:
                    made = trace_frame(context(), shutter)
                else:
                    made = render_frame(context(), shutter, width, height)
            watch(frame, shutter, made.energy)
            # The image first: a debug layer that cannot be written makes the frame fail, but costs no image.
            if kept is None:
                metadata = frame_metadata(source, frame, shutter, chosen, made, fingerprint, target)
                write_frame(path, made.channels, metadata)
        if layer is not None:
            layer.add_frame(frame, made.photons, chosen.smoothing)
        status = "written" if kept is None else "skipped"
        return FrameOutcome(frame, status, path, "", len(made.photons), made.energy, dict(made.seconds))

    reports = SequenceReports(source.file, stats, skip_existing)
    loop = FrameLoop(render_one, names.path, shown, persistence, reports.add)
    loop.run(wanted, layer)
    return reports.finished(chosen, target, loop, time.perf_counter() - started, existing.anew)


def write_photons(
    scene: StageLike,
    layer: FilePath,
    *,
    frames: Frames = None,
    default_time: bool = False,
    progress: str | Progress | None = None,
    curves: int | None = None,
    stats: FilePath | None = None,
    strict: bool = False,
    frame_timeout: float | None = None,
    retries: int = 0,
    max_failures: int | None = None,
    **settings: Any,
) -> SequenceResult:
    """Traces the photons of frames of a USD stage and writes them as a debug layer, with a view layer beside it.

    The stage needs no camera. Arguments are those of :func:`render`.

    Raises:
        InputError: As for :func:`render`.
    """
    started = time.perf_counter()
    chosen = chosen_settings(settings)
    persistence = Persistence(frame_timeout, retries, max_failures)
    shown = progress_of(progress)
    source, wanted = _open(scene, chosen, frames, default_time, strict)
    files = StageFiles(source)
    prepare_outputs(source, files, stats, layer)
    chosen, target = settled_settings(source, chosen)
    writer = _debug_layer(layer, source, chosen, wanted, curves)
    watch = EnergyWatch(source)
    context = _LazyContext(source, chosen)

    def trace_one(frame: float) -> FrameOutcome:
        shutter = shutter_of(source, frame, chosen)
        with files.unchanged(strict):
            traced = trace_frame(context(), shutter)
        watch(frame, shutter, traced.energy)
        writer.add_frame(frame, traced.photons, chosen.smoothing)
        return FrameOutcome(frame, "traced", "", "", len(traced.photons), traced.energy, dict(traced.seconds))

    reports = SequenceReports(source.file, stats, resume=False)
    loop = FrameLoop(trace_one, lambda frame: "", shown, persistence, reports.add)
    loop.run(wanted, writer)
    return reports.finished(chosen, target, loop, time.perf_counter() - started)


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
    source = open_scene(scene, chosen, math.isnan(frame))
    chosen, _ = settled_settings(source, chosen)
    return trace_frame(RenderContext(source, chosen), shutter_of(source, frame, chosen)).photons


class _LazyContext:
    """The context of a sequence, made by its first frame: what cannot be used fails frames, not the sequence."""

    def __init__(self, source: StageScene, settings: Settings) -> None:
        self._source, self._settings = source, settings
        self._context: RenderContext | None = None

    def __call__(self) -> RenderContext:
        if self._context is None:
            self._context = RenderContext(self._source, self._settings)
        return self._context


def chosen_settings(changes: Mapping[str, Any], settings: Settings | None = None) -> Settings:
    """``settings`` (or the defaults) with ``changes``; lists become tuples, NumPy's numbers Python's.

    Raises:
        InputError: A name or a value is not usable.
    """
    return Settings.of(settings, **{name: _plain(value) for name, value in changes.items()})


def open_scene(scene: StageLike, settings: Settings, default_time: bool) -> StageScene:
    """The stage, at its default time if that is asked for.

    Raises:
        InputError: The stage cannot be used.
    """
    if isinstance(scene, str | os.PathLike):
        check_name(scene)
        # A pipe would be waited for.
        if os.path.exists(scene) and not os.path.isfile(scene) and not os.path.isdir(scene):
            raise InputError("is no ordinary file (name a USD file)", file=os.fspath(scene))
    return (DefaultTimeScene if default_time else StageScene).open(scene, settings)


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
    scene: StageLike, settings: Settings, frames: Frames, default_time: bool, strict: bool
) -> tuple[StageScene, tuple[float, ...]]:
    asked = frames_asked(frames, default_time)
    # Tried here, so that a missing device is refused once and not by every frame.
    Launcher(settings.device, settings.threads)
    source = open_scene(scene, settings, default_time)
    if strict and source.warnings.of_usd:
        raise InputError(f"{source.warnings.of_usd[0]} (--strict)", file=source.file)
    return source, asked or source.frames()


def settled_settings(source: StageScene, settings: Settings) -> tuple[Settings, ErrorTarget | None]:
    """Settings without an open choice of photons, and what they were chosen for, if for anything.

    Raises:
        InputError: The stage cannot be used, or has no camera.
    """
    if settings.target_error is None:
        return settings, None
    return settled(source, settings, spread_shutters(source, settings), *source.resolution())


def spread_shutters(source: StageScene, settings: Settings) -> list[Shutter]:
    """Shutters of whole frames spread over the animation.

    Between frames they would see breaks in the motion of vertices, which frames that open on a time sample do not see.

    Raises:
        InputError: The camera's shutter cannot be used.
    """
    offsets = (round(still.middle - source.start) for still in source.reference_shutters())
    frames = [min(source.start + offset, source.end) for offset in dict.fromkeys(offsets)]
    return [shutter_of(source, frame, settings) for frame in frames]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | list | tuple):
        return tuple(map(_plain, value))
    return value.item() if isinstance(value, np.generic) else value


def _is_newer(path: str, begun: float) -> bool:
    try:
        return os.stat(path).st_mtime > begun
    except OSError:
        return False


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
