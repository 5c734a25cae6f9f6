"""Claims on frames, so that renders that share a folder do not render a frame twice.

A claim is a hidden file beside the frame that its process holds locked. The system frees the lock however the process
ends, so that a claim never outlives its render; the file it leaves behind then is swept by the next one.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator

from tpdwarp.io.locks import FileLock

_CLAIM = re.compile(r"\..+\.claim")


class ClaimedElsewhere(Exception):
    """Another process renders this frame."""


@contextlib.contextmanager
def claimed(path: str) -> Iterator[None]:
    """Holds the claim on the frame at ``path``.

    Where the file system has no locks, everybody may render everything: frames are still never torn.

    Raises:
        ClaimedElsewhere: Another process holds it.
    """
    folder, name = os.path.split(path)
    lock = FileLock(os.path.join(folder, f".{name}.claim"))
    if not lock.acquire():
        raise ClaimedElsewhere(path)
    try:
        yield
    finally:
        lock.release()


def sweep_claims(folder: str) -> None:
    """Removes claims that no process holds from ``folder``."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _CLAIM.fullmatch(entry.name):
                lock = FileLock(entry.path)
                if lock.acquire():
                    lock.release()
