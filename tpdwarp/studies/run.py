"""A whole study: a stage in, measurements out."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any

from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.outputs import check_outputs
from tpdwarp.jobs.frame_loop import reason_of
from tpdwarp.jobs.opening import Frames, chosen_settings, frames_asked, open_scene, shutter_of
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.studies.cases import Case, Sweep
from tpdwarp.studies.files import write_csv, write_json
from tpdwarp.studies.measures import errors_of
from tpdwarp.studies.plot import matplotlib_module
from tpdwarp.studies.progress import StudyProgress, study_progress_of
from tpdwarp.studies.report import write_report
from tpdwarp.studies.result import ExposureResult, Measured, StudyResult
from tpdwarp.studies.solutions import Renderer, Solution
from tpdwarp.studies.store import Store, default_folder
from tpdwarp.studies.truth import TruthSettings, truth_of
from tpdwarp.usd.read.layer_files import content_hash
from tpdwarp.usd.read.stage import StageScene

FilePath = str | os.PathLike[str]

DEFAULT_WIDTH = 256


def study(
    scene: FilePath,
    *,
    sweep: Sweep = Sweep(),  # noqa: B008
    truth: TruthSettings = TruthSettings(),  # noqa: B008
    frames: Frames = None,
    cache: FilePath | None = None,
    time_limit: float | None = None,
    progress: str | StudyProgress | None = None,
    csv: FilePath | None = None,
    json: FilePath | None = None,
    report: FilePath | None = None,
    **settings: Any,
) -> StudyResult:
    """Measures error against time over methods and settings, beside a converged accumulation of the same frames.

    Args:
        scene: The stage; it needs a camera.
        sweep: What is tried.
        truth: How well the accumulation is rendered.
        frames: As for :func:`tpdwarp.render`; None takes the middle frame of the stage. Flicker takes two or more.
        cache: Folder where everything rendered is kept, so that a study can go on; None takes the user's.
        time_limit: Nothing new is begun after so many seconds; None for no limit.
        progress: ``auto``, ``bar``, ``plain``, ``none``, an object of
            :class:`tpdwarp.studies.progress.StudyProgress`, or None, which shows nothing.
        csv, json, report: Also write the measurements to these files; the report is one HTML page.
        **settings: Fields of :class:`tpdwarp.settings.Settings` that all cases share.

    Raises:
        InputError: The input or the settings cannot be used, an output cannot be written where it is asked for, or
            a report is asked for and Matplotlib is not installed.
        FrameError: The truth cannot be rendered, or an output cannot be written after all.
    """
    started = time.perf_counter()
    outputs = {"--csv": csv, "--json": json, "--report": report}
    check_outputs(outputs, {})
    if report is not None:
        matplotlib_module()
    base = chosen_settings({"image_width": DEFAULT_WIDTH, **settings})
    if base.shutter is not None and any(exposure is not None for exposure in sweep.exposures):
        raise InputError("--shutter fixes the exposure (leave one out)")
    cases = sweep.cases(base)
    source = open_scene(scene, base, default_time=False)
    check_outputs(outputs, {"is part of the scene": source.used_files()})
    chosen = frames_asked(frames, False) or (float(round(0.5 * (source.start + source.end))),)
    shown = study_progress_of(progress)
    store = Store(cache or default_folder(), content_hash(source.file))
    work = _Work(source, chosen, store, shown, started, time_limit)
    shown.start(len(cases) + 2 * len(sweep.exposures))
    exposures: list[ExposureResult] = []
    left: list[str] = []
    try:
        for exposure in sweep.exposures:
            of_exposure = [case for case in cases if case.exposure == exposure]
            found, missed = _at_exposure(work, truth, base, exposure, of_exposure)
            exposures += [found] if found is not None else []
            left += missed
    finally:
        shown.finish()
    seconds = time.perf_counter() - started
    size = (work.renderer.width, work.renderer.height)
    result = StudyResult(source.file, chosen, size, tuple(exposures), tuple(left), seconds)
    for path, write in ((csv, write_csv), (json, write_json), (report, write_report)):
        if path is not None:
            write(path, result)
    return result


def _at_exposure(
    work: _Work, truth: TruthSettings, base: Settings, exposure: float | None, cases: Sequence[Case]
) -> tuple[ExposureResult | None, list[str]]:
    """What was found at one exposure (None without a truth), and the cases left out."""
    halves = truth.halves(base, exposure)
    shutters = work.shutters(halves[0])
    length = shutters[0].exposure
    solutions = [
        work.solution(f"truth {number} of 2, exposure {length:g}", half) for number, half in enumerate(halves, 1)
    ]
    if None in solutions:
        return None, [f"truth, exposure {length:g}", *(f"{case.label}, exposure {length:g}" for case in cases)]
    converged = truth_of(*solutions, work.source.file)
    measured, failed, left = [], {}, []
    for case in cases:
        label = f"{case.label}, exposure {length:g}"
        try:
            solution = work.solution(label, case.settings)
        except FrameError as error:
            failed[label] = reason_of(error)
            continue
        if solution is None:
            left.append(label)
        else:
            measured.append(Measured(case, errors_of(solution, converged.solution), solution))
    return ExposureResult(length, converged, tuple(measured), failed), left


class _Work:
    """Renders what is not kept from before, until time is up."""

    def __init__(
        self,
        source: StageScene,
        frames: Sequence[float],
        store: Store,
        shown: StudyProgress,
        started: float,
        time_limit: float | None,
    ) -> None:
        self.source, self.renderer = source, Renderer(source, *source.resolution())
        self._frames, self._store, self._shown = frames, store, shown
        self._started, self._time_limit = started, time_limit

    def shutters(self, settings: Settings) -> list[Shutter]:
        return [shutter_of(self.source, frame, settings) for frame in self._frames]

    def solution(self, label: str, settings: Settings) -> Solution | None:
        """The frames rendered with ``settings``; None where they are not kept and time is up."""
        size = [self.renderer.width, self.renderer.height]
        path = self._store.path({"settings": settings.as_dict(), "frames": list(self._frames), "size": size})
        found = self._store.load(path)
        fresh, begun = found is None, time.perf_counter()
        if fresh and self._time_limit is not None and begun - self._started > self._time_limit:
            return None
        self._shown.step(label)
        if found is None:
            found = self.renderer.render(self.shutters(settings), settings)
            self._store.save(path, found)
        self._shown.done(label, time.perf_counter() - begun, fresh)
        return found
