"""Exit codes, and whether tracebacks are wanted."""

from __future__ import annotations

import os

DONE = 0
FAILED = 1
REFUSED = 2
INTERRUPTED = 130


def debugging() -> bool:
    """Whether ``TPDWARP_DEBUG`` asks for tracebacks."""
    return os.environ.get("TPDWARP_DEBUG", "0") not in ("", "0")
