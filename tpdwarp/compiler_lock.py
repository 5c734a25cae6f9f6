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
# Who compiles for the first time makes the compiler's headers (2 s). One that has made them already takes the next
# kernel within that time: of four processes on two cores one needed 1.2 s from a kernel to the next.
HEADER_SECONDS = 2.0


def lock_of(folder: str) -> FileLock:
    """The lock that is held by who compiles the module that ``folder`` will hold."""
    return FileLock(f"{folder}.compiling")


class Compilers:
    """The processes that compile into a cache, as one of them sees them."""

    def __init__(self) -> None:
        self._has_headers = self._waited = False

    @contextlib.contextmanager
    def compiled_once(self, folder: str) -> Iterator[None]:
        """While entered, either ``folder`` is there, or nobody else compiles it (or has for far too long).

        Other modules may be compiled meanwhile: processes that do the same thing wait for each other, those that do
        something else do not.
        """
        lock = lock_of(folder)
        now = time.monotonic()
        deadline = now + LONGEST_WAIT_SECONDS
        begins = now + HEADER_SECONDS if self._waited and not self._has_headers else now
        while not os.path.isdir(folder):
            now = time.monotonic()
            if now >= deadline or (now >= begins and lock.acquire()):
                self._has_headers = True
                break
            self._waited = True
            pause(POLL_SECONDS)
        try:
            yield
        finally:
            lock.release()
