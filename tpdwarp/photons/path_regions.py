"""Regions of rows, in each of which one thread traces some paths and all that branches from them.

Traced in passes, each over all paths that branched from those of the pass before, a lattice takes a launch for every
generation, and the late ones hold few paths: inside of glass most launches trace less than what they cost. So a thread
is given a region: some paths, and room to which what branches from them is added. Where the room ends, what is left
goes on in a region of the next launch. Which paths share a region, and so the order of rows, does not depend on the
number of threads.

Rows that the regions are given come first, one region after the other, and the room of all of them behind: where
nothing branches, columns of what was traced are taken as they lie.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.photons.branching import MOST_DECISIONS
from tpdwarp.photons.path_state import PathState
from tpdwarp.photons.photon_map import MOST_VERTICES

VERTICES = wp.constant(MOST_VERTICES)
# Paths that a region is given: on the CPU few enough that two threads share a thousand, on a GPU, where all threads
# run at once, one (of the tumbler with 16 384 photons an H200 traces a further frame in 2.7 s so, in 3.8 s with four).
GIVEN, GIVEN_ON_A_GPU = 256, 1
# Rows that a region has for each of them; the ball of glass of ``usd_scenes.solids`` fills three.
ROWS = 4
# Rows that are free before a path is traced: as many as may branch from it.
SPARE = int(MOST_DECISIONS)


@wp.struct
class PathQueue:
    """Paths that wait, one a row.

    ``cell`` is where each starts on the light and ``mask`` how it branches; where ``resumes`` is 1 it goes on from
    ``states``, else from the light. ``vertices`` are those behind it, where they are recorded. Of each region ``done``
    is how many of its rows were traced, and ``used`` how many hold a path. All regions are given ``count`` paths, each
    but the last ``given`` of them, and ``room`` rows for what branches.
    """

    cell: wp.array(dtype=wp.int32)
    mask: wp.array(dtype=wp.int32)
    resumes: wp.array(dtype=wp.int32)
    states: wp.array(dtype=PathState)
    vertices: wp.array(dtype=wp.vec3)
    done: wp.array(dtype=wp.int32)
    used: wp.array(dtype=wp.int32)
    count: int
    given: int
    room: int


@wp.func
def given_to(paths: PathQueue, region: int) -> int:
    """How many paths a region is given."""
    return wp.min(paths.given, paths.count - region * paths.given)


@wp.func
def row_of(paths: PathQueue, region: int, number: int) -> int:
    """The row of a path of a region, by its number there."""
    own = given_to(paths, region)
    if number < own:
        return region * paths.given + number
    return paths.count + region * paths.room + number - own


@wp.func
def hand_over(waiting: PathQueue, source: int, paths: PathQueue, row: int):
    """Puts a path that waits in one queue into a row of another."""
    paths.cell[row] = waiting.cell[source]
    paths.mask[row] = waiting.mask[source]
    paths.resumes[row] = waiting.resumes[source]
    if waiting.resumes[source] == 1:
        paths.states[row] = waiting.states[source]
        if paths.vertices.shape[0] > 0:
            for k in range(VERTICES):
                paths.vertices[row * VERTICES + k] = waiting.vertices[source * VERTICES + k]


@wp.func
def add_branch(paths: PathQueue, row: int, parent: int, reported: int, state: Any):
    """Puts what branches from a row at the decision ``reported``, a bit, into another."""
    paths.cell[row] = paths.cell[parent]
    paths.mask[row] = paths.mask[parent] | reported
    paths.resumes[row] = 1
    paths.states[row] = state
    if paths.vertices.shape[0] > 0:
        for k in range(wp.min(state.count + 1, VERTICES)):
            paths.vertices[row * VERTICES + k] = paths.vertices[parent * VERTICES + k]


@dataclass(frozen=True, eq=False)
class PathRegions:
    """The regions of one launch.

    Attributes:
        count: How many there are.
        rows: Rows of all of them.
        queue: On the device.
    """

    count: int
    rows: int
    queue: PathQueue

    @classmethod
    def room_for(cls, paths: int, branching: bool, recording: bool, launcher: Launcher) -> PathRegions:
        """Regions for ``paths``; memory is taken up only as rows are written."""
        given = min(paths, GIVEN_ON_A_GPU if launcher.device.is_cuda else GIVEN)
        count = -(-paths // given)
        queue = PathQueue()
        queue.count, queue.given, queue.room = paths, given, given * (ROWS - 1) + SPARE if branching else 0
        rows = paths + count * queue.room
        for name in ("cell", "mask", "resumes"):
            setattr(queue, name, launcher.empty(rows, wp.int32))
        queue.states = launcher.empty(rows if branching else 0, PathState)
        queue.vertices = launcher.zeros(rows * MOST_VERTICES if recording else 0, wp.vec3)
        queue.done, queue.used = launcher.zeros(count, wp.int32), launcher.zeros(count, wp.int32)
        return cls(count, rows, queue)

    def traced(self) -> np.ndarray:
        """Rows that were traced, region by region, shape [n]."""
        return self._within(np.zeros(self.count, np.int32), self.queue.done.numpy())

    def left(self) -> np.ndarray:
        """Rows that wait for another launch, region by region, shape [n] int32."""
        return self._within(self.queue.done.numpy(), self.queue.used.numpy()).astype(np.int32)

    def _within(self, first: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Rows of the paths ``first`` … ``end`` − 1 of each region, by their numbers there."""
        counts = end - first
        region = np.repeat(np.arange(self.count), counts)
        number = np.arange(len(region)) - np.repeat(np.cumsum(counts) - counts - first, counts)
        paths, given, room = self.queue.count, self.queue.given, self.queue.room
        own = np.minimum(given, paths - region * given)
        return np.where(number < own, region * given + number, paths + region * room + number - own)


def as_they_lie(rows: np.ndarray) -> np.ndarray | slice:
    """The rows, as a slice where they follow each other, so that columns of them are no copies."""
    if len(rows) and rows[-1] - rows[0] == len(rows) - 1 and (np.diff(rows) == 1).all():
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


@dataclass(frozen=True, eq=False)
class WaitingPaths:
    """Paths that a launch is given.

    Attributes:
        sources: Their rows in ``queue``, shape [n] int32.
        queue: Where they wait.
    """

    sources: np.ndarray
    queue: PathQueue

    @classmethod
    def at_light(cls, cells: np.ndarray, launcher: Launcher) -> WaitingPaths:
        """Those of some cells that refract always, from which others branch."""
        queue, count = PathQueue(), len(cells)
        queue.cell = launcher.array(cells, wp.int32)
        queue.mask, queue.resumes = launcher.zeros(count, wp.int32), launcher.zeros(count, wp.int32)
        queue.states, queue.vertices = launcher.empty(0, PathState), launcher.empty(0, wp.vec3)
        queue.done, queue.used = launcher.empty(0, wp.int32), launcher.empty(0, wp.int32)
        return cls(np.arange(count, dtype=np.int32), queue)

    @classmethod
    def of(cls, regions: PathRegions) -> WaitingPaths:
        """Those that are left of some regions."""
        return cls(regions.left(), regions.queue)
