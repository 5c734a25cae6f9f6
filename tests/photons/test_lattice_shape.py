"""Laws of how a distant light's lattice is drawn out across the direction in which surfaces turn."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, turning_rod_source, wave_source
from tpdwarp.photons.lattice_shape import (
    LARGEST_ASPECT,
    OWN_AXES,
    LatticeShape,
    convex_hull,
    lattice_shape,
    rectangle_turn,
    turned,
)
from tpdwarp.photons.lattices import FEWEST_ROWS, plan_emission
from tpdwarp.scene.description import LightAtShutter, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.scene.normalization import Normalization
from usd_scenes.oracle import Wave

STILL = Shutter.still(0.5)


def swell(slope_u: float, slope_v: float) -> MeshAtShutter:
    """A square of water whose normals turn along x and along y by these amounts a unit."""
    flat = bumpy("/water", WATER, 1.0, False)
    points = flat.points.copy()
    points[:, 2] = 1.0
    normals = np.stack([-slope_u * points[:, 0], -slope_v * points[:, 1], np.ones(len(points))], axis=1)
    return replace(flat, points=points, normals=normals, normal_indices=flat.triangles)


def shape_of(*meshes: MeshAtShutter, light: LightAtShutter = SUN) -> LatticeShape:
    return lattice_shape([(light, SceneAtShutter(STILL, (floor(), *meshes), (light,)))])


def rolled(degrees: float) -> LightAtShutter:
    """The sun turned about its own axis, which changes nothing of its light."""
    return replace(SUN, axes=turned(SUN.axes, math.radians(degrees)))


def elongation_of(*meshes: MeshAtShutter, light: LightAtShutter = SUN) -> float:
    return shape_of(*meshes, light=light).aspect


@pytest.mark.parametrize("ratio", [1 / 64, 1 / 4, 1 / 2, 1, 2, 4, 64])
def test_cells_are_longer_across_by_how_much_more_normals_turn_along(ratio):
    expected = min(max(ratio, 1 / LARGEST_ASPECT), LARGEST_ASPECT)
    assert elongation_of(swell(0.3 * math.sqrt(ratio), 0.3 / math.sqrt(ratio))) == expected


def test_a_light_turned_by_a_quarter_sees_the_other_direction():
    quarter = replace(SUN, axes=np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) @ SUN.axes)
    assert elongation_of(swell(0.8, 0.2)) == 4
    assert elongation_of(swell(0.8, 0.2), light=quarter) == 1 / 4


def test_flat_water_and_water_that_turns_alike_have_square_cells():
    assert elongation_of(swell(0.0, 0.0)) == elongation_of(swell(1e-3, 0.0)) == elongation_of(swell(0.5, 0.5)) == 1


def test_what_is_no_sheet_has_square_cells():
    rod = turning_rod_source(5.0, looking_down()).at(STILL)
    assert lattice_shape([(rod.lights[0], rod)]).aspect == 1
    hole = replace(sheet := swell(0.8, 0.1), triangles=sheet.triangles[20:], normal_indices=sheet.normal_indices[20:])
    assert elongation_of(hole) == 1


@pytest.mark.parametrize(("photons", "rows"), [(64, 8), (256, 8), (1024, 8), (16384, 32)])
def test_some_rows_of_long_cells_are_kept(photons, rows):
    source = wave_source(Wave())
    scene = source.at(STILL)
    (lattice,) = plan_emission(source, photons, Normalization.of(scene)).lattices
    across, down = (count // 2 for count in lattice.wrap)
    assert (down, across * down) == (rows, photons) and rows >= FEWEST_ROWS


@pytest.mark.parametrize("degrees", [10, 20, 45, 80, 135, -30])
@pytest.mark.parametrize("water", [swell(0.8, 0.1), swell(0.3, 0.3), swell(0.0, 0.0)])
def test_a_light_s_roll_changes_nothing(water, degrees):
    straight, light = shape_of(water), rolled(degrees)
    shape = shape_of(water, light=light)
    # The same axes in the world, up to which of them is u.
    axis = turned(light.axes, shape.turn)[0]
    along = max(abs(axis[0]), abs(axis[1]))
    assert straight == OWN_AXES or straight.turn == 0
    assert along == pytest.approx(1, abs=1e-9) and shape.excess == pytest.approx(1, abs=1e-9)
    assert shape.aspect == (straight.aspect if abs(axis[0]) > 0.5 else 1 / straight.aspect)


@pytest.mark.parametrize("degrees", [15, 30, -40])
def test_cells_go_with_the_waves_however_the_water_is_cut(degrees):
    """Normals that turn along a direction of their own, on water that ends along x and y."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    flat = swell(0.0, 0.0)
    along = flat.points[:, :2] @ [c, s]
    water = replace(flat, normals=np.stack([-0.8 * c * along, -0.8 * s * along, np.ones(len(along))], axis=1))
    shape = shape_of(water)
    assert shape.turn == pytest.approx(math.radians(degrees), abs=1e-9) and shape.aspect == LARGEST_ASPECT
    # A square of side 1 fits into one of side |cos| + |sin|.
    assert shape.excess == pytest.approx((abs(c) + abs(s)) ** 2)


@pytest.mark.parametrize("count", [4, 100_000])
def test_the_least_rectangle_lies_along_what_is_long(count):
    inside = np.random.default_rng(1).uniform(-1, 1, (count, 2)) * (3, 1)
    corners = np.concatenate([inside, np.array([[-3, -1], [3, -1], [3, 1], [-3, 1]])])
    turn = math.radians(25)
    spun = corners @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    assert rectangle_turn(convex_hull(spun)) == pytest.approx(turn, abs=1e-9)
    assert rectangle_turn(convex_hull(corners)) == 0
