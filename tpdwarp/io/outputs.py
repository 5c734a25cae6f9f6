"""Outputs kept apart: none may be an input, nor another output."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping

from tpdwarp.errors import InputError
from tpdwarp.io.files import check_writable

FilePath = str | os.PathLike[str]


def check_outputs(
    outputs: Mapping[str, FilePath | None],
    inputs: Mapping[str, Iterable[FilePath]],
    frames: Iterable[FilePath] = (),
) -> None:
    """Makes sure that every output can be written, and that writing it destroys nothing that is read or written too.

    Files are compared as the file system does: two names of one file are the same.

    Args:
        outputs: Files to be written, by what people call them (``--stats``); None where one is not asked for.
        inputs: Files that are read, by what an output that is one of them would be (``is the scene itself``).
        frames: Files of frames to be written. That their folder can be written is found out with the first.

    Raises:
        InputError: An output cannot be written, is read, or is written twice.
    """
    wanted = {role: os.fspath(path) for role, path in outputs.items() if path is not None}
    numbered = [os.fspath(path) for path in frames]
    for path in (*numbered[:1], *wanted.values()):
        check_writable(path)
    read = {identity: role for role, paths in inputs.items() for path in paths for identity in _identities(path)}
    written: dict[object, str] = {}
    for role, path in (*wanted.items(), *(("frames", path) for path in numbered)):
        for identity in _identities(path):
            if identity in read:
                raise InputError(f"{read[identity]} (choose another name)", file=path)
            other = written.setdefault(identity, role)
            if other != role:
                raise InputError(f"is written by {other} and by {role} (give each a name of its own)", file=path)


def _identities(path: FilePath) -> list[object]:
    """What tells a file from others: its place, and where it exists, its number."""
    text = os.fspath(path)
    folder, name = os.path.split(text)
    found: list[object] = [os.path.join(os.path.realpath(folder or os.curdir), name)]
    try:
        status = os.stat(text)
    except (OSError, ValueError):
        return found
    return [*found, (status.st_dev, status.st_ino)]
