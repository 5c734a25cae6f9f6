"""Flicker: how the difference to the baseline changes from frame to frame.

A difference that stays is a matter for the other measures; one that comes and goes is what an eye sees in motion, even
where each single frame is within its limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tpdwarp.checks.findings import FrameComparison
from tpdwarp.checks.limits import Limits
from tpdwarp.checks.measures import judge
from tpdwarp.checks.pixels import root_mean_square

Reduced = Mapping[str, tuple[np.ndarray, np.ndarray]]


def with_flicker(
    comparison: FrameComparison, reduced: Reduced, since: FrameComparison, before: Reduced, limits: Limits
) -> FrameComparison:
    """A comparison with the flicker of its colour groups measured and judged.

    Flicker is the root of the mean squared change, since the frame before, of image less baseline, as a part of the
    baseline's root of the mean square.

    Args:
        comparison: One frame.
        reduced: Its images, by group: image and baseline, shape [h, w, 3].
        since, before: The same of the frame before. Where that failed, a right frame after it jumps back, so findings
            say which it was.
        limits: What is allowed.
    """
    measures, findings = dict(comparison.measures), list(comparison.findings)
    which = f" since frame {since.name}{', which failed' if since.status == 'failed' else ''}"
    for group, (image, baseline) in reduced.items():
        if group not in before or before[group][0].shape != image.shape:
            continue
        change, baseline_change = image - before[group][0], baseline - before[group][1]
        level = root_mean_square(baseline)
        found = replace(
            measures[group],
            flicker=root_mean_square(change - baseline_change) / (level or 1.0),
            change=root_mean_square(change),
            baseline_change=root_mean_square(baseline_change),
        )
        measures[group] = found
        allowed = limits.of(group)
        findings += [
            replace(finding, message=finding.message + which)
            for finding in judge(group, found, allowed, limits.flip.percentile)
            if finding.kind == "flicker"
        ]
    return replace(comparison, measures=measures, findings=tuple(findings))
