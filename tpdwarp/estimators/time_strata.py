"""Stratified time assignment: every photon has one random time of the shutter, and neighbours have different ones.

For distribution ray tracing in time (Cook 1984) and time dependent photon mapping (Cammarano & Jensen 2002).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene


def stratified_times(count: int, seed: int) -> np.ndarray:
    """A random instant in each of ``count`` equal parts of the shutter, as fractions of it, shape [count]."""
    return (np.arange(count) + np.random.default_rng(seed).random(count)) / count


def cells_at_time(number: int, count: int, seed: int) -> Callable[[Lattice, Patch], ChosenCells]:
    """Chooses the lattice cells whose photons are traced at time ``number`` of ``count``.

    The lattice is cut into square blocks of at least ``count`` cells; in each, the times are shuffled, so that the
    photons of any neighbourhood are spread evenly over the shutter. A cell keeps its time from frame to frame.
    """

    def chosen(lattice: Lattice, patch: Patch) -> ChosenCells:
        return ChosenCells.of_patch(patch, np.flatnonzero(_numbers(patch, count, seed) == number))

    return chosen


def _numbers(patch: Patch, count: int, seed: int) -> np.ndarray:
    """The time of each cell of ``patch``, by number, shape [count_u · count_v]."""
    side = math.ceil(math.sqrt(count))
    first = np.array([patch.first_u, patch.first_v]) // side * side
    blocks_u, blocks_v = (
        -(-(start + size - corner) // side)
        for start, size, corner in zip(
            (patch.first_u, patch.first_v), (patch.count_u, patch.count_v), first, strict=True
        )
    )
    u, v = first[0] + np.arange(blocks_u * side), first[1] + np.arange(blocks_v * side)
    keys = _hashed(u[None, :], v[:, None], seed).reshape(blocks_v, side, blocks_u, side).swapaxes(1, 2)
    ranks = keys.reshape(blocks_v, blocks_u, side * side).argsort(axis=2, kind="stable").argsort(axis=2, kind="stable")
    numbers = ranks.reshape(blocks_v, blocks_u, side, side).swapaxes(1, 2).reshape(len(v), len(u)) * count // side**2
    down, right = patch.first_v - first[1], patch.first_u - first[0]
    return numbers[down : down + patch.count_v, right : right + patch.count_u].ravel()


def _hashed(u: np.ndarray, v: np.ndarray, seed: int) -> np.ndarray:
    """A pseudo-random 64-bit number for each cell (the finaliser of SplitMix64)."""
    with np.errstate(over="ignore"):
        z = u.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) + v.astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
        z = z + np.uint64(seed) * np.uint64(0x165667B19E3779F9)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


def random_times(tracer: PhotonTracer, scenes: Sequence[LoadedScene]) -> Sequence[float]:
    """A random time in each part of the shutter, as fractions of it; its middle where nothing moves."""
    if not any(scene.moves for scene in scenes):
        return [0.5]
    return stratified_times(tracer.settings.accumulation_times, tracer.settings.seed)


def photons_at_stratified_times(
    tracer: PhotonTracer, shutter: Shutter, times: Sequence[float], clock: Clock
) -> tuple[list[PhotonMap], EnergyAccount, EmissionPlan]:
    """The photons of one lattice, each traced at one of several times of the shutter.

    A scene at a time of its own for every photon is out of reach with one BVH a scene, so the photons share ``times``.

    Args:
        times: Fractions of the shutter, one in each of as many equal parts of it.

    Returns:
        One map a time, standing for its part of the shutter, where the flux went, and the lattice.
    """
    settings, count = tracer.settings, len(times)
    plan = tracer.plan(settings.photons, clock)
    maps: list[PhotonMap] = []
    energy = EnergyAccount()
    for number, time in enumerate(times):
        instant = shutter.open + float(time) * shutter.exposure
        loaded = tracer.load(Shutter(shutter.frame, instant, instant), clock)
        chosen = cells_at_time(number, count, settings.seed)
        photons, account = tracer.trace(loaded, plan, clock, seed=settings.seed, chosen=chosen)
        maps.append(replace(photons, time=(number + 0.5) / count - 0.5, duration=1.0 / count))
        energy.add(account)
    return maps, energy, plan
