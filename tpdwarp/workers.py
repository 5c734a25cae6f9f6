"""Threads that work through the chunks of a launch, and have all stopped when it is over.

Locks here are those that the interpreter takes and frees in one step (``threading.Lock``, ``queue.SimpleQueue``), not
``Condition`` nor ``Semaphore``: a signal's handler may raise between any two steps of those, which leaves them locked.
"""

from __future__ import annotations

import queue
import threading
import time
import weakref
from collections.abc import Callable, Sequence

# Chunks take milliseconds to a second; looking for their end this often costs nothing beside them.
POLL_SECONDS = 0.002


class Workers:
    """Threads that end with the object.

    Args:
        count: How many threads; there are fewer where the system allows no more.

    Raises:
        RuntimeError: It allows none.
    """

    def __init__(self, count: int) -> None:
        self.count = 0
        self._tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        try:
            while self.count < count:
                # Daemons, for an interpreter that ends must not wait for threads that wait for it.
                threading.Thread(target=_work_off, args=(self._tasks,), name="tpdwarp-launch", daemon=True).start()
                self.count += 1
        except RuntimeError:
            if self.count == 0:
                raise
        weakref.finalize(self, _dismiss, self._tasks, self.count)

    def submit(self, task: Callable[[], None]) -> None:
        """Has ``task``, which must not raise, called once by one of the threads."""
        self._tasks.put(task)


class Chunks:
    """The chunks of one launch, taken by several threads until none is left or one fails.

    A kernel is given meshes and trees by their numbers, which keep nothing alive: a caller that unwinds while a chunk
    runs frees what the chunk reads, and the process dies. :meth:`on` therefore returns, or raises, only when no chunk
    runs and none will begin.

    Args:
        run: Works on the chunk that begins at an item.
        bases: First items of the chunks.
    """

    def __init__(self, run: Callable[[int], None], bases: Sequence[int]) -> None:
        self._run, self._bases = run, iter(bases)
        self._count = self._left = len(bases)
        self._running = 0
        self._stopped = False
        self._error: BaseException | None = None
        self._lock = threading.Lock()
        self._over: queue.SimpleQueue[None] = queue.SimpleQueue()

    def on(self, workers: Workers) -> None:
        """Works through the chunks.

        Raises:
            BaseException: What a chunk raised first, or what interrupted the wait.
        """
        try:
            for _ in range(min(workers.count, self._count)):
                workers.submit(self._work)
            self._over.get()
        finally:
            self._stop()
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        while (base := self._next()) is not None:
            error = None
            try:
                self._run(base)
            except BaseException as raised:
                error = raised
            with self._lock:
                self._running -= 1
                self._left -= 1
                if error is not None and self._error is None:
                    self._error = error
                if self._left == 0 or error is not None:
                    self._over.put(None)

    def _next(self) -> int | None:
        with self._lock:
            base = None if self._stopped or self._error is not None else next(self._bases, None)
            self._running += base is not None
            return base

    def _stop(self) -> None:
        """Lets no chunk begin any more, and waits for those that run, however often the wait is interrupted."""
        interruption: BaseException | None = None
        while True:
            try:
                with self._lock:
                    self._stopped = True
                    running = self._running
                if running == 0:
                    break
                time.sleep(POLL_SECONDS)
            except BaseException as raised:
                interruption = raised
        if interruption is not None:
            raise interruption


def _work_off(tasks: queue.SimpleQueue[Callable[[], None] | None]) -> None:
    while (task := tasks.get()) is not None:
        task()
        # A thread that waits must not keep the arrays of its last launch.
        del task


def _dismiss(tasks: queue.SimpleQueue[Callable[[], None] | None], count: int) -> None:
    for _ in range(count):
        tasks.put(None)
