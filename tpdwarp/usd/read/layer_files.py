"""The files a stage is composed of."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from pxr import Tf, Usd

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.diagnostics import usd_diagnostics
from tpdwarp.usd.read.used_files import used_files


def content_hash(file: str) -> str:
    """Hash of the content of all layers that the stage at ``file`` uses, whatever they are called.

    Raises:
        pxr.Tf.ErrorException: The stage cannot be opened.
    """
    digests = []
    stage = Usd.Stage.Open(file)
    for layer in stage.GetUsedLayers():
        if layer.realPath and os.path.isfile(layer.realPath):
            digests.append(hashlib.sha256(Path(layer.realPath).read_bytes()).hexdigest())
        elif not layer.anonymous:
            digests.append(hashlib.sha256(layer.ExportToString().encode()).hexdigest())
    return hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()


def files_of_stage(file: str) -> list[str]:
    """All files that the stage at ``file`` reads, in silence; the file alone where it cannot be opened as a stage."""
    try:
        with usd_diagnostics(WarnOnce("", silent=True)):
            return used_files(Usd.Stage.Open(file))
    except (Tf.ErrorException, InputError):
        return [file]
