"""Claims on frames, so that renders that share a folder do not render a frame twice.

A claim is a hidden file beside the frame that its process holds locked. The system frees the lock however the process
ends, so that a claim never outlives its render; the file it leaves behind then is swept by the next one. A process that
lives but does nothing any more (stopped, or cut off from a file server that still holds its lock) writes no more signs
of life to the file: its claim expires, and at worst a frame is rendered twice.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
from collections.abc import Iterator

from tpdwarp.io.locks import FileLock

# A sign of life is a write of the file's time, which costs nothing beside a frame.
BEAT_SECONDS = 5.0
# Libraries may hold the interpreter for long, but seldom while so many signs of life are due.
EXPIRES_SECONDS = 6 * BEAT_SECONDS

_CLAIM = re.compile(r"\..+\.claim")


class ClaimedElsewhere(Exception):
    """Another process renders this frame."""


class Claims:
    """The claims of one sequence."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, float]] = {}

    @contextlib.contextmanager
    def held(self, path: str) -> Iterator[None]:
        """Holds the claim on the frame at ``path``, or does without where the claim of another has expired.

        Where the file system has no locks, everybody may render everything: frames are still never torn.

        Raises:
            ClaimedElsewhere: Another process holds it.
        """
        lock, ended = FileLock(claim_path(path)), threading.Event()
        # A signal may come between any two steps, also while cleaning up; further ones wait until this has unwound.
        try:
            try:
                if lock.acquire():
                    threading.Thread(target=_beat, args=(lock.path, ended), name="tpdwarp-claim", daemon=True).start()
                elif not self._expired(lock.path):
                    raise ClaimedElsewhere(path)
                yield
            finally:
                ended.set()
                lock.release()
        finally:
            ended.set()
            lock.release()

    def _expired(self, path: str) -> bool:
        """Whether a claim has shown no sign of life since it was looked at first: clocks of hosts need not agree."""
        try:
            beat = os.stat(path).st_mtime_ns
        except OSError:
            return False
        now = time.monotonic()
        last, since = self._seen.get(path, (0, now))
        if beat != last:
            self._seen[path] = beat, now
            return False
        return now - since > EXPIRES_SECONDS


def claim_path(path: str) -> str:
    """The file that claims the frame at ``path``."""
    folder, name = os.path.split(path)
    return os.path.join(folder, f".{name}.claim")


def sweep_claims(folder: str) -> None:
    """Removes claims that no process holds from ``folder``."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _CLAIM.fullmatch(entry.name):
                lock = FileLock(entry.path)
                if lock.acquire():
                    lock.release()


def _beat(path: str, ended: threading.Event) -> None:
    while not ended.wait(BEAT_SECONDS):
        with contextlib.suppress(OSError):
            os.utime(path)
