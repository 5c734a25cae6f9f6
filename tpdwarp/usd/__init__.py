"""Reading stages and writing debug layers: the only package that imports ``pxr``."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tpdwarp.usd.read.stage import StageScene

__all__ = ["StageScene"]

# A crate that is truncated while it is read through a memory map ends the process; read by calls, it is an error.
os.environ.setdefault("USDC_USE_PREAD", "1")


def __getattr__(name: str) -> Any:
    if name == "StageScene":
        from tpdwarp.usd.read.stage import StageScene

        return StageScene
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
