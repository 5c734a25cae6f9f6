"""Loading the renderer's modules without Python's search for cycles of references."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collector_paused() -> Iterator[None]:
    """Pauses the search for unreachable cycles within the block; what the caller switched off stays off.

    Warp keeps the syntax tree of each of its functions, so that loading makes 200 000 objects that stay. Python
    searched them 350 times for cycles meanwhile: a tenth of the time that loading took, and nothing to free.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        # What was loaded counts as old at once, instead of being searched as young twice.
        if gc.get_freeze_count() == 0:
            gc.freeze()
            gc.unfreeze()
        if was_on:
            gc.enable()
