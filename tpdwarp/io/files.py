"""Writing files so that they appear under their names only when complete."""

from __future__ import annotations

import contextlib
import os
import secrets
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tpdwarp.errors import FrameError, InputError


def check_writable(path: str | os.PathLike[str]) -> None:
    """Makes the folder of ``path`` where it is missing, and tries whether a file can be made there.

    The folder is tried rather than its permission bits: these say nothing to an administrator, nor on a read-only
    file system.

    Raises:
        InputError: ``path`` is a folder or a device, or its folder cannot be created or written.
    """
    text = os.fspath(path)
    try:
        target = Path(os.path.realpath(text))
        if not text or target.is_dir():
            raise InputError("is a folder (name a file in it)", file=text)
        if target.exists() and not target.is_file():
            raise InputError("is not an ordinary file (choose another name)", file=text)
        os.makedirs(target.parent, exist_ok=True)
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be written: {reason} (choose another folder or name)", file=text) from error


@contextlib.contextmanager
def complete_or_absent(path: str | os.PathLike[str]) -> Iterator[str]:
    """Gives a temporary path to write to, which becomes ``path`` when the block ends well and vanishes otherwise.

    The temporary file is hidden, lies in the same folder and has the same extension. What was at ``path`` before
    stays there untouched until it is replaced in one step. A symbolic link is followed, not replaced.

    Raises:
        FrameError: The block wrote nothing, or the file system refused to keep it.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem[:40]}.{secrets.token_hex(4)}.tmp{target.suffix}")
    try:
        yield str(temporary)
        try:
            # Network file systems and full disks may report a failed write only here, before the name is taken.
            with open(temporary, "r+b") as written:
                os.fsync(written.fileno())
            os.replace(temporary, target)
        except OSError as error:
            raise FrameError(f"{os.fspath(path)}: cannot be written: {error.strerror}") from error
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
