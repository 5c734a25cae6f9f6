"""Whatever ends a launch, no chunk of it runs afterwards."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
import time
import weakref

import numpy as np
import pytest

from tpdwarp.workers import Chunks, Workers


class Recorder:
    """Chunks that take a while and keep count of how many run; one of them may raise."""

    def __init__(self, seconds=0.02, fail=None):
        self.seconds, self.fail = seconds, fail or {}
        self.running, self.begun = 0, []
        self._lock = threading.Lock()

    def __call__(self, base):
        with self._lock:
            self.running += 1
            self.begun.append(base)
        try:
            if base in self.fail:
                raise self.fail[base]
            time.sleep(self.seconds)
        finally:
            with self._lock:
                self.running -= 1


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_every_chunk_is_run_once(count):
    recorder = Recorder(seconds=0)
    Chunks(recorder, range(count)).on(Workers(3))
    assert sorted(recorder.begun) == list(range(count))


def test_where_the_system_allows_few_threads_those_do_all(monkeypatch):
    start, started = threading.Thread.start, []

    def allowed_two(thread):
        if len(started) == 2:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", allowed_two)
    workers, recorder = Workers(8), Recorder(seconds=0)
    Chunks(recorder, range(20)).on(workers)
    assert workers.count == 2 and sorted(recorder.begun) == list(range(20))


@pytest.mark.parametrize("error", [MemoryError, KeyboardInterrupt, SystemExit, RuntimeError])
def test_a_chunk_that_raises_ends_the_launch_when_the_others_have_ended(error):
    recorder = Recorder(fail={5: error("5")})
    with pytest.raises(error):
        Chunks(recorder, range(40)).on(Workers(4))
    assert recorder.running == 0 and len(recorder.begun) < 40
    begun = len(recorder.begun)
    time.sleep(3 * recorder.seconds)
    assert len(recorder.begun) == begun


@pytest.mark.parametrize("signals", [1, 2, 3])
def test_an_interrupted_caller_goes_on_only_when_no_chunk_runs(signals):
    recorder = Recorder(seconds=0.5)

    def interrupt():
        for _ in range(signals):
            time.sleep(0.03)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    sender = threading.Thread(target=interrupt)
    try:
        sender.start()
        with pytest.raises(KeyboardInterrupt):
            Chunks(recorder, range(40)).on(Workers(2))
        running = recorder.running
    finally:
        sender.join()
        signal.signal(signal.SIGINT, before)
    assert running == 0 and len(recorder.begun) < 40


def test_workers_are_free_for_the_next_launch_after_one_that_failed():
    workers = Workers(2)
    with pytest.raises(RuntimeError):
        Chunks(Recorder(fail={0: RuntimeError()}), range(10)).on(workers)
    recorder = Recorder(seconds=0)
    Chunks(recorder, range(10)).on(workers)
    assert sorted(recorder.begun) == list(range(10))


def test_threads_end_with_their_workers_and_keep_no_launch_alive():
    before = set(threading.enumerate())
    workers = Workers(3)
    own = set(threading.enumerate()) - before
    values = np.zeros(3)
    kept = weakref.ref(values)

    def run(base, values=values):
        values[base] = 1

    Chunks(run, range(3)).on(workers)
    del run, values
    gc.collect()
    deadline = time.monotonic() + 5
    while kept() is not None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert kept() is None
    del workers
    while own & set(threading.enumerate()) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(own) == 3 and not own & set(threading.enumerate())


def test_a_process_ends_while_workers_wait():
    script = "from tpdwarp.workers import Chunks, Workers\nw = Workers(2)\nChunks(print, [1, 2]).on(w)"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=20).returncode == 0
