"""The process's standard streams, made fit for printing whatever the process was started with."""

from __future__ import annotations

import os
import sys


def mend_streams() -> None:
    """Opens streams that are closed (``2>&-``) on nothing, and has others escape what they cannot encode.

    A descriptor that is closed is taken by the next file that is opened; what libraries print would go into a frame.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest that is free, which is this one.
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or getattr(stream, "closed", False):
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
