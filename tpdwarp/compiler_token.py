"""Whose turn it is to compile kernels, of several processes that start on one empty cache."""

from __future__ import annotations

import atexit
import contextlib
import os
import threading
import time
from collections.abc import Iterator

from tpdwarp.io.locks import FileLock
from tpdwarp.stopping import pause

# Another process that compiles is waited for so long, then its work is done a second time: all kernels take 15 to 100 s
# on a machine of two busy cores, and one that is starved by others must not hold everybody up.
LONGEST_WAIT_SECONDS = 100.0
POLL_SECONDS = 0.05
# A process needs its next kernel within that time of the last, so that it is not overtaken by one that would have to
# compile the headers first (2 s). Of four processes on two cores one needed 1.2 s from a kernel to the next.
KEPT_SECONDS = 4.0


class CompilerToken:
    """Held by the one process that compiles into a cache, until it has needed no kernel for a while."""

    NAME = ".tpdwarp.compiling"

    def __init__(self) -> None:
        self._lock: FileLock | None = None
        self._guard = threading.Lock()
        self._released_at = 0.0
        atexit.register(self._release)

    @contextlib.contextmanager
    def turn(self, cache: str, folder: str) -> Iterator[None]:
        """While entered, either ``folder`` is there, or nobody else compiles (or has for far too long)."""
        deadline = time.monotonic() + LONGEST_WAIT_SECONDS
        while not os.path.isdir(folder) and not self._take(cache) and time.monotonic() < deadline:
            pause(POLL_SECONDS)
        try:
            yield
        finally:
            with self._guard:
                if self._lock is not None:
                    self._released_at = time.monotonic() + KEPT_SECONDS
                    timer = threading.Timer(KEPT_SECONDS, self._release_if_idle)
                    timer.daemon = True
                    timer.start()

    def _take(self, cache: str) -> bool:
        with self._guard:
            # Not given back while this process compiles.
            self._released_at = float("inf")
            if self._lock is not None and os.path.dirname(self._lock.path) == cache:
                return True
            lock = FileLock(os.path.join(cache, self.NAME))
            if not lock.acquire():
                return False
            self._lock = lock
            return True

    def _release_if_idle(self) -> None:
        with self._guard:
            if time.monotonic() < self._released_at:
                return
        self._release()

    def _release(self) -> None:
        with self._guard:
            if self._lock is not None:
                self._lock.release()
                self._lock = None
