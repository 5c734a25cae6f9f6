"""Launches spread over threads."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.errors import InputError


def counting_kernel() -> wp.Kernel:
    @wp.kernel(module="unique", enable_backward=False)
    def count(base: int, visits: wp.array(dtype=wp.int32)):
        i = base + wp.tid()
        visits[i] = visits[i] + i + 1

    return count


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("items", [1, 511, 513, 100_003])
def test_every_item_is_visited_exactly_once(threads, items):
    launcher = Launcher("cpu", threads)
    visits = launcher.zeros(items, wp.int32)
    launcher(counting_kernel(), items, [visits])
    np.testing.assert_array_equal(visits.numpy(), np.arange(items) + 1)


def test_a_kernel_is_compiled_once_however_many_threads_launch_it():
    launcher, kernel = Launcher("cpu", 3), counting_kernel()
    launcher(kernel, 100_000, [launcher.zeros(100_000, wp.int32)])
    assert len(kernel.module.execs) == 1


def test_nothing_is_launched_for_no_items():
    Launcher("cpu", 2)(counting_kernel(), 0, [Launcher("cpu", 1).zeros(0, wp.int32)])


def test_rows_are_zeroed_arrays_of_the_structs_types():
    @wp.struct
    class Pair:
        place: wp.array(dtype=wp.vec3)
        number: wp.array(dtype=wp.int32)

    pair = Launcher("cpu", 1).rows(Pair, 5)
    assert pair.place.numpy().shape == (5, 3) and pair.number.numpy().dtype == np.int32
    assert not pair.place.numpy().any() and not pair.number.numpy().any()


def test_a_device_that_does_not_exist_is_refused():
    with pytest.raises(InputError, match="no 'cuda:77'"):
        Launcher("cuda:77")
