"""The files that frames of a stage are made of, with all that they hold."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os

from pxr import Sdf, Tf, Usd, UsdUtils

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.diagnostics import usd_diagnostics

_BLOCK = 1 << 20


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
                    paths.update(_tiles(_package(layer.ComputeAbsolutePath(name))))
    return sorted(path for path in paths if os.path.isfile(path))


def content_digest(stage: Usd.Stage, files: list[str]) -> str:
    """Hash of what ``files`` hold, whatever they are called, and of layers that are in memory only."""
    digests = [file_digest(path) for path in files]
    session = stage.GetSessionLayer()
    for layer in stage.GetUsedLayers():
        if not layer.realPath and layer != session:
            digests.append(hashlib.sha256(layer.ExportToString().encode()).hexdigest())
    return hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()


def file_digest(path: str) -> str:
    """Hash of what a file holds.

    Raises:
        OSError: It cannot be read.
    """
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _package(path: str) -> str:
    """``shot.usdz`` for ``shot.usdz[geometry.usdc]``."""
    return path.split("[", 1)[0] if path.endswith("]") else path


def _tiles(path: str) -> list[str]:
    """The files of a texture in tiles, ``wood.<UDIM>.png``."""
    if "<UDIM>" not in path:
        return [path]
    before, _, after = path.partition("<UDIM>")
    return glob.glob(f"{glob.escape(before)}[0-9][0-9][0-9][0-9]{glob.escape(after)}")
