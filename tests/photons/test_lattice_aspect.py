"""Laws of how a distant light's lattice is drawn out across the direction in which surfaces turn."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, turning_rod_source, wave_source
from tpdwarp.photons.lattice_aspect import LARGEST_ASPECT, lattice_aspect
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


def elongation_of(*meshes: MeshAtShutter, light: LightAtShutter = SUN) -> float:
    return lattice_aspect([(light, SceneAtShutter(STILL, (floor(), *meshes), (light,)))])


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
    assert lattice_aspect([(rod.lights[0], rod)]) == 1
    hole = replace(sheet := swell(0.8, 0.1), triangles=sheet.triangles[20:], normal_indices=sheet.normal_indices[20:])
    assert elongation_of(hole) == 1


@pytest.mark.parametrize(("photons", "rows"), [(64, 8), (256, 8), (1024, 8), (16384, 32)])
def test_some_rows_of_long_cells_are_kept(photons, rows):
    source = wave_source(Wave())
    scene = source.at(STILL)
    (lattice,) = plan_emission(source, photons, Normalization.of(scene)).lattices
    across, down = (count // 2 for count in lattice.wrap)
    assert (down, across * down) == (rows, photons) and rows >= FEWEST_ROWS
