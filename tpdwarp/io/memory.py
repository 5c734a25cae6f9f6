"""How much memory this program may take."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

# What is left to the system, to other programs and to the file cache.
SHARE = 0.75
# Where groups of processes have limits of their own: version 2, then version 1.
_GROUP_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def memory_allowed(most: float | None) -> float:
    """Bytes that rendering may take: ``most``, or three quarters of this machine's, or of its container's."""
    return most if most is not None else SHARE * machine_memory()


def machine_memory() -> float:
    """Bytes of memory that this machine has, or that the container has in which this process runs."""
    found = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for path in _GROUP_LIMITS:
        # Where there is no limit it says ``max``, or a number beyond all machines.
        with contextlib.suppress(OSError, ValueError):
            found.append(int(Path(path).read_text()))
    return min(found)
