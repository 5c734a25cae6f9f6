"""What a stage's files declare, looked at before USD composes them: USD waits for pipes, its recursion ends the process
on prims that are nested too deep, and a few bytes may stand for more than any machine holds."""

from __future__ import annotations

import contextlib
import mmap
import os
import stat
import struct
import zipfile
from collections.abc import Iterator

import numpy as np
from pxr import Ar, Sdf, Tf

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.crate_sizes import MAGIC, CrateTables
from tpdwarp.usd.read.diagnostics import usd_diagnostics

# Real stages are some tens deep. USD needs 0.2 s for 1000, 40 s for 10 000, and crashes before 100 000.
MOST_DEPTH = 1000
# An index of a corner costs a third of what a triangle does (see :mod:`tpdwarp.io.memory`), any other value what its
# copies in double precision do.
BYTES_AN_INDEX = 380
COPIES = 4
_BLOCK = 1 << 24


def checked_layers(file: str, most_memory: float) -> list[Sdf.Layer]:
    """Opens a stage's layers one by one, each after a look at what it declares.

    Args:
        file: The stage.
        most_memory: Bytes that its largest array may need.

    Returns:
        The layers, to be kept until the stage is open, so that USD need not read them again. What cannot be opened is
        left to the stage to complain of.

    Raises:
        InputError: A file is a pipe or a device, nests prims too deep, or declares an array that is too large.
    """
    found: list[Sdf.Layer] = []
    left, seen = [(os.path.realpath(file), "")], set()
    while left:
        path, by = left.pop()
        if path in seen:
            continue
        seen.add(path)
        _check_file(path, by, most_memory)
        with contextlib.suppress(Tf.ErrorException, InputError), usd_diagnostics(WarnOnce("", silent=True)):
            layer = Sdf.Layer.FindOrOpen(path)
            if layer is not None:
                found.append(layer)
                for name in layer.GetCompositionAssetDependencies():
                    resolved = str(Ar.GetResolver().Resolve(Sdf.ComputeAssetPathRelativeToLayer(layer, name)))
                    if resolved:
                        left.append((resolved.split("[", 1)[0] if resolved.endswith("]") else resolved, path))
    return found


def _check_file(path: str, by: str, most_memory: float) -> None:
    try:
        kind = os.stat(path).st_mode
    except OSError:
        return
    if not stat.S_ISREG(kind):
        named = f", and {by} names it" if by else ""
        raise InputError(f"is no ordinary file{named} (name a USD file)", file=path)
    for name, data in _layers_in(path):
        _check_layer(f"{path}[{name}]" if name else path, data, most_memory)


@contextlib.contextmanager
def _mapped(path: str) -> Iterator[bytes | mmap.mmap]:
    with open(path, "rb") as file:
        if os.fstat(file.fileno()).st_size == 0:
            yield b""
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield data


def _layers_in(path: str) -> Iterator[tuple[str, bytes | mmap.mmap]]:
    """The layers of a file: itself, or those of a package by their names."""
    with contextlib.suppress(OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
        if not path.lower().endswith(".usdz"):
            with _mapped(path) as data:
                yield "", data
            return
        with zipfile.ZipFile(path) as package:
            for member in package.infolist():
                # USD takes members that are stored as they are only.
                if member.filename.lower().endswith((".usd", ".usda", ".usdc")) and not member.compress_type:
                    yield member.filename, package.read(member)


def _check_layer(name: str, data: bytes | mmap.mmap, most_memory: float) -> None:
    depth = 0
    if data[: len(MAGIC)] == MAGIC:
        with contextlib.suppress(ValueError, KeyError, IndexError, struct.error, TypeError):
            tables = CrateTables(data)
            depth = tables.depth(MOST_DEPTH)
            for count, size, whole in tables.arrays():
                need = count * BYTES_AN_INDEX if whole else size * COPIES
                if need > most_memory:
                    raise InputError(
                        f"declares an array of {count} values, which would need {need / 2**30:.3g} GB of memory, and "
                        f"{most_memory / 2**30:.3g} may be taken (see --max-memory)",
                        file=name,
                    )
    else:
        depth = _text_depth(data)
    if depth > MOST_DEPTH:
        raise InputError(f"nests prims {depth} deep (at most {MOST_DEPTH})", file=name)


def _text_depth(data: bytes | mmap.mmap) -> int:
    """How deep braces are nested in a text; those within strings count too, and seldom do."""
    deepest = depth = 0
    for start in range(0, len(data), _BLOCK):
        block = np.frombuffer(data[start : start + _BLOCK], np.uint8)
        steps = (block == ord("{")).astype(np.int32) - (block == ord("}"))
        levels = depth + np.cumsum(steps)
        deepest, depth = max(deepest, int(levels.max())), int(levels[-1])
    return deepest
