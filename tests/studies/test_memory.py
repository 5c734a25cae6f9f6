import mmap

import numpy as np

from tpdwarp.studies.memory import peak_bytes, reset_peak

SIZE = 2**26


def held() -> mmap.mmap:
    """Pages of their own, all in use; what an allocator has kept from before must not serve for them."""
    pages = mmap.mmap(-1, SIZE)
    np.frombuffer(pages, np.uint8)[:] = 1
    return pages


def test_the_peak_holds_what_was_held_and_let_go():
    reset_peak()
    before = peak_bytes()
    held().close()
    # What else the process lets go of meanwhile is less than half of it.
    assert peak_bytes() >= before + SIZE // 2


def test_a_reset_forgets_the_peak():
    pages = held()
    reset_peak()
    high = peak_bytes()
    pages.close()
    reset_peak()
    assert peak_bytes() <= high - SIZE // 2
