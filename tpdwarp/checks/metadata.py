"""Comparing what two frames say about how they were made."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from typing import Any

import numpy as np

from tpdwarp.checks.findings import Finding, Severity
from tpdwarp.checks.limits import MetadataLimits

_SETTINGS = "tpdwarp:settings"


def metadata_findings(
    metadata: Mapping[str, Any], baseline: Mapping[str, Any], limits: MetadataLimits
) -> Iterator[Finding]:
    """Differences between two images' attributes.

    Args:
        metadata, baseline: Attributes, as :func:`tpdwarp.io.images.read_stored` gives them.
        limits: Which of them count.
    """
    for name in sorted({*metadata, *baseline}):
        severity = _severity(name, limits)
        if severity is None:
            continue
        mine, theirs = metadata.get(name), baseline.get(name)
        settings = (_settings(mine), _settings(theirs)) if name == _SETTINGS else (None, None)
        if settings[0] is not None and settings[1] is not None:
            yield from _settings_findings(settings[0], settings[1], severity, limits)
        elif not _equal(mine, theirs, limits.relative):
            yield Finding(severity, "metadata", f"{name} is {_text(mine)}, the baseline has {_text(theirs)}")


def _settings_findings(
    mine: Mapping[str, Any], theirs: Mapping[str, Any], severity: Severity, limits: MetadataLimits
) -> Iterator[Finding]:
    for name in sorted({*mine, *theirs}):
        if name in limits.ignored_settings or _equal(mine.get(name), theirs.get(name), limits.relative):
            continue
        # A setting that only one program knows was at its default in the other, as far as anyone can tell.
        known = name in mine and name in theirs
        weight: Severity = severity if known and name not in limits.warned_settings else "warn"
        values = [_text(side[name]) if name in side else "not known" for side in (mine, theirs)]
        yield Finding(weight, "settings", f"setting {name} is {values[0]}, the baseline has {values[1]}")


def _severity(name: str, limits: MetadataLimits) -> Severity | None:
    if any(fnmatch(name, pattern) for pattern in limits.fail):
        return "fail"
    return "warn" if any(fnmatch(name, pattern) for pattern in limits.warn) else None


def _settings(value: Any) -> dict[str, Any] | None:
    try:
        settings = json.loads(value)
    except (TypeError, ValueError, RecursionError):
        return None
    return settings if isinstance(settings, dict) else None


def _equal(mine: Any, theirs: Any, relative: float) -> bool:
    if mine is None or theirs is None:
        return mine is theirs
    try:
        numbers = np.asarray(mine, np.float64), np.asarray(theirs, np.float64)
    except (TypeError, ValueError, OverflowError):
        return bool(np.all(mine == theirs))
    if isinstance(mine, str) or isinstance(theirs, str):
        return mine == theirs
    if numbers[0].shape != numbers[1].shape:
        return False
    scale = max(float(np.abs(numbers[1]).max(initial=0.0)), float(np.abs(numbers[0]).max(initial=0.0)))
    return bool(np.all(np.abs(numbers[0] - numbers[1]) <= relative * scale))


def _text(value: Any) -> str:
    if value is None:
        return "absent"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, np.ndarray):
        return " ".join(f"{number:.6g}" for number in value.ravel())
    text = str(value)
    return text if len(text) <= 80 else text[:77] + "..."
