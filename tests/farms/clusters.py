"""Schedulers and workers as processes of their own, which can be killed and stopped."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import tpdwarp

ROOT = Path(tpdwarp.__file__).parent.parent
# Dask's own patience is five minutes with workers that say nothing.
QUICK = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "8s", "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s"}


class Cluster:
    """A scheduler on a port of its own, and workers that are started one by one.

    Args:
        folder: Where workers keep what they spill.
        protocol: ``tcp`` or ``tls``.
        options: Further options of both.
    """

    def __init__(self, folder: Path, protocol: str = "tcp", options: tuple[str, ...] = ()) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address = f"{protocol}://127.0.0.1:{port}"
        self._folder, self._options, self._port = folder, options, port
        self.scheduler: subprocess.Popen | None = None
        self.workers: list[subprocess.Popen] = []

    def start_scheduler(self) -> None:
        host = ["--host", self.address.rsplit(":", 1)[0], "--port", self._port, "--dashboard-address", "127.0.0.1:0"]
        self.scheduler = self._start("scheduler", *host)

    def start_worker(self, *options: object, **changes: str) -> None:
        limits = ["--nthreads", 1, "--local-directory", self._folder, "--death-timeout", 120]
        self.workers.append(self._start("worker", self.address, *limits, *options, **changes))

    def stop(self) -> None:
        for process in [self.scheduler, *self.workers]:
            if process is not None:
                # Nannies have workers below them.
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def _start(self, kind: str, *arguments: object, **changes: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", kind, *map(str, (*arguments, *self._options))],
            env={**os.environ, "PYTHONPATH": str(ROOT), **QUICK, **changes},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )


@contextlib.contextmanager
def cluster(folder: Path, workers: int, **options) -> Iterator[Cluster]:
    """A scheduler with ``workers`` workers, killed afterwards with all that they have started."""
    made = Cluster(folder, **options)
    try:
        made.start_scheduler()
        for _ in range(workers):
            made.start_worker()
        yield made
    finally:
        made.stop()
