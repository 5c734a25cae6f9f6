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
    null where nothing was traced), ``photons`` landed, and how many ``tries`` it took. A frame that was skipped has
    what its file says of its rendering.
    """
    return {
        "scene": scene,
        "settings": settings.as_dict(),
        "versions": versions(),
        "target_error": asdict(result.target) if result.target else None,
        "seconds": result.seconds,
        "problems": list(result.problems),
        "rendered_anew": dict(result.anew),
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


class StatisticsLines:
    """Statistics in which each frame is a line of JSON, added as the frame ends: they outlive whatever ends a run.

    A line has the fields of an entry of ``frames`` in :func:`statistics_of`.

    Args:
        path: The file.
        resume: Whether lines of earlier runs stay; frames that are skipped then keep theirs.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], resume: bool) -> None:
        self._path = os.fspath(path)
        self._known: set[object] = set()
        if resume and os.path.exists(self._path):
            self._mend()
        else:
            with complete_or_absent(self._path) as temporary, open(temporary, "w", encoding="utf-8"):
                pass

    def add(self, outcome: FrameOutcome) -> None:
        """Adds the line of a frame that has ended.

        Raises:
            OSError: It cannot be written.
        """
        entry = _frame_statistics(outcome)
        if outcome.status == "skipped" and entry["frame"] in self._known:
            return
        line = json.dumps(entry, allow_nan=False) + "\n"
        # In one piece: others may add to the same file.
        with open(self._path, "ab", buffering=0) as file:
            file.write(line.encode())
        self._known.add(entry["frame"])

    def _mend(self) -> None:
        """Drops a last line that was cut short, and notes the frames that have lines."""
        with open(self._path, "r+b") as file:
            whole = 0
            for line in file:
                try:
                    entry = json.loads(line)
                    complete = line.endswith(b"\n") and isinstance(entry, dict)
                except ValueError:
                    complete = False
                if not complete:
                    break
                whole += len(line)
                if entry.get("status") != "failed":
                    self._known.add(entry.get("frame"))
            file.truncate(whole)


def _frame_statistics(outcome: FrameOutcome) -> dict[str, Any]:
    return {
        "frame": None if math.isnan(outcome.frame) else outcome.frame,
        "status": outcome.status,
        "path": outcome.path,
        "reason": outcome.reason,
        "seconds": {**outcome.seconds, "total": outcome.total_seconds},
        "tries": outcome.tries,
        "photons": outcome.photons,
        "energy": outcome.energy.as_dict() if outcome.energy else None,
    }
