"""Precompiled headers of the compiler, in folders that say whose they are: those of who was killed can be swept."""

from __future__ import annotations

import atexit
import contextlib
import glob
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator

from tpdwarp.io.files import host_name, is_running


class Headers:
    """Where this process keeps them. Each thread that compiles makes its own (2 s), below the temporary folder."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entered = 0
        self._before: str | None = None

    @contextlib.contextmanager
    def own(self) -> Iterator[None]:
        """Has Warp make its headers in a folder of this process, which is removed as it ends."""
        self._enter()
        try:
            yield
        finally:
            with self._lock:
                self._entered -= 1
                if not self._entered:
                    tempfile.tempdir = self._before

    def _enter(self) -> None:
        with self._lock:
            self._entered += 1
            if self._entered > 1:
                return
            self._before = tempfile.tempdir
            folder = os.path.join(tempfile.gettempdir(), f"tpdwarp-headers-{host_name()}-{os.getpid()}")
            made = not os.path.isdir(folder)
            with contextlib.suppress(OSError):
                os.makedirs(folder, mode=0o700, exist_ok=True)
                tempfile.tempdir = folder
                if made:
                    atexit.register(shutil.rmtree, folder, ignore_errors=True)


def sweep_headers() -> None:
    """Removes those of processes that are gone."""
    for left in glob.glob(os.path.join(glob.escape(tempfile.gettempdir()), f"tpdwarp-headers-{host_name()}-*")):
        number = left.rsplit("-", 1)[-1]
        if number.isdigit() and not is_running(int(number)):
            shutil.rmtree(left, ignore_errors=True)
