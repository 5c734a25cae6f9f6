"""Measurements as a table for terminals."""

from __future__ import annotations

from tpdwarp.studies.result import ExposureResult, StudyResult

STAGES = ("read", "build", "plan", "trace", "footprints", "view", "gather")


def table_lines(result: StudyResult) -> list[str]:
    """The study in lines: a table an exposure, best first, with ``*`` where a case is on the Pareto front."""
    lines = []
    for part in result.exposures:
        lines += _lines(part)
    if any(part.measured for part in result.exposures):
        lines.append("* on the Pareto front: no other case is both faster and closer to the truth.")
        lines.append("Times are CPU seconds a frame of all threads; CPU s leaves out plan, done once an animation.")
    lines += [f"failed: {label}: {reason}" for label, reason in result.failed.items()]
    if result.left:
        lines.append(f"time was up before {len(result.left)} more (run again to go on): {result.left[0]} …")
    return lines


def _lines(part: ExposureResult) -> list[str]:
    truth = part.truth.solution
    seconds = sum(truth.cpu_seconds.values())
    lines = [
        f"exposure {part.exposure:g} frames; truth with relative noise {part.truth.relative_noise:.2g} "
        f"(half of the difference of its halves, {seconds:.3g} s CPU each)"
    ]
    stages = [stage for stage in STAGES if any(stage in found.solution.cpu_seconds for found in part.measured)]
    rows = [["", "method", "photons", "landed", "rel. RMSE", "RMSE", "bias", "FLIP", "flicker", "CPU s", *stages, "MB"]]
    front = part.front
    for found in sorted(part.measured, key=lambda entry: entry.errors.rmse):
        errors, solution = found.errors, found.solution
        rows.append(
            [
                "*" if any(found is other for other in front) else "",
                found.case.series,
                "-" if found.case.outside else str(found.case.settings.photons),
                f"{solution.landed:.0f}",
                f"{errors.relative_rmse:.4f}",
                f"{errors.rmse:.4g}",
                f"{errors.bias:+.4f}",
                f"{errors.flip:.4f}",
                "-" if errors.flicker is None else f"{errors.flicker:.4f}",
                f"{found.cpu:.3f}",
                *(f"{solution.cpu_seconds.get(stage, 0.0):.3f}" for stage in stages),
                f"{solution.memory / 2**20:.0f}",
            ]
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [text.ljust(size) if index < 2 else text.rjust(size) for index, (text, size) in _sized(row, widths)]
        lines.append("  ".join(cells).rstrip())
    return [*lines, ""]


def _sized(row: list[str], widths: list[int]) -> list[tuple[int, tuple[str, int]]]:
    return list(enumerate(zip(row, widths, strict=True)))
