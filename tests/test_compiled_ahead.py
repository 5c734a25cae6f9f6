"""Kernels are compiled by another thread ahead of their use, once, and by whoever wants them sooner."""

import threading
import time

import pytest

from tpdwarp.compiled_ahead import CompiledAhead


class Module:
    """Stands in for a module of kernels."""

    def __init__(self):
        self.forgotten = 0

    def mark_modified(self):
        self.forgotten += 1


def compilers():
    return [thread for thread in threading.enumerate() if thread.name == "tpdwarp-compile"]


@pytest.fixture
def held():
    """Compiles as long as it is held: what was begun, how to let it end, and the modules' keeper."""
    begun, go = [], threading.Event()

    def compile_module(module):
        begun.append(module)
        assert go.wait(30)
        if module.forgotten < 0:
            raise RuntimeError("no such function")

    yield begun, go, CompiledAhead(compile_module)
    go.set()
    for thread in compilers():
        thread.join(30)


def until(condition):
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def test_one_that_is_not_begun_is_taken_back_and_one_that_is_is_waited_for(held):
    begun, go, ahead = held
    first, second, other = Module(), Module(), Module()
    ahead.add(first)
    ahead.add(second)
    until(lambda: begun == [first])
    ahead.claim(second)
    ahead.claim(other)
    threading.Timer(0.1, go.set).start()
    ahead.claim(first)
    assert go.is_set() and begun == [first]
    until(lambda: not compilers())


def test_what_fails_is_tried_again_by_whoever_wants_it_and_the_next_is_compiled(held):
    begun, go, ahead = held
    wrong, right = Module(), Module()
    wrong.forgotten = -1
    go.set()
    ahead.add(wrong)
    until(lambda: not compilers())
    ahead.add(right)
    until(lambda: begun == [wrong, right] and not compilers())
    assert (wrong.forgotten, right.forgotten) == (0, 0)
