"""The files that a check reads, so that none of its outputs is written over them."""

from __future__ import annotations

import os

from tpdwarp.checks.sequences import LAYER_EXTENSIONS, files_of
from tpdwarp.errors import InputError
from tpdwarp.io.images import EXTENSIONS

FilePath = str | os.PathLike[str]


def inputs_of(
    *, frames: FilePath | None = None, baseline: FilePath, scene: FilePath | None = None, limits: FilePath | None = None
) -> dict[str, list[str]]:
    """Files that are read, by what is wrong with an output that is one of them.

    Args:
        frames, baseline: Places of frames and debug layers; None, or one that does not exist, has no files.
        scene: A stage that is rendered.
        limits: A limits file.
    """
    found = {
        "is a frame that is checked": _files_in(frames),
        "is part of the baseline": _files_in(baseline),
        "is the limits file": [os.fspath(limits)] if limits is not None else [],
    }
    if scene is not None:
        # Here and not above, because comparing alone need not wait for USD to load.
        from tpdwarp.usd.read.layer_files import files_of_stage

        found["is part of the scene"] = files_of_stage(os.fspath(scene))
    return found


def _files_in(place: FilePath | None) -> list[str]:
    try:
        files = [] if place is None else files_of(place, (*EXTENSIONS, *LAYER_EXTENSIONS))
    except InputError:
        return []
    return [file.path for file in files]
