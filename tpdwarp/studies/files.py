"""Measurements as CSV and JSON."""

from __future__ import annotations

import csv
import json
import os
from typing import Any

from tpdwarp.io.files import complete_or_absent
from tpdwarp.jobs.statistics import versions
from tpdwarp.studies.result import StudyResult, rows_of


def write_csv(path: str | os.PathLike[str], result: StudyResult) -> None:
    """Writes one line a measurement, under the names of :func:`tpdwarp.studies.result.rows_of`.

    Raises:
        FrameError: The file cannot be written.
        OSError: Likewise.
    """
    rows = rows_of(result)
    names = list(dict.fromkeys(name for row in rows for name in row))
    with complete_or_absent(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(rows)


def write_json(path: str | os.PathLike[str], result: StudyResult) -> None:
    """Writes everything measured, with the noise of the truths and what was left out.

    Raises:
        FrameError: The file cannot be written.
        OSError: Likewise.
    """
    with complete_or_absent(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        json.dump(as_dict(result), file, indent=1, allow_nan=False)
        file.write("\n")


def as_dict(result: StudyResult) -> dict[str, Any]:
    """A study as plain JSON values."""
    truths = [{"exposure": part.exposure, "relative_noise": part.truth.relative_noise} for part in result.exposures]
    return {
        "scene": result.scene,
        "frames": list(result.frames),
        "size": list(result.size),
        "versions": versions(),
        "seconds": result.seconds,
        "truths": truths,
        "measured": rows_of(result),
        "failed": result.failed,
        "left": list(result.left),
    }
