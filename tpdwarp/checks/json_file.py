"""The result of a check as JSON."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from typing import Any

from tpdwarp.checks.findings import CheckResult, FrameComparison
from tpdwarp.io.files import complete_or_absent
from tpdwarp.version import VERSION


def as_json(result: CheckResult) -> dict[str, Any]:
    """A result as plain JSON values. Infinity, which JSON does not know, is null."""
    statuses = [frame.status for frame in result.frames]
    return {
        "program": f"tpdwarp {VERSION}",
        "frames_path": result.frames_path,
        "baseline_path": result.baseline_path,
        "ok": result.ok,
        "counts": {status: statuses.count(status) for status in ("same", "passed", "warned", "failed")},
        "seconds": result.seconds,
        "limits_file": result.limits_file,
        "limits": _plain(asdict(result.limits)),
        "frames": [_frame(frame) for frame in result.frames],
    }


def write_json(path: str | os.PathLike[str], result: CheckResult) -> None:
    """Writes a result as JSON; the file appears only when complete.

    Raises:
        FrameError: The file cannot be written.
    """
    with complete_or_absent(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        json.dump(as_json(result), file, indent=1, allow_nan=False)
        file.write("\n")


def _frame(frame: FrameComparison) -> dict[str, Any]:
    return {
        "name": frame.name,
        "frame": frame.frame,
        "status": frame.status,
        "path": frame.path,
        "baseline": frame.baseline,
        "findings": [_plain(asdict(finding)) for finding in frame.findings],
        "measures": {group: _plain(asdict(measures)) for group, measures in frame.measures.items()},
        "seconds": frame.seconds,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
