"""How many prims and meshes instances stand for, counted without visiting them: a few nested ones make billions."""

from __future__ import annotations

from collections import Counter
from graphlib import CycleError, TopologicalSorter

from pxr import Usd

from tpdwarp.errors import InputError

# A mesh of an instance that is read on its own, as glass is, takes 25 kB and 8 ms a frame, whatever its size; so many
# take as long as anybody waits.
MOST_PLACED = 1_000_000
# Prims are visited several times, some microseconds each.
MOST_PRIMS = 10_000_000


def check_native_instances(stage: Usd.Stage) -> None:
    """Refuses a stage whose native instances stand for too many prims.

    Raises:
        InputError: They do.
    """
    prototypes = stage.GetPrototypes()
    if not prototypes:
        return
    held = {str(root.GetPath()): _held(root) for root in (stage.GetPseudoRoot(), *prototypes)}
    totals: dict[str, int] = {}
    try:
        for path in TopologicalSorter({path: of for path, (_, of) in held.items()}).static_order():
            own, of = held[path]
            totals[path] = own + sum(times * totals[prototype] for prototype, times in of.items())
    except CycleError as error:
        raise InputError("is an instance that holds itself", prim=str(error.args[1][0])) from error
    refuse_too_many_prims(totals[str(stage.GetPseudoRoot().GetPath())])


def refuse_too_many_prims(count: int) -> None:
    """Refuses a stage of more than ten million prims.

    Raises:
        InputError: It has more.
    """
    if count > MOST_PRIMS:
        raise InputError(f"references and instances stand for {count:.3g} prims (at most {MOST_PRIMS}; see --mask)")


def refuse_too_many(count: int, path: str) -> None:
    """Refuses an instancer that places too many meshes.

    Args:
        count: How many.
        path: Its prim.

    Raises:
        InputError: There are more than a million.
    """
    if count > MOST_PLACED:
        raise InputError(f"places {count:.3g} meshes (at most {MOST_PLACED}; see --mask)", prim=path)


def _held(root: Usd.Prim) -> tuple[int, Counter[str]]:
    """How many prims lie below ``root``, and how often each prototype is among them."""
    count, of = 0, Counter()
    for prim in Usd.PrimRange(root):
        count += 1
        if prim.IsInstance():
            of[str(prim.GetPrototype().GetPath())] += 1
    return count, of
