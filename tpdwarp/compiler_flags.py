"""Options of kernels: what modules they lie in, and what LLVM has to be told to compile them well."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import warp as wp

# Loops of more steps are not unrolled: those over lanes, of which LLVM finds few again once they are sixteen lines; and
# those around rays, whose steps are hundreds of lines: what hides a light would not be inlined, and to copy the scene
# for each call takes as long as its ray.
MOST_UNROLLED = 4
# Functions of up to so many instructions, as LLVM weighs them, become part of those that call them. Chosen by
# measurement: camera rays over open water take .8 of the time that they take with half as many, and with twice as many
# nothing but compiling takes longer.
LARGEST_INLINED = 10000
INLINED = f"-mllvm=-inline-threshold={LARGEST_INLINED}"
# Bits of vectors where a CPU has such. LLVM prefers half of them for the sake of older ones' clocks: a footprint takes
# 1.3 times as long with it.
WIDEST_VECTORS = 512


def own_module(flags: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Of a kernel that is made for what a scene requires, in a module of its own with the options ``flags``.

    Warp hashes such a module as the kernel is defined, for its default number of threads a block, and again as it is
    loaded where that is for another, which takes a tenth of a second for the largest. A CPU has one thread a block.
    """
    return {"module": "unique", "module_options": {"block_dim": 1, **(flags or {})}, "enable_backward": False}


def lanes_in_vectors() -> dict[str, Any]:
    """Of modules whose kernels work on lanes, in loops over what is written for one of them: a function that is called
    in such a loop has to become part of it."""
    unrolled = f"-mllvm=-unroll-full-max-count={MOST_UNROLLED}"
    return _with_flags(f"-mprefer-vector-width={WIDEST_VECTORS}", unrolled, INLINED)


def calls_inlined() -> dict[str, Any]:
    """Of modules whose functions take large structures: Warp passes them by value, and to copy one takes longer than
    a ray."""
    return {"max_unroll": MOST_UNROLLED, **_with_flags(INLINED)}


def _with_flags(*flags: str) -> dict[str, Any]:
    given = "-march=native" if wp.config.cpu_compiler_flags is None else wp.config.cpu_compiler_flags
    return {"cpu_compiler_flags": " ".join([given, *flags])}
