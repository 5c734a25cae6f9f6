"""Exit codes, and whether tracebacks are wanted."""

from __future__ import annotations

import os

DONE = 0
FAILED = 1
REFUSED = 2
# What shells report of a process that a signal ended: 130 after SIGINT, 143 after SIGTERM, 129 after SIGHUP.
SIGNALLED = 128


def debugging() -> bool:
    """Whether ``TPDWARP_DEBUG`` asks for tracebacks."""
    return os.environ.get("TPDWARP_DEBUG", "0") not in ("", "0")
