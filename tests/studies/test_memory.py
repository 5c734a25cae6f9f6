import numpy as np

from tpdwarp.studies.memory import peak_bytes, reset_peak


def test_the_peak_holds_what_was_held_and_let_go():
    reset_peak()
    before, size = peak_bytes(), 2**26
    held = np.ones(size, np.uint8)
    assert held[-1] == 1
    del held
    # A large array has pages of its own; what else the process lets go of meanwhile is less than half of it.
    assert peak_bytes() >= before + size // 2


def test_a_reset_forgets_the_peak():
    size = 2**26
    held = np.ones(size, np.uint8)
    reset_peak()
    high = peak_bytes()
    assert held[-1] == 1
    del held
    reset_peak()
    assert peak_bytes() <= high - size // 2
