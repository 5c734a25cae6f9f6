"""The statistics file: what every frame cost and where its energy went, as JSON."""

from __future__ import annotations

import json
import math
import os
import platform
from dataclasses import asdict
from importlib import metadata
from typing import TYPE_CHECKING, Any

from tpdwarp.io.files import complete_or_absent
from tpdwarp.settings import Settings
from tpdwarp.version import VERSION

if TYPE_CHECKING:
    from tpdwarp.jobs.results import FrameOutcome, SequenceResult

_LIBRARIES = ("warp-lang", "numpy", "usd-core", "OpenImageIO")


def versions() -> dict[str, str]:
    """Versions of the program, of Python and of the libraries, by their package names."""
    found = {"tpdwarp": VERSION, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found


def statistics_of(scene: str, settings: Settings, result: SequenceResult) -> dict[str, Any]:
    """The statistics of a sequence as plain JSON values.

    ``frames`` has one entry a frame, in order: ``frame`` (null for the default time), ``status`` (``written``,
    ``traced``, ``skipped`` or ``failed``), ``path``, ``reason``, ``seconds`` by stage, ``energy`` (W, with ``counts``;
    null where nothing was traced) and ``photons`` landed.
    """
    return {
        "scene": scene,
        "settings": settings.as_dict(),
        "versions": versions(),
        "target_error": asdict(result.target) if result.target else None,
        "seconds": result.seconds,
        "problems": list(result.problems),
        "frames": [_frame_statistics(outcome) for outcome in result.outcomes],
    }


def write_statistics(path: str | os.PathLike[str], statistics: dict[str, Any]) -> None:
    """Writes statistics as JSON; the file appears only when complete.

    Raises:
        FrameError: The file cannot be written.
        OSError: Likewise.
    """
    with complete_or_absent(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        json.dump(statistics, file, indent=1, allow_nan=False)
        file.write("\n")


def _frame_statistics(outcome: FrameOutcome) -> dict[str, Any]:
    return {
        "frame": None if math.isnan(outcome.frame) else outcome.frame,
        "status": outcome.status,
        "path": outcome.path,
        "reason": outcome.reason,
        "seconds": {**outcome.seconds, "total": outcome.total_seconds},
        "photons": outcome.photons,
        "energy": outcome.energy.as_dict() if outcome.energy else None,
    }
