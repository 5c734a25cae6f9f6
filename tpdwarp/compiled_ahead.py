"""Kernels that a thread of its own compiles while others are compiled, or used, that come before them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

import warp as wp

from tpdwarp.errors import logger
from tpdwarp.stopping import pause

POLL_SECONDS = 0.01


class CompiledAhead:
    """The modules that are to be compiled, and the thread that does so while there are any.

    Args:
        compile_module: Compiles one.
    """

    def __init__(self, compile_module: Callable[[wp.Module], None]) -> None:
        self._compile = compile_module
        self._waiting: deque[wp.Module] = deque()
        self._current: wp.Module | None = None
        self._lock = threading.Lock()

    def add(self, module: wp.Module) -> None:
        """Has a module compiled; whoever wants it meanwhile claims it first."""
        with self._lock:
            begins = not self._waiting and self._current is None
            self._waiting.append(module)
        if begins:
            # No daemon: the compiler must not be at work while the interpreter ends.
            threading.Thread(target=self._work_off, name="tpdwarp-compile").start()

    def claim(self, module: wp.Module) -> None:
        """Takes a module back that is not begun yet; waits for one that is being compiled.

        Raises:
            Stopped: A signal asked the process to end.
        """
        with self._lock:
            if module in self._waiting:
                self._waiting.remove(module)
        while self._current is module:
            pause(POLL_SECONDS)

    def _work_off(self) -> None:
        while True:
            with self._lock:
                if not self._waiting or not threading.main_thread().is_alive():
                    self._waiting.clear()
                    self._current = None
                    return
                self._current = self._waiting.popleft()
            try:
                self._compile(self._current)
            except Exception as error:
                # Whoever wants it tries again, and says so. What failed once is remembered, and not tried again.
                logger.debug("compiled ahead", exc_info=error)
                self._current.mark_modified()
