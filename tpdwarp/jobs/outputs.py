"""What a sequence writes: looked at before anything is rendered."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from tpdwarp.errors import InputError
from tpdwarp.io.files import sweep_temporaries
from tpdwarp.io.images import EXTENSIONS as IMAGES
from tpdwarp.io.outputs import FilePath, check_outputs
from tpdwarp.jobs.claims import sweep_claims
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.usd.write.debug_layer import EXTENSIONS as LAYERS
from tpdwarp.usd.write.debug_layer import view_path

if TYPE_CHECKING:
    from tpdwarp.usd.read.stage import StageScene


def prepare_outputs(
    source: StageScene,
    files: StageFiles,
    stats: FilePath | None,
    layer: FilePath | None,
    frames: Sequence[str] = (),
    others: Mapping[str, FilePath] | None = None,
    holdouts: Sequence[str] = (),
) -> None:
    """Makes sure that outputs destroy nothing, and removes what killed renders have left beside them.

    Args:
        source: The stage.
        files: What it is made of.
        stats: The statistics file, if one is wanted.
        layer: The debug layer, likewise.
        frames: The files of the frames.
        others: Further files, by what people call them.
        holdouts: Images that frames are held out by.

    Raises:
        InputError: An output cannot be written, is one of the stage's files, or is two outputs; or statistics have the
            name of an image or a layer.
    """
    layers = {} if layer is None else {"the debug layer": layer, "its view layer": view_path(layer)}
    outputs = {"--stats": stats, **layers, **(others or {})}
    inputs = {"is read by the scene": files.paths, "is the scene itself": [source.file]}
    inputs["is read by --holdout"] = holdouts
    check_outputs(outputs, inputs, frames)
    if stats is not None and os.path.splitext(stats)[1].lower() in (*IMAGES, *LAYERS):
        raise InputError("is no name for statistics (use .json or .jsonl)", file=os.fspath(stats))
    written = (os.fspath(path) for path in (*frames[:1], *outputs.values()) if path is not None)
    for folder in {os.path.dirname(path) or os.curdir for path in written}:
        sweep_folder(folder)


def sweep_folder(folder: str) -> None:
    """Removes what processes that were killed have left in a folder of frames."""
    sweep_temporaries(folder)
    sweep_claims(folder)
