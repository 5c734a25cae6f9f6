"""Dask clusters: one of this machine's processes, or one that somebody else has started."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass

import dask
from distributed import Client, LocalCluster
from distributed.security import Security

from tpdwarp.errors import InputError

LOOPBACK = "127.0.0.1"
# A scheduler that a service manager or a batch system starts anew is back within that.
CONNECT_SECONDS = 10.0
# How long an orderly end may take; what is left then is killed.
CLOSE_SECONDS = 1.0
# Dask samples the stack of its workers a hundred times a second and has their allocator give every freed block back,
# which costs frames of large arrays a quarter of their processor time; both are of use to graphs of many small tasks.
FOR_FRAMES = {
    "distributed.worker.profile.enabled": False,
    "distributed.nanny.pre-spawn-environ": {name: 1 for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")},
}


@dataclass(frozen=True)
class Tls:
    """Certificates in PEM files, with which clients, schedulers and workers trust each other, and nobody else.

    Attributes:
        ca: Those that sign the others.
        certificate: This machine's.
        key: Its key.
    """

    ca: str
    certificate: str
    key: str

    def security(self) -> Security:
        """Dask's configuration for all roles, which refuses connections that are not encrypted.

        Raises:
            InputError: A file cannot be read.
        """
        for path in (self.ca, self.certificate, self.key):
            if not os.path.isfile(path):
                raise InputError("no such certificate or key", file=path)
        roles = {}
        for role in ("client", "scheduler", "worker"):
            roles[f"tls_{role}_cert"], roles[f"tls_{role}_key"] = self.certificate, self.key
        return Security(require_encryption=True, tls_ca_file=self.ca, **roles)


@contextlib.contextmanager
def local_cluster(workers: int, memory: float, dashboard: str, tls: Tls | None) -> Iterator[str]:
    """A scheduler and workers of one thread each on this machine, reachable from it alone.

    Args:
        workers: How many.
        memory: Bytes that all of them may take; a worker that takes more than its part is started anew.
        dashboard: Where the dashboard listens, ``host:port``; empty takes any port of this machine's own.
        tls: Certificates; None for connections that every user of this machine could open.

    Yields:
        The scheduler's address.
    """
    _hush()
    dask.config.set(FOR_FRAMES)
    cluster = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host=LOOPBACK if tls is None else f"tls://{LOOPBACK}",
        dashboard_address=dashboard or f"{LOOPBACK}:0",
        memory_limit=int(memory / workers),
        silence_logs=logging.CRITICAL,
        security=None if tls is None else tls.security(),
    )
    # It is closed below; the end of the program need not try again, and wait ten seconds for what was killed.
    cluster.shutdown_on_close = False
    try:
        yield cluster.scheduler_address
    except BaseException:
        # Frames in hand are dropped: nobody waits for them any more.
        _kill_workers()
        raise
    finally:
        with contextlib.suppress(Exception):
            cluster.close(timeout=CLOSE_SECONDS)
        _kill_workers()


def connected(address: str, tls: Tls | None) -> Client:
    """A client of the scheduler at ``address``.

    Raises:
        OSError: There is none, or it does not trust us.
        ValueError: The address is none.
    """
    _hush()
    security = None if tls is None else tls.security()
    return Client(address, timeout=CONNECT_SECONDS, security=security, set_as_default=False)


def _hush() -> None:
    """What Dask says of workers that come and go is said by us, in one line."""
    for name in ("distributed", "asyncio", "tornado", "bokeh"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    dask.config.set({"logging.distributed": "critical"})


def _kill_workers() -> None:
    for process in multiprocessing.active_children():
        with contextlib.suppress(OSError):
            os.kill(process.pid, signal.SIGKILL)
