"""Devices and threads: every kernel launch is spread over all cores here.

Warp runs a CPU launch on one thread but releases the interpreter while it does, so a launch is cut into chunks that
Python threads work through. Kernels therefore take ``base`` as their first argument and work on item
``base + wp.tid()``; they write disjoint outputs only, so that the pixels do not depend on the number of threads.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from copy import copy
from typing import Any

import numpy as np
import warp as wp

from tpdwarp.errors import InputError
from tpdwarp.kernel_cache import KernelCache
from tpdwarp.stopping import raise_if_asked
from tpdwarp.workers import Chunks, Workers

CHUNKS_PER_THREAD = 16
SMALLEST_CHUNK = 512
# Threads a block on a GPU: few, so that launches of some thousand paths reach all multiprocessors.
GPU_BLOCK = 64

wp.config.log_level = wp.LOG_WARNING
wp.config.enable_backward = False

_cache = KernelCache()


@contextmanager
def _without_native_stderr() -> Iterator[None]:
    """Drops what native code prints to stderr: Warp's warns wherever there is no GPU driver, asked for or not."""
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:
        # There is no stderr, so nothing has to be dropped.
        yield
        return
    elsewhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(elsewhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(elsewhere)


class Launcher:
    """Runs kernels on one device.

    Args:
        device: Warp device name.
        threads: CPU threads, 0 for all cores; ignored on a GPU.

    Raises:
        InputError: The device does not exist.
    """

    def __init__(self, device: str = "cpu", threads: int = 0) -> None:
        _cache.start_warp(_without_native_stderr if device == "cpu" else nullcontext)
        try:
            self.device = wp.get_device(device)
        except Exception as error:
            raise InputError(f"--device: there is no {device!r} here (try cpu)") from error
        count = threads or len(os.sched_getaffinity(0))
        self.threads = 1 if self.device.is_cuda else count
        self._workers = Workers(self.threads) if self.threads > 1 else None

    def __call__(
        self,
        kernel: wp.Kernel,
        count: int,
        inputs: Sequence[Any],
        smallest_chunk: int = SMALLEST_CHUNK,
        in_turn: bool = False,
    ) -> None:
        """Launches ``kernel`` over ``count`` items; ``base`` is put in front of ``inputs``.

        However this ends, by an interruption too, no thread runs the kernel afterwards, so that arrays and meshes may
        be freed.

        Args:
            in_turn: Whether the kernel takes a second argument, how many items a thread works through, the first of
                them ``base + wp.tid() * in_turn``: all of a chunk on the CPU, where Warp copies a kernel's arguments
                anew for each thread, which of large structures takes longer than a ray.

        Raises:
            Stopped: A signal asked the process to end.
            FrameTimeout: The frame's time limit has passed.
        """
        raise_if_asked()
        if count <= 0:
            return
        if self.device.is_cuda:
            _cache.load(kernel.module, self.device, GPU_BLOCK)
            given = [0, *([1] if in_turn else []), *inputs]
            wp.launch(kernel, dim=count, inputs=given, device=self.device, block_dim=GPU_BLOCK)
            return
        # Loaded once, as a launch on the CPU would (one thread a block), or each thread compiles it again.
        _cache.load(kernel.module, self.device, 1)
        chunk = max(smallest_chunk, -(-count // (self.threads * CHUNKS_PER_THREAD)))

        # Arguments are packed once for all chunks, which takes longer than to trace a few paths.
        given = [0, *([0] if in_turn else []), *inputs]
        packed = wp.launch(kernel, dim=1, inputs=given, device=self.device, record_cmd=True)

        def run(base: int) -> None:
            items = min(chunk, count - base)
            # Each thread sets arguments of its own.
            command = copy(packed)
            command.params = list(packed.params)
            command.set_param_at_index(0, base)
            if in_turn:
                command.set_param_at_index(1, items)
            else:
                command.set_dim(items)
            command.launch()

        bases = range(0, count, chunk)
        # A single chunk is done sooner than handed over.
        if self._workers is not None and len(bases) > 1:
            Chunks(run, bases).on(self._workers)
            return
        # One thread takes chunks as well, for an interruption is heard between them only.
        for base in bases:
            raise_if_asked()
            run(base)

    def array(self, values: np.ndarray, dtype: Any) -> wp.array:
        """A device copy (a view on the CPU) of ``values``."""
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device, copy=self.device.is_cuda)

    def zeros(self, count: int, dtype: Any) -> wp.array:
        return wp.zeros(count, dtype=dtype, device=self.device)

    def empty(self, count: int, dtype: Any) -> wp.array:
        return wp.empty(count, dtype=dtype, device=self.device)

    def rows(self, struct: Any, count: int, but: Sequence[str] = (), zeroed: bool = True) -> Any:
        """An instance of a Warp struct of arrays, every array with ``count`` rows ``but`` those named."""
        instance = struct()
        for name, variable in struct.vars.items():
            if name not in but:
                setattr(instance, name, (self.zeros if zeroed else self.empty)(count, variable.type.dtype))
        return instance

    def rows_of(self, array: wp.array, rows: np.ndarray | slice) -> np.ndarray:
        """Some rows of an array of one dimension, on the host; from a GPU nothing else is copied.

        Of a slice it is a view on the CPU.
        """
        if isinstance(rows, slice):
            return array[rows].numpy()
        if not self.device.is_cuda:
            return array.numpy().take(rows, axis=0)
        return wp.indexedarray(array, [self.array(rows.astype(np.int32), wp.int32)]).numpy()
