"""Finding limits by rendering a stage with other seeds: what honest renders differ by is no difference."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from tpdwarp.checks.findings import CheckResult
from tpdwarp.checks.inputs import inputs_of
from tpdwarp.checks.limits import FlipLimits, GroupLimits, Limits, limits_beside, write_limits
from tpdwarp.checks.prediction_limit import prediction_limit, student_inverse
from tpdwarp.checks.render import Recipe, recipe_of, render_like
from tpdwarp.checks.run import check
from tpdwarp.errors import InputError
from tpdwarp.io.outputs import check_outputs
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.version import VERSION

FilePath = str | os.PathLike[str]

FEWEST_SEEDS = 4
# A pixel fails beyond so many root mean squares: rare in any noise without spikes, and spikes are counted besides.
_PIXEL_DEVIATIONS = 4.0
_COLOR_MEASURES = ("flip_mean", "flip_high", "energy", "flicker")
_MEASURES = {
    "failed_percent": "fail_percent",
    "hard": "hard",
    "rmse": "rmse",
    "coarse": "coarse",
    **{name: name for name in _COLOR_MEASURES},
}
_LEAST_SPREAD = 0.05
_MOST_SPREAD = 50.0
# Measures everything and fails nothing; FLIP is measured only where it has a limit.
_OPEN = GroupLimits(**{field.name: 1e300 for field in fields(GroupLimits)})


def calibrate(
    scene: FilePath,
    baseline: FilePath,
    *,
    seeds: int = 12,
    false_alarms: float = 1e-3,
    limits: FilePath | None = None,
    progress: str | Progress | None = None,
    **changes: Any,
) -> Limits:
    """Renders a stage as its baseline was, with other seeds, and writes limits that such renders keep.

    For every channel group and measure, the largest value over the frames is taken of each seed, and a prediction limit
    over the seeds, of the logarithms for all but energy. Each measure has its share of ``false_alarms``, so that
    a check of the whole sequence with a further seed fails with at most that probability, as far as the values are
    distributed so. No limit is below the defaults, which stand for other machines. Limits of metadata, sequences and
    photons stay as they are: photons do not depend on the seed, unless they are emitted at random.

    Args:
        scene: The stage.
        baseline: Frames of it, one seed's.
        seeds: Renders to compare; each takes as long as the baseline took.
        false_alarms: Probability that a check of honest frames fails.
        limits: File to write; None for ``tpdwarp-check.toml`` beside the baseline.
        progress: As for :func:`tpdwarp.render`.
        **changes: Settings that are to differ from the baseline's (``threads``, ``device``).

    Returns:
        The limits written.

    Raises:
        InputError: The arguments cannot be used, a frame cannot be rendered again, or SciPy is not installed.
    """
    student_inverse()
    if seeds < FEWEST_SEEDS:
        raise InputError(f"--seeds must be {FEWEST_SEEDS} or more, not {seeds}")
    if not 0 < false_alarms < 0.5:
        raise InputError(f"--false-alarms must lie between 0 and 0.5, not {false_alarms}")
    target = Path(limits) if limits is not None else limits_beside(baseline)
    check_outputs({"--limits": target}, inputs_of(baseline=baseline, scene=scene))
    recipe = replace(recipe_of(baseline), layer="")
    shown = progress_of(progress)
    with tempfile.TemporaryDirectory(prefix="tpdwarp-calibrate-") as folder:
        first = int(recipe.settings.get("seed", 0))
        renders = [Path(folder) / str(number) for number in range(seeds)]
        for number, frames in enumerate(renders):
            render_like(scene, recipe, frames, shown, **{**changes, "seed": first + 1 + number})
        found = calibrated(renders, baseline, recipe, false_alarms)
    note = (
        f"{seeds} other seeds of {Path(scene).name}, {len(recipe.frames)} frames, "
        f"at most {false_alarms:g} false alarms a check"
    )
    record = {"note": note, "program": f"tpdwarp {VERSION}", "seeds": seeds, "false_alarms": false_alarms}
    found = replace(found, calibration=record)
    write_limits(target, found, "Limits of tpdwarp check, found by calibration; numbers may be changed by hand.")
    return found


def calibrated(renders: Sequence[FilePath], baseline: FilePath, recipe: Recipe, false_alarms: float) -> Limits:
    """Limits that renders of other seeds keep; see :func:`calibrate`.

    Raises:
        InputError: A frame could not be rendered or compared.
    """
    template = Path(baseline) / recipe.name if Path(baseline).is_dir() else Path(baseline)
    rough = [_checked(frames, template, {}) for frames in renders]
    groups = list(rough[0].frames[0].measures)
    colors = [group for group in groups if rough[0].frames[0].measures[group].energy is not None]
    defaults = Limits()
    absolute = {
        group: max(
            defaults.of(group).fail_absolute,
            _PIXEL_DEVIATIONS * max(frame.measures[group].rms for result in rough for frame in result.frames),
        )
        for group in groups
    }
    wanted = {
        group: {"fail_absolute": absolute[group], "fail_relative": defaults.of(group).fail_relative} for group in groups
    }
    fine = [_checked(frames, template, wanted) for frames in renders]
    count = sum(len(_MEASURES) - (0 if group in colors else len(_COLOR_MEASURES)) for group in groups)
    found: dict[str, dict[str, float]] = {}
    for group in groups:
        entry = {"fail_absolute": absolute[group], "warn_absolute": absolute[group]}
        for measure, limit in _MEASURES.items():
            values = [_largest(result, group, measure) for result in fine]
            if any(value is None for value in values):
                continue
            predicted = _limit([value or 0.0 for value in values], false_alarms / count, measure == "energy")
            default = getattr(defaults.of(group), limit)
            # FLIP of groups that are not judged by it stays unmeasured, for it takes long.
            if math.isfinite(default):
                entry[limit] = max(default, predicted)
        found[group] = entry
    return Limits(groups=found, flip=FlipLimits())


def _checked(frames: FilePath, baseline: FilePath, groups: Mapping[str, Mapping[str, float]]) -> CheckResult:
    flip = {"beauty": {"flip_mean": 1e300, "flip_high": 1e300}}
    others = {"flip_mean": math.inf, "flip_high": math.inf}
    merged = {name: {**groups.get(name, {}), **flip.get(name, {})} for name in {*groups, *flip}}
    result = check(frames, baseline, limits=Limits(all=replace(_OPEN, **others), groups=merged))
    for frame in result.failed:
        raise InputError(f"frame {frame.name} is of no use for calibrating: {frame.failures[0]}", file=frame.path)
    return result


def _largest(result: CheckResult, group: str, measure: str) -> float | None:
    values = [getattr(frame.measures[group], measure) for frame in result.frames]
    known = [abs(value) for value in values if value is not None]
    return max(known) if known else None


def _limit(values: Sequence[float], false_alarms: float, plain: bool) -> float:
    """A prediction limit of the values, or of their logarithms where they are sizes that scatter by factors."""
    if max(values) == 0:
        return 0.0
    if plain:
        return prediction_limit(values, false_alarms)
    least = min(value for value in values if value > 0)
    logarithms = [math.log(max(value, 0.5 * least)) for value in values]
    middle = sum(logarithms) / len(logarithms)
    # Seeds that happen to agree do not promise that the next will.
    above = prediction_limit(logarithms, false_alarms) - middle
    return math.exp(middle + min(max(above, math.log1p(_LEAST_SPREAD)), _MOST_SPREAD))
