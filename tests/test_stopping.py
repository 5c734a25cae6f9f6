"""Signals and time limits are heard, wherever they come."""

import contextlib
import signal
import threading
import time

import pytest

from tpdwarp.device import Launcher
from tpdwarp.stopping import FrameTimeout, Stopped, raise_if_asked, signals_stop, time_limit


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_raises_and_says_which_it_was(number):
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(Stopped) as stopped, signals_stop():
            signal.raise_signal(number)
        assert stopped.value.number == number
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)


def test_a_signal_whose_exception_is_swallowed_is_heard_at_the_next_launch():
    with pytest.raises(Stopped), signals_stop():
        with contextlib.suppress(Stopped):
            signal.raise_signal(signal.SIGTERM)
        Launcher("cpu", 1)(None, 0, [])


def test_what_unwinds_is_not_disturbed_by_further_signals():
    cleaned = []
    with pytest.raises(Stopped), signals_stop():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGTERM)
            cleaned.append(True)
    assert cleaned
    raise_if_asked()


def test_ignored_signals_stay_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals_stop():
            signal.raise_signal(signal.SIGHUP)
            raise_if_asked()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_frame_over_its_time_is_interrupted_wherever_it_is():
    started = time.monotonic()
    with pytest.raises(FrameTimeout, match=r"took longer than 0\.05 s"), time_limit(0.05):
        time.sleep(30)
    assert time.monotonic() - started < 10


def test_a_frame_within_its_time_is_left_alone():
    before = signal.getsignal(signal.SIGALRM)
    with time_limit(0.2):
        pass
    time.sleep(0.3)
    raise_if_asked()
    with time_limit(None):
        pass
    assert signal.getsignal(signal.SIGALRM) is before


def test_threads_other_than_the_main_one_hear_the_limit_at_the_next_launch():
    heard = []

    def work():
        try:
            with time_limit(0.01):
                time.sleep(0.05)
                raise_if_asked()
        except FrameTimeout as error:
            heard.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert heard
