"""Writing files so that they appear under their names only when complete."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tpdwarp.errors import FrameError, InputError
from tpdwarp.stopping import work_begins

# Another program's scheme in front of a name; one letter is a drive.
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
_TEMPORARY = re.compile(r"\..*\.([0-9a-f]{8})-([0-9a-f]+)-[0-9a-f]{8}\.tmp(\.\w+)?")
# Temporaries of other hosts, whose processes cannot be looked for, are left behind after so long.
ABANDONED_SECONDS = 86400.0


def file_name(path: str | os.PathLike[str]) -> str:
    """A path as a text.

    Raises:
        InputError: It is no path, or one of bytes.
    """
    name = os.fspath(path) if isinstance(path, str | os.PathLike) else path
    if not isinstance(name, str):
        raise InputError(f"a file must be named by a text or a path, not {path!r}")
    return name


def check_writable(path: str | os.PathLike[str]) -> None:
    """Makes the folder of ``path`` where it is missing, and tries whether a file can be made there.

    The folder is tried rather than its permission bits: these say nothing to an administrator, nor on a read-only
    file system.

    Raises:
        InputError: ``path`` is a folder or a device, or its folder cannot be created or written.
    """
    text = os.fspath(path)
    check_name(text)
    if _URL.match(text):
        raise InputError("is a URL (write to a file, and copy it there)", file=text)
    try:
        target = Path(os.path.realpath(os.path.dirname(text) or os.curdir)) / os.path.basename(text)
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
    stays there untouched until it is replaced in one step. A symbolic link is replaced, not followed: who may plant one
    beside frames could otherwise have any file written over.

    Raises:
        FrameError: The block wrote nothing, or the file system refused to keep it.
    """
    folder, name = os.path.split(os.fspath(path))
    target = Path(os.path.realpath(folder or os.curdir)) / name
    work_begins()
    owner = f"{host_name()}-{os.getpid():x}-{secrets.token_hex(4)}"
    temporary = target.with_name(f".{target.stem[:40]}.{owner}.tmp{target.suffix}")
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


def check_name(path: str | os.PathLike[str]) -> None:
    """Refuses names that libraries, which take UTF-8, would not understand as Python does.

    Raises:
        InputError: The name holds bytes that are no UTF-8, or the process was started in a locale of another encoding.
    """
    text = os.fspath(path)
    if "\0" in text:
        raise InputError("is no file name (leave out the null character)", file=text)
    plain = text.isascii()
    if not plain and sys.getfilesystemencoding().lower().replace("-", "") != "utf8":
        raise InputError("needs file names in UTF-8 (set PYTHONUTF8=1, or choose a name in ASCII)", file=text)
    if not plain and any("\ud800" <= character <= "\udfff" for character in text):
        raise InputError("is no name in UTF-8 (rename it)", file=text)


def sweep_temporaries(folder: str | os.PathLike[str]) -> int:
    """Removes temporaries of :func:`complete_or_absent` from ``folder`` whose processes were killed.

    Those of processes that run on are left alone, and those of other hosts for a day.

    Returns:
        How many were removed.
    """
    removed = 0
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = _TEMPORARY.fullmatch(entry.name)
            if found and _is_abandoned(entry, found[1], int(found[2], 16)):
                with contextlib.suppress(OSError):
                    os.unlink(entry.path)
                    removed += 1
    return removed


def is_running(process: int) -> bool:
    """Whether a process of this host runs."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _is_abandoned(entry: os.DirEntry[str], host: str, process: int) -> bool:
    if host == host_name():
        return not is_running(process)
    with contextlib.suppress(OSError):
        return time.time() - entry.stat(follow_symlinks=False).st_mtime > ABANDONED_SECONDS
    return False


def host_name() -> str:
    """Eight digits that tell hosts apart, and containers, which number processes anew."""
    parts = [socket.gethostname()]
    with contextlib.suppress(OSError):
        parts.append(os.readlink("/proc/self/ns/pid"))
    return hashlib.sha256(" ".join(parts).encode("utf-8", "surrogateescape")).hexdigest()[:8]
