"""The files that frames of a stage are made of, with all that they hold."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable

from pxr import Sdf, Tf, Usd, UsdUtils

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.diagnostics import usd_diagnostics
from tpdwarp.usd.read.numbered_files import all_files


def used_layers(stage: Usd.Stage) -> dict[str, Sdf.Layer]:
    """The layers on disk that ``stage`` has open, by their files (packages count as one)."""
    return {_package(layer.realPath): layer for layer in stage.GetUsedLayers() if layer.realPath}


def used_files(stage: Usd.Stage) -> list[str]:
    """Files that ``stage`` reads now or may read for some frame: layers, clips, and assets such as textures.

    What cannot be found is left out: reading the stage has warned of it.
    """
    layers = used_layers(stage)
    paths = set(layers)
    for file, layer in layers.items():
        # Its errors and warnings repeat those of opening the stage.
        with contextlib.suppress(Tf.ErrorException, InputError), usd_diagnostics(WarnOnce("", silent=True)):
            for names in UsdUtils.ExtractExternalReferences(file):
                for name in names:
                    paths.update(all_files(_package(layer.ComputeAbsolutePath(name))))
    return sorted(path for path in paths if os.path.isfile(path))


def content_digest(stage: Usd.Stage, file_digests: Iterable[str]) -> str:
    """Hash of what the stage's files hold, by their own digests, and of its layers that are in memory only."""
    digests = list(file_digests)
    session = stage.GetSessionLayer()
    for layer in stage.GetUsedLayers():
        if not layer.realPath and layer != session:
            digests.append(hashlib.sha256(layer.ExportToString().encode()).hexdigest())
    return hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()


def _package(path: str) -> str:
    """``shot.usdz`` for ``shot.usdz[geometry.usdc]``."""
    return path.split("[", 1)[0] if path.endswith("]") else path

