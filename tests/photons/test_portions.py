"""Portions of the light: every cell is in one of them, whatever lattices they are told apart on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.photons.emission import Patch
from tpdwarp.photons.lattices import Lattice
from tpdwarp.photons.portions import Marks, Portion
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import SceneLoader
from tpdwarp.settings import Settings
from usd_scenes.in_memory import wave_source
from usd_scenes.oracle import Wave


def lattice(origin: tuple[float, float], step: tuple[float, float]) -> Lattice:
    return Lattice("/sun", 0, None, np.inf, origin, step, (64, 64), 0)


def rectangles(grid: Lattice, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    low = np.array(grid.origin) + cells * np.array(grid.step)
    return low, low + grid.step


def patch(first: tuple[int, int], count: tuple[int, int]) -> Patch:
    out = Patch()
    (out.first_u, out.first_v), (out.count_u, out.count_v) = first, count
    return out


@pytest.mark.parametrize("step", [(0.31, 0.22), (0.05, 0.9), (1.7, 1.3)])
@pytest.mark.parametrize("beside", [0.0, 1.5])
def test_cells_of_another_lattice_are_marked_where_they_touch_marked_ones(step, beside):
    random = np.random.default_rng(3)
    mine, other = lattice((0.3, -2.0), (0.4, 0.25)), lattice((-1.03, 0.71), step)
    marks = Marks(mine, np.array([-4, 7]), random.random((9, 6)) < 0.15)
    found = marks.on(other, beside)
    u, v = np.meshgrid(np.arange(-150, 150), np.arange(-60, 60), indexing="ij")
    cells = np.stack([u.ravel(), v.ravel()], axis=1)
    low, high = rectangles(other, cells)
    low, high = low - beside * np.array(step), high + beside * np.array(step)
    there = np.argwhere(marks.marked) + marks.first
    begin, end = rectangles(mine, there)
    touch = np.all((low[:, None] < end) & (high[:, None] > begin), axis=2).any(axis=1)
    np.testing.assert_array_equal(found.holds(cells), touch)


def test_each_finer_cell_is_in_one_portion_and_patches_are_cut_to_theirs():
    marks = {2: Marks(lattice((0.0, 0.0), (1.0, 1.0)), np.array([-3, 5]), np.eye(4, 6, dtype=bool))}
    seen, others = Portion(marks, True, 0.5, (3, 2)), Portion(marks, False, 0.5)
    whole = (-30, 0), (60, 40)
    fine = Portion({}, False, 1.0).cells_of(2, patch(*whole)).cell
    number = np.full(len(fine), 2)
    coarse = fine // (3, 2)
    np.testing.assert_array_equal(seen.holds(number, fine), ~others.holds(number, coarse))
    assert not seen.holds(number - 1, fine).any() and others.holds(number - 1, fine).all()
    cut = patch(*whole)
    assert seen.cut(2, cut) and (cut.first_u, cut.count_u, cut.first_v, cut.count_v) == (-9, 12, 10, 12)
    assert len(seen.cells_of(2, cut)) == 6 * 4 == seen.holds(number, fine).sum()
    assert not seen.cut(1, patch(*whole)) and others.cut(1, patch(*whole))


def test_portions_have_all_of_the_flux_between_them():
    tracer = PhotonTracer(SceneLoader(wave_source(Wave()), Launcher()), Settings())
    loaded = tracer.load(Shutter(0, 0.0, 1.0))
    coarse = tracer.plan(400)
    (number, all_of_it), *_ = [(coarse.number_of(one), cells) for one, cells in coarse.patches(loaded.scene)]
    random = np.random.default_rng(4)
    grid = random.random((all_of_it.count_u, all_of_it.count_v)) < 0.3
    marks = {number: Marks(coarse.lattices[number], np.array([all_of_it.first_u, all_of_it.first_v]), grid)}
    fine = replace(coarse.finer(3, 2), portion=Portion(marks, True, 0.3, (3, 2)))
    rest = replace(coarse, portion=Portion(marks, False, 0.7))
    accounts = [tracer.trace(loaded, plan, Clock())[1] for plan in (coarse, fine, rest)]
    whole, *parts = accounts
    assert parts[0].counts["emitted"] == 6 * grid.sum() and parts[1].counts["emitted"] == (~grid).sum()
    assert sum(part.sent for part in parts) == pytest.approx(whole.sent, rel=1e-5)
    assert sum(part.deposited for part in parts) == pytest.approx(whole.deposited, rel=1e-3)
