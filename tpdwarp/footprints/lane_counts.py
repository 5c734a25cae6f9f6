"""Functions and structures of lanes: there is one of each for each number of lanes that a device wants.

They are written once, in terms of ``Lanes`` and of each other; for a number of lanes each is built again with these
names as they are for that number. Warp's own generics would do so from the types of arguments, yet a module's hash,
and with it whether compiled kernels are found again, would depend on what else a process has run.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from types import FunctionType
from typing import Any

import warp as wp

from tpdwarp.compiler_flags import own_module


class PerLaneCount:
    """What there is one of for each number of lanes.

    Args:
        make: Makes the one for a number of lanes.
    """

    def __init__(self, make: Callable[[int], Any]) -> None:
        self._make = make
        self._made: dict[int, Any] = {}

    def of(self, count: int) -> Any:
        """The one for ``count`` lanes, made when first asked for."""
        if count not in self._made:
            self._made[count] = self._make(count)
        return self._made[count]


def for_lanes(function: Callable, count: int) -> FunctionType:
    """The Python function with all that it names as it is for ``count`` lanes."""
    named = _with_lanes(function.__globals__, {*function.__code__.co_names, *_words(function)}, count)
    out = FunctionType(function.__code__, named, function.__name__, function.__defaults__, function.__closure__)
    out.__qualname__ = f"{function.__qualname__}_{count}"
    out.__doc__ = function.__doc__
    out.__annotations__ = dict(function.__annotations__)
    return out


def lane_func(function: Callable) -> PerLaneCount:
    """A Warp function for each number of lanes."""
    return PerLaneCount(lambda count: wp.func(for_lanes(function, count)))


def func_of_lanes(count: int) -> Callable[[Callable], wp.Function]:
    """A Warp function for one number of lanes: of those that are made for each form of footprint."""
    return lambda function: wp.func(for_lanes(function, count))


def func_native(value: str) -> Callable[[Callable], PerLaneCount]:
    """The same in C++: the statements ``value``, with {count} in them for the number of lanes.

    Warp reads in the source how a function is decorated: with what is called ``func_native`` in a module.
    """

    def decorated(function: Callable) -> PerLaneCount:
        return PerLaneCount(
            lambda count: wp.func_native(value.replace("{count}", str(count)))(for_lanes(function, count))
        )

    return decorated


def kernel_of_lanes(count: int, flags: Mapping[str, Any] | None = None) -> Callable[[Callable], wp.Kernel]:
    """A kernel in a module of its own for one number of lanes, with the options ``flags``."""
    return lambda function: wp.kernel(**own_module(flags))(for_lanes(function, count))


def lane_kernel(function: Callable) -> PerLaneCount:
    """Such a kernel for each number of lanes."""
    return PerLaneCount(lambda count: kernel_of_lanes(count)(function))


def lane_struct(given: type) -> PerLaneCount:
    """A Warp structure for each number of lanes."""

    def make(count: int) -> Any:
        named = _with_lanes(vars(sys.modules[given.__module__]), _words(given), count)
        types = inspect.get_annotations(given, globals=named, eval_str=True)
        body = {"__annotations__": types, "__doc__": given.__doc__, "__module__": given.__module__}
        return wp.struct(type(f"{given.__name__}_{count}", (), body))

    return PerLaneCount(make)


def _words(given: Callable) -> set[str]:
    """What the annotations of a function or structure name."""
    return {word for annotation in given.__annotations__.values() for word in re.findall(r"\w+", annotation)}


def _with_lanes(module: Mapping[str, Any], names: Iterable[str], count: int) -> dict[str, Any]:
    """What a module holds, with those of ``names`` that there is one of for each number of lanes."""
    out = dict(module)
    for name in names:
        if isinstance(out.get(name), PerLaneCount):
            out[name] = out[name].of(count)
    return out
