"""What is loaded without the search for cycles is not searched as young afterwards either."""

import gc

import pytest

from tpdwarp.loading import collector_paused


@pytest.fixture
def collector():
    was_on = gc.isenabled()
    gc.enable()
    yield
    gc.unfreeze()
    (gc.enable if was_on else gc.disable)()


def is_young(made: object) -> bool:
    return any(one is made for generation in (0, 1) for one in gc.get_objects(generation))


def test_what_was_loaded_is_old_at_once_and_can_be_freed(collector):
    with collector_paused():
        assert not gc.isenabled()
        made = [[] for _ in range(10)]
    assert gc.isenabled()
    assert not is_young(made)
    assert gc.get_freeze_count() == 0


def test_what_a_caller_froze_stays_frozen(collector):
    made = [[]]
    gc.freeze()
    with collector_paused():
        pass
    # What is frozen is of no generation.
    assert not any(one is made for one in gc.get_objects())


def test_a_collector_that_is_off_stays_off(collector):
    gc.disable()
    with collector_paused():
        pass
    assert not gc.isenabled()
