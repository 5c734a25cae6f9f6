"""A whole check: two places in, a result out."""

from __future__ import annotations

import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from tpdwarp.checks.findings import CheckResult, FrameComparison
from tpdwarp.checks.flicker import Reduced, with_flicker
from tpdwarp.checks.frames import ComparedFrame, compare_surely
from tpdwarp.checks.inputs import inputs_of
from tpdwarp.checks.json_file import write_json
from tpdwarp.checks.junit import write_junit
from tpdwarp.checks.limits import Limits, limits_beside, read_limits
from tpdwarp.checks.photons import compare_layers, layer_pairs
from tpdwarp.checks.picture_store import PictureStore
from tpdwarp.checks.report import write_report
from tpdwarp.checks.sequences import Pair, image_pairs
from tpdwarp.checks.update import finish_interrupted_update
from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.outputs import check_outputs
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.jobs.results import FrameOutcome

FilePath = str | os.PathLike[str]
Writer = Callable[[FilePath, CheckResult], None]

# Pictures in a report: so wide in short sequences, and smaller the longer they are, that a page stays one to open.
WIDEST_PICTURE, NARROWEST_PICTURE, WIDE_COUNT = 480, 160, 60


def check(
    frames: FilePath,
    baseline: FilePath,
    *,
    limits: FilePath | Limits | None = None,
    report: FilePath | None = None,
    junit: FilePath | None = None,
    json: FilePath | None = None,
    threads: int = 0,
    progress: str | Progress | None = None,
    new: bool = False,
    render: FilePath | None = None,
    device: str = "",
) -> CheckResult:
    """Compares frames (and debug layers) with their baseline.

    Args:
        frames: A folder, an image, a debug layer, or a name with ``####`` where the frame number goes.
        baseline: The same.
        limits: What is allowed; a TOML file takes its values, None the file ``tpdwarp-check.toml`` beside the baseline,
            or the defaults where there is none.
        report: Also write an HTML report here.
        junit: Also write JUnit XML here.
        json: Also write JSON here.
        threads: Frames compared at the same time; 0 for as many as there are cores. Each holds one frame in memory.
        progress: As for :func:`tpdwarp.render`.
        new: Whether the baseline may be a folder that does not exist yet, or is empty. Every frame is extra then.
        render: A stage to be rendered into the folder ``frames`` first, with the baseline's own settings and frames.
        device: What to render on; empty for the processor.

    Raises:
        InputError: The two cannot be compared: a place does not exist or holds nothing, or the limits are unusable.
            Single frames that cannot be read are failures in the result.
        FrameError: A report cannot be written.
    """
    started = time.perf_counter()
    if threads < 0:
        raise InputError(f"--threads must be 0 or more, not {threads}")
    finish_interrupted_update(baseline)
    allowed, limits_file = _limits(limits, baseline)
    outputs = {"--report": report, "--junit": junit, "--json": json}
    shown = progress_of(progress)
    if render is not None:
        # Here and not above, for comparing alone need not wait for the renderer to load.
        from tpdwarp.checks.render import recipe_of, render_like

        recipe = recipe_of(baseline)
        inputs = inputs_of(baseline=baseline, scene=render, limits=limits_file or None)
        check_outputs(outputs, inputs, recipe.outputs(frames))
        machine = {"threads": threads} | ({"device": device} if device else {})
        render_like(render, recipe, frames, shown, **machine)
    else:
        check_outputs(outputs, inputs_of(frames=frames, baseline=baseline, limits=limits_file or None))
    pairs, layers = _paired(os.fspath(frames), os.fspath(baseline), new=new)
    shown.start(len(pairs) + len(layers))
    workers = threads or len(os.sched_getaffinity(0))
    width = 0 if report is None else picture_width(len(pairs))
    compared: list[FrameComparison] = []
    store = PictureStore()

    def tell(comparison: FrameComparison) -> None:
        # Frames overlap: what counts for the time that is left is how fast they come, not how long each takes.
        nonlocal last
        now = time.perf_counter()
        shown.end(_outcome(comparison, now - last))
        last = now

    last = time.perf_counter()
    try:
        for comparison in _compared(pairs, allowed, workers, width):
            if comparison.pictures:
                comparison = replace(comparison, pictures=store.keep(comparison.pictures))
            compared.append(comparison)
            tell(comparison)
        for mine, theirs in layers:
            of_layer = list(compare_layers(mine, theirs, allowed))
            compared += of_layer
            failed = next((entry for entry in of_layer if entry.status == "failed"), None)
            tell(failed or FrameComparison("photons", None, mine))
    finally:
        shown.finish()
    result = CheckResult(
        os.fspath(frames),
        os.fspath(baseline),
        tuple(compared),
        allowed,
        limits_file,
        time.perf_counter() - started,
        "" if report is None else os.fspath(report),
    )
    _write_all(result, ((report, write_report), (junit, write_junit), (json, write_json)))
    return result


def _write_all(result: CheckResult, outputs: Iterable[tuple[FilePath | None, Writer]]) -> None:
    """Writes every report, also behind one that cannot be written.

    Raises:
        FrameError: One or more could not be written.
    """
    problems = []
    for path, write in outputs:
        if path is not None:
            try:
                write(path, result)
            except FrameError as error:
                problems.append(str(error))
            except OSError as error:
                problems.append(f"{os.fspath(path)}: cannot be written: {error.strerror}")
    if problems:
        raise FrameError("; ".join(problems))


def picture_width(count: int) -> int:
    """Width of a report's pictures of ``count`` frames: the pixels of all together stay bounded up to 540 frames."""
    return max(NARROWEST_PICTURE, min(WIDEST_PICTURE, round(WIDEST_PICTURE * (WIDE_COUNT / max(1, count)) ** 0.5)))


def _limits(limits: FilePath | Limits | None, baseline: FilePath) -> tuple[Limits, str]:
    if isinstance(limits, Limits):
        return limits, ""
    if limits is not None:
        return read_limits(limits), os.fspath(limits)
    beside = limits_beside(baseline)
    return (read_limits(beside), str(beside)) if beside.is_file() else (Limits(), "")


def _paired(frames: str, baseline: str, new: bool) -> tuple[list[Pair], list[tuple[str, str]]]:
    if new and not Path(baseline).exists() and "#" not in Path(baseline).name:
        alone = image_pairs(frames, frames)
        return [replace(pair, baselines=()) for pair in alone], [(mine, "") for mine, _ in layer_pairs(frames, frames)]
    pairs, layers = image_pairs(frames, baseline), layer_pairs(frames, baseline)
    if not (Path(frames).is_dir() and Path(baseline).is_dir()):
        layers = [pair for pair in layers if all(pair)]
    for place, held in (
        (frames, [pair.files for pair in pairs if pair.files] + [pair[0] for pair in layers if pair[0]]),
        (baseline, [pair.baselines for pair in pairs if pair.baselines] + [pair[1] for pair in layers if pair[1]]),
    ):
        if not held and not (new and place == baseline):
            raise InputError("holds no frames and no debug layers to compare", file=place)
    return pairs, layers


def _compared(pairs: Sequence[Pair], limits: Limits, threads: int, picture_width: int) -> Iterator[FrameComparison]:
    """Comparisons in order; no more frames are in memory than there are threads, and one reduced frame."""
    waiting: deque[tuple[Pair, Future[ComparedFrame]]] = deque()
    before: tuple[FrameComparison, Reduced] | None = None
    left = iter(pairs)
    with ThreadPoolExecutor(threads) as pool:
        try:
            while True:
                while len(waiting) <= threads and (pair := next(left, None)) is not None:
                    waiting.append((pair, pool.submit(compare_surely, pair, limits, picture_width)))
                if not waiting:
                    return
                pair, future = waiting.popleft()
                done = future.result()
                numbered = pair.frame is not None and math.isfinite(pair.frame)
                comparison = done.comparison
                if numbered and before:
                    comparison = with_flicker(comparison, done.reduced, *before, limits)
                # What is gone by the next frame is not worth its memory: the pictures, above all.
                before = (replace(comparison, pictures={}), done.reduced) if numbered and done.reduced else None
                yield comparison
        finally:
            for _, future in waiting:
                future.cancel()


def _outcome(comparison: FrameComparison, seconds: float) -> FrameOutcome:
    failed = comparison.status == "failed"
    return FrameOutcome(
        math.nan if comparison.frame is None else comparison.frame,
        "failed" if failed else "compared",
        comparison.path,
        str(comparison.failures[0]) if failed else "",
        total_seconds=seconds,
    )
