"""Who compiles a kernel, of several processes that want it at once."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator

from tpdwarp.io.locks import FileLock
from tpdwarp.stopping import pause

# Another process that compiles a kernel is waited for so long, then its work is done a second time: the largest takes
# 12 s, and one that is starved by others must not hold everybody up.
LONGEST_WAIT_SECONDS = 100.0
POLL_SECONDS = 0.05


def lock_of(folder: str) -> FileLock:
    """The lock that is held by who compiles the module that ``folder`` will hold."""
    return FileLock(f"{folder}.compiling")


@contextlib.contextmanager
def compiled_once(folder: str) -> Iterator[None]:
    """While entered, either ``folder`` is there, or nobody else compiles it (or has for far too long).

    Other modules may be compiled meanwhile: processes that do the same thing wait for each other, those that do
    something else do not.
    """
    lock = lock_of(folder)
    deadline = time.monotonic() + LONGEST_WAIT_SECONDS
    while not os.path.isdir(folder) and not lock.acquire() and time.monotonic() < deadline:
        pause(POLL_SECONDS)
    try:
        yield
    finally:
        lock.release()
