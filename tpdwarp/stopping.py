"""Stopping in an orderly way: signals and time limits, heard wherever a frame can be left.

A signal's handler may raise anywhere, and what it raises may be swallowed: by a library that is being imported, by
a destructor, by a callback from native code. Handlers here therefore also remember the signal, and
:func:`raise_if_asked`, which launches and frame loops call, raises for one that went unheard.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from tpdwarp.errors import FrameError

# Signals that ask a process to end: by a terminal, by a farm or a service manager, by a terminal that is gone.
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

# Cleaning up takes less than that; who sends a second signal later wants the process gone whatever it is doing.
PATIENCE_SECONDS = 2.0

_IMPORTING = "<frozen importlib._bootstrap"


class Stopped(KeyboardInterrupt):
    """A signal asked the process to end.

    Args:
        number: Which.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(signal.Signals(number).name)


class FrameTimeout(FrameError):
    """A frame took longer than it may."""


class _State:
    """What was asked for, and since when; one a process, as handlers of signals are."""

    signal_number: int | None = None
    asked_at = 0.0
    deadline: float | None = None
    limit = 0.0
    leave: Callable[[int], None] | None = None
    working = False


_state = _State()


@contextmanager
def signals_stop(leave: Callable[[int], None] | None = None) -> Iterator[None]:
    """While entered, SIGINT, SIGTERM and SIGHUP raise :class:`Stopped` in the main thread.

    Signals that are ignored stay so (``nohup``, jobs in the background). Elsewhere than in the main thread, which
    alone may handle signals, this does nothing.

    Args:
        leave: Ends the process, given the signal. Called for one that comes while modules are still being imported and
            nothing has begun that would have to be cleaned up: imports take seconds, and cannot be left half way. With
            it, signals are ignored afterwards, for then only the interpreter's end follows; without, they do what they
            did before.
    """
    before = {}
    _state.signal_number, _state.leave, _state.working = None, leave, False
    try:
        for number in SIGNALS:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, _on_signal)
    except ValueError:
        pass
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if leave is None else signal.SIG_IGN)
        _state.signal_number = _state.leave = None


def work_begins() -> None:
    """Says that from now on there may be something to clean up."""
    _state.working = True


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """While entered, :class:`FrameTimeout` is raised once ``seconds`` have gone; None sets no limit.

    In the main thread it interrupts Python wherever it is; in others the next :func:`raise_if_asked` raises it. Native
    code is left to end by itself.
    """
    if seconds is None:
        yield
        return
    armed = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGALRM, _on_alarm) if armed else None
    _state.deadline, _state.limit = time.monotonic() + seconds, seconds
    try:
        if armed:
            signal.setitimer(signal.ITIMER_REAL, seconds)
        yield
    finally:
        _state.deadline = None
        if armed:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def raise_if_asked() -> None:
    """Raises what was asked for and not heard yet.

    Raises:
        Stopped: A signal came.
        FrameTimeout: The time limit has passed.
    """
    if _state.signal_number is not None:
        raise Stopped(_state.signal_number)
    if _state.deadline is not None and time.monotonic() > _state.deadline:
        raise _timeout()


def pause(seconds: float) -> None:
    """Sleeps, but not past a signal.

    Raises:
        Stopped: A signal came.
    """
    raise_if_asked()
    time.sleep(seconds)
    raise_if_asked()


def _on_signal(number: int, frame: FrameType | None) -> None:
    now = time.monotonic()
    # Once it unwinds it must not be disturbed, or what it cleans up stays behind.
    unwinding = _state.signal_number is not None and now - _state.asked_at < PATIENCE_SECONDS
    if _state.signal_number is None:
        _state.signal_number, _state.asked_at = number, now
    if unwinding:
        return
    if not _importing(frame):
        raise Stopped(_state.signal_number)
    if _state.leave is not None and not _state.working:
        _state.leave(number)


def _on_alarm(number: int, frame: FrameType | None) -> None:
    # Without a deadline the frame has just ended in time.
    if _state.deadline is not None and _state.signal_number is None and not _importing(frame):
        raise _timeout()


def _timeout() -> FrameTimeout:
    return FrameTimeout(f"took longer than {_state.limit:g} s (give it more --frame-timeout)")


def _importing(frame: FrameType | None) -> bool:
    """Whether a module is being imported: left half way, it cannot be imported again, and the error may be lost."""
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORTING):
            return True
        frame = frame.f_back
    return False
