"""Reading stages and writing debug layers: the only package that imports ``pxr``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tpdwarp.usd.read.stage import StageScene

__all__ = ["StageScene"]


def __getattr__(name: str) -> Any:
    if name == "StageScene":
        from tpdwarp.usd.read.stage import StageScene

        return StageScene
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
