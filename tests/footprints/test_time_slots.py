"""Slots of the shutter: what queries find there of footprints is what they find of all of them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, photon_map, pixel, queries, shaped
from tpdwarp.footprints import time_slots
from tpdwarp.footprints.footprint_map import FootprintMap
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.light import FootprintLight
from tpdwarp.footprints.plain_gather import plain_gather
from tpdwarp.footprints.time_slots import MOST_SLOTS, slots_of
from tpdwarp.footprints.weights import GatherForm

CELL, WINDOW = 0.02, 0.25


def sweeping(seed: int = 3, count: int = 200) -> list:
    """Photons that sweep over many cells, some of them along curves, some in parts of the shutter alone."""
    rng = np.random.default_rng(seed)

    def some(**columns):
        at = np.append(rng.uniform(-0.2, 0.2, (count, 2)), np.zeros((count, 1)), axis=1)
        way = np.append(rng.uniform(-0.4, 0.4, (count, 2)), np.zeros((count, 1)), axis=1)
        steps = (CELL, 0.2 * CELL, 0), (-0.3 * CELL, 0.5 * CELL, 0)
        return photon_map(at, *steps, dxdt=way * columns.get("duration", 1.0), flux=CELL**2, **columns)

    bend = [(0.3, -0.2, 0), (0.2, 0.3, 0), (0, 0, 0), (0, 0, 0)]
    return [
        some(trajectory=bend),
        some(time=-0.25, duration=0.5, trajectory=[(0, 0, 0)] * 4),
        some(time=0.4375, duration=0.125, trajectory=[(0, 0, 0)] * 4),
    ]


@pytest.mark.parametrize("moves", [False, True])
def test_queries_find_in_slots_what_they_find_among_all_footprints(monkeypatch, moves):
    rng = np.random.default_rng(8)
    at = np.append(rng.uniform(-0.3, 0.3, (400, 2)), np.zeros((400, 1)), axis=1)
    motion = rng.uniform(-0.05, 0.05, 3) * (1, 1, 0) if moves else (0, 0, 0)
    points, number = queries(at, motion), rng.integers(0, 4, 400)
    middles = (number + 0.5) * WINDOW - 0.5
    lookup = Lookup(0.0, (0.0, WINDOW), moves, True, np.column_stack([middles + 0.03, middles]))
    cut, in_slots = [], time_slots.sweeps_in
    monkeypatch.setattr(
        "tpdwarp.footprints.footprint_map.sweeps_in", lambda *given: cut.append(given[3:5]) or in_slots(*given)
    )
    monkeypatch.setattr(time_slots, "LEAST_COVERED", 0.0)
    light = FootprintLight(sweeping(), GatherForm(), 1.0, pixel(), True, ONE_THREAD)
    found = light.irradiance(points, lookup)
    assert {slot for slot, count in cut if count == 4} == {0, 1, 2, 3}
    monkeypatch.setattr(time_slots, "LEAST_COVERED", np.inf)
    # Beside a rim rounding decides what counts.
    differing = np.abs(found.photons - light.irradiance(points, lookup).photons)
    assert differing.max() <= 1 and differing.mean() < 0.02
    footprints = shaped(*sweeping(), moves=True)
    for k in range(4):
        middle = (k + 0.5) * WINDOW - 0.5
        alone = Lookup(middle + 0.03, (middle, WINDOW), moves, True)
        plain = plain_gather(footprints, points, GatherForm(), ONE_THREAD, alone)
        here = number == k
        # Parabolas err by 1/500 of a footprint, of which some tens overlap.
        peak = plain.irradiance.max()
        np.testing.assert_allclose(found.irradiance[here], plain.irradiance[here], atol=2e-3 * peak)


def test_what_races_over_the_receiver_sees_as_much_of_its_way_in_slots(monkeypatch):
    rng = np.random.default_rng(8)
    at = np.append(rng.uniform(-0.2, 0.2, (400, 2)), np.zeros((400, 1)), axis=1)
    points, middles = queries(at, (0.62, 0.37, 0)), (rng.integers(0, 4, 400) + 0.5) * WINDOW - 0.5
    lookup = Lookup(0.0, (0.0, WINDOW), True, False, np.column_stack([middles, middles]))
    light = FootprintLight(sweeping(), GatherForm(), 1.0, pixel(), True, ONE_THREAD)
    counts, in_slot = [], FootprintMap.in_slot
    monkeypatch.setattr(FootprintMap, "in_slot", lambda *given: counts.append(given[2]) or in_slot(*given))
    found = []
    for least in (0.0, np.inf):
        monkeypatch.setattr(time_slots, "LEAST_COVERED", least)
        found.append(light.irradiance(points, lookup).irradiance)
    assert {1} < set(counts)
    # Parabolas err by 1/500 of a footprint, of which some tens overlap.
    np.testing.assert_allclose(*found, atol=2e-3 * found[1].max())


def test_windows_lie_in_one_slot_each_or_the_shutter_is_whole():
    def windows(*pairs: tuple[float, float]) -> np.ndarray:
        return np.array([(middle, middle, length) for middle, length in pairs])

    count, number = slots_of(windows((-0.375, 0.25), (0.125, 0.25), (0.4375, 0.125)), MOST_SLOTS)
    assert count == 4
    np.testing.assert_array_equal(number, [0, 2, 3])
    assert slots_of(windows((-0.375, 0.25)), 2)[0] == 2
    # One reaches over the middle; another is the whole shutter.
    assert slots_of(windows((-0.375, 0.25), (0.05, 0.2)), MOST_SLOTS)[0] == 1
    assert slots_of(windows((0.0, 1.0)), MOST_SLOTS)[0] == 1
    assert slots_of(windows((-1 / 3, 1 / 3), (0.0, 1 / 3)), MOST_SLOTS)[0] == 1


def test_a_slot_holds_those_that_shine_then_and_no_more_of_what_they_sweep_over():
    short = [photon_map(np.zeros((300, 3)), (CELL, 0, 0), (0, CELL, 0), (0.5, 0, 0))]
    short += [photon_map(np.zeros((90, 3)), (CELL, 0, 0), (0, CELL, 0), time=0.25, duration=0.5)]
    every = shaped(*short, moves=True)
    assert every.most_slots >= 4
    first, last = every.in_slot(0, 4), every.in_slot(3, 4)
    assert (first.count, last.count) == (300, 390)

    def reach(footprints: FootprintMap) -> tuple[float, float]:
        moving = footprints.pieces.rows.numpy()["footprint"] < 300
        return footprints.pieces.lower.numpy()[moving, 0].min(), footprints.pieces.upper.numpy()[moving, 0].max()

    own = reach(every)[1] - 0.25
    np.testing.assert_allclose(reach(first), (-0.25 - own, -0.125 + own), atol=1e-5)
    np.testing.assert_allclose(reach(last), (0.125 - own, 0.25 + own), atol=1e-5)
    # What neither moves nor goes out is in every slot as it is.
    still = photon_map(np.zeros((300, 3)), (CELL, 0, 0), (0, CELL, 0))
    assert shaped(still, moves=True).most_slots == 1
