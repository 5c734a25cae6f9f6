"""For how much of a part of the shutter light is there that begins or ends within it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.trajectories.test_fit import root_mean_square
from tpdwarp.trajectories.passing import _extents
from tpdwarp.trajectories.retraced import PARTS, distances, place_in_cell

SHAPE = (40, 48)
LENGTHS = np.array([0.5, *[1.0] * (PARTS - 1), 0.5]) / PARTS
MIDDLES = np.cumsum(LENGTHS) - 0.5 * LENGTHS


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("way", [8.0, 24.0])
def test_cells_that_an_edge_passes_are_lit_for_as_long_as_it_has_not_passed_them(angle, way):
    """A straight edge goes evenly by ``way`` cells within the shutter, and leaves behind it what is dark."""
    u, v = np.indices(SHAPE) - (np.array(SHAPE)[:, None, None] - 1) / 2
    along = np.cos(angle) * u + np.sin(angle) * v
    there = along[None] > way * (MIDDLES - 0.5)[:, None, None]
    known = np.abs(along) < 0.5 * way + 4
    extents = _extents(there & known, known, np.zeros(there.shape), LENGTHS, known & ~there)[0]
    lit = (LENGTHS[:, None, None] * there * extents).sum(axis=0)
    exact = np.clip(along / way + 0.5, 0, 1)
    # Where the grid cuts edges off, nothing is known of what is beside them.
    inside = np.pad(np.ones(np.subtract(SHAPE, 8), bool), 4) & (np.abs(along) < 0.4 * way)
    # Edges are known to a cell, and to octagons in place of circles: a twelfth of the way from one part to the next.
    worst = (0.5 + way / PARTS / 12) / way
    assert np.abs(lit - exact)[inside].max() < worst + 0.5 / way
    assert (lit - exact)[inside].mean() == pytest.approx(0.0, abs=0.1 * worst)
    if way / PARTS > 2:
        # Parts that stand for all of their time are wrong by up to half of one.
        steps = (LENGTHS[:, None, None] * there).sum(axis=0)
        assert np.std((lit - exact)[inside]) < 0.7 * np.std((steps - exact)[inside])


@pytest.mark.parametrize("angle", [0.1, 0.5, 1.2])
@pytest.mark.parametrize("way", [8.6, 23.4])
def test_steady_light_is_cut_off_when_the_edge_passes_the_middle_of_a_cell(angle, way):
    """The same edge, as photons at the places of cells that they have in each part see it."""
    u, v = np.indices(SHAPE) - (np.array(SHAPE)[:, None, None] - 1) / 2
    along = np.cos(angle) * u + np.sin(angle) * v
    cells = np.argwhere(np.ones(SHAPE, bool))
    places = np.stack([place_in_cell(cells, part) for part in range(PARTS + 1)]).reshape(PARTS + 1, *SHAPE, 2)
    seen = along + places @ [np.cos(angle), np.sin(angle)]
    there = seen > way * (MIDDLES - 0.5)[:, None, None]
    known = np.ones(SHAPE, bool)
    exact = np.clip(along / way + 0.5, 0, 1)
    # Edges are looked for among cells that change; beside those the last of the way is not as well known.
    inside = np.pad(np.ones(np.subtract(SHAPE, 12), bool), 6) & (np.abs(along) < 0.3 * way)
    steady, fading = there * 1.0, there * np.linspace(1.0, 2.0, PARTS + 1)[:, None, None] ** 3
    errors = []
    for power in (steady, fading):
        lit = (LENGTHS[:, None, None] * there * _extents(there, known, power, LENGTHS, known & ~there)[0]).sum(axis=0)
        errors.append(root_mean_square((lit - exact)[inside]))
    # Of cells around one some thirty count, of which seven lie at the edge: they tell it to an eighth of a cell.
    assert errors[0] < 0.25 / way
    # Of what fades nothing is told so.
    assert errors[0] < 0.6 * errors[1]


@pytest.mark.parametrize("angle", [0.0, 0.4])
@pytest.mark.parametrize("is_gap", [False, True])
@pytest.mark.parametrize(("width", "way"), [(8, 48), (11, 72)])
def test_what_is_hardly_wider_than_its_way_from_part_to_part_passes_on_both_sides(width, way, is_gap, angle):
    """Of a stick, or of a gap, one edge comes and another goes; what is nearest may belong to the other one."""
    shape = (120, 40)
    u, v = np.indices(shape) - (np.array(shape)[:, None, None] - 1) / 2
    along = np.cos(angle) * u + np.sin(angle) * v
    cells = np.argwhere(np.ones(shape, bool))
    places = np.stack([place_in_cell(cells, part) for part in range(PARTS + 1)]).reshape(PARTS + 1, *shape, 2)
    seen = along + places @ [np.cos(angle), np.sin(angle)] - way * (MIDDLES - 0.5)[:, None, None]
    there = (np.abs(seen) < 0.5 * width) == is_gap
    known = np.ones(shape, bool)
    extents, unknown = _extents(there, known, there * 1.0, LENGTHS, known & ~there)
    lit = (LENGTHS[:, None, None] * there * extents).sum(axis=0)
    inside = np.abs(along) < 0.5 * (way - width) - 2
    inside[:, :6] = inside[:, -6:] = False
    exact = width / way if is_gap else 1.0 - width / way
    assert lit[inside].mean() == pytest.approx(exact, abs=0.0015)
    assert root_mean_square(lit[inside] - exact) < 0.017
    assert unknown[:, :, inside].mean() < 1e-3


def test_what_is_there_all_the_time_is_lit_all_the_time_and_what_comes_at_once_from_half_way():
    there = np.zeros((PARTS + 1, *SHAPE), bool)
    there[:, :10] = True
    # Edges at rest are near, at which light is there all the time, or never.
    there[4:, 12:30] = True
    known = np.ones(SHAPE, bool)
    extents, unknown = _extents(there, known, np.zeros(there.shape), LENGTHS, known & ~there)
    assert (extents[:, :10] == 1.0).all()
    lit = (LENGTHS[:, None, None] * there * extents).sum(axis=0)
    # Nothing says when it came, but that it was between two parts.
    np.testing.assert_allclose(lit[12:30], 1.0 - 0.5 * (MIDDLES[3] + MIDDLES[4]))
    came = np.zeros_like(there)
    came[4, 12:30] = True
    np.testing.assert_array_equal(unknown, [came, np.zeros_like(came)])


def test_distances_lie_on_octagons():
    sources = np.zeros((61, 61), bool)
    sources[30, 30] = True
    u, v = np.indices(sources.shape) - 30
    exact = np.hypot(u, v)
    found = distances(sources, 20)
    near = exact < 18
    # An octagon with steps along four sides and eight by turns departs from a circle by 12 % at most, and by a step.
    assert (np.abs(found - exact) <= 0.12 * exact + 1)[near].all()
    assert (found[exact > 26] == 21).all()
